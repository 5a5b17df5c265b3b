//! Disc and bulge of the host: golden values, exact derivatives, and streams, likelihoods and priors with them.

use crate::golden::{cases, json, number, numbers, relative_difference};
use crate::haloes::{THETA, hessian, likelihood_is_that_of, near, small};
use oblate::Error;
use oblate::inference::{FitSettings, StreamTarget};
use oblate::likelihood::StreamLikelihood;
use oblate::params::{DIM, PriorSettings, QRange, StreamParams, StreamPrior, index_of};
use oblate::potential::{
    Baryons, BaryonsCotangent, Disc, DiscProfile, DiscShape, Galaxy, HaloKind, Hernquist, Potential,
};
use oblate::scalar::{Dual, Real, Vec3, gradient_of, lift};
use oblate::stream::{BaryonSettings, BulgeProfile, DiscPlane, DiscSettings, Model, ModelSettings};
use oblate_samplers::{Marginal, Symmetry, Target};
use serde_json::Value;

/// Of the golden values: the three masses of an exponential disc nearly cancel.
const TOLERANCE: f64 = 1e-10;

fn meets_its_golden_values(potential: &impl Potential<f64>, case: &Value) {
    let id = &case["id"];
    let x = Vec3::from(numbers::<3>(&case["x_kpc"]));
    let phi = potential.value(x) / number(&case["phi"]);
    assert!((phi - 1.0).abs() < TOLERANCE, "{id}: phi {phi}");
    let acceleration = potential.acceleration(x).to_array();
    let difference = relative_difference(&acceleration, &numbers::<3>(&case["acc"]));
    assert!(difference < TOLERANCE, "{id}: acc {difference:e}");
    let golden: Vec<f64> = (0..3)
        .flat_map(|i| numbers::<3>(&case["hess"][i]))
        .collect();
    let difference = relative_difference(&hessian(potential, x), &golden);
    assert!(difference < TOLERANCE, "{id}: hess {difference:e}");
}

/// The disc of a golden case.
pub fn disc_of(case: &Value) -> Disc<f64> {
    let shape = DiscShape::new(DiscProfile::Exponential, number(&case["thickness"]));
    let normal = Vec3::from(numbers::<3>(&case["normal"]));
    Disc::new(
        number(&case["mass_msun"]),
        number(&case["r_s_kpc"]),
        normal,
        shape,
    )
}

/// The bulge of a golden case.
pub fn bulge_of(case: &Value) -> Hernquist<f64> {
    Hernquist {
        mass: number(&case["mass_msun"]),
        r_s: number(&case["r_s_kpc"]),
    }
}

#[test]
fn discs_and_bulges_meet_their_golden_values() {
    let file = json("baryons.json");
    let mut seen = [0, 0];
    for case in cases(&file) {
        if case["kind"] == "exponential" {
            seen[0] += 1;
            meets_its_golden_values(&disc_of(case), case);
        } else {
            seen[1] += 1;
            meets_its_golden_values(&bulge_of(case), case);
        }
    }
    assert_eq!(seen, [24, 16]);
}

