//! Calibration of fits: the ranks of the true values of mocks in their posteriors, and how often intervals contain them.
//!
//! If parameters are drawn from the prior and data from the model, the posterior probability below the true value is uniformly
//! distributed, and a central interval of any probability contains the true value as often as that probability says (Cook, Gelman and
//! Rubin 2006; Talts et al. 2018). A choice of mocks by their data alone changes neither.

use crate::data::TrackExtent;
use serde::{Deserialize, Serialize};
use statrs::distribution::Uniform;
use statrs::stats_tests::NaNPolicy;
use statrs::stats_tests::ks_test::{KSOneSampleAlternativeMethod, ks_onesample};
use std::collections::BTreeMap;

/// Probabilities of the central intervals whose coverage is counted.
pub const LEVELS: [f64; 4] = [0.5, 0.68, 0.9, 0.95];

/// A set of fits is not calibrated if ranks as far from uniform as those of its worst quantity have less than this probability, with
/// the number of quantities taken into account.
pub const MIN_P_VALUE: f64 = 0.01;

/// Number of groups, of as many fits each, by the number of bins of their tracks.
const GROUPS: usize = 3;

/// The true values of one mock in its posterior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankedFit {
    /// The name of the fit.
    pub name: String,
    /// Radii of its track, by which fits of one track are recognised.
    pub r_kpc: Vec<f64>,
    /// How far its track extends.
    pub extent: TrackExtent,
    /// Mean over its posterior of |q - true q|; none without q.
    pub q_error: Option<f64>,
    /// Whether it has passed its checks.
    pub converged: bool,
    /// Its effective sample size.
    pub ess: f64,
    /// Its likelihood calls.
    pub calls: u64,
    /// Its time of all threads together.
    pub cpu_seconds: f64,
    /// By name: the posterior probability below the true value, from 0 to 1.
    pub ranks: Vec<(String, f64)>,
}

/// The calibration of one quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationRow {
    /// Its name.
    pub name: String,
    /// Number of fits.
    pub fits: usize,
    /// Mean of the ranks; 0.5 is expected, with a standard deviation of `1 / sqrt(12 fits)`. True values are too low in the posterior
    /// if it is below.
    pub mean_rank: f64,
    /// Largest distance of the distribution of ranks from the uniform one (Kolmogorov and Smirnov).
    pub distance: f64,
    /// Probability of a larger distance if ranks are uniform; asymptotic, which is too large for few fits.
    pub p_value: f64,
    /// Fraction of the fits whose central interval of each of [`LEVELS`] contains the true value.
    pub coverage: [f64; LEVELS.len()],
}

/// The calibration of q for tracks of some numbers of bins.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationGroup {
    /// Smallest and largest number of bins.
    pub bins: (usize, usize),
    /// q.
    pub row: CalibrationRow,
}

/// The calibration of a set of fits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Every quantity, over all fits.
    pub all: Vec<CalibrationRow>,
    /// Every quantity, over the fits that have passed their checks; empty if none has.
    pub converged: Vec<CalibrationRow>,
    /// q by the number of bins, over the fits that have passed their checks; empty without q or with fewer than three fits.
    pub q_by_bins: Vec<CalibrationGroup>,
}

/// The posterior probability below a value; draws that are equal to it count half.
#[must_use]
pub fn rank(values: &[f64], weights: &[f64], truth: f64) -> f64 {
    let (mut below, mut total) = (0.0, 0.0);
    for (value, weight) in values.iter().zip(weights) {
        total += weight;
        if *value < truth {
            below += weight;
        } else if value.total_cmp(&truth).is_eq() {
            below += 0.5 * weight;
        }
    }
    below / total
}

