//! From particles to one mean radius per angle from the progenitor.

mod bins;
mod segment;

pub use bins::{BinEdges, BinGrid, PartialSums, Sums, Track, TrackBin};
