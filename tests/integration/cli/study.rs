//! A study with a setting that no run could use is refused before its first fit, with file, table, key and remedy.

use super::{oblate, refused, write};

/// A study of three mocks that would take hours.
const STUDY: &str = r#"
title = "a study"
out = "OUT"
[tracks]
files = ["track.csv"]
samplers = ["nested"]
[mocks]
count = 1
seed = 7
samplers = ["pt-hmc"]
mock = { model = { releases = { particles = 2000 } } }
[population]
samplers = ["nested"]
"#;

const TRACK: &str = "phi,r,r_err\n-15,60,1\n-5,61,1\n5,62,1\n15,63,1\n";

#[test]
fn a_setting_that_no_run_can_use_is_refused_before_the_first_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "track.csv", TRACK);
    let out = folder.path().join("results");
    let study = STUDY.replace("OUT", &out.display().to_string());
    let with = |table: &str, more: &str| {
        let header = format!("[{table}]\n");
        if study.contains(&header) {
            study.replace(&header, &format!("{header}{more}\n"))
        } else {
            format!("{study}[{table}]\n{more}\n")
        }
    };
    for (text, words) in [
        (
            with("population.settings", "family = { q_min = 2.0 }"),
            &["[population.settings]", "family.q_min = 2", "below q_max"][..],
        ),
        (
            with("population.settings", "reweighting = { max_draws = 0 }"),
            &["[population.settings]", "reweighting.max_draws"],
        ),
        (
            with("population.settings", "sampling.nested = { n_live = 2 }"),
            &["[population.settings]", "n_live"],
        ),
        (
            study.replace(
                "[population]\nsamplers = [\"nested\"]",
                "[population]\nsamplers = []",
            ),
            &["[population]", "samplers", "pt-hmc"],
        ),
        (
            study.replace("samplers = [\"pt-hmc\"]", "samplers = []"),
            &["[mocks]", "samplers"],
        ),
        (
            with("mocks", "fit = { sampling = { pt_hmc = { rounds = 0 } } }"),
            &["[mocks.fit]", "rounds"],
        ),
        (
            with("mocks", "fit = { likelihood = { min_fraction = 2.0 } }"),
            &["[mocks.fit]", "min_fraction"],
        ),
        (
            // The posterior of q needs the prior of q.
            with("mocks", "fit = { prior = { fixed = { dir_x = 0.0 } } }"),
            &["[mocks.fit]", "prior of q"],
        ),
        (
            with("mocks", "fit = { prior = { q_min = 0.7 } }"),
            &["[mocks.fit]", "wider range of q"],
        ),
        (
            study.replace("mock = {", "mock = { noise = nan,"),
            &["[mocks.mock]", "noise"],
        ),
        (
            with(
                "tracks",
                "fit = { model = { releases = { particles = 1001 } } }",
            ),
            &["[tracks.fit]", "particles = 1001"],
        ),
        (
            with("tracks", "assume_error = \"0.02\""),
            &["assume_error", "2%"],
        ),
        (
            study.replace("[\"track.csv\"]", "[\"track.csv\", \"track.csv\"]"),
            &["[tracks]", "track", "`name`"],
        ),
        (
            study
                .split("[mocks]")
                .next()
                .expect("a beginning")
                .to_owned()
                + "[population]\nof = \"mocks\"\nsamplers = [\"nested\"]\n",
            &["[population]", "of = \"mocks\"", "add a table `[mocks]`"],
        ),
        // Each value of a list has a folder of its own.
        (
            study.replace(
                "samplers = [\"pt-hmc\"]",
                "samplers = [\"pt-hmc\", \"pt-hmc\"]",
            ),
            &["[mocks]", "samplers = pt-hmc", "once"],
        ),
        (
            study.replacen("[\"nested\"]", "[\"nested\", \"nested\"]", 1),
            &["[tracks]", "samplers = nested", "once"],
        ),
        (
            with("population", "families = [\"beta\", \"uniform\", \"beta\"]"),
            &["[population]", "families = beta", "once"],
        ),
        (
            with("population", "subsets = { sizes = [10, 10], repeats = 1 }"),
            &["[population.subsets]", "sizes = 10", "once"],
        ),
        (
            study.replace("[\"track.csv\"]", "[]"),
            &["[tracks]", "files = []", "leave the table out"],
        ),
        (
            study.replace("count = ", "count = 0 # "),
            &["[mocks]", "count = 0"],
        ),
    ] {
        let path = write(folder.path(), "study.toml", &text);
        let output = oblate(&["run", &path], "");
        let mut all = vec!["study.toml"];
        all.extend(words);
        refused(&output, &all);
        assert!(!out.exists(), "{text}");
    }
}

#[test]
fn a_study_that_ran_out_of_time_says_how_to_continue() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("results");
    let study = STUDY
        .replace("OUT", &out.display().to_string())
        .replace(
            "[tracks]\nfiles = [\"track.csv\"]\nsamplers = [\"nested\"]\n",
            "",
        )
        .replace("[\"pt-hmc\"]", "[\"nested\"]\nfit = { coarse_particles = 64, model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 } }");
    let study = write(folder.path(), "study.toml", &study);
    let output = oblate(&["run", &study, "--max-minutes", "0", "-q"], "");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_ne!(output.status.code(), Some(0), "{text}");
    let next = format!("To continue the study:\n    oblate run {study} -q\n");
    assert!(text.contains(&next), "{text}");
}
