//! A prior predictive check before the fit: whether the prior can produce the track at all. A smooth likelihood is finite
//! everywhere, so the sampler itself would not detect it.

use super::target::StreamTarget;
use crate::error::{Error, Result};
use crate::likelihood::DataBin;
use oblate_samplers::rng::{Domain, stream};
use rayon::prelude::*;

/// Told how much of a work of many values is done, and of how many.
pub type Advanced<'a> = dyn FnMut(u64, u64) + 'a;

/// Number of prior draws.
const DRAWS: u64 = 1_000;

/// A bin is reached by a draw that covers it at a mean radius within this factor of the data's.
const FACTOR: f64 = 5.0;

/// Number of draws between two reports of progress.
const CHUNK: u64 = 50;

/// Checks that every data bin is reached by at least one of 1,000 prior draws: that the draw's track covers the bin, at a radius within
/// a factor of five of the data's. `advanced` is told how many of how many draws are done.
///
/// # Errors
/// [`Error::UnreachableTrack`] with the first bin that no draw reaches.
pub fn check_prior_predictive(
    target: &StreamTarget,
    seed: u64,
    advanced: &mut Advanced<'_>,
) -> Result<()> {
    let likelihood = target.likelihood();
    let grid = likelihood.track().grid();
    let data: Vec<_> = likelihood.track().data().copied().collect();
    let reached_by = |i: u64| -> Vec<bool> {
        let mut rng = stream(seed, Domain::Prior, 2, i);
        let params = target.stream_prior().draw(&mut rng);
        let track = likelihood.track_at(&params).map(|(track, _)| track);
        let track = track.unwrap_or_default();
        let near = |r: f64, of: f64| r < FACTOR * of && r > of / FACTOR;
        let covers =
            |d: &DataBin| (track.bins.iter()).any(|b| b.bin == d.bin && near(b.r_kpc, d.r_kpc));
        data.iter().map(covers).collect()
    };
    let either = |a: Vec<bool>, b: Vec<bool>| a.iter().zip(&b).map(|(a, b)| *a || *b).collect();
    let mut reached = vec![false; data.len()];
    for first in (0..DRAWS / CHUNK).map(|chunk| chunk * CHUNK) {
        let chunk = (first..first + CHUNK).into_par_iter().map(reached_by);
        reached = either(reached, chunk.reduce(|| vec![false; data.len()], either));
        advanced(first + CHUNK, DRAWS);
    }
    match reached.iter().position(|r| !r) {
        None => Ok(()),
        Some(i) => Err(Error::UnreachableTrack {
            tries: DRAWS,
            phi_deg: grid.centre_deg(data[i].bin),
            r_kpc: data[i].r_kpc,
        }),
    }
}
