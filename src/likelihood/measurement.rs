//! What is measured in a bin beside its mean radius: the mean line-of-sight velocity, the width of the stream, and the density of its stars
//! (docs/physics.md, section 7).

use super::coverage::{Coverage, least_weight};
use super::observation::Observation;
use crate::error::{Rejection, Result};
use crate::scalar::{Dual, Real, gradient_of, lift};
use crate::track::{BinQuantity, Sums, moments};
use oblate_samplers::limits::in_range;
use oblate_samplers::normal::LN_SQRT_2PI;
use serde::{Deserialize, Serialize};
use std::f64::consts::LN_10;

/// A measurement of a quantity in a bin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BinMeasurement {
    /// Number of the bin.
    pub bin: i64,
    /// What is measured.
    pub quantity: BinQuantity,
    /// Its value, in the unit of the quantity.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
    /// Whether it is the velocity of one star and not the mean: the scatter of the velocities in the bin adds to its error.
    pub of_one_star: bool,
}

/// Added in quadrature to the model's width, kpc: a bin with a single particle has no width, where the root has no derivative.
const LEAST_WIDTH_KPC: f64 = 1e-3;

impl BinMeasurement {
    /// Checks that value and error are in their ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is not.
    pub(super) fn check(&self) -> Result<()> {
        let column = self.quantity.column();
        in_range(
            &format!("track.{}", column.value),
            self.value,
            column.values,
        )?;
        in_range(
            &format!("track.{}", column.error),
            self.error,
            column.errors,
        )?;
        Ok(())
    }

    /// An upper bound of its contribution to ln L.
    pub(super) fn ln_likelihood_bound(&self) -> f64 {
        -self.error.ln() - LN_SQRT_2PI
    }
}

/// What the likelihood of a measurement depends on beside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeasurementRules {
    pub coverage: Coverage,
    /// The weight of a covered bin.
    pub threshold: f64,
    /// [`SamplingScheme::variance_factor`](crate::spray::SamplingScheme::variance_factor) of the model, or 0 without model noise.
    pub variance_factor: f64,
    /// Fraction of all particles per degree that a weight of one stands for.
    pub fraction_per_weight: f64,
}

/// The contribution of a measurement to ln L, its residual in standard errors, and the cover of its bin.
pub(super) struct MeasurementTerm<S> {
    pub ln_likelihood: S,
    pub residual: S,
    pub covered: S,
}

/// Number of variables of a contribution to ln L.
const VARIABLES: usize = 7;

/// A measurement at the index of its bin in the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measurement {
    pub index: usize,
    pub datum: BinMeasurement,
}

impl Measurement {
    /// What its contribution depends on: weight, mean of the squares of all weights, sum and sum of squares of what its quantity is computed from, the velocity of the host, the
    /// distance factor and the number of stars.
    fn variables<S: Copy>(&self, sums: &Sums<S>, observation: &Observation<S>) -> [S; VARIABLES] {
        let i = self.index;
        let (sum, sum_of_squares) = match self.datum.quantity {
            BinQuantity::Velocity => (sums.v[i], sums.v2[i]),
            // The density depends on the weight alone.
            BinQuantity::Width | BinQuantity::Density => (sums.r[i], sums.r2[i]),
        };
        [
            sums.weight[i],
            sums.mean_square_weight,
            sum,
            sum_of_squares,
            observation.v_host_km_s,
            observation.distance_factor,
            observation.log10_n_stars,
        ]
    }

    /// Its contribution to ln L.
    ///
    /// # Errors
    /// [`Rejection::Uncovered`] under [`Coverage::Reject`] if its bin is not covered.
    pub fn term<S: Real>(
        &self,
        sums: &Sums<S>,
        observation: &Observation<S>,
        rules: &MeasurementRules,
    ) -> std::result::Result<MeasurementTerm<S>, Rejection> {
        self.term_of(self.variables(sums, observation), rules)
    }

    fn term_of<S: Real>(
        &self,
        [
            weight,
            mean_square_weight,
            sum,
            sum_of_squares,
            v_host,
            distance_factor,
            log10_n_stars,
        ]: [S; VARIABLES],
        rules: &MeasurementRules,
    ) -> std::result::Result<MeasurementTerm<S>, Rejection> {
        let covered = rules.coverage.of(weight, rules.threshold)?;
        let count = weight;
        let weight = weight.max(least_weight(rules.threshold));
        let (mean, variance) = moments(weight, sum, sum_of_squares);
        let variance_factor = mean_square_weight * rules.variance_factor;
        let per_weight = variance_factor / weight;
        // The model's value, and the variance of it by the number of particles.
        let (model, noise) = match self.datum.quantity {
            BinQuantity::Velocity if self.datum.of_one_star => {
                (mean + v_host, variance * (per_weight + 1.0))
            }
            BinQuantity::Velocity => (mean + v_host, variance * per_weight),
            BinQuantity::Width => {
                let width = (variance + LEAST_WIDTH_KPC * LEAST_WIDTH_KPC).sqrt() / distance_factor;
                // That of the standard deviation of a normal distribution.
                (width, width * width * per_weight * 0.5)
            }
            BinQuantity::Density => {
                let scale = (log10_n_stars * LN_10).exp() * rules.fraction_per_weight;
                // Poisson's.
                (scale * count, scale * scale * weight * variance_factor)
            }
        };
        let error = self.datum.error;
        let variance = noise + error * error;
        let residual = model - self.datum.value;
        let ln_covered = -(residual * residual / variance + variance.ln()) * 0.5 - LN_SQRT_2PI;
        let sd = S::from_f64(error);
        Ok(MeasurementTerm {
            ln_likelihood: rules.coverage.ln_likelihood(covered, ln_covered, sd),
            residual: residual / variance.sqrt(),
            covered,
        })
    }

    /// Adds the derivatives of its contribution to ln L to those by the sums and by the observation.
    ///
    /// # Errors
    /// As of [`term`](Self::term).
    pub fn vjp(
        &self,
        sums: &Sums<f64>,
        observation: &Observation<f64>,
        rules: &MeasurementRules,
        sums_bar: &mut Sums<f64>,
        observation_bar: &mut Observation<f64>,
    ) -> std::result::Result<(), Rejection> {
        let variables: [Dual<VARIABLES>; VARIABLES] = lift(&self.variables(sums, observation));
        let term = self.term_of(variables, rules)?;
        let [
            weight,
            mean_square_weight,
            sum,
            sum_of_squares,
            v_host,
            distance_factor,
            log10_n_stars,
        ] = gradient_of(&term.ln_likelihood);
        let (sum_bar, sum_of_squares_bar) = match self.datum.quantity {
            BinQuantity::Velocity => (&mut sums_bar.v, &mut sums_bar.v2),
            BinQuantity::Width | BinQuantity::Density => (&mut sums_bar.r, &mut sums_bar.r2),
        };
        sum_bar[self.index] += sum;
        sum_of_squares_bar[self.index] += sum_of_squares;
        sums_bar.weight[self.index] += weight;
        sums_bar.mean_square_weight += mean_square_weight;
        observation_bar.v_host_km_s += v_host;
        observation_bar.distance_factor += distance_factor;
        observation_bar.log10_n_stars += log10_n_stars;
        Ok(())
    }
}
