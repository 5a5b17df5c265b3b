//! `oblate orientation`: the angles of draws whose axes are known.

use super::{SMALL, json, oblate, small_fit, write};
use crate::runs::store;
use oblate::params::{QRange, Shape};
use oblate::run::RunFolder;
use oblate::scalar::Vec3;
use oblate_samplers::Run;

/// The disc is inclined by 60 degrees about its major axis, which has the angle 20 degrees from the x axis of the sky: docs/physics.md, section 2.
const INCLINATION_DEG: f64 = 60.0;
const PHI_DEG: f64 = 20.0;

/// The run with this symmetry axis in each draw, numbered by row.
fn with_axis(run: &Run, axis: impl Fn(usize) -> Vec3<f64>) -> Run {
    let mut run = run.clone();
    let place = |names: &[String], name: &str| {
        let place = names.iter().position(|own| own == name);
        place.expect("a column")
    };
    let derived: Vec<String> = run.derived_names.iter().map(|d| d.0.clone()).collect();
    let dirs = ["dir_x", "dir_y", "dir_z"].map(|name| place(&run.names, name));
    let axes = ["axis_x", "axis_y", "axis_z", "q"].map(|name| place(&derived, name));
    let (dim, derived_dim) = (run.draws.dim, run.draws.derived_dim);
    for row in 0..run.draws.len() {
        let dir = axis(row) * 1.3;
        let Shape { q, axis } = QRange::default().shape(dir);
        for (k, value) in dirs.into_iter().zip(dir.to_array()) {
            run.draws.theta[row * dim + k] = value;
        }
        for (k, value) in axes.into_iter().zip([axis.x, axis.y, axis.z, q]) {
            run.draws.derived[row * derived_dim + k] = value;
        }
    }
    run
}

#[test]
fn angles_are_those_between_known_axes_and_the_line_of_sight_or_the_disc() {
    let (folder, _, track) = small_fit();
    let config = SMALL.replace("dir_x = 0.1, dir_y = 0.2, ", "").replace(
        "max_halvings = 3",
        "max_halvings = 3, baryons = { disc = { profile = \"miyamoto_nagai\", thickness = 0.1 } }",
    );
    let disc = format!(
        "prior.fixed = {{ log10_m_disc = 10.5, r_disc_kpc = 3.5, inclination_disc_deg = {INCLINATION_DEG:?}, phi_disc_deg = {PHI_DEG:?},"
    );
    let config = config.replace("prior.fixed = {", &disc);
    let config = write(folder.path(), "disc.toml", &config);
    let path = folder.path().join("run");
    let run_folder = path.display().to_string();
    let fit = ["fit", &track, "--config", &config, "--out", &run_folder];
    let output = oblate(&[&fit[..], &["--allow-unconverged", "-q"]].concat(), "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let run = RunFolder::open(&path).expect("a folder").read();
    let run = run.expect("a run").run;
    let angles = |run: &Run, to: &str| {
        store(&path, run);
        let output = oblate(&["orientation", &run_folder, "--to", to, "--json"], "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let said = json(&output.stdout)["streams"][0]["angle_deg"].clone();
        assert_eq!(said["unit"], "deg");
        ["lo95", "lo68", "median", "hi68", "hi95"].map(|key| said[key].as_f64().expect(key))
    };

    let (sin, cos) = INCLINATION_DEG.to_radians().sin_cos();
    let (sin_phi, cos_phi) = PHI_DEG.to_radians().sin_cos();
    let line_of_sight = Vec3::new(0.0, 0.0, 1.0);
    let major = Vec3::new(cos_phi, sin_phi, 0.0);
    let pole = Vec3::new(-sin_phi * sin, cos_phi * sin, cos);
    let half = 0.5_f64;
    let tilted = |from: Vec3<f64>| from * (0.75_f64.sqrt()) + major * half;
    // By hand: the major axis lies on the sky and in the disc.
    for (axis, to_line_of_sight, to_pole) in [
        (line_of_sight, 0.0, 60.0),
        (line_of_sight * -1.0, 0.0, 60.0),
        (pole, 60.0, 0.0),
        (pole * -1.0, 60.0, 0.0),
        (major, 90.0, 90.0),
        (
            tilted(line_of_sight),
            30.0,
            (0.75_f64.sqrt() * half).acos().to_degrees(),
        ),
        (
            tilted(pole),
            (0.75_f64.sqrt() * half).acos().to_degrees(),
            30.0,
        ),
        (
            tilted(pole) * -1.0,
            (0.75_f64.sqrt() * half).acos().to_degrees(),
            30.0,
        ),
    ] {
        let known = with_axis(&run, |_| axis);
        for (to, expected) in [("line-of-sight", to_line_of_sight), ("disc", to_pole)] {
            for angle in angles(&known, to) {
                // An angle of zero is the arc cosine of 1 to rounding: 2e-8 radians.
                assert!(
                    (angle - expected).abs() < 1e-5,
                    "{axis:?} {to}: {angle} {expected}"
                );
            }
        }
    }
    // Seven tenths of the weight at 30 degrees from the pole, the rest in the disc.
    let weights = run.draws.weights();
    let mut below = 0.0;
    let is_tilted: Vec<bool> = weights
        .iter()
        .map(|weight| {
            below += weight;
            below < 0.7
        })
        .collect();
    let mixed = with_axis(
        &run,
        |row| if is_tilted[row] { tilted(pole) } else { major },
    );
    let [lo95, lo68, median, hi68, hi95] = angles(&mixed, "disc");
    for (angle, expected) in [
        (lo95, 30.0),
        (lo68, 30.0),
        (median, 30.0),
        (hi68, 90.0),
        (hi95, 90.0),
    ] {
        assert!((angle - expected).abs() < 1e-5, "{angle} {expected}");
    }
}
