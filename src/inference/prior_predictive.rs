//! A prior predictive check before the fit: whether the prior can produce the track at all. A smooth likelihood is finite
//! everywhere, so the sampler itself would not detect it.

use super::target::StreamTarget;
use crate::error::{Error, Result};
use crate::likelihood::DataBin;
use oblate_samplers::Error as SamplerError;
use oblate_samplers::rng::{Domain, stream};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Told how much of a work of many values is done, and of how many; `Break` stops the work there.
pub type Advanced<'a> = dyn FnMut(u64, u64) -> ControlFlow<()> + 'a;

/// Number of prior draws.
const DRAWS: u64 = 1_000;

/// A bin is reached by a draw that covers it at a mean radius within this factor of the data's.
const FACTOR: f64 = 5.0;

/// Number of draws between two reports of progress.
const CHUNK: u64 = 50;

/// Checks which data bins are reached by none of 1,000 prior draws: by none whose track covers the bin, at a radius within
/// a factor of five of the data's. `advanced` is told how many of how many draws are done. The ends of a track that winds far are rare, and
/// some bins may be out of reach; returns a warning that names them.
///
/// # Errors
/// [`Error::UnreachableTrack`] if no draw reaches more than half of the bins; [`SamplerError::Interrupted`] if `advanced` stops it.
pub fn check_prior_predictive(
    target: &StreamTarget,
    seed: u64,
    advanced: &mut Advanced<'_>,
) -> Result<Option<String>> {
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
        if advanced(first + CHUNK, DRAWS).is_break() {
            return Err(SamplerError::Interrupted.into());
        }
    }
    let unreached: Vec<&DataBin> = (data.iter().zip(&reached))
        .filter_map(|(bin, reached)| (!reached).then_some(bin))
        .collect();
    let Some(first) = unreached.first() else {
        return Ok(None);
    };
    if 2 * unreached.len() > data.len() {
        return Err(Error::UnreachableTrack {
            tries: DRAWS,
            bins: data.len(),
            unreached: unreached.len(),
            phi_deg: grid.centre_deg(first.bin),
            r_kpc: first.r_kpc,
        });
    }
    let centres: Vec<String> = (unreached.iter())
        .map(|bin| grid.centre_deg(bin.bin).to_string())
        .collect();
    Ok(Some(format!(
        "none of {DRAWS} prior draws covers the bins at phi = {} deg within a factor of five of their radii: so it may be where a track winds \
         far; otherwise check these rows",
        centres.join(", ")
    )))
}
