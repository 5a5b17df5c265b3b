//! From particles to one mean radius per angle from the progenitor.

mod bins;

pub use bins::{BinEdges, BinGrid, Sums, Track, TrackBin};