/// On dual numbers the acceleration is minus the gradient of the potential, and the reverse mode is the transpose of its derivative.
fn derivatives_are_exact(baryons: &Baryons<f64>, x: [f64; 3]) {
    let lambda = Vec3::new(0.3, -1.1, 0.7);
    let n = baryons.disc.normal;
    let values = [0.0, 0.0, n.x, n.y, n.z, 0.0, 0.0, x[0], x[1], x[2]];
    let v: [Dual<10>; 10] = lift(&values);
    let dual = Baryons {
        disc: baryons.disc.with_numbers(
            v[0].exp() * baryons.disc.mass,
            v[1].exp() * baryons.disc.r_s,
            Vec3::new(v[2], v[3], v[4]),
        ),
        bulge: Hernquist {
            mass: v[5].exp() * baryons.bulge.mass,
            r_s: v[6].exp() * baryons.bulge.r_s,
        },
    };
    let at = Vec3::new(v[7], v[8], v[9]);
    let acceleration = baryons.acceleration(Vec3::from(x)).to_array();
    let slope = gradient_of(&dual.value(at));
    let minus = acceleration.map(|a| -a);
    assert!(relative_difference(&minus, &slope[7..]) < 1e-9);

    let mut cotangent = BaryonsCotangent::zero();
    let (value, x_bar) = baryons.vjp(Vec3::from(x), lambda, &mut cotangent);
    assert!(relative_difference(&value.to_array(), &acceleration) < 1e-12);
    let by_duals = gradient_of(&dual.acceleration(at).dot(Vec3::from_f64(lambda)));
    let BaryonsCotangent { disc, bulge } = cotangent;
    let ours = [
        disc.ln_mass,
        disc.ln_r_s,
        disc.normal.x,
        disc.normal.y,
        disc.normal.z,
        bulge.ln_mass,
        bulge.ln_r_s,
    ];
    let difference = relative_difference(&ours, &by_duals[..7]);
    assert!(difference < 1e-9, "{ours:?} {by_duals:?}");
    assert!(relative_difference(&x_bar.to_array(), &by_duals[7..]) < 1e-9);
}

#[test]
fn derivatives_of_discs_and_bulges_are_exact() {
    let file = json("baryons.json");
    let (discs, bulges): (Vec<&Value>, Vec<&Value>) =
        (cases(&file).iter()).partition(|case| case["kind"] == "exponential");
    for (case, with_bulge) in discs.iter().zip(bulges.iter().cycle()) {
        let x = numbers::<3>(&case["x_kpc"]);
        let (disc, bulge) = (disc_of(case), bulge_of(with_bulge));
        let shape = DiscShape::new(DiscProfile::MiyamotoNagai, number(&case["thickness"]));
        let simple = Disc::new(disc.mass, disc.r_s, disc.normal, shape);
        for disc in [disc, simple] {
            for bulge in [Hernquist::none(), bulge] {
                derivatives_are_exact(&Baryons { disc, bulge }, x);
            }
        }
        let disc = Disc::none();
        derivatives_are_exact(&Baryons { disc, bulge }, x);
    }
}

/// How far the three discs are from an exponential one: what docs/physics.md, section 2, says.
#[test]
fn three_discs_approximate_an_exponential_one() {
    let file = json("baryons.json");
    for case in cases(&file).iter().filter(|c| c["kind"] == "exponential") {
        let x = Vec3::from(numbers::<3>(&case["x_kpc"]));
        let ours = disc_of(case).acceleration(x);
        let exact = Vec3::from(numbers::<3>(&case["acc_exponential"]));
        let off = ((ours - exact).norm2() / exact.norm2()).sqrt();
        assert!(off < 0.121, "{}: {off}", case["id"]);
    }
}

const DISC: DiscSettings = DiscSettings {
    profile: DiscProfile::Exponential,
    thickness: 0.1,
    plane: DiscPlane::Angles,
};

const BOTH: BaryonSettings = BaryonSettings {
    disc: Some(DISC),
    bulge: Some(BulgeProfile::Hernquist),
};

/// The parameters of [`THETA`], in a galaxy with a heavy disc and a bulge.
fn theta() -> [f64; DIM] {
    let mut params = StreamParams::from_array(THETA);
    params.log10_m_disc = 10.8;
    params.r_disc_kpc = 4.0;
    params.inclination_disc_deg = 60.0;
    params.phi_disc_deg = 25.0;
    params.log10_m_bulge = 10.3;
    params.r_bulge_kpc = 0.8;
    params.phi0_deg = 5.0;
    params.to_array()
}

fn with(halo: HaloKind, baryons: BaryonSettings) -> ModelSettings {
    ModelSettings {
        baryons,
        ..small(halo)
    }
}

