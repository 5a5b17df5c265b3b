//! The prior: its settings, its draws, and the coordinates of the unit cube and of standard normals.

use super::{DRAWS, default_prior, rng};
use crate::ks;
use oblate::params::{
    PARAMETERS, PriorSettings, QPrior, REQUIRED, StreamParams, StreamPrior, index_of,
};
use oblate::{Error, Rejection};
use oblate_samplers::{Marginal, Prior, normal as gaussian};
use proptest::prelude::*;

const fn uniform(lo: f64, hi: f64) -> Marginal {
    Marginal::Uniform { lo, hi }
}

const fn normal(sd: f64) -> Marginal {
    Marginal::Normal { mean: 0.0, sd }
}

fn params() -> StreamParams<f64> {
    StreamParams::from([
        12.5, 15.0, 0.3, -0.8, 0.6, 8.0, 2.0, 60.0, 40.0, -30.0, 150.0, 20.0, 2.5,
    ])
}

#[test]
fn an_empty_file_is_the_default() {
    let settings: PriorSettings = serde_json::from_str("{}").unwrap();
    assert_eq!(settings, PriorSettings::default());
    assert_eq!(StreamPrior::new(&settings).unwrap().prior().dim(), REQUIRED);
}

/// From behind, a galaxy looks as from the front unless something is known of the sign of its axis or of the progenitor's velocity along the line of sight.
#[test]
fn a_prior_that_tells_the_near_side_needs_both() {
    let known = Marginal::Normal {
        mean: -100.0,
        sd: 10.0,
    };
    let even = uniform(-1.0, 1.0);
    let refused = |change: &dyn Fn(&mut PriorSettings)| {
        let mut settings = PriorSettings::default();
        change(&mut settings);
        let prior = StreamPrior::new(&settings).unwrap();
        prior.check_sides().err().map(|error| error.to_string())
    };
    type Change<'a> = &'a dyn Fn(&mut PriorSettings);
    let telling: [(&str, Change<'_>); 4] = [
        ("vz0_km_s", &|s| s.marginals.vz0_km_s = Some(known)),
        ("dir_x", &|s| s.fixed.dir_x = Some(0.3)),
        ("dir_y", &|s| s.marginals.dir_y = Some(uniform(0.0, 1.0))),
        ("dir_x", &|s| {
            s.marginals.dir_x = Some(Marginal::HalfNormal { sd: 1.0 })
        }),
    ];
    for (name, change) in telling {
        let words = refused(change).expect(name);
        assert!(
            words.contains("prior.marginals.z0_kpc") && words.contains(name),
            "{words}"
        );
        for both in [
            &(|s: &mut PriorSettings| s.marginals.z0_kpc = Some(normal(150.0))) as Change<'_>,
            &|s: &mut PriorSettings| s.fixed.z0_kpc = Some(20.0),
        ] {
            let with_both = refused(&|s| {
                change(s);
                both(s);
            });
            assert_eq!(with_both, None, "{name}");
        }
    }
    let silent: [Change<'_>; 6] = [
        &|_| (),
        // In the plane of the sky, or known by another component: an axis is the same as its opposite.
        &|s| (s.fixed.dir_x, s.fixed.dir_y, s.fixed.dir_z) = (Some(0.5), Some(0.0), Some(0.0)),
        &|s| {
            s.marginals.dir_x = Some(Marginal::HalfNormal { sd: 1.0 });
            s.marginals.dir_z = Some(normal(1.0));
        },
        &|s| s.fixed.vz0_km_s = Some(0.0),
        &|s| (s.fixed.dir_x, s.fixed.dir_y) = (Some(0.0), Some(0.0)),
        &|s| (s.marginals.dir_x, s.fixed.dir_z) = (Some(even), Some(0.7)),
    ];
    for change in silent {
        assert_eq!(refused(change), None);
    }
}

#[test]
fn settings_come_back_from_their_own_file() {
    let mut settings = PriorSettings::default();
    settings.fix("age_gyr", 2.0).unwrap();
    settings.marginals.x0_kpc = Some(normal(90.0));
    let text = serde_json::to_string(&settings).unwrap();
    assert_eq!(
        serde_json::from_str::<PriorSettings>(&text).unwrap(),
        settings
    );
}

#[test]
fn one_marginal_can_be_changed_without_naming_the_others() {
    let settings: PriorSettings = serde_json::from_str(
        r#"{"marginals": {"age_gyr": {"kind": "uniform", "lo": 2.0, "hi": 3.0}}}"#,
    )
    .unwrap();
    assert_eq!(settings.marginals.age_gyr, Some(uniform(2.0, 3.0)));
    assert_eq!(
        settings.marginals.x0_kpc,
        PriorSettings::default().marginals.x0_kpc
    );
}

#[test]
fn unknown_keys_are_errors_at_every_depth() {
    for text in [
        r#"{"q_minimum": 0.4}"#,
        r#"{"fixed": {"age": 2.0}}"#,
        r#"{"marginals": {"age": {"kind": "half_normal", "sd": 1.0}}}"#,
        r#"{"marginals": {"age_gyr": {"kind": "half_normal", "sd": 1.0, "mean": 0.0}}}"#,
    ] {
        let error = serde_json::from_str::<PriorSettings>(text).unwrap_err();
        assert!(error.to_string().contains("unknown field"), "{error}");
    }
}

#[test]
fn fixed_parameters_are_filled_in_and_left_out() {
    let mut settings = PriorSettings::default();
    settings.fix("r_s_halo_kpc", 15.0).unwrap();
    settings.fix("age_gyr", 2.5).unwrap();
    let prior = StreamPrior::new(&settings).unwrap();
    assert_eq!(prior.prior().dim(), 11);
    assert_eq!(prior.free_index("age_gyr"), None);
    assert_eq!(prior.free_index("dir_x"), Some(1));
    let all = params().to_array();
    let free: Vec<f64> = (0..13)
        .filter(|i| ![1, 12].contains(i))
        .map(|i| all[i])
        .collect();
    assert_eq!(prior.fill(&free), params());
    prior.check_inside(&params()).unwrap();
    let mut other = params();
    other.age_gyr = 2.0;
    let error = prior.check_inside(&other).unwrap_err();
    assert!(matches!(error, Error::Setting { ref key, .. } if key == "age_gyr"));
}

#[test]
fn impossible_settings_are_refused_with_their_key() {
    let with = |change: &dyn Fn(&mut PriorSettings)| {
        let mut settings = PriorSettings::default();
        change(&mut settings);
        match StreamPrior::new(&settings) {
            Err(Error::Setting { key, .. }) => key,
            Err(Error::OutOfRange(wrong)) => wrong.key,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(with(&|s| s.q_min = 0.0), "prior.q_min");
    assert_eq!(with(&|s| s.q_max = 0.5), "prior.q_max");
    assert_eq!(
        with(&|s| s.marginals.age_gyr = Some(uniform(4.0, 1.0))),
        "prior.marginals.age_gyr"
    );
    assert_eq!(
        with(&|s| s.marginals.r_s_prog_kpc = Some(Marginal::Normal { mean: 2.0, sd: 1.0 })),
        "prior.marginals.r_s_prog_kpc"
    );
    assert_eq!(
        with(&|s| s.fixed.age_gyr = Some(0.0)),
        "prior.fixed.age_gyr"
    );
    assert_eq!(
        with(&|s| s.fixed.vx0_km_s = Some(f64::NAN)),
        "prior.fixed.vx0_km_s"
    );
    // In the range of the parameter, but not in its prior.
    assert_eq!(
        with(&|s| s.fixed.age_gyr = Some(4.5)),
        "prior.fixed.age_gyr"
    );
    assert_eq!(
        with(&|s| s.fixed.vy0_km_s = Some(-100.0)),
        "prior.fixed.vy0_km_s"
    );
    let wide = PriorSettings {
        fixed: StreamParams {
            age_gyr: Some(4.5),
            ..StreamParams::default()
        },
        marginals: StreamParams {
            age_gyr: Some(uniform(1.0, 5.0)),
            ..PriorSettings::default().marginals
        },
        ..PriorSettings::default()
    };
    assert!(wide.check().is_ok());
    assert_eq!(with(&|s| s.fixed = params().map(Some)), "prior.fixed");
    let mut settings = PriorSettings::default();
    let error = settings.fix("age", 2.0).unwrap_err().to_string();
    assert!(error.contains("age_gyr"), "{error}");
}

#[test]
fn points_outside_the_prior_are_refused_by_name() {
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    prior.check_inside(&params()).unwrap();
    for (name, value) in [
        ("log10_m_halo", 14.1),
        ("dir_z", -1e-9),
        ("vx0_km_s", f64::INFINITY),
        ("vy0_km_s", -1.0),
        ("age_gyr", f64::NAN),
    ] {
        let mut wrong = params();
        *wrong.get_mut(index_of(name).unwrap()).unwrap() = value;
        let error = prior.check_inside(&wrong).unwrap_err();
        assert!(
            matches!(error, Error::OutsidePrior { name: ref n, .. } if n == name),
            "{error}"
        );
        let cause = if value.is_finite() {
            Rejection::OutsidePrior
        } else {
            Rejection::BadParameter
        };
        assert_eq!(prior.check_point(&wrong), Err(cause), "{name}");
    }
    let mut bound = params();
    (bound.log10_m_halo, bound.dir_z) = (14.0, 0.0);
    assert_eq!(prior.check_point(&bound), Ok(()));
}

#[test]
fn fixed_parameters_may_be_left_out_and_free_ones_may_not() {
    let mut settings = PriorSettings::default();
    settings.fix("age_gyr", 2.5).unwrap();
    let prior = StreamPrior::new(&settings).unwrap();
    let mut given = params().map(Some);
    assert_eq!(prior.complete(&given).unwrap(), params());
    given.age_gyr = None;
    let all = prior.complete(&given).unwrap();
    assert_eq!(all, params());
    assert_eq!(prior.fill(&prior.free_values(&all.to_array())), all);
    given.age_gyr = Some(2.0);
    let error = prior.complete(&given).unwrap_err();
    assert!(matches!(error, Error::Setting { ref key, .. } if key == "age_gyr"));
    given.age_gyr = None;
    given.dir_x = None;
    let error = prior.complete(&given).unwrap_err();
    assert!(
        matches!(error, Error::Setting { ref key, ref value, .. } if key == "dir_x" && value == "missing")
    );
}

/// The default prior with two of the optional parameters.
fn with_optional() -> StreamPrior {
    let mut settings = PriorSettings::default();
    settings.marginals.jitter = Some(Marginal::HalfNormal { sd: 0.05 });
    settings.fix("distance_factor", 1.1).unwrap();
    StreamPrior::new(&settings).unwrap()
}

#[test]
fn optional_parameters_are_absent_free_or_fixed() {
    let absent = StreamPrior::new(&PriorSettings::default()).unwrap();
    assert_eq!(absent.present(), (0..REQUIRED).collect::<Vec<_>>());
    assert!(absent.free_optional().is_empty());
    assert_eq!(absent.free_index("jitter"), None);
    let prior = with_optional();
    let [jitter, factor] = ["jitter", "distance_factor"].map(|name| index_of(name).unwrap());
    assert_eq!(prior.prior().dim(), REQUIRED + 1);
    assert_eq!(prior.free_optional(), [jitter]);
    assert_eq!(prior.free_index("jitter"), Some(REQUIRED));
    assert_eq!(prior.present().last(), Some(&factor));
    assert_eq!(prior.present().len(), REQUIRED + 2);
    let mut theta = params().to_array()[..REQUIRED].to_vec();
    theta.push(0.02);
    let all = prior.fill(&theta);
    let numbers = [all.jitter, all.distance_factor, all.phi0_deg];
    assert_eq!(
        numbers.map(f64::to_bits),
        [0.02, 1.1, 0.0].map(f64::to_bits)
    );
    assert_eq!(prior.free_values(&all.to_array()), theta);
    prior.check_inside(&all).unwrap();
    // Lines of a file: fixed and absent ones may be left out.
    let mut given = all.map(Some);
    (given.distance_factor, given.phi0_deg) = (None, None);
    assert_eq!(prior.complete(&given).unwrap(), all);
    given.phi0_deg = Some(3.0);
    let error = prior.complete(&given).unwrap_err().to_string();
    assert!(error.contains("prior.marginals.phi0_deg"), "{error}");
    let mut turned = all;
    turned.phi0_deg = 3.0;
    assert!(prior.check_inside(&turned).is_err());
    given.phi0_deg = None;
    given.jitter = None;
    let error = prior.complete(&given).unwrap_err().to_string();
    assert!(error.contains("jitter = missing"), "{error}");
}

#[test]
fn settings_with_optional_parameters_come_back_and_name_no_others() {
    let settings = *with_optional().settings();
    let text = serde_json::to_string(&settings).unwrap();
    assert!(text.contains("jitter") && !text.contains("phi0_deg"));
    assert_eq!(
        serde_json::from_str::<PriorSettings>(&text).unwrap(),
        settings
    );
    let text = serde_json::to_string(&PriorSettings::default()).unwrap();
    for parameter in &PARAMETERS[REQUIRED..] {
        assert!(!text.contains(parameter.name));
    }
}

#[test]
fn a_parameter_of_every_stream_needs_a_distribution_and_a_jitter_is_not_negative() {
    let key = |change: &dyn Fn(&mut PriorSettings)| {
        let mut settings = PriorSettings::default();
        change(&mut settings);
        settings.check().unwrap_err().to_string()
    };
    let error = key(&|s| s.marginals.age_gyr = None);
    assert!(error.contains("prior.marginals.age_gyr = none"), "{error}");
    let error = key(&|s| s.marginals.jitter = Some(normal(0.1)));
    assert!(
        error.contains("prior.marginals.jitter") && error.contains("half_normal"),
        "{error}"
    );
    let error = key(&|s| s.marginals.jitter = Some(uniform(-0.1, 0.1)));
    assert!(error.contains("prior.marginals.jitter.lo"), "{error}");
    let error = key(&|s| s.fixed.jitter = Some(-0.1));
    assert!(error.contains("prior.fixed.jitter"), "{error}");
}

#[test]
fn the_prior_of_q_is_known_only_while_the_shape_vector_is_free_and_standard() {
    let q_prior = |settings: &PriorSettings| StreamPrior::new(settings).unwrap().q_prior();
    let mut settings = PriorSettings {
        q_max: 1.2,
        ..PriorSettings::default()
    };
    assert_eq!(q_prior(&settings), QPrior::Uniform { lo: 0.5, hi: 1.2 });
    settings.marginals.dir_z = Some(normal(1.0));
    assert_eq!(q_prior(&settings), QPrior::Uniform { lo: 0.5, hi: 1.2 });
    settings.marginals.dir_y = Some(normal(2.0));
    assert_eq!(q_prior(&settings), QPrior::Unknown);
    settings.fix("dir_y", 0.0).unwrap();
    assert_eq!(q_prior(&settings), QPrior::Unknown);
}

#[test]
fn q_is_uniform_and_the_axis_isotropic_over_the_hemisphere() {
    let prior = default_prior();
    let mut rng = rng(1);
    let (mut q, mut cosine, mut azimuth, mut both) = (vec![], vec![], vec![], vec![]);
    for _ in 0..DRAWS {
        let shape = prior.shape(&prior.draw(&mut rng));
        let turn = shape.axis.y.atan2(shape.axis.x) / std::f64::consts::TAU + 0.5;
        q.push(shape.q - 0.5);
        cosine.push(shape.axis.z);
        azimuth.push(turn);
        // Independence of q and the axis: the sum of two uniforms, modulo 1, is uniform too.
        both.push((shape.q - 0.5 + shape.axis.z).fract());
    }
    for (name, sample) in [
        ("q", q),
        ("cosine", cosine),
        ("azimuth", azimuth),
        ("sum", both),
    ] {
        let d = ks::distance_from_uniform(sample);
        assert!(d < ks::LIMIT, "{name}: {d}");
    }
}

#[test]
fn draws_follow_the_marginals_and_lie_inside() {
    let prior = default_prior();
    let mut rng = rng(2);
    let draws: Vec<_> = (0..DRAWS).map(|_| prior.draw(&mut rng)).collect();
    for draw in &draws {
        prior.check_inside(draw).unwrap();
    }
    for (i, parameter) in PARAMETERS[..REQUIRED].iter().enumerate() {
        let marginal = prior.prior().marginals()[i];
        let u = draws
            .iter()
            .map(|d| marginal.u_from_theta(d.to_array()[i]))
            .collect();
        let d = ks::distance_from_uniform(u);
        assert!(d < ks::LIMIT, "{}: {d}", parameter.name);
    }
}

/// The coordinates in which samplers move.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Coordinates {
    Cube,
    Normals,
}

impl Coordinates {
    fn theta_from_x(self, prior: &Prior, x: &[f64]) -> Vec<f64> {
        let mut theta = vec![0.0; x.len()];
        match self {
            Self::Cube => prior.theta_from_u(x, &mut theta),
            Self::Normals => prior.theta_from_z(x, &mut theta),
        }
        theta
    }

    fn x_from_theta(self, prior: &Prior, theta: &[f64]) -> Vec<f64> {
        let pairs = prior.marginals().iter().zip(theta);
        match self {
            Self::Cube => pairs.map(|(m, t)| m.u_from_theta(*t)).collect(),
            Self::Normals => {
                let mut z = vec![0.0; theta.len()];
                prior.z_from_theta(theta, &mut z);
                z
            }
        }
    }

    /// `d theta_i / d x_i`: the density of x over that of theta.
    fn dtheta_dx(self, prior: &Prior, theta: &[f64]) -> Vec<f64> {
        let pairs = prior.marginals().iter().zip(theta);
        let ln_pdf_x = |m: &Marginal, t: f64| match self {
            Self::Cube => 0.0,
            Self::Normals => gaussian::ln_pdf(m.z_from_theta(t)),
        };
        pairs
            .map(|(m, t)| (ln_pdf_x(m, *t) - m.ln_pdf(*t)).exp())
            .collect()
    }
}

proptest! {
    #[test]
    fn coordinates_invert_exactly_and_jacobians_match_central_differences(
        z in proptest::collection::vec(-4.0_f64..4.0, 13)
    ) {
        let stream = default_prior();
        let prior = stream.prior();
        let theta = Coordinates::Normals.theta_from_x(prior, &z);
        for system in [Coordinates::Cube, Coordinates::Normals] {
            let x = system.x_from_theta(prior, &theta);
            let back = system.theta_from_x(prior, &x);
            let slope = system.dtheta_dx(prior, &theta);
            for i in 0..13 {
                // Half a unit in the last place of x, through the slope, and two of theta itself.
                let grain = 1.2e-16 * x[i].abs() * slope[i] + 1e-15 * theta[i].abs().max(1.0);
                prop_assert!((back[i] - theta[i]).abs() < 10.0 * grain, "{:?} {}", system, i);
                // A step small against the distance to the cube's walls.
                let room = if system == Coordinates::Cube { x[i].min(1.0 - x[i]) } else { 1.0 };
                let h = 1e-4 * room;
                let at = |dx: f64| {
                    let mut moved = x.clone();
                    moved[i] += dx;
                    system.theta_from_x(prior, &moved)[i]
                };
                let central = (at(h) - at(-h)) / (2.0 * h);
                // Truncation of second order in the relative step; rounding of theta over the step.
                let tolerance = 1e-6 * slope[i] + 10.0 * grain / h;
                prop_assert!((central - slope[i]).abs() < tolerance, "{:?} {}: {} {}", system, i, central, slope[i]);
            }
        }
    }
}
