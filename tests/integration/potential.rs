//! Potentials against 200-digit values, their derivatives by duals included, and the reverse mode against both.

use crate::golden::{cases, json, number, numbers, relative_difference};
use oblate::potential::{
    Disc, DiscProfile, DiscShape, FlattenedNfw, Halo, HaloCotangent, HaloParameters, Nfw, Plummer,
    PlummerCotangent, Potential, Sum, log10_m200,
};
use oblate::scalar::{Dual, Real, Scalar, Vec3, gradient_of, lift};
use oblate::units::{CRITICAL_DENSITY, G};
use serde_json::Value;
use std::f64::consts::PI;

/// The golden files' own tolerance: each entry against the largest of its vector or matrix.
const TOLERANCE: f64 = 1e-12;

fn unit<S: Real>(v: Vec3<S>) -> Vec3<S> {
    v * (S::one() / v.norm2().sqrt())
}

/// The halo of a golden case.
pub fn nfw_of(case: &Value) -> FlattenedNfw<f64> {
    let get = |key: &str| number(&case[key]);
    let axis = unit(Vec3::from(numbers::<3>(&case["v"])));
    FlattenedNfw::new(get("M"), get("Rs"), get("q"), axis)
}

/// The Plummer sphere of a golden case.
pub fn plummer_of(case: &Value) -> Plummer<f64> {
    Plummer {
        mass: number(&case["m"]),
        r_s: number(&case["a"]),
    }
}

/// The profile and the thickness of the disc of a golden case.
fn shape_of(case: &Value) -> DiscShape {
    let thickness = number(&case["b"]) / number(&case["a"]);
    DiscShape::new(DiscProfile::MiyamotoNagai, thickness)
}

/// The disc of a golden case.
pub fn miyamoto_nagai_of(case: &Value) -> Disc<f64> {
    let normal = unit(Vec3::from(numbers::<3>(&case["v"])));
    Disc::new(
        number(&case["M"]),
        number(&case["a"]),
        normal,
        shape_of(case),
    )
}

/// All functions of a potential, against one golden case.
fn check_contract(potential: &impl Potential<f64>, case: &Value) {
    let x = Vec3::from(numbers::<3>(&case["x"]));
    let id = &case["id"];
    let phi = number(&case["phi"]);
    assert!(
        ((potential.value(x) - phi) / phi).abs() < TOLERANCE,
        "phi {id}"
    );
    let acceleration = potential.acceleration(x).to_array();
    let golden = numbers::<3>(&case["acc"]);
    if golden.iter().any(|a| a.abs() > 0.0) {
        assert!(
            relative_difference(&acceleration, &golden) < TOLERANCE,
            "acc {id} {acceleration:?}"
        );
    }
    let [xx, xy, xz, yy, yz, zz] = numbers::<6>(&case["hess"]);
    let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let largest = [xx, xy, xz, yy, yz, zz]
        .iter()
        .fold(0.0_f64, |m, v| m.max(v.abs()));
    for (i, row) in rows.iter().enumerate() {
        let mut e = [0.0; 3];
        e[i] = 1.0;
        let ours = potential.hessian_product(x, Vec3::from(e)).to_array();
        for (a, b) in ours.iter().zip(row) {
            assert!((a - b).abs() < TOLERANCE * largest, "hess {id} {a} {b}");
        }
    }
    let density = potential.density(x);
    let scale = largest / (4.0 * std::f64::consts::PI * G);
    assert!(
        (density - number(&case["density"])).abs() < TOLERANCE * scale,
        "density {id}"
    );
    if x.norm2() > 0.0 {
        let radial = potential.second_derivative_along(x, unit(x));
        assert!(
            (radial - number(&case["d2phi_dr2"])).abs() < TOLERANCE * largest,
            "d2phi_dr2 {id}"
        );
    }
}

/// Derivatives of the acceleration by the given parameters, against `dacc` of a golden case.
fn check_parameter_derivatives<const N: usize>(
    case: &Value,
    names: [&str; N],
    acceleration: impl Fn([Dual<N>; N], Vec3<Dual<N>>) -> Vec3<Dual<N>>,
) {
    let values = names.map(|name| match name {
        "vx" => number(&case["v"][0]),
        "vy" => number(&case["v"][1]),
        "vz" => number(&case["v"][2]),
        other => number(&case[other]),
    });
    let x = Vec3::from_f64(Vec3::from(numbers::<3>(&case["x"])));
    let a = acceleration(lift(&values), x)
        .to_array()
        .map(|c| gradient_of(&c));
    for (i, name) in names.iter().enumerate() {
        let key = if *name == "log10M" { "M" } else { name };
        let golden_value = &case["dacc"][*name];
        if golden_value.is_null() {
            continue;
        }
        let golden = numbers::<3>(golden_value);
        let ours = [a[0][i], a[1][i], a[2][i]];
        if golden.iter().any(|g| g.abs() > 0.0) {
            let difference = relative_difference(&ours, &golden);
            assert!(
                difference < TOLERANCE,
                "d acc / d {key}, case {}: {difference:e}",
                case["id"]
            );
        }
    }
}

