//! The population density of q, from draws of the hyperparameters, for tables and figures.

use super::family::Family;
use crate::error::{Error, Result};
use oblate_samplers::diagnostics::weighted_quantile;
use oblate_samplers::output::Draws;
use serde::{Deserialize, Serialize};

/// Equal-weight draws of the hyperparameters that the bands are made of: the error of a 2.5 % quantile is then 0.35 %
/// in probability, below a line's width.
const BAND_DRAWS: usize = 2_000;

/// The population density of q on a grid, at the two ends of the support that of half a step inside, as the density of some families is infinite there: its posterior mean, which is the predictive density of a new halo's q, and
/// the median with pointwise bands over the hyperparameters. All arrays have the length of the grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PopulationDensity {
    /// The grid, from one end of the family's support to the other, equally spaced.
    pub q: Vec<f64>,
    /// Posterior mean of the density.
    pub mean: Vec<f64>,
    /// Posterior median.
    pub median: Vec<f64>,
    /// Lower end of the central 68 % band.
    pub lo68: Vec<f64>,
    /// Upper end of the central 68 % band.
    pub hi68: Vec<f64>,
    /// Lower end of the central 95 % band.
    pub lo95: Vec<f64>,
    /// Upper end of the central 95 % band.
    pub hi95: Vec<f64>,
}

impl PopulationDensity {
    /// The density on `points` equally spaced values of q from weighted draws of the hyperparameters.
    ///
    /// # Errors
    /// [`Error::Setting`] for fewer than two points, [`Error::DrawColumns`] for no draws or draws of another family.
    pub fn new<F: Family<N>, const N: usize>(
        family: &F,
        draws: &Draws,
        points: usize,
    ) -> Result<Self> {
        if points < 2 {
            return Err(Error::Setting {
                key: "points".to_owned(),
                value: points.to_string(),
                remedy: "give at least 2 points of the grid".to_owned(),
            });
        }
        if draws.is_empty() || draws.dim != N {
            return Err(Error::DrawColumns {
                found: if draws.is_empty() { 0 } else { draws.dim },
                needed: N,
            });
        }
        let (lo, hi) = family.support();
        let half_step = 0.5 * (hi - lo) / (points - 1) as f64;
        let q: Vec<f64> = (0..points)
            .map(|i| lo + (hi - lo) * i as f64 / (points - 1) as f64)
            .collect();
        // Row by row over the draws, as each has one normalisation.
        let mut at: Vec<Vec<f64>> = vec![Vec::with_capacity(BAND_DRAWS); points];
        for row in draws.resample(BAND_DRAWS, 0.5) {
            let mut alpha = [0.0; N];
            alpha.copy_from_slice(draws.theta_row(row));
            let ln_pdf = family.ln_pdf(alpha);
            for (values, q) in at.iter_mut().zip(&q) {
                let inside = q.clamp(lo + half_step, hi - half_step);
                values.push(ln_pdf(inside).exp());
            }
        }
        let equal = [1.0; BAND_DRAWS];
        let band = |p: f64| {
            at.iter()
                .map(|values| weighted_quantile(values, &equal, p))
                .collect()
        };
        Ok(Self {
            mean: at
                .iter()
                .map(|v| v.iter().sum::<f64>() / v.len() as f64)
                .collect(),
            median: band(0.5),
            lo68: band(0.16),
            hi68: band(0.84),
            lo95: band(0.025),
            hi95: band(0.975),
            q,
        })
    }

    /// As a table with commas: one line of names, then one line for each value of q, with all digits.
    #[must_use]
    pub fn csv(&self) -> String {
        let columns = [
            ("q", &self.q),
            ("mean", &self.mean),
            ("median", &self.median),
            ("lo68", &self.lo68),
            ("hi68", &self.hi68),
            ("lo95", &self.lo95),
            ("hi95", &self.hi95),
        ];
        let mut table = columns.map(|(name, _)| name).join(",") + "\n";
        for row in 0..self.q.len() {
            table += &columns
                .map(|(_, values)| format!("{:?}", values[row]))
                .join(",");
            table.push('\n');
        }
        table
    }
}