impl CalibrationRow {
    /// From the ranks of one quantity.
    #[must_use]
    pub fn new(name: &str, ranks: &[f64]) -> Self {
        let fits = ranks.len();
        let within = |level: f64| {
            let inside = ranks.iter().filter(|u| (*u - 0.5).abs() <= 0.5 * level);
            inside.count() as f64 / fits as f64
        };
        let tested = ks_onesample(
            ranks.to_vec(),
            &Uniform::standard(),
            KSOneSampleAlternativeMethod::TwoSidedAsymptotic,
            NaNPolicy::Propogate,
        );
        let (distance, p_value) = tested.unwrap_or((f64::NAN, f64::NAN));
        Self {
            name: name.to_owned(),
            fits,
            mean_rank: ranks.iter().sum::<f64>() / fits as f64,
            distance,
            p_value,
            coverage: LEVELS.map(within),
        }
    }

    /// Standard deviation of the coverage of a level, if it is right.
    #[must_use]
    pub fn coverage_error(&self, level: f64) -> f64 {
        (level * (1.0 - level) / self.fits as f64).sqrt()
    }
}

impl Calibration {
    /// From the ranks of fits.
    #[must_use]
    pub fn new(fits: &[RankedFit]) -> Self {
        let converged: Vec<&RankedFit> = fits.iter().filter(|fit| fit.converged).collect();
        Self {
            all: rows(&fits.iter().collect::<Vec<_>>()),
            q_by_bins: by_bins(&converged),
            converged: rows(&converged),
        }
    }

    /// The rows that the verdict is about: those of the fits that have passed their checks, or of all where none has.
    #[must_use]
    pub fn judged(&self) -> &[CalibrationRow] {
        if self.converged.is_empty() {
            &self.all
        } else {
            &self.converged
        }
    }

    /// The quantity whose ranks are the least probable, and that probability with the number of quantities taken into account.
    #[must_use]
    pub fn worst(&self) -> Option<(&CalibrationRow, f64)> {
        let judged = self.judged();
        let row = judged
            .iter()
            .min_by(|a, b| a.p_value.total_cmp(&b.p_value))?;
        Some((row, (row.p_value * judged.len() as f64).min(1.0)))
    }

    /// Whether no quantity is out of calibration, by [`MIN_P_VALUE`].
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        self.worst().is_none_or(|(_, p)| p >= MIN_P_VALUE)
    }
}

/// One row for each quantity, in the order of the first fit that has it.
fn rows(fits: &[&RankedFit]) -> Vec<CalibrationRow> {
    let mut order: Vec<&str> = Vec::new();
    let mut ranks: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, u) in fits.iter().flat_map(|fit| &fit.ranks) {
        if !ranks.contains_key(name.as_str()) {
            order.push(name);
        }
        ranks.entry(name).or_default().push(*u);
    }
    let row = |name: &&str| CalibrationRow::new(name, &ranks[name]);
    order.iter().map(row).collect()
}

/// q in groups of as many fits each by the number of bins.
fn by_bins(fits: &[&RankedFit]) -> Vec<CalibrationGroup> {
    let of_q = |fit: &&RankedFit| {
        let q = fit.ranks.iter().find(|(name, _)| name == "q");
        q.map(|(_, u)| (fit.r_kpc.len(), *u))
    };
    let mut ranked: Vec<(usize, f64)> = fits.iter().filter_map(of_q).collect();
    ranked.sort_by_key(|(bins, _)| *bins);
    let n = ranked.len();
    if n < GROUPS {
        return Vec::new();
    }
    let group = |k: usize| {
        // Tracks of one number of bins stay together: a group ends where the number changes.
        let end = |k: usize| {
            let at = ranked[(k * n / GROUPS).min(n - 1)].0;
            if k == GROUPS {
                n
            } else {
                ranked.partition_point(|(bins, _)| *bins < at)
            }
        };
        let part = &ranked[end(k)..end(k + 1)];
        let (first, last) = (part.first()?, part.last()?);
        let u: Vec<f64> = part.iter().map(|(_, u)| *u).collect();
        Some(CalibrationGroup {
            bins: (first.0, last.0),
            row: CalibrationRow::new("q", &u),
        })
    };
    (0..GROUPS).filter_map(group).collect()
}