#[test]
fn every_potential_meets_its_200_digit_values() {
    let file = json("potential.json");
    let mut seen = [0, 0, 0];
    for case in cases(&file) {
        match case["kind"].as_str() {
            Some("nfw") => {
                seen[0] += 1;
                check_contract(&nfw_of(case), case);
                check_parameter_derivatives(case, ["M", "Rs", "q", "vx", "vy", "vz"], |p, x| {
                    FlattenedNfw::new(p[0], p[1], p[2], unit(Vec3::new(p[3], p[4], p[5])))
                        .acceleration(x)
                });
            }
            Some("plummer") => {
                seen[1] += 1;
                check_contract(&plummer_of(case), case);
                check_parameter_derivatives(case, ["m", "a"], |p, x| {
                    Plummer {
                        mass: p[0],
                        r_s: p[1],
                    }
                    .acceleration(x)
                });
            }
            Some("miyamoto_nagai") => {
                seen[2] += 1;
                check_contract(&miyamoto_nagai_of(case), case);
                let shape = shape_of(case);
                check_parameter_derivatives(case, ["M", "vx", "vy", "vz"], |p, x| {
                    let a = Dual::from_f64(number(&case["a"]));
                    let normal = unit(Vec3::new(p[1], p[2], p[3]));
                    Disc::new(p[0], a, normal, shape).acceleration(x)
                });
            }
            other => panic!("unknown kind {other:?}"),
        }
    }
    assert_eq!(seen, [120, 30, 20]);
}

#[test]
fn the_derivative_by_log10_mass_is_the_golden_one() {
    let file = json("potential.json");
    for case in cases(&file).iter().filter(|c| c["kind"] == "nfw") {
        let axis = Vec3::from_f64(unit(Vec3::from(numbers::<3>(&case["v"]))));
        let x = Vec3::from_f64(Vec3::from(numbers::<3>(&case["x"])));
        let [log10_mass] = lift::<1>(&[number(&case["M"]).log10()]);
        let mass = (log10_mass * std::f64::consts::LN_10).exp();
        let lifted = |key: &str| Dual::<1>::from_re(number(&case[key]));
        let a = FlattenedNfw::new(mass, lifted("Rs"), lifted("q"), axis).acceleration(x);
        let ours = a.to_array().map(|c| gradient_of(&c)[0]);
        // 10^(log10 M) in doubles is good to 1e-14 only times ln(10) log10(M).
        assert!(
            relative_difference(&ours, &numbers::<3>(&case["dacc"]["log10M"])) < 2e-12,
            "{}",
            case["id"]
        );
    }
}

#[test]
fn vjp_is_the_transpose_of_the_dual_derivative() {
    let file = json("potential.json");
    let lambda = Vec3::new(0.3, -1.1, 0.7);
    for case in cases(&file).iter().filter(|c| c["kind"] == "nfw") {
        let get = |key: &str| number(&case[key]);
        let x = numbers::<3>(&case["x"]);
        let halo = nfw_of(case);
        let axis = halo.axis;
        let mut cotangent = HaloCotangent::zero();
        let (acceleration, x_bar) = Nfw::vjp(&halo, Vec3::from(x), lambda, &mut cotangent);
        assert!(
            relative_difference(
                &acceleration.to_array(),
                &halo.acceleration(Vec3::from(x)).to_array()
            ) < TOLERANCE
        );
        let v: [Dual<9>; 9] = lift(&[
            0.0,
            0.0,
            halo.flattening,
            axis.x,
            axis.y,
            axis.z,
            x[0],
            x[1],
            x[2],
        ]);
        let mut dual = FlattenedNfw::new(
            v[0].exp() * get("M"),
            v[1].exp() * get("Rs"),
            Dual::from_re(get("q")),
            Vec3::new(v[3], v[4], v[5]),
        );
        dual.flattening = v[2];
        let a = dual
            .acceleration(Vec3::new(v[6], v[7], v[8]))
            .dot(Vec3::from_f64(lambda));
        let golden = gradient_of(&a);
        let ours = [
            cotangent.ln_mass,
            cotangent.ln_r_s,
            cotangent.flattening,
            cotangent.axis.x,
            cotangent.axis.y,
            cotangent.axis.z,
        ];
        assert!(
            relative_difference(&ours, &golden[..6]) < 1e-11,
            "{} {ours:?} {golden:?}",
            case["id"]
        );
        assert!(
            relative_difference(&x_bar.to_array(), &golden[6..]) < 1e-11,
            "{}",
            case["id"]
        );
    }
    for case in cases(&file)
        .iter()
        .filter(|c| c["kind"] == "plummer")
        .skip(1)
    {
        let x = numbers::<3>(&case["x"]);
        let progenitor = plummer_of(case);
        let mut cotangent = PlummerCotangent::zero();
        let (_, x_bar) = progenitor.vjp(Vec3::from(x), lambda, &mut cotangent);
        let v: [Dual<5>; 5] = lift(&[0.0, progenitor.r_s, x[0], x[1], x[2]]);
        let dual = Plummer {
            mass: v[0].exp() * progenitor.mass,
            r_s: v[1],
        };
        let golden = gradient_of(
            &dual
                .acceleration(Vec3::new(v[2], v[3], v[4]))
                .dot(Vec3::from_f64(lambda)),
        );
        assert!(relative_difference(&[cotangent.ln_mass, cotangent.r_s], &golden[..2]) < TOLERANCE);
        assert!(relative_difference(&x_bar.to_array(), &golden[2..]) < TOLERANCE);
    }
}

