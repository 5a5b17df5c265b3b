//! The selection of streams: which fraction of them is kept at each q.

use super::mock::is_kept;
use super::mock_settings::MockSettings;
use crate::error::{Error, Result};
use crate::params::{AXIS_RATIOS, StreamPrior};
use crate::stream::Model;
use oblate_samplers::limits::{MAX_SEED, in_range};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// The fraction of streams that are kept, at some values of q. Between them it is linear, beyond them constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// Values of q, in increasing order.
    pub q: Vec<f64>,
    /// Fraction of the streams of this q that are kept; a common factor has no influence on a population.
    pub kept: Vec<f64>,
    /// Standard error of each fraction.
    pub error: Vec<f64>,
}

/// Allowed numbers of values of q of a [`Selection`].
pub const SELECTION_POINTS: RangeInclusive<usize> = 2..=10_000;

/// Allowed numbers of streams that are made at each value of q.
pub const SELECTION_DRAWS: RangeInclusive<usize> = 10..=10_000_000;

impl Selection {
    /// Checks every number by itself: the ranges of docs/limits.md. Checks then that the lists have one length and that q increases.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        let Self { q, kept, error } = self;
        for value in q {
            in_range("selection.q", *value, 0.0..=*AXIS_RATIOS.end())?;
        }
        for value in kept {
            in_range("selection.kept", *value, 1e-9..=1.0)?;
        }
        for value in error {
            in_range("selection.error", *value, 0.0..=1.0)?;
        }
        in_range("number of selection.q", q.len(), SELECTION_POINTS)?;
        let refuse = |key: &str, value: String, remedy: &str| {
            Err(Error::Setting {
                key: key.to_owned(),
                value,
                remedy: remedy.to_owned(),
            })
        };
        for (key, list) in [("selection.kept", kept), ("selection.error", error)] {
            if list.len() != q.len() {
                let value = format!("{} numbers", list.len());
                return refuse(key, value, "give one number for each of selection.q");
            }
        }
        match q.windows(2).find(|pair| pair[0] >= pair[1]) {
            Some(pair) => refuse(
                "selection.q",
                format!("{:?}, {:?}", pair[0], pair[1]),
                "give q in increasing order, each once",
            ),
            None => Ok(()),
        }
    }

    /// The two neighbouring rows of a value of q, and how much of the second is taken.
    #[must_use]
    pub fn neighbours(&self, q: f64) -> (usize, usize, f64) {
        let last = self.q.len() - 1;
        match self.q.partition_point(|at| *at <= q) {
            0 => (0, 0, 0.0),
            above if above > last => (last, last, 0.0),
            above => {
                let (lo, hi) = (self.q[above - 1], self.q[above]);
                (above - 1, above, (q - lo) / (hi - lo))
            }
        }
    }

    /// The fraction at a value of q.
    #[must_use]
    pub fn at(&self, q: f64) -> f64 {
        let (below, above, part) = self.neighbours(q);
        self.kept[below] * (1.0 - part) + self.kept[above] * part
    }
}

/// Estimates the selection of mocks: at `points` values of q, the middles of equal cells of the prior's range, `draws` streams are made
/// with the other parameters from the prior, the same at every q, and those that meet the criteria are counted. `advanced` is told the
/// number of values of q that are done.
///
/// # Errors
/// Those of [`MockSettings::check`] and [`ModelSettings::check_distributions`](crate::stream::ModelSettings::check_distributions);
/// [`Error::OutOfRange`] for numbers of points, draws or seeds that are not allowed;
/// [`Error::Setting`] for settings with a population of q; [`Error::TooMuchMemory`] as of [`mocks`](super::mocks()); [`Error::NoneKept`] if
/// no draw of some q meets the criteria.
pub fn selection(
    prior: &StreamPrior,
    settings: &MockSettings,
    points: usize,
    draws: usize,
    seed: u64,
    advanced: &mut dyn FnMut(usize),
) -> Result<Selection> {
    settings.check()?;
    in_range("points", points, SELECTION_POINTS)?;
    in_range("draws", draws, SELECTION_DRAWS)?;
    in_range("seed", seed, 0..=MAX_SEED)?;
    if settings.population.is_some() {
        return Err(Error::Setting {
            key: "population".to_owned(),
            value: "given".to_owned(),
            remedy: "leave it out: a selection is made at every q".to_owned(),
        });
    }
    settings
        .model
        .memory(rayon::current_num_threads())
        .check()?;
    settings.model.check_distributions(prior)?;
    prior.check_sides()?;
    let model = Model::new(&settings.model)?;
    let (lo, hi) = (prior.settings().q_min, prior.settings().q_max);
    let mut found = Selection {
        q: Vec::new(),
        kept: Vec::new(),
        error: Vec::new(),
    };
    for point in 0..points {
        let q = lo + (hi - lo) * (point as f64 + 0.5) / points as f64;
        let kept = (0..draws as u64)
            .into_par_iter()
            .filter(|index| is_kept(prior, settings, &model, q, seed, *index))
            .count();
        if kept == 0 {
            return Err(Error::NoneKept {
                q,
                tries: draws as u64,
            });
        }
        let n = draws as f64;
        // Half a stream more of each outcome, so that a fraction of 1 has an error.
        let fraction = (kept as f64 + 0.5) / (n + 1.0);
        found.q.push(q);
        found.kept.push(kept as f64 / n);
        found.error.push((fraction * (1.0 - fraction) / n).sqrt());
        advanced(point + 1);
    }
    Ok(found)
}
