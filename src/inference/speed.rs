//! How many values of ln L this machine computes in a second, and how long a default fit takes with them.

use super::settings::FitSettings;
use super::target::StreamTarget;
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::params::{DIM, without_optional};
use std::time::{Duration, Instant};

/// Draws of the posteriors of five tracks, the track's name first: the points of a fit cost as much as these.
const DRAWS: &str = include_str!("../../benches/draws.csv");

/// So many values of the coarse model take as long as the shortest coarse stage of a default fit with all 13 parameters free, moves along the surrogate
/// included (docs/validation.md, section 4), and as the longest (section 5, s0).
const COARSE_VALUES: [f64; 2] = [3e5, 13e6];

/// The same for values of the model itself, in the bridge (docs/validation.md, section 4), without further MCMC steps and with all of them.
const VALUES: [f64; 2] = [2e4, 1.5e5];

/// Values of ln L per second, on all threads of the present rayon pool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Of the default model.
    pub model: f64,
    /// Of the coarse model that a default fit samples first.
    pub coarse: f64,
}

impl Speed {
    /// Measures for some time, half of it for each model.
    ///
    /// # Errors
    /// None but those of a model of default settings, which cannot be wrong.
    pub fn measure(time: Duration) -> Result<Self> {
        let settings = FitSettings::default();
        let phi: Vec<f64> = (0..15).map(|k| f64::from(10 * k - 70)).collect();
        let (r, r_err) = (vec![60.0; phi.len()], vec![1.0; phi.len()]);
        let track = ObservedTrack::new("speed", &phi, 10.0, &r, &r_err)?;
        let model = values_per_second(&StreamTarget::from_track(&track, &settings)?, time / 2);
        let coarse = match settings.coarse(track.bin_width_deg) {
            Some(coarse) => {
                values_per_second(&StreamTarget::from_track(&track, &coarse)?, time / 2)
            }
            None => model,
        };
        Ok(Self { model, coarse })
    }

    /// Shortest and longest time of a default fit with all 13 parameters free, seconds.
    #[must_use]
    pub fn seconds_of_fit(&self) -> [f64; 2] {
        [0, 1].map(|k| COARSE_VALUES[k] / self.coarse + VALUES[k] / self.model)
    }
}

fn values_per_second(target: &StreamTarget, time: Duration) -> f64 {
    // Comments and the header have no numbers.
    let points: Vec<[f64; DIM]> = DRAWS
        .lines()
        .filter_map(|line| {
            let values: Option<Vec<f64>> =
                line.split(',').skip(1).map(|v| v.parse().ok()).collect();
            Some(without_optional(values?.try_into().ok()?))
        })
        .collect();
    // Every thread has some points at a time, as in a sampler.
    let batch = points.repeat(rayon::current_num_threads());
    // The first values allocate memory.
    let _ = target.likelihood().ln_likelihoods(&points);
    let (began, mut count) = (Instant::now(), 0);
    while count == 0 || began.elapsed() < time {
        let values = target.likelihood().ln_likelihoods(&batch);
        count += values.len();
    }
    count as f64 / began.elapsed().as_secs_f64()
}
