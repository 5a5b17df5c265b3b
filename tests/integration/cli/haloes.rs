//! Kinds of haloes by flag and setting: streams, fits, and fits of one track side by side.

use super::{example, json, oblate, refused, small_fit, write};
use std::path::Path;

#[test]
fn a_stream_is_in_the_halo_of_the_flag_or_of_the_setting() {
    let folder = tempfile::tempdir().expect("a folder");
    let params = example("stream.toml").display().to_string();
    let config = write(
        folder.path(),
        "fit.toml",
        "model.halo = \"logarithmic\"\nmodel.releases.particles = 512",
    );
    let printed = |more: &[&str]| {
        let output = oblate(&[&["stream", &params], more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let by_flag = |halo| printed(&["--particles", "512", "--halo", halo]);
    assert_eq!(by_flag("nfw"), printed(&["--particles", "512"]));
    assert_eq!(by_flag("logarithmic"), printed(&["--config", &config]));
    assert_ne!(by_flag("nfw"), by_flag("nfw-density"));
    assert_ne!(by_flag("nfw"), by_flag("logarithmic"));
    // A profile changes the model's numbers, not its physics.
    let in_profile = printed(&["--config", &config, "--profile", "paper"]);
    assert_eq!(
        in_profile,
        printed(&["--profile", "paper", "--halo", "logarithmic"])
    );

    // The parameters of a second axis are those of the stream: no settings need to fix them.
    let text = std::fs::read_to_string(&params).expect("parameters");
    let text = format!("{text}p_halo = 0.7\npsi_halo_deg = 40.0\n");
    let triaxial = write(folder.path(), "triaxial.toml", &text);
    let fixed = write(
        folder.path(),
        "fixed.toml",
        "prior.fixed = { p_halo = 0.7, psi_halo_deg = 40.0 }",
    );
    let particles = ["--particles", "512", "--halo"];
    let of_file = oblate(
        &[&["stream", &triaxial], &particles[..], &["nfw-triaxial"]].concat(),
        "",
    );
    assert_eq!(of_file.status.code(), Some(0), "{of_file:?}");
    let of_file = String::from_utf8(of_file.stdout).expect("text");
    assert_ne!(of_file, by_flag("nfw-density"));
    let fixed = [&particles[..], &["nfw-triaxial", "--config", &fixed]].concat();
    assert_eq!(of_file, printed(&fixed));
    let in_vain = [&["stream", &triaxial], &particles[..], &["nfw"]].concat();
    refused(&oblate(&in_vain, ""), &["p_halo", "leave"]);

    let unknown = write(folder.path(), "other.toml", "model.halo = \"einasto\"");
    let output = oblate(&["stream", &params, "--config", &unknown], "");
    refused(&output, &["other.toml", "einasto", "nfw_density"]);
}

#[test]
fn fits_in_several_haloes_are_compared_by_their_evidence() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let fit = |name: &str, halo: &[&str]| {
        let out = path(name);
        let arguments = ["fit", &track, "--config", &config, "--out", &out, "--json"];
        let arguments = [&arguments[..], &["--allow-unconverged"], halo];
        let output = oblate(&arguments.concat(), "");
        assert!(output.status.success(), "{output:?}");
        let text = std::fs::read_to_string(Path::new(&out).join("config.toml"));
        (out, json(&output.stdout), text.expect("settings"))
    };
    let (one, of_one, settings) = fit("one", &[]);
    let (two, of_two, other_settings) = fit("two", &["--halo", "nfw-density"]);
    // The default is not named, so that settings of earlier fits are those of the same fit.
    assert!(!settings.contains("halo = "), "{settings}");
    assert!(
        other_settings.contains("halo = \"nfw_density\""),
        "{other_settings}"
    );
    assert_ne!(of_one["ln_z"], of_two["ln_z"]);
    // They need not agree.
    let output = oblate(&["compare", &one, &two], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let note = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(note.contains("another host (nfw_density) than"), "{note}");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("two models; ln Z"), "{text}");
    assert!(!note.contains("continue those"), "{note}");
    // The page says the same.
    let page = path("page.html");
    let output = oblate(&["report", &one, &two, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let html = std::fs::read_to_string(&page).expect("a page");
    assert!(html.contains("odds: ") && html.contains("another host or family than the first"));
    let output = oblate(&["report", &one, "--out", &page, "--force"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let html = std::fs::read_to_string(&page).expect("a page");
    assert!(!html.contains("odds: "));
    let output = oblate(&["compare", &one, &one], "");
    assert!(output.stderr.is_empty(), "{output:?}");

    // Neither need fits with other priors, or with other errors of the data.
    let (wide, ..) = fit("wide", &["--set", "prior.q_max=2.5"]);
    let (loose, ..) = fit("loose", &["--set", "likelihood.error_floor_percent=30"]);
    let output = oblate(&["compare", &one, &wide, &loose], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let note = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(
        note.matches("another prior, or with other errors").count(),
        2,
        "{note}"
    );
    // The figure of both has no prior, and room for the whole posterior of each.
    let output = oblate(&["report", &one, &wide, "--out", &page, "--force"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let html = std::fs::read_to_string(&page).expect("a page");
    assert!(html.contains("another prior or other errors"), "{html}");
}

#[test]
fn a_logarithmic_halo_is_fitted_with_a_prior_of_its_own() {
    let (folder, config, track) = small_fit();
    let evaluate = |more: &[&str]| {
        let arguments = ["evaluate", &track, "--config", &config, "--halo"];
        oblate(&[&arguments[..], more].concat(), "")
    };
    let output = evaluate(&["logarithmic"]);
    refused(
        &output,
        &["prior.marginals.log10_m_halo", "circular velocity"],
    );
    // Other haloes have the default.
    assert!(evaluate(&["nfw-density"]).status.success());

    let out = folder.path().join("mocks").display().to_string();
    let arguments = ["mock", "--count", "1", "--out", &out, "--halo"];
    let output = oblate(&[&arguments[..], &["logarithmic"]].concat(), "");
    refused(&output, &["prior.marginals.log10_m_halo"]);
}
