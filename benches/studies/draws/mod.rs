//! Draws of posteriors of the gala tracks, from benches/draws.csv.

use oblate::params::DIM;
use std::path::Path;

/// The name of each draw's track, and its thirteen parameters.
pub fn draws() -> Vec<(String, [f64; DIM])> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/draws.csv");
    csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(file)
        .expect("the draws")
        .deserialize()
        .map(|row| row.expect("a name and 13 numbers"))
        .collect()
}
