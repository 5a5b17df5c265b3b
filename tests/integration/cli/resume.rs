//! Fits that are extended, or killed and continued.

use super::{json, oblate, small_fit};
use std::process::{Command, Stdio};

#[test]
fn a_tempered_fit_that_ended_too_soon_is_extended() {
    let (folder, config, track) = small_fit();
    let fit = |name: &str, coarse: &str, extensions: &str, more: &[&str]| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--sampler", "pt-hmc"];
        args.extend(["--coarse-particles", coarse, "--extensions", extensions]);
        args.extend(["--out", &out, "--json", "-q"]);
        args.extend(more);
        let output = oblate(&args, "");
        let say = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{say}");
        assert!(say.contains("sampling.pt_hmc.extensions="), "{say}");
        json(&output.stdout)
    };
    for coarse in ["0", "64"] {
        let name = |what: &str| format!("{what}{coarse}");
        let expected = fit(&name("at once"), coarse, "2", &[]);
        let short = fit(&name("in two"), coarse, "1", &[]);
        assert_ne!(short["ln_z"], expected["ln_z"]);
        let again = fit(&name("in two"), coarse, "1", &["--resume"]);
        assert_eq!(again["ln_z"], short["ln_z"]);
        // Killed during the extension, it is resumed with the same settings, and with more extensions continues.
        let out = folder.path().join(name("in two")).display().to_string();
        let going = [
            "fit",
            &track,
            "--config",
            &config,
            "--sampler",
            "pt-hmc",
            "--coarse-particles",
            coarse,
            "--extensions",
            "2",
            "--out",
            &out,
            "--resume",
            "--checkpoint-every",
            "0",
            "-q",
        ];
        let going = going.map(str::to_owned);
        assert!(killed(&going, 300));
        let again = fit(&name("in two"), coarse, "1", &["--resume"]);
        assert_eq!(again["ln_z"], short["ln_z"]);
        let longer = fit(&name("in two"), coarse, "2", &["--resume"]);
        assert_eq!(result(&longer), result(&expected), "{coarse}");
    }
}

/// A summary without the data of the processes that made it: their times, and the command of the last one.
fn result(summary: &serde_json::Value) -> serde_json::Value {
    let mut summary = summary.clone();
    summary["command"].take();
    for seconds in ["cpu_seconds", "wall_seconds"] {
        summary["cost"][seconds].take();
    }
    summary
}

/// Kills a command after so many milliseconds, and returns whether it was still running.
fn killed(args: &[String], after: u64) -> bool {
    let mut child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts");
    std::thread::sleep(std::time::Duration::from_millis(after));
    child.kill().expect("a kill");
    child.wait().expect("its end").code().is_none()
}

#[test]
fn a_fit_killed_at_twenty_moments_comes_to_the_numbers_of_one_never_stopped() {
    let (folder, config, track) = small_fit();
    for (what, sampler, flags) in [
        ("nested", "nested", &[][..]),
        ("pt-hmc", "pt-hmc", &[][..]),
        ("coarse", "nested", &["--coarse-particles", "64"][..]),
        ("both", "pt-hmc", &["--coarse-particles", "64"][..]),
    ] {
        let args = |out: &str, more: &[&str]| -> Vec<String> {
            let mut args = vec!["fit", &track, "--config", &config, "--out", out];
            args.extend(["--sampler", sampler, "--checkpoint-every", "0", "-q"]);
            args.extend(["--json", "--allow-unconverged"]);
            args.extend(flags);
            args.extend(more);
            args.into_iter().map(str::to_owned).collect()
        };
        let of = |args: &[String]| -> serde_json::Value {
            let args: Vec<&str> = args.iter().map(String::as_str).collect();
            let output = oblate(&args, "");
            let say = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(0), "{say}");
            json(&output.stdout)
        };
        let whole = folder.path().join(format!("whole_{what}"));
        let begun = std::time::Instant::now();
        let expected = of(&args(&whole.display().to_string(), &[]));
        let millis = u64::try_from(begun.elapsed().as_millis()).expect("a short fit");
        let out = folder.path().join(format!("killed_{what}"));
        let name = out.display().to_string();
        // Kills from the start to a fifth of a whole run, each at another time; on a slow computer there are as many.
        let mut kills = 0;
        for kill in 1..=20 {
            let after = 2 + millis * (kill * 7 % 20) / 100;
            kills += usize::from(killed(&args(&name, &["--resume"]), after));
            if out.join("summary.json").exists() {
                break;
            }
        }
        assert!(kills >= 3, "{what}: {kills} kills");
        if what == "nested" && !out.join("summary.json").exists() {
            // No time at all: still a result, which says that it is unfinished and can be resumed.
            let spent = of(&args(&name, &["--resume", "--max-minutes", "0"]));
            assert_eq!(spent["converged"], false);
            // The last kill may have come between the run's end and its summary.
            let over = spent["status"] == "complete";
            assert!(
                over || spent["status"] == "budget-spent",
                "{}",
                spent["status"]
            );
            assert_eq!(spent["ln_z"] == expected["ln_z"], over);
        }
        let resumed = of(&args(&name, &["--resume"]));
        assert_eq!(result(&resumed), result(&expected), "{what}");
    }
}
