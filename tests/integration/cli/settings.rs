//! Settings: printed and read back, or refused with file, line and remedy.

use super::{example, oblate, refused, write};
use std::path::Path;

#[test]
fn every_setting_is_printed_and_read_back() {
    let output = oblate(&["fit", "--print-config"], "");
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), "all.toml", &text);
    let again = oblate(&["fit", "--print-config", "--config", &path], "");
    assert_eq!(String::from_utf8_lossy(&again.stdout), text);
    // Every table of the first level has a comment that says where it is explained.
    let mut before = "";
    for line in text.lines() {
        if line.starts_with('[') && !line.contains('.') {
            assert!(
                before.starts_with("# ") && before.contains("docs/"),
                "{line}"
            );
        }
        before = line;
    }
}

/// A profile is of the model and of its comparison with the data; what is known of the data's errors is not its own.
#[test]
fn a_profile_keeps_what_is_known_of_the_errors_of_the_data() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "[likelihood]\nerror_floor_percent = 2.5\nerror_correlation = { angle_deg = 12.0, fraction = 0.4 }\n";
    let path = write(folder.path(), "errors.toml", text);
    for profile in ["fast", "paper"] {
        let flags = [
            "fit",
            "--print-config",
            "--config",
            &path,
            "--profile",
            profile,
        ];
        let output = oblate(&flags, "");
        let printed = String::from_utf8(output.stdout).expect("text");
        for line in [
            "error_floor_percent = 2.5",
            "angle_deg = 12.0",
            "fraction = 0.4",
        ] {
            assert!(printed.contains(line), "{profile}: {line}\n{printed}");
        }
    }
}

#[test]
fn bad_settings_and_parameters_name_file_line_and_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let out = folder.path().join("run").display().to_string();
    let unknown = write(folder.path(), "unknown.toml", "seed = 1\nsneed = 2\n");
    let fit = |config: &str| oblate(&["fit", &track, "--config", config, "--out", &out], "");
    // A setting that no sampler can work with is refused before a folder is made.
    let few = write(
        folder.path(),
        "few.toml",
        "[sampling]\nsampler = \"nested\"\nnested = { n_live = 3 }\n",
    );
    refused(&fit(&few), &["n_live", "3"]);
    assert!(!folder.path().join("run").exists());
    refused(
        &fit(&unknown),
        &[
            "unknown.toml",
            "line 2",
            "sneed",
            "--print-config",
            "\n2 | sneed = 2\n  | ^^^^^\n",
        ],
    );
    // Keys of a table that is merged with defaults are reported with their own lines as well.
    let deep = "[sampling]\nsampler = \"nested\"\n\n[sampling.nested]\nn_live = 100\nn_alive = 3\n";
    let deep = write(folder.path(), "deep.toml", deep);
    refused(
        &fit(&deep),
        &["deep.toml", "line 6", "\n6 | n_alive = 3\n  | ^^^^^^^\n"],
    );
    let text = "[sampling]\nsampler = \"nested\"\nnested.steps = 4\nnested.n_live = \"a\"\n";
    let typed = write(folder.path(), "typed.toml", text);
    refused(
        &fit(&typed),
        &[
            "typed.toml",
            "line 4",
            "\n4 | nested.n_live = \"a\"\n  |        ^^^^^^\n",
        ],
    );
    refused(&fit("nowhere.toml"), &["nowhere.toml", "readable"]);
    let odd = write(
        folder.path(),
        "odd.toml",
        "[model.releases]\nparticles = 1001\n",
    );
    refused(&fit(&odd), &["particles = 1001", "multiple"]);
    let outside = std::fs::read_to_string(example("stream.toml"))
        .expect("the example")
        .lines()
        .map(|l| {
            if l.starts_with("age_gyr") {
                "age_gyr = 40.0"
            } else {
                l
            }
        })
        .collect::<Vec<_>>()
        .join("\n");
    let outside = write(folder.path(), "outside.toml", &outside);
    refused(
        &oblate(&["stream", &outside], ""),
        &["outside.toml", "age_gyr", "[1, 4]"],
    );
    refused(
        &oblate(&["evaluate", &track], "{\"age_gyr\": 1}\n"),
        &["standard input", "line 1", "log10_m_halo = missing"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
}
