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

/// The key that a word is probably meant for, if it is none itself. Four letters are too few to tell.
pub fn meant_by(word: &str) -> Option<&'static str> {
    let near = nearest(word, &KEYS).filter(|key| key.len() > 4);
    near.filter(|_| !KEYS.contains(&word))
}
