//! What populations say of fits and posteriors of which they cannot say all, and how they are compared.

use super::population::STUDY;
use super::{json, oblate, write};
use std::path::Path;
use std::process::Output;

/// The draws of the fits of three mocks, without a population.
fn three_fits(folder: &Path) -> Vec<String> {
    let (mocks, _) = STUDY.split_once("[population]").expect("a population");
    let out = folder.join("study").display().to_string();
    let study = write(folder, "study.toml", &mocks.replace("OUT", &out));
    let output = oblate(&["run", &study, "-q"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let fits = std::fs::read_dir(folder.join("study/mocks")).expect("fits");
    let mut fits: Vec<String> = fits
        .map(|entry| entry.expect("an entry").path().display().to_string())
        .collect();
    fits.sort();
    fits
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn summary(run: &str) -> serde_json::Value {
    let bytes = std::fs::read(Path::new(run).join("summary.json"));
    json(&bytes.expect("a summary"))
}

#[test]
fn populations_say_no_more_than_their_draws_and_fits_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let fits = three_fits(folder.path());
    let run = |verb: &str, runs: &[String], more: &[&str]| -> Output {
        let mut args = vec![verb];
        args.extend(runs.iter().map(String::as_str));
        args.extend(more);
        oblate(&args, "")
    };
    let population = |out: &str, more: &[&str]| {
        let few = [
            "-q",
            "--allow-unconverged",
            "--set",
            "sampling.nested={n_live=60}",
            "--out",
            out,
        ];
        run("population", &fits, &[&few[..], more].concat())
    };

    // Stopped before its first draws: neither the streams nor the hyperparameters are to blame.
    let stopped = population(&path("stopped"), &["--max-minutes", "0"]);
    let said = text(&stopped.stdout) + &text(&stopped.stderr);
    for word in ["NOT MEASURED", "MODEL NOT ACCURATE"] {
        assert!(!said.contains(word), "{said}");
    }

    // The setting is that of `--set`, which comes after all flags.
    let beta = path("beta");
    let output = population(
        &beta,
        &["--family", "mixture", "--set", "family.name=\"beta\""],
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(summary(&beta)["parameters"]["ln_alpha_pop"].is_object());
    // A quarter of its prior has an infinite density at an end of the support.
    let table = std::fs::read_to_string(Path::new(&beta).join("density.csv")).expect("a table");
    let means: Vec<f64> = table
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .nth(1)
                .expect("a mean")
                .parse()
                .expect("a number")
        })
        .collect();
    assert_eq!(means.len(), 201);
    assert!(
        means.iter().all(|mean| (0.0..100.0).contains(mean)),
        "{means:?}"
    );

    // q of a stream in its own fit, of which the family has only a part.
    let narrow = path("narrow");
    let output = population(
        &narrow,
        &["--set", "family.q_min=0.8", "--set", "family.q_max=1.2"],
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    for (stream, fit) in fits.iter().enumerate() {
        let own = &summary(&narrow)["population"]["streams"][stream]["q"];
        assert_eq!(own["lo95"], summary(fit)["q"]["lo95"]);
        assert_eq!(own["hi95"], summary(fit)["q"]["hi95"]);
    }

    // With a selection, or another support, ln Z is of other data or of another model.
    let selection = write(
        folder.path(),
        "selection.toml",
        "[selection]\nq = [0.5, 1.5]\nkept = [0.9, 0.1]\nerror = [0.01, 0.01]\n",
    );
    let [plain, selected] = ["plain", "selected"].map(path);
    population(&plain, &[]);
    let output = population(&selected, &["--config", &selection]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    for (other, note, verdict) in [
        (
            &selected,
            "another selection",
            "other data, so that they need not agree",
        ),
        (
            &narrow,
            "another family, support or hyperprior",
            "two models; ln Z",
        ),
        (&fits[0], "a fit and a population", "other data"),
    ] {
        let output = run("compare", &[plain.clone(), other.clone()], &[]);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert!(text(&output.stderr).contains(note), "{output:?}");
        assert!(text(&output.stdout).contains(verdict), "{output:?}");
    }
    let output = run("compare", &fits[..2], &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(
        text(&output.stderr).contains("the fit of another track"),
        "{output:?}"
    );
    assert!(text(&output.stdout).contains("other data"), "{output:?}");

    // Populations have no ranks and no axes.
    let all = [&fits[..], std::slice::from_ref(&plain)].concat();
    for verb in ["calibration", "orientation"] {
        let output = run(verb, &all, &[]);
        assert_ne!(output.status.code(), Some(2), "{output:?}");
        let note = format!("skipped: {plain} is no fit of a track");
        assert!(text(&output.stderr).contains(&note), "{output:?}");
    }

    // A fit whose model is not accurate enough is taken, and named.
    let file = Path::new(&fits[1]).join("summary.json");
    let before = std::fs::read_to_string(&file).expect("a summary");
    let (head, checks) = before.split_once("\"model_checks\"").expect("checks");
    let checks = checks
        .replacen("\"pass\": true", "\"pass\": false", 1)
        .replacen("\"pass\":true", "\"pass\":false", 1);
    std::fs::write(&file, format!("{head}\"model_checks\"{checks}")).expect("a summary");
    let failed = summary(&fits[1])["model_checks"].clone();
    let failed = failed
        .as_array()
        .expect("checks")
        .iter()
        .find(|check| check["pass"] == false);
    let failed = failed.expect("a failed check")["name"]
        .as_str()
        .expect("a name")
        .to_owned();
    let warned = path("warned");
    population(&warned, &[]);
    let name = Path::new(&fits[1])
        .file_name()
        .expect("a name")
        .to_string_lossy();
    let warnings = summary(&warned)["model_warnings"].clone();
    let named = |warning: &serde_json::Value| {
        let warning = warning.as_str().expect("words");
        warning.contains(&format!("the fit {name} has failed checks of its model"))
            && warning.contains(&failed)
    };
    assert!(
        warnings.as_array().expect("warnings").iter().any(named),
        "{warnings}"
    );
}
