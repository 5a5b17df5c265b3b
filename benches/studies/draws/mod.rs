//! Draws of the posteriors of the gala tracks, from benches/draws.csv.

use oblate::params::{DIM, REQUIRED, without_optional};
use std::path::Path;

/// A draw of the posterior of a track.
pub struct Draw {
    /// The track's name.
    pub track: String,
    /// All parameters; optional ones are absent.
    pub theta: [f64; DIM],
}

/// All draws, track by track.
pub fn draws() -> Vec<Draw> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/draws.csv");
    csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(file)
        .expect("the draws")
        .deserialize()
        .map(|row| row.expect("a name and 13 numbers"))
        .map(|(track, theta): (String, [f64; REQUIRED])| Draw {
            track,
            theta: without_optional(theta),
        })
        .collect()
}