#[test]
fn likelihoods_with_disc_and_bulge_have_exact_gradients() {
    likelihood_is_that_of::<Galaxy>(&with(HaloKind::Nfw, BOTH), &theta());
    likelihood_is_that_of::<Galaxy>(&with(HaloKind::NfwDensity, BOTH), &theta());
    // In a logarithmic halo of this mass the stream turns so often that rounding grows.
    let mut light = StreamParams::from_array(theta());
    light.log10_m_halo = 11.2;
    let logarithmic = with(HaloKind::Logarithmic, BOTH);
    likelihood_is_that_of::<Galaxy>(&logarithmic, &light.to_array());
    // In the plane of the halo, and each alone.
    let disc = DiscSettings {
        profile: DiscProfile::MiyamotoNagai,
        plane: DiscPlane::Halo,
        ..DISC
    };
    let disc = BaryonSettings {
        disc: Some(disc),
        bulge: None,
    };
    likelihood_is_that_of::<Galaxy>(&with(HaloKind::Nfw, disc), &theta());
    let bulge = BaryonSettings { disc: None, ..BOTH };
    likelihood_is_that_of::<Galaxy>(&with(HaloKind::Nfw, bulge), &theta());
}

#[test]
fn a_light_disc_changes_a_stream_little_and_a_heavy_one_much() {
    let radii = |model: &ModelSettings, log10_m_disc: f64| {
        let mut params = StreamParams::from_array(theta());
        params.log10_m_disc = log10_m_disc;
        params.log10_m_bulge = log10_m_disc;
        params.phi0_deg = 0.0;
        let stream = Model::new(model).unwrap().stream(&params).unwrap();
        let track = stream.track(10.0).unwrap();
        track.bins.iter().map(|b| b.r_kpc).collect::<Vec<f64>>()
    };
    let without = radii(&small(HaloKind::Nfw), 2.0);
    let light = radii(&with(HaloKind::Nfw, BOTH), 2.0);
    assert_eq!(without.len(), light.len());
    assert!(relative_difference(&light, &without) < 1e-6);
    let heavy = radii(&with(HaloKind::Nfw, BOTH), 11.0);
    assert!(heavy.len() != without.len() || relative_difference(&heavy, &without) > 0.05);
}

#[test]
fn a_disc_lies_as_its_angles_say() {
    let normal = |inclination: f64, phi: f64, phi0: f64| {
        let mut params = StreamParams::from_array(theta());
        params.inclination_disc_deg = inclination;
        params.phi_disc_deg = phi;
        params.phi0_deg = phi0;
        let axis = Vec3::new(0.0, 0.6, 0.8);
        BOTH.at(&params, axis).disc.normal.to_array()
    };
    let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15);
    // Face-on, its normal is the line of sight. Edge-on with its major axis along x, the normal is along y.
    assert!(close(normal(0.0, 40.0, 0.0), [0.0, 0.0, 1.0]));
    assert!(close(normal(90.0, 0.0, 0.0), [0.0, 1.0, 0.0]));
    // The major axis is in the disc, phi0 turns the data's zero to the progenitor.
    let [x, y, z] = normal(50.0, 70.0, 30.0);
    let (sin, cos) = 40.0_f64.to_radians().sin_cos();
    assert!((x * cos + y * sin).abs() < 1e-15 && z > 0.0);
    // At positive inclinations the side at phi + 90 degrees is the far one: there the plane has negative z.
    let at = -(x * -sin + y * cos) / z;
    assert!(at < 0.0);
    // The mirrored sky has the angles of opposite signs.
    let [mx, my, mz] = normal(-50.0, -70.0, -30.0);
    assert!(close([mx, -my, mz], [x, y, z]));
    // In the plane of the halo.
    let plane = BaryonSettings {
        disc: Some(DiscSettings {
            plane: DiscPlane::Halo,
            ..DISC
        }),
        bulge: None,
    };
    let axis = Vec3::new(0.0, 0.6, 0.8);
    let params = StreamParams::from_array(theta());
    assert_eq!(plane.at(&params, axis).disc.normal, axis);
}

