//! How many values of ln L this machine computes in a second, and how long a fit takes with them.

use super::settings::FitSettings;
use super::target::StreamTarget;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::params::{DIM, REQUIRED, without_optional};
use oblate_samplers::Error as SamplerError;
use oblate_samplers::rng::{Domain, stream};
use std::time::{Duration, Instant};

/// Draws of the posteriors of five tracks, the track's name first: the points of a fit cost as much as these.
const DRAWS: &str = include_str!("../../benches/draws.csv");

/// So many values of the coarse model take as long as the shortest coarse stage of a default fit with all 13 parameters free, moves along the surrogate
/// included (docs/validation.md, section 3), as their mean, and as twice the longest of thirteen tracks.
const COARSE_VALUES: [f64; 3] = [3e5, 1.2e6, 4.5e6];

/// The same for values of the model itself, in the bridge (docs/validation.md, section 3), without further MCMC steps, in the mean, and with all of
/// them.
const VALUES: [f64; 3] = [7e3, 1e5, 5e5];

/// Draws of the prior from which [`Speed::of_fit`] takes the best, and how many of these.
const PRIOR_DRAWS: u64 = 400;
const BEST: usize = 8;

/// Number of these draws between two looks at an interrupt.
const CHUNK: usize = 20;

/// Time for which [`Speed::of_fit`] measures each model.
const SHORT: Duration = Duration::from_millis(100);

/// Values of ln L per second, on all threads of the present rayon pool, and the number of parameters of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Of the model.
    pub model: f64,
    /// Of the coarse model, if the fit samples one first.
    pub coarse: Option<f64>,
    /// Number of free parameters of the fit.
    pub free: usize,
}

impl Speed {
    /// Measures for some time, half of it for each model of a default fit.
    ///
    /// # Errors
    /// None but those of a model of default settings, which cannot be wrong.
    pub fn measure(time: Duration) -> Result<Self> {
        let settings = FitSettings::default();
        let phi: Vec<f64> = (0..15).map(|k| f64::from(10 * k - 70)).collect();
        let (r, r_err) = (vec![60.0; phi.len()], vec![1.0; phi.len()]);
        let track = ObservedTrack::new("speed", &phi, 10.0, &r, &r_err)?;
        // Comments and the header have no numbers.
        let points: Vec<[f64; DIM]> = DRAWS
            .lines()
            .filter_map(|line| {
                let values: Option<Vec<f64>> =
                    line.split(',').skip(1).map(|v| v.parse().ok()).collect();
                Some(without_optional(values?.try_into().ok()?))
            })
            .collect();
        let (model, coarse) = targets(&track, &settings)?;
        let model = values_per_second(&model, &points, time / 2);
        Ok(Self {
            model,
            coarse: coarse.map(|c| values_per_second(&c, &points, time / 2)),
            free: REQUIRED,
        })
    }

    /// Measures for a part of a second, with the models of this fit, near its track: at the best of some hundred draws of its prior, unless
    /// the work is `interrupted` meanwhile.
    ///
    /// # Errors
    /// As of [`StreamTarget::from_track`]; [`Error::Sampler`] after an interrupt.
    pub fn of_fit(
        track: &ObservedTrack,
        settings: &FitSettings,
        interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self> {
        let (model, coarse) = targets(track, settings)?;
        let first = coarse.as_ref().unwrap_or(&model);
        let draws: Vec<[f64; DIM]> = (0..PRIOR_DRAWS)
            .map(|i| {
                let mut rng = stream(settings.seed, Domain::Prior, 3, i);
                first.stream_prior().draw(&mut rng).to_array()
            })
            .collect();
        let mut values = Vec::new();
        for draws in draws.chunks(CHUNK) {
            values.extend(first.likelihood().ln_likelihoods(draws));
            if interrupted() {
                return Err(Error::Sampler(SamplerError::Interrupted));
            }
        }
        let mut kept: Vec<(f64, [f64; DIM])> = (values.iter().zip(draws))
            .filter_map(|(value, draw)| Some((value.as_ref().ok()?.ln_likelihood, draw)))
            .collect();
        kept.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let points: Vec<[f64; DIM]> = kept.into_iter().map(|(_, draw)| draw).take(BEST).collect();
        Ok(Self {
            model: values_per_second(&model, &points, SHORT),
            coarse: coarse.map(|c| values_per_second(&c, &points, SHORT)),
            free: model.stream_prior().free().len(),
        })
    }

    /// Values per second of the model that a fit samples first: the coarse one, if it has one.
    #[must_use]
    pub fn first(&self) -> f64 {
        self.coarse.unwrap_or(self.model)
    }

    /// Shortest, mean and longest time of a fit by the default sampler, seconds: those of default fits, in proportion to the number of free parameters.
    #[must_use]
    pub fn seconds_of_fit(&self) -> [f64; 3] {
        let share = self.free as f64 / REQUIRED as f64;
        [0, 1, 2].map(|k| {
            let bridge = self.coarse.map_or(0.0, |_| VALUES[k] / self.model);
            share * (COARSE_VALUES[k] / self.first() + bridge)
        })
    }
}

/// The model of a fit, and the coarse one that it samples first, if it does.
fn targets(
    track: &ObservedTrack,
    settings: &FitSettings,
) -> Result<(StreamTarget, Option<StreamTarget>)> {
    let coarse = settings.coarse(track.bin_width_deg);
    let coarse = coarse.map(|coarse| StreamTarget::from_track(track, &coarse));
    Ok((
        StreamTarget::from_track(track, settings)?,
        coarse.transpose()?,
    ))
}

/// Values of ln L per second at these points; 0 without a point.
fn values_per_second(target: &StreamTarget, points: &[[f64; DIM]], time: Duration) -> f64 {
    // Every thread has some points at a time, as in a sampler.
    let batch = points.repeat(rayon::current_num_threads());
    // The first values allocate memory.
    let _ = target.likelihood().ln_likelihoods(points);
    let (began, mut count) = (Instant::now(), 0);
    while !batch.is_empty() && (count == 0 || began.elapsed() < time) {
        let values = target.likelihood().ln_likelihoods(&batch);
        count += values.len();
    }
    count as f64 / began.elapsed().as_secs_f64()
}
