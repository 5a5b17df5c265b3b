//! The ranges of flags, and of the number of threads in the environment.

use super::{Row, rows};
use crate::cli::{example, oblate};
use std::process::Command;

#[test]
fn the_ranges_of_flags_are_those_of_the_page() {
    let params = example("stream.toml").display().to_string();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out").display().to_string();
    for Row { key, lo, hi } in rows("5. Flags") {
        let arguments: &[&str] = match key.as_str() {
            "--threads" => &["stream", "nowhere"],
            "--seconds" => &["doctor"],
            "--checkpoint-every" | "--max-minutes" => &["population", "nowhere", "--out", &out],
            _ => &["stream", &params, "--particles", "64"],
        };
        let words = |value: f64| {
            let flag = format!("{key}={value}");
            let output = oblate(&[arguments, &[&flag]].concat(), "");
            String::from_utf8(output.stderr).expect("text")
        };
        let refusal = format!("error: {key} = ");
        for end in [lo, hi] {
            // The edge may be half of the bin width at most, which is that of the default here.
            let end = if key == "--edge" { end.min(5.0) } else { end };
            let words = words(end);
            assert!(!words.contains(&refusal), "{words}");
        }
        let step = if key.starts_with("--bin") || key == "--edge" || key == "--min-fraction" {
            1e-3
        } else {
            1.0
        };
        let least = if step < 1.0 || lo > 0.0 {
            lo - step
        } else {
            hi + 2.0
        };
        for beyond in [least, hi + step] {
            let words = words(beyond);
            assert!(words.contains(&refusal), "{key}={beyond}: {words}");
            assert!(words.contains(": allowed "), "{words}");
        }
    }
}

#[test]
fn more_threads_in_the_environment_than_in_a_flag_are_refused_too() {
    let params = example("stream.toml").display().to_string();
    let words = |threads: &str| {
        let command = Command::new(env!("CARGO_BIN_EXE_oblate"))
            .args(["stream", &params, "--particles", "64"])
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .expect("the command");
        String::from_utf8(command.stderr).expect("text")
    };
    assert_eq!(words("0"), "");
    assert_eq!(words("1024"), "");
    let refused = words("1000000");
    assert!(
        refused.contains("RAYON_NUM_THREADS = 1000000: allowed 0 to 1024"),
        "{refused}"
    );
}
