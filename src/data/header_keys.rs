//! The keys of a track's header that are read, and words that are nearly one of them, which would be taken for free text.

use super::table::nearest;

/// The keys; `units` belongs to CSV alone.
pub const KEYS: [&str; 7] = [
    "name",
    "units",
    "bin_width",
    "distance",
    "assume_error",
    "handedness",
    "progenitor_pa",
];

/// Units that are written at the end of a key, though its value has them.
const UNITS: [&str; 3] = ["_deg", "_mpc", "_kpc"];

/// A comment line with its number in the file, from 1.
pub type Comment<'a> = (usize, &'a str);

/// What a comment says.
pub enum Entry<'a> {
    /// A key and its value.
    Value(&'static str, &'a str),
    /// What is not a key with a value, and the key that it is probably meant for.
    Nearly(&'a str, &'static str),
    /// Free text.
    Text,
}

/// The comments above the names of the columns, which are the header, and those below.
pub fn comments(text: &str) -> (Vec<Comment<'_>>, Vec<Comment<'_>>) {
    let is_names = |line: &str| !line.trim().is_empty() && !line.starts_with('#');
    let above = text.lines().position(is_names).unwrap_or(usize::MAX);
    let comments = (1..).zip(text.lines()).filter(|(_, l)| l.starts_with('#'));
    comments.partition(|(line, _)| *line <= above)
}

/// Reads a comment of CSV.
pub fn entry(comment: &str) -> Entry<'_> {
    let text = comment.trim_start_matches('#').trim();
    if let Some((key, value)) = text.split_once([':', '=']) {
        let key = key.trim();
        if let Some(known) = KEYS.iter().find(|known| **known == key) {
            return Entry::Value(known, value.trim());
        }
        if let Some(meant) = meant_by(key) {
            return Entry::Nearly(key, meant);
        }
    }
    // A key without its colon would be taken for free text.
    let end = [' ', '\t', ',', ':', '=', '(', '['];
    let word = text.split(end).next().unwrap_or_default();
    let lower = word.to_lowercase();
    let known = KEYS.iter().find(|known| **known == without_unit(&lower));
    match known.filter(|known| **known != "name") {
        Some(known) => Entry::Nearly(word, known),
        None => Entry::Text,
    }
}

/// The key that a word is probably meant for, if it is none itself. Four letters are too few to tell.
pub fn meant_by(word: &str) -> Option<&'static str> {
    let lower = word.to_lowercase();
    let near = nearest(without_unit(&lower), &KEYS).filter(|key| key.len() > 4);
    near.filter(|_| !KEYS.contains(&word))
}

/// A word without a unit at its end.
fn without_unit(word: &str) -> &str {
    let stem = UNITS.iter().find_map(|unit| word.strip_suffix(unit));
    stem.unwrap_or(word)
}