/// The NFW halo with nothing but its acceleration: its derivatives are the defaults of [`Halo`].
#[derive(Clone, Copy, Debug, Default)]
struct NfwByTangents;

impl Halo for NfwByTangents {
    type In<S: Scalar> = FlattenedNfw<S>;

    fn new<S: Scalar>(parameters: HaloParameters<S>) -> FlattenedNfw<S> {
        Nfw::new(parameters)
    }

    fn parameters<S: Scalar>(halo: &FlattenedNfw<S>) -> HaloParameters<S> {
        Nfw::parameters(halo)
    }
}

#[test]
fn derivatives_by_tangents_equal_those_by_hand() {
    let file = json("potential.json");
    let lambda = Vec3::new(0.3, -1.1, 0.7);
    let all = |bar: &HaloCotangent<f64>| {
        let axis = bar.axis;
        [
            bar.ln_mass,
            bar.ln_r_s,
            bar.flattening,
            axis.x,
            axis.y,
            axis.z,
        ]
    };
    let mut seen = 0;
    for case in cases(&file).iter().filter(|c| c["kind"] == "nfw") {
        let x = Vec3::from(numbers::<3>(&case["x"]));
        let halo = nfw_of(case);
        let (mut by_hand, mut by_tangents) = (HaloCotangent::zero(), HaloCotangent::zero());
        let (_, x_bar) = Nfw::vjp(&halo, x, lambda, &mut by_hand);
        let (a, x_bar_by_tangents) = NfwByTangents::vjp(&halo, x, lambda, &mut by_tangents);
        let close = |a: &[f64], b: &[f64]| relative_difference(a, b) < 1e-11;
        assert!(close(&a.to_array(), &halo.acceleration(x).to_array()));
        assert!(
            close(&x_bar_by_tangents.to_array(), &x_bar.to_array()),
            "{}",
            case["id"]
        );
        assert!(close(&all(&by_tangents), &all(&by_hand)), "{}", case["id"]);
        let product = NfwByTangents::hessian_product(&halo, x, lambda);
        assert!(close(
            &product.to_array(),
            &halo.hessian_product(x, lambda).to_array()
        ));
        seen += 1;
    }
    assert_eq!(seen, 120);
}

#[test]
fn a_sum_of_potentials_adds_up() {
    let x: Vec3<f64> = Vec3::new(3.0, -20.0, 11.0);
    let halo = FlattenedNfw::new(1e12, 15.0, 0.7, Vec3::new(0.0, 0.6, 0.8));
    let shape = DiscShape::new(DiscProfile::MiyamotoNagai, 0.1);
    let disc = Disc::new(5e10, 3.0, Vec3::new(0.0, 0.0, 1.0), shape);
    let both = Sum(halo, disc);
    let v = Vec3::new(0.2, 0.5, -0.1);
    let rest: f64 = both.value(x) - halo.value(x) - disc.value(x);
    assert!(rest.abs() < 1e-9);
    let h: Vec3<f64> =
        both.hessian_product(x, v) - halo.hessian_product(x, v) - disc.hessian_product(x, v);
    assert!(h.norm2().sqrt() < 1e-12);
    let ratio: f64 = both.density(x) / (halo.density(x) + disc.density(x));
    assert!((ratio - 1.0).abs() < 1e-12);
}

#[test]
fn m200_is_the_mass_inside_200_critical_densities() {
    for (log10_mass, r_s) in [(11.0, 25.0), (12.0, 15.0), (14.0, 10.0)] {
        let m200 = 10.0_f64.powf(log10_m200(log10_mass, r_s));
        let r200 = (m200 / (200.0 * CRITICAL_DENSITY * 4.0 * PI / 3.0)).cbrt();
        let s = r200 / r_s;
        let enclosed = 10.0_f64.powf(log10_mass) * ((1.0 + s).ln() - s / (1.0 + s));
        assert!((enclosed / m200 - 1.0).abs() < 1e-9, "{log10_mass} {r_s}");
    }
}
