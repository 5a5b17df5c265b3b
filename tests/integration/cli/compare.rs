//! `oblate compare`: what it says about runs that agree and about runs that do not, and its exit code.

use super::{json, oblate, small_fit};
use crate::folders::copy;
use crate::runs::store;
use oblate::run::RunFolder;

#[test]
fn a_comparison_with_a_run_that_differs_fails() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name);
    let shown = |name: &str| path(name).display().to_string();
    let fit = ["fit", &track, "--config", &config, "--out", &shown("first")];
    let output = oblate(&[&fit[..], &["--allow-unconverged", "-q"]].concat(), "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let run = RunFolder::open(&path("first")).expect("a folder").read();
    let run = run.expect("a run").run;
    for name in ["same", "evidence", "marginal"] {
        copy(&path("first"), &path(name));
    }
    // Both runs have this error, so that the combined one is larger by the root of two.
    let mut other = run.clone();
    other.evidence.ln_z += 10.0 * 2.0_f64.sqrt() * run.evidence.error;
    store(&path("evidence"), &other);
    let mut other = run.clone();
    let rows = other.draws.theta.chunks_exact_mut(run.draws.dim);
    rows.for_each(|row| row[0] += 1.0);
    store(&path("marginal"), &other);

    let compared = |names: &[&str], more: &[&str]| {
        let names = names.iter().map(|name| shown(name));
        let names: Vec<String> = ["compare".to_owned()].into_iter().chain(names).collect();
        let arguments = names.iter().map(String::as_str).chain(more.iter().copied());
        oblate(&arguments.collect::<Vec<_>>(), "")
    };
    for (other, code, verdict) in [
        ("same", 0, "they agree (ln Z by +0.00 "),
        ("evidence", 1, "they DISAGREE (ln Z by -10.00 "),
        ("marginal", 1, "they DISAGREE (ln Z by +0.00 "),
    ] {
        let output = compared(&["first", other], &[]);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let line = format!("first against {other}: {verdict}");
        assert!(text.starts_with(&line), "{text}");
        let note = String::from_utf8_lossy(&output.stderr).into_owned();
        let advised = note.contains("To decide between runs that disagree");
        assert_eq!(advised, code == 1, "{note}");
    }
    let output = compared(&["first", "marginal"], &["--json"]);
    let worst = &json(&output.stdout)["marginals"][0];
    assert_eq!(worst["name"], run.names[0]);
    let medians = [0, 1].map(|k: usize| worst["median"][k].as_f64().expect("a number"));
    assert!((medians[1] - medians[0] - 1.0).abs() < 1e-12, "{worst}");
    // One of several is enough.
    let output = compared(&["first", "evidence", "same"], &[]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let output = compared(&["first", "same", "same"], &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}
