//! Every command line on the pages is typed into a shell, page by page, with settings that make it quick. That of docs/tour.md is `tour.rs`.

use crate::folders::copy;
use crate::pages::{PAGES, command_lines};
use std::path::Path;
use std::process::Command;
use toml::{Table, Value};

/// Flags of a fit of a fraction of a second.
const QUICK: &str = "--coarse-particles 0 --particles 128 --live 60 --set model.step_phase=2.0 --set model.max_halvings=3 \
                     --set sampling.nested.kernel=random-slice --set sampling.nested.steps=2 --set sampling.nested.max_batches=1 \
                     --allow-unconverged --force -q";

/// The same as settings of a study.
const QUICK_FIT: &str = r#"
coarse_particles = 0
model = { step_phase = 2.0, max_halvings = 3, releases = { particles = 128 } }
sampling.nested = { n_live = 60, kernel = "random-slice", steps = 2, max_batches = 1 }
sampling.pt_hmc = { chain_sets = 2, rounds = 2, first_scans = 4, smc_particles = 20, mcmc_steps = 2, slice_updates = 1, surrogate = false, extensions = 0 }
"#;

/// Tracks that commands name: with radii alone, with velocities of a bin and of a star, and with densities.
const TRACK: &str = "phi,r,r_err\n-25,49,1\n-15,57,1\n-5,63,1\n5,55,1\n15,54,1\n25,50,1\n";
const VELOCITIES: &str =
    "phi,r,r_err,v,v_err\n-15,57,1,,\n-5,63,1,20,9\n5,55,1,,\n15,54,1,,\n7,,,35,8\n";
const DENSITIES: &str =
    "phi,r,r_err,density,density_err\n-15,57,1,30,9\n-5,63,1,50,9\n5,55,1,40,9\n";

/// Puts values into a table, and keeps what else is there.
fn put(into: &mut Table, from: Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(more)) => put(inner, more),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

/// Makes the study of the quickstart a quick one.
fn make_quick(study: &Path) {
    let text = std::fs::read_to_string(study).expect("the study");
    let mut settings: Table = text.parse().expect("settings");
    settings.insert("allow_unconverged".to_owned(), true.into());
    for group in ["tracks", "mocks"] {
        let group = settings[group].as_table_mut().expect("a table");
        let fit = group["fit"].as_table_mut().expect("a table");
        put(fit, QUICK_FIT.parse().expect("settings"));
    }
    std::fs::write(study, settings.to_string()).expect("a study");
}

/// The line with what makes it quick.
fn quick(line: &str) -> String {
    match line.split_whitespace().nth(1) {
        Some("fit") if line.contains("--sampler") => format!("{line} {QUICK}"),
        Some("fit") => format!("{line} --sampler nested {QUICK}"),
        Some("population") => format!("{line} --allow-unconverged"),
        Some("doctor") => format!("{line} --seconds 1"),
        _ => line.to_owned(),
    }
}

#[test]
fn every_command_line_on_a_page_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = Path::new(env!("CARGO_BIN_EXE_oblate"));
    let bin = program.parent().expect("a folder").display().to_string();
    let path = format!("{bin}:{}", std::env::var("PATH").expect("a path"));
    let mut count = 0;
    for page in PAGES.iter().filter(|page| **page != "docs/tour.md") {
        let lines = command_lines(page);
        if lines.is_empty() {
            continue;
        }
        let folder = tempfile::tempdir().expect("a folder");
        for part in ["examples", "benches/peers"] {
            copy(&root.join(part), &folder.path().join(part));
        }
        make_quick(&folder.path().join("examples/quickstart.toml"));
        for (name, text) in [
            ("track.csv", TRACK),
            ("velocities.csv", VELOCITIES),
            ("densities.csv", DENSITIES),
        ] {
            std::fs::write(folder.path().join(name), text).expect("a track");
        }
        for line in lines {
            let output = Command::new("sh")
                .args(["-c", &quick(&line)])
                .env("PATH", &path)
                .env("HOME", folder.path())
                .current_dir(folder.path())
                .output()
                .expect("a shell");
            // Two quick runs need not agree.
            let disagrees = line.starts_with("oblate compare") && output.status.code() == Some(1);
            assert!(
                output.status.success() || disagrees,
                "{page}: {line}: {output:?}"
            );
            count += 1;
        }
    }
    assert!(count >= 10, "only {count} command lines");
}
