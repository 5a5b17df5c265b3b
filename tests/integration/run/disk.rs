//! Full disks and killed processes: the folder is afterwards as if nothing had happened.
//!
//! A limit on the size of a file stands for the full disk: a write beyond it fails as one on a full disk does.

use crate::cli::{SMALL, example};
use crate::folders::tree;
use oblate_samplers::checkpoint::hash;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A nested fit into `fit` in a folder, under a limit of so many blocks of 512 bytes to every file.
fn fit(folder: &Path, flags: &str, blocks: Option<u32>) -> Output {
    let limit = blocks.map_or_else(String::new, |n| format!("trap '' XFSZ; ulimit -f {n}; "));
    fs::write(folder.join("small.toml"), SMALL).unwrap();
    Command::new("sh")
        .arg("-c")
        .arg(format!(
            "{limit}exec \"$0\" fit \"$1\" --config small.toml --checkpoint-every 0 --out fit --resume -q --allow-unconverged {flags}"
        ))
        .arg(env!("CARGO_BIN_EXE_oblate"))
        .arg(example("tracks/s2_spherical.ecsv"))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// The files of a finished fit but its log, each with a hash; the summary without its times.
fn files(path: &Path) -> Vec<(String, u64)> {
    let mut files = tree(path);
    files.remove(Path::new("log.jsonl"));
    files
        .into_iter()
        .map(|(path, content)| {
            let name = path.display().to_string();
            let mut content = content.unwrap_or_default();
            if name.starts_with("checkpoint") {
                // Kept by a run that has not converged; it has the times that the run took.
                content.clear();
            }
            if name == "summary.json" {
                let text = String::from_utf8(content).unwrap();
                let timeless = text.lines().filter(|line| !line.contains("_seconds\""));
                content = timeless.collect::<Vec<_>>().join("\n").into_bytes();
            }
            (name, hash(&content))
        })
        .collect()
}

#[test]
fn a_checkpoint_that_finds_no_room_leaves_the_one_before_it_and_no_trace() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = |name: &str| {
        let path = temporary.path().join(name);
        fs::create_dir_all(&path).unwrap();
        path
    };
    let (whole, full) = (folder("whole"), folder("full"));
    let output = fit(&whole, "", None);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    // Checkpoints grow with the run.
    let output = fit(&full, "", Some(40));
    let say = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{say}");
    assert!(
        say.contains("fit/checkpoint") && say.contains("make room") && say.contains("--resume"),
        "{say}"
    );
    let left: Vec<_> = tree(&full.join("fit")).into_keys().collect();
    assert!(left.contains(&"checkpoint".into()), "{left:?}");
    let output = fit(&full, "", None);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let say = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!say.contains("error") && !say.contains("warning"), "{say}");
    assert_eq!(files(&full.join("fit")), files(&whole.join("fit")));
}

#[test]
fn a_result_that_finds_no_room_is_written_by_a_resume_without_sampling() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    // The draws of the prior take more room than the checkpoint of a run that has just begun.
    let output = fit(folder, "--max-minutes 0", Some(31));
    let say = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{say}");
    for words in [
        "posterior.zarr/prior/",
        "no work is lost",
        "make room",
        "--resume",
    ] {
        assert!(say.contains(words), "{words}: {say}");
    }
    let names: Vec<_> = tree(&folder.join("fit")).into_keys().collect();
    let expected = [
        "checkpoint",
        "config.toml",
        "log.jsonl",
        "track.ecsv",
        "versions.json",
    ];
    assert_eq!(names, expected.map(Path::new));
    let output = fit(folder, "--max-minutes 0", None);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(folder.join("fit/summary.json").exists());
}
