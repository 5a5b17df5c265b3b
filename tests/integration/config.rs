//! Settings as text.

use oblate::FitSettings;
use oblate::config::{StudyConfig, read};
use oblate::data::MockSettings;
use oblate::potential::HaloKind;
use oblate::stream::ModelSettings;
use std::path::Path;

/// The message about a settings file with this text.
fn refusal(text: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fit.toml");
    std::fs::write(&path, text).unwrap();
    read::<FitSettings>(&path).unwrap_err().to_string()
}

#[test]
fn settings_that_are_too_long_or_nested_too_deeply_are_refused() {
    let long = format!("seed = 1 #{}", "x".repeat(1 << 20));
    assert!(refusal(&long).contains("longer than 1 MiB"));
    for (deep, why) in [
        (format!("seed = {}", "[".repeat(20_000)), "more than 512"),
        (format!("seed = {}", "[".repeat(500)), "recurs"),
        (format!("a{} = 1", ".a".repeat(20_000)), "recurs"),
        (format!("[a{}]", ".a".repeat(20_000)), "recurs"),
        (format!("seed = {}", "{ a = ".repeat(500)), "recurs"),
        // The parser's own limit does not hold for tables without an equals sign.
        (
            "x = { a\ny = { b = 1 }\n".repeat(4_000),
            "line 513: more than 512",
        ),
    ] {
        let words = refusal(&deep);
        assert!(words.contains(why), "{words}");
    }
}

#[test]
fn a_list_in_the_place_of_a_table_is_refused() {
    // The values that it does not name would not be the defaults of streams.
    let words = refusal("[sampling]\nnested = [500]\n");
    assert!(
        words.contains("nested") && words.contains("not a table"),
        "{words}"
    );
}

#[test]
fn every_study_of_the_examples_can_begin() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let studies = std::fs::read_dir(examples.join("studies")).unwrap();
    let mut files: Vec<_> = studies.map(|entry| entry.unwrap().path()).collect();
    assert!(files.len() >= 3, "{files:?}");
    files.push(examples.join("quickstart.toml"));
    for file in files {
        let study: StudyConfig = read(&file).unwrap();
        assert!(
            study.check().is_ok(),
            "{}: {:?}",
            file.display(),
            study.check()
        );
    }
}

/// A model of mocks with some keys keeps the others of mocks: their random particles and their own table of releases.
#[test]
fn keys_of_the_model_of_mocks_are_taken_over_that_of_mocks() {
    let parse = |text: &str| toml::from_str::<MockSettings>(text);
    let given = parse("model = { halo = \"nfw_density\", releases = { particles = 4_000 } }");
    let mut expected = MockSettings::default();
    expected.model.halo = HaloKind::NfwDensity;
    expected.model.releases.particles = 4_000;
    assert_eq!(given.expect("settings"), expected);
    assert_ne!(
        expected.model.releases.seed,
        ModelSettings::default().releases.seed
    );
    for (wrong, word) in [
        ("model = { haloo = \"nfw\" }", "haloo"),
        ("model = { releases = { particle = 5 } }", "particle"),
        ("model = { releases = 3 }", "releases"),
    ] {
        let error = parse(wrong).expect_err(wrong).to_string();
        assert!(error.contains(word), "{error}");
    }
}
