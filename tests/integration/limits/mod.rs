//! The ranges of docs/limits.md are those of the code: values at their ends pass, values beyond fail, and no number is left out.

mod flags;
mod memory;
mod mocks;
mod parameters;
mod settings;
mod study;
mod track;

use std::num::ParseFloatError;
use std::path::Path;

/// A row of a table of the page.
struct Row {
    key: String,
    lo: f64,
    hi: f64,
}

/// The text of docs/limits.md.
fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/limits.md");
    std::fs::read_to_string(path).expect("the page")
}

/// A number as the page writes it.
fn number(text: &str) -> Result<f64, ParseFloatError> {
    text.replace(',', "").parse()
}

/// The ranges "LO to HI" in the line of the page that begins with these words.
fn ranges(words: &str) -> Vec<(f64, f64)> {
    let page = page();
    let mut lines = page.lines();
    let line = lines
        .find(|line| line.starts_with(words))
        .expect("the line");
    let words: Vec<&str> = line
        .split_whitespace()
        .filter(|word| *word != "%")
        .collect();
    let between = |three: &[&str]| match three {
        [lo, "to", hi] => Some((number(lo).ok()?, number(hi).ok()?)),
        _ => None,
    };
    words.windows(3).filter_map(between).collect()
}

/// The rows of a section of docs/limits.md.
fn rows(section: &str) -> Vec<Row> {
    let page = page();
    let heading = format!("## {section}\n");
    let text = page.split(&heading).nth(1).expect("the section");
    let text = text.split("\n## ").next().expect("its text");
    let rows: Vec<Row> = text
        .lines()
        .filter_map(|line| {
            let mut cells = line.strip_prefix('|')?.split('|').map(str::trim);
            let key = cells.next()?.trim_matches('`').to_owned();
            let (lo, hi) = cells.next()?.split_once(" to ")?;
            Some(Row {
                key,
                lo: number(lo).expect("a number"),
                hi: number(hi).expect("a number"),
            })
        })
        .collect();
    assert!(rows.len() > 2, "{section}: only {} rows", rows.len());
    rows
}
