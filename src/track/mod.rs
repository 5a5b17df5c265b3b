//! From particles to one mean radius per angle from the progenitor.

mod bins;
mod stretch;

pub use bins::{BinEdges, BinGrid, PartialSums, Sums, Track, TrackBin};
