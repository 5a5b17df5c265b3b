//! Every halo, disc and bulge and the progenitor, against galpy, gala and Agama.

use crate::baryons::{bulge_of, disc_of};
use crate::golden::{cases, json, number, numbers, relative_difference};
use crate::haloes::{hessian, symmetric, triaxial};
use crate::potential::{miyamoto_nagai_of, nfw_of, plummer_of};
use oblate::potential::{Halo, Logarithmic, NfwDensity, Potential};
use oblate::scalar::Vec3;
use oblate::units::G;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Largest differences of the value, the acceleration and the Hessian, relative to the largest entry of each.
type Errors = [f64; 3];

/// Of closed forms: gala loses digits near the centre of an NFW halo, and an exponential disc is a sum of three that nearly cancel.
const CLOSED: Errors = [1e-10; 3];
/// Of the eight nodes, docs/physics.md, section 2.
const NODES: Errors = [2e-6, 6e-6, 3e-5];

/// The differences of a potential from the numbers of a code; `constant` is added to ours. A Hessian that is left out has none.
fn errors(potential: &impl Potential<f64>, constant: f64, x: Vec3<f64>, code: &Value) -> Errors {
    let phi = number(&code["phi"]);
    let of_hessian = code.get("hess").map_or(0.0, |theirs| {
        let theirs: Vec<f64> = (0..3).flat_map(|i| numbers::<3>(&theirs[i])).collect();
        relative_difference(&hessian(potential, x), &theirs)
    });
    [
        ((potential.value(x) + constant) / phi - 1.0).abs(),
        relative_difference(
            &potential.acceleration(x).to_array(),
            &numbers::<3>(&code["acc"]),
        ),
        of_hessian,
    ]
}

/// The differences of our potential of a case, and what is allowed of its kind.
fn compared(kind: &str, case: &Value, code: &Value) -> (Errors, Errors) {
    let position = case.get("x").unwrap_or(&case["x_kpc"]);
    let x = Vec3::from(numbers::<3>(position));
    let closed = |errors| (errors, CLOSED);
    match kind {
        "nfw" => closed(errors(&nfw_of(case), 0.0, x, code)),
        "plummer" => closed(errors(&plummer_of(case), 0.0, x, code)),
        "miyamoto_nagai" => closed(errors(&miyamoto_nagai_of(case), 0.0, x, code)),
        "exponential" => closed(errors(&disc_of(case), 0.0, x, code)),
        "hernquist" => closed(errors(&bulge_of(case), 0.0, x, code)),
        "logarithmic" => {
            // Ours is zero at the centre.
            let r_s = number(&case["r_s_kpc"]);
            let at_centre = G * number(&case["mass_msun"]) / r_s * r_s.ln();
            closed(errors(
                &Logarithmic::new(symmetric(case)),
                at_centre,
                x,
                code,
            ))
        }
        "nfw_density" => {
            let halo = NfwDensity::new(symmetric(case));
            (errors(&halo, 0.0, x, code), NODES)
        }
        "nfw_triaxial" => {
            let halo = NfwDensity::new(triaxial(case));
            (errors(&halo, 0.0, x, code), NODES)
        }
        other => panic!("unknown kind {other}"),
    }
}

/// Names and kinds of the numbers of each code, with their count.
fn counts(file: &Value) -> BTreeMap<(String, String), usize> {
    let mut counts = BTreeMap::new();
    for code in cases(file) {
        let text = |key: &str| code[key].as_str().expect("a name").to_owned();
        *counts.entry((text("kind"), text("code"))).or_insert(0) += 1;
    }
    counts
}

#[test]
fn every_potential_is_that_of_other_codes() {
    let file = json("codes.json");
    let names = [
        "potential.json",
        "haloes.json",
        "triaxial.json",
        "baryons.json",
    ];
    let files: BTreeMap<&str, Value> = names.iter().map(|name| (*name, json(name))).collect();
    for code in cases(&file) {
        let kind = code["kind"].as_str().expect("a kind");
        let name = code["file"].as_str().expect("a file");
        let case = cases(&files[name])
            .iter()
            .find(|case| case["id"] == code["id"])
            .expect("the case of a code");
        let (errors, allowed) = compared(kind, case, code);
        assert!(
            errors.iter().zip(&allowed).all(|(e, a)| e < a),
            "{} of {kind}, {name} {}: {errors:?}",
            code["code"],
            code["id"]
        );
    }
}

/// Each kind has the numbers of two codes, those that are gala's in baryons.json included.
#[test]
fn every_potential_has_two_other_codes() {
    let counts = counts(&json("codes.json"));
    let mut codes: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for ((kind, code), count) in &counts {
        assert!(*count >= 16, "{kind} {code} {count}");
        codes.entry(kind).or_default().insert(code);
    }
    for kind in ["exponential", "hernquist"] {
        codes.entry(kind).or_default().insert("gala");
    }
    assert_eq!(codes.len(), 8);
    for (kind, codes) in codes {
        assert!(codes.len() >= 2, "{kind} {codes:?}");
    }
}
