//! A prior predictive check before the fit: whether the prior can produce the track at all. A smooth likelihood is finite
//! everywhere, so the sampler itself would not detect it.

use super::target::StreamTarget;
use crate::error::{Error, Result};
use oblate_samplers::rng::{Domain, stream};
use rayon::prelude::*;

/// Number of prior draws.
const DRAWS: u64 = 1_000;

/// A bin is reached by a draw that covers it at a mean radius within this factor of the data's.
const FACTOR: f64 = 5.0;

/// Checks that every data bin is reached by at least one of 1,000 prior draws: that the draw's track covers the bin, at a radius within
/// a factor of five of the data's.
///
/// # Errors
/// [`Error::UnreachableTrack`] with the first bin that no draw reaches.
pub fn check_prior_predictive(target: &StreamTarget, seed: u64) -> Result<()> {
    let likelihood = target.likelihood();
    let grid = likelihood.track().grid();
    let data: Vec<_> = likelihood.track().data().copied().collect();
    let reached = (0..DRAWS)
        .into_par_iter()
        .map(|i| {
            let params = target
                .stream_prior()
                .draw(&mut stream(seed, Domain::Prior, 2, i));
            let track = likelihood
                .track_at(&params)
                .map(|(track, _)| track)
                .unwrap_or_default();
            data.iter()
                .map(|d| {
                    track.bins.iter().any(|b| {
                        b.bin == d.bin && b.r_kpc < FACTOR * d.r_kpc && b.r_kpc > d.r_kpc / FACTOR
                    })
                })
                .collect::<Vec<bool>>()
        })
        .reduce(
            || vec![false; data.len()],
            |a, b| a.iter().zip(&b).map(|(a, b)| *a || *b).collect(),
        );
    match reached.iter().position(|r| !r) {
        None => Ok(()),
        Some(i) => Err(Error::UnreachableTrack {
            tries: DRAWS,
            phi_deg: grid.centre_deg(data[i].bin),
            r_kpc: data[i].r_kpc,
        }),
    }
}
