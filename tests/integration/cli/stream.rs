//! `oblate stream`: its machine form, and the settings of a fit.

use super::{example, json, oblate, write};

#[test]
fn stream_prints_its_machine_form() {
    let params = example("stream.toml").display().to_string();
    let output = oblate(&["stream", &params, "--particles", "1000", "--json"], "");
    assert_eq!(output.status.code(), Some(0));
    let value = json(&output.stdout);
    let n = value["track"]["phi_deg"].as_array().expect("bins").len();
    assert!(n >= 3);
    for key in ["r_kpc", "n"] {
        assert_eq!(value["track"][key].as_array().expect("a column").len(), n);
    }
    let q = value["q"].as_f64().expect("q");
    assert!(q > 0.5 && q < 1.5);
    assert_eq!(value["axis"].as_array().expect("axis").len(), 3);
    assert!(value["seconds"].as_f64().expect("seconds") > 0.0);
}

#[test]
fn stream_takes_the_settings_of_a_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "model.releases.particles = 512\nlikelihood = { edges = \"hard\", min_fraction = 0.02 }\nprior.fixed.age_gyr = 3.0\n";
    let config = write(folder.path(), "fit.toml", text);
    let params = example("stream.toml").display().to_string();
    let printed = |more: &[&str]| {
        let output = oblate(&[&["stream", &params], more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let by_flags = |particles| {
        let flags = [
            "--particles",
            particles,
            "--edge",
            "0",
            "--min-fraction",
            "0.02",
        ];
        printed(&flags)
    };
    assert_eq!(printed(&["--config", &config]), by_flags("512"));
    // Flags override the file.
    assert_eq!(
        printed(&["--config", &config, "--particles", "1024"]),
        by_flags("1024")
    );
    assert_ne!(printed(&[]), by_flags("2560"));
}

#[test]
fn the_track_is_that_of_the_data_where_the_settings_have_parameters_of_the_observation() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = "model.releases.particles = 512\n\
        prior.marginals.phi0_deg = { kind = \"uniform\", lo = -40, hi = 40 }\n\
        prior.fixed.distance_factor = 2.0\n";
    let config = write(folder.path(), "fit.toml", settings);
    let alone = example("stream.toml").display().to_string();
    let params = std::fs::read_to_string(&alone).expect("parameters");
    let observed = format!("{params}\nphi0_deg = 20.0\ndistance_factor = 2.0\n");
    let observed = write(folder.path(), "observed.toml", &observed);
    let track = |args: &[&str]| {
        let output = oblate(&[&["stream", "--json"], args].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let value = json(&output.stdout);
        let column = |name: &str| -> Vec<f64> {
            let values = value["track"][name].as_array().expect("a column").iter();
            values.map(|x| x.as_f64().expect("a number")).collect()
        };
        (column("phi_deg"), column("r_kpc"))
    };
    let (phi, r) = track(&[&alone, "--particles", "512"]);
    let (phi_observed, r_observed) = track(&[&observed, "--config", &config]);
    let near = |a: &[f64], b: Vec<f64>| {
        a.iter()
            .zip(&b)
            .all(|(a, b)| (a - b).abs() < 1e-9 * b.abs())
    };
    assert!(phi.len() > 2 && phi.len() == phi_observed.len());
    assert!(near(
        &phi_observed,
        phi.iter().map(|phi| phi + 20.0).collect()
    ));
    assert!(near(&r_observed, r.iter().map(|r| 0.5 * r).collect()));
    // Without such settings they are those of the file, and not left out of account.
    let of_file = track(&[&observed, "--particles", "512"]);
    assert_eq!(of_file, (phi_observed, r_observed));
}
