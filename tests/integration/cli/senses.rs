//! `oblate fit` of both senses of phi: its two folders, its table, and what is refused.

use super::{json, oblate, refused, small_fit};
use oblate::params::PriorSettings;
use std::path::Path;

#[test]
fn both_senses_are_fitted_weighed_and_resumed_and_the_wrong_one_is_improbable() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run").display().to_string();
    let fit = |more: &[&str]| {
        let args = ["fit", &track, "--config", &config, "--handedness", "both"];
        let more = [&["--out", &out, "-q", "--allow-unconverged"], more].concat();
        oblate(&[&args[..], &more].concat(), "")
    };
    // A range of phi0 that is not symmetric: the mirrored track has the mirrored one.
    let phi0 = "prior.marginals.phi0_deg={kind=\"uniform\",lo=-5,hi=15}";
    let output = fit(&["--set", phi0, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let result = json(&output.stdout);
    let rows = result["senses"].as_array().expect("rows");
    let number = |row: usize, key: &str, part: &str| {
        let value = if key == "ln_z" {
            &rows[row]["summary"][key]
        } else {
            &rows[row][key]
        };
        value[part].as_f64().expect("a number")
    };
    assert_eq!(rows[0]["handedness"], "as-given");
    assert_eq!(rows[1]["handedness"], "mirrored");
    let [given, mirrored] = [0, 1].map(|row| number(row, "probability", "value"));
    assert!((given + mirrored - 1.0).abs() < 1e-12);
    let ln_ratio = number(0, "ln_z", "value") - number(1, "ln_z", "value");
    assert!(
        ln_ratio > 5.0,
        "the track was made with this sense: {ln_ratio}"
    );
    assert!(((given / mirrored).ln() - ln_ratio).abs() < 1e-3 * ln_ratio);
    let error = number(0, "ln_z", "error").hypot(number(1, "ln_z", "error"));
    let expected = given * mirrored * error;
    assert!((number(1, "probability", "error") / expected - 1.0).abs() < 1e-9);
    let text = |name: &str| {
        std::fs::read_to_string(Path::new(&out).join("mirrored").join(name)).expect("a file")
    };
    let settings: toml::Table = text("config.toml").parse().expect("TOML");
    let prior = &settings["prior"];
    assert_eq!(prior["marginals"]["phi0_deg"]["lo"].as_float(), Some(-15.0));
    assert_eq!(prior["marginals"]["phi0_deg"]["hi"].as_float(), Some(5.0));
    assert_eq!(prior["fixed"]["dir_y"].as_float(), Some(-0.2));
    assert!(text("track.ecsv").contains("phi_mirrored"));

    refused(&fit(&["--set", phi0]), &["as-given", "exists already"]);
    // Read back, as a table; and a folder of its own is continued by the command that is printed for it.
    let again = fit(&["--set", phi0, "--resume"]);
    assert_eq!(again.status.code(), Some(0), "{again:?}");
    let table = String::from_utf8(again.stdout).expect("text");
    assert!(
        table.starts_with("sense ") && table.contains("mirrored  NO"),
        "{table}"
    );
    let one = format!("{out}/mirrored");
    let (its_track, its_config) = (format!("{one}/track.ecsv"), format!("{one}/config.toml"));
    let args = ["fit", &its_track, "--config", &its_config, "--out", &one];
    let more = ["--resume", "--json", "-q", "--allow-unconverged"];
    let resumed = json(&oblate(&[&args[..], &more].concat(), "").stdout);
    assert_eq!(resumed["ln_z"], rows[1]["summary"]["ln_z"]);
    // Fits that the time limit has stopped do not say how probable the senses are.
    let stopped = folder.path().join("stopped").display().to_string();
    let args = ["fit", &track, "--config", &config, "--handedness", "both"];
    let more = ["--max-minutes", "0", "--out", &stopped, "-q"];
    let output = oblate(&[&args[..], &more].concat(), "");
    let table = String::from_utf8_lossy(&output.stdout);
    assert_eq!(table.matches("not known yet").count(), 2, "{table}");
    let told = String::from_utf8_lossy(&output.stderr);
    let both = format!("--handedness both --out {stopped} -q --resume");
    assert_eq!(told.matches(&both).count(), 1, "{told}");
    // A folder of a run cannot hold two of them.
    let output = oblate(
        &[
            "fit",
            &track,
            "--config",
            &config,
            "--handedness",
            "both",
            "--out",
            &one,
        ],
        "",
    );
    refused(&output, &["folder of one run"]);
    // They are fits of two tracks, which a comparison says, and which a page does not compare.
    let output = oblate(&["compare", &format!("{out}/as-given"), &one], "");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("other sense of phi"), "{text}");
    let page = folder.path().join("page.html").display().to_string();
    let given = format!("{out}/as-given");
    let output = oblate(&["report", &given, &one, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = std::fs::read_to_string(&page).expect("the page");
    assert!(!text.contains("combined standard errors"), "compared");
    assert!(
        text.contains("s2_spherical, mirrored"),
        "the groups are named"
    );
}

#[test]
fn both_senses_need_a_prior_that_can_be_mirrored() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run").display().to_string();
    let fit = |set: &str| {
        let args = ["fit", &track, "--config", &config, "--handedness", "both"];
        oblate(&[&args[..], &["--set", set, "--out", &out]].concat(), "")
    };
    refused(
        &fit("prior.marginals.vy0_km_s={kind=\"normal\",mean=0,sd=250}"),
        &["prior.marginals.vy0_km_s", "both senses"],
    );
    refused(
        &fit("prior.marginals.phi0_deg={kind=\"half_normal\",sd=9}"),
        &["prior.marginals.phi0_deg", "opposite sign"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
    let args = ["evaluate", &track, "--handedness", "both"];
    refused(&oblate(&args, ""), &["--handedness = both", "mirrored"]);
    // The default prior is that of both senses.
    let prior = PriorSettings::default();
    assert_eq!(prior.mirrored().expect("a prior"), prior);
}