/// A prior with the parameters of disc and bulge, of which the masses are free.
fn prior() -> PriorSettings {
    let mut settings = PriorSettings::default();
    let mass = Marginal::Uniform { lo: 9.0, hi: 12.0 };
    settings.marginals.log10_m_disc = Some(mass);
    settings.marginals.log10_m_bulge = Some(mass);
    settings.marginals.z0_kpc = Some(Marginal::Normal {
        mean: 0.0,
        sd: 150.0,
    });
    settings.fixed.r_disc_kpc = Some(4.0);
    settings.fixed.inclination_disc_deg = Some(60.0);
    settings.fixed.phi_disc_deg = Some(25.0);
    settings.fixed.r_bulge_kpc = Some(0.8);
    settings
}

fn refusal(settings: &PriorSettings, baryons: BaryonSettings) -> Option<String> {
    let prior = StreamPrior::new(settings).unwrap();
    match baryons.check_prior(&prior) {
        Ok(()) => None,
        Err(Error::Setting { key, remedy, .. }) => Some(format!("{key}: {remedy}")),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn a_prior_has_the_parameters_of_the_parts_and_no_others() {
    assert_eq!(refusal(&prior(), BOTH), None);
    assert_eq!(
        refusal(&PriorSettings::default(), BaryonSettings::default()),
        None
    );
    let named = |settings: &PriorSettings, baryons, word: &str| {
        let refusal = refusal(settings, baryons).expect("a refusal");
        assert!(refusal.contains(word), "{refusal}");
    };
    named(&prior(), BaryonSettings::default(), "log10_m_disc");
    named(
        &prior(),
        BaryonSettings {
            bulge: None,
            ..BOTH
        },
        "log10_m_bulge",
    );
    let mut lacking = prior();
    lacking.fixed.r_disc_kpc = None;
    named(&lacking, BOTH, "prior.fixed.r_disc_kpc");
    // In the plane of the halo it has no angles.
    let in_plane = BaryonSettings {
        disc: Some(DiscSettings {
            plane: DiscPlane::Halo,
            ..DISC
        }),
        ..BOTH
    };
    named(&prior(), in_plane, "inclination_disc_deg");
    // An inclined disc has a near side, an edge-on or a face-on one has none.
    let mut near = prior();
    near.marginals.z0_kpc = PriorSettings::default().marginals.z0_kpc;
    named(&near, BOTH, "prior.marginals.z0_kpc");
    for inclination in [0.0, 90.0] {
        near.fixed.inclination_disc_deg = Some(inclination);
        assert_eq!(refusal(&near, BOTH), None);
    }
}

/// A target of data near a stream with disc and bulge.
fn target(settings: &PriorSettings) -> StreamTarget {
    let model_settings = with(HaloKind::Nfw, BOTH);
    let model = Model::new(&model_settings).unwrap();
    let stream = model.stream(&StreamParams::from_array(theta())).unwrap();
    let track = near(&stream.track(10.0).unwrap(), &model_settings);
    let likelihood = StreamLikelihood::new(model, track, QRange::default());
    StreamTarget::new(likelihood, StreamPrior::new(settings).unwrap())
}

#[test]
fn masses_velocities_and_age_scale_together_if_all_masses_are_free() {
    let target = target(&prior());
    let orbit = |target: &StreamTarget| {
        let mut symmetries = target.symmetries().iter();
        symmetries.any(|symmetry| matches!(symmetry, Symmetry::Orbit(_)))
    };
    assert!(orbit(&target));
    let mut fixed = prior();
    fixed.fixed.log10_m_bulge = Some(10.3);
    assert!(!orbit(&self::target(&fixed)));

    let mut scaled = StreamParams::from_array(theta());
    scaled.phi0_deg = 0.0;
    let likelihood = target.likelihood();
    let before = likelihood.ln_likelihood(&scaled.to_array()).unwrap();
    let s = 1.7_f64;
    for mass in [
        &mut scaled.log10_m_halo,
        &mut scaled.log10_m_prog,
        &mut scaled.log10_m_disc,
        &mut scaled.log10_m_bulge,
    ] {
        *mass += s.log10();
    }
    for velocity in [
        &mut scaled.vx0_km_s,
        &mut scaled.vy0_km_s,
        &mut scaled.vz0_km_s,
    ] {
        *velocity *= s.sqrt();
    }
    scaled.age_gyr /= s.sqrt();
    let after = likelihood.ln_likelihood(&scaled.to_array()).unwrap();
    let (before, after) = (before.ln_likelihood, after.ln_likelihood);
    assert!(
        (before - after).abs() < 1e-6 * before.abs(),
        "{before} {after}"
    );
}

/// The features of a surrogate, and their reverse mode by differences.
#[test]
fn features_with_a_disc_have_exact_derivatives() {
    let target = target(&prior());
    let free = target.stream_prior().free_values(&theta());
    let z: Vec<f64> = (free.iter().zip(target.prior().marginals()))
        .map(|(value, marginal)| marginal.z_from_theta(*value))
        .collect();
    let features = |z: &[f64]| {
        let mut theta = vec![0.0; z.len()];
        target.prior().theta_from_z(z, &mut theta);
        let mut all = vec![0.0; target.feature_count()];
        target.features(z, &theta, &mut all);
        (theta, all)
    };
    let (theta, all) = features(&z);
    let bar: Vec<f64> = (0..all.len()).map(|i| 0.3 + (i as f64).sin()).collect();
    let mut z_bar = vec![0.0; z.len()];
    target.features_vjp(&z, &theta, &bar, &mut z_bar);
    for i in 0..z.len() {
        let moved = |by: f64| {
            let mut z = z.clone();
            z[i] += by;
            let (_, all) = features(&z);
            all.iter().zip(&bar).map(|(f, b)| f * b).sum::<f64>()
        };
        let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let scale = slope.abs().max(1.0);
        assert!(
            (slope - z_bar[i]).abs() < 1e-6 * scale,
            "{i}: {slope} {}",
            z_bar[i]
        );
    }
    assert!(index_of("log10_m_disc").is_some_and(|i| target.stream_prior().free().contains(&i)));
}

#[test]
fn settings_name_the_parts() {
    let text =
        "[baryons]\nbulge = \"hernquist\"\ndisc = { profile = \"exponential\", thickness = 0.1 }";
    let settings: ModelSettings = toml::from_str(text).unwrap();
    assert_eq!(settings.baryons, BOTH);
    assert_eq!(settings.host_in_words(), "nfw with a disc and a bulge");
    settings.check().unwrap();
    let default = toml::to_string(&FitSettings::default()).unwrap();
    assert!(!default.contains("baryons"), "{default}");
    let mut thick = settings;
    thick.baryons.disc = Some(DiscSettings {
        thickness: 20.0,
        ..DISC
    });
    assert!(thick.check().is_err());
    // Three discs that are exponential together have a negative density if they are thicker than this.
    for (profile, thickness, allowed) in [
        (DiscProfile::Exponential, 0.8, true),
        (DiscProfile::Exponential, 0.9, false),
        (DiscProfile::MiyamotoNagai, 0.9, true),
    ] {
        thick.baryons.disc = Some(DiscSettings {
            profile,
            thickness,
            ..DISC
        });
        assert_eq!(thick.check().is_ok(), allowed, "{profile:?} {thickness}");
    }
    let unknown = "[baryons]\nbulge = \"sersic\"";
    assert!(toml::from_str::<ModelSettings>(unknown).is_err());
}
