//! The ranges of what a study makes: mocks, subsets, and runs whose settings are used late.

use super::{Row, rows};
use oblate::config::StudyConfig;

/// Whether a study of this many mocks, with this seed, may be run: the error's words otherwise.
fn study(count: u64, seed: u64) -> Result<(), String> {
    let text = format!(
        "title = 'a'\nout = 'b'\n[mocks]\ncount = {count}\nseed = {seed}\nsamplers = ['nested']"
    );
    let config: StudyConfig = toml::from_str(&text).map_err(|e| e.to_string())?;
    config.check().map_err(|e| e.to_string())
}

#[test]
fn the_number_of_mocks_of_a_study_is_that_of_the_page() {
    let rows = rows("4. Mocks");
    let range = |wanted: &str| {
        let row = rows.iter().find(|Row { key, .. }| key == wanted);
        let Row { lo, hi, .. } = row.expect("a row of the page");
        (*lo as u64, *hi as u64)
    };
    let (lo, hi) = range("seed");
    for seed in [lo, hi.min(i64::MAX as u64)] {
        assert_eq!(study(1, seed), Ok(()));
    }
    let (lo, hi) = range("count");
    for count in [lo, hi] {
        assert_eq!(study(count, 1), Ok(()));
    }
    assert!(study(hi + 1, 1).unwrap_err().contains("count = 100001"));
    assert!(
        study(lo - 1, 1)
            .unwrap_err()
            .contains("allowed 1 to 100000")
    );
}

#[test]
fn subsets_of_a_study_are_as_the_page_says() {
    let study = |sizes: &str, repeats: usize| {
        let text = format!(
            "title = 'a'\nout = 'b'\n[population]\nsamplers = ['nested']\nsubsets = {{ sizes = {sizes}, repeats = {repeats} }}"
        );
        let config: StudyConfig = toml::from_str(&text).expect("a study");
        config.check().map_err(|e| e.to_string())
    };
    assert_eq!(study("[1, 100000]", 1), Ok(()));
    assert_eq!(study("[]", 1_000), Ok(()));
    for (sizes, repeats, words) in [
        ("[0]", 1, "[population.subsets] sizes = 0"),
        ("[5, 100001]", 1, "sizes = 100001"),
        ("[10, 5, 10]", 1, "sizes = 10: name each value"),
        ("[5]", 0, "repeats = 0"),
        ("[5]", 1_001, "repeats = 1001"),
    ] {
        let error = study(sizes, repeats).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn a_study_is_refused_as_a_whole_for_settings_that_it_uses_late() {
    let text = "title = 'a'\nout = 'b'\n[population]\nsamplers = ['nested']\n\
                settings = { reweighting = { max_draws = 0 } }";
    let config: StudyConfig = toml::from_str(text).expect("a study");
    let error = config.check().unwrap_err().to_string();
    assert!(
        error.starts_with("[population.settings] reweighting.max_draws = 0"),
        "{error}"
    );
}
