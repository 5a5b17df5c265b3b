//! The likelihood of a track: normal in the mean radius of each bin, with a rule for bins that are not covered (docs/physics.md, section 7).

use super::correlation::{ErrorCorrelation, ExpectedError};
use super::coverage::{Coverage, least_weight};
use super::measurement::{BinMeasurement, Measurement, MeasurementRules};
use super::observation::Observation;
use crate::data::{RADII_KPC, RADIUS_ERRORS_KPC};
use crate::error::{Error, Rejection, Result};
use crate::scalar::{Dual, LANES, Real, gradient_of, lift};
use crate::spray::TableSettings;
use crate::track::{ANGLES_DEG, BIN_WIDTHS_DEG, BinEdges, BinGrid, BinQuantity, Sums};
use oblate_samplers::limits::{Memory, in_range};
use oblate_samplers::normal::LN_SQRT_2PI;
use serde::{Deserialize, Serialize};

/// How a track is compared with data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LikelihoodSettings {
    /// Edges of the bins.
    pub edges: BinEdges,
    /// The rule for bins that are not covered.
    pub coverage: Coverage,
    /// Whether the Monte-Carlo variance of each bin's mean in the model is added to the variance of the data. With a few thousand particles
    /// the two are of the same size.
    pub model_noise: bool,
    /// The threshold on a bin's weight over the number of particles: half of that of mocks.
    pub min_fraction: f64,
    /// Smallest standard error of a radius, per cent of the radius: smaller errors of the data are raised to it. 0: none.
    pub error_floor_percent: f64,
    /// How the errors of the radii are correlated along the track; none: they are independent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_correlation: Option<ErrorCorrelation>,
}

impl Default for LikelihoodSettings {
    fn default() -> Self {
        Self {
            edges: BinEdges::default(),
            coverage: Coverage::default(),
            model_noise: true,
            min_fraction: 0.005,
            error_floor_percent: 0.0,
            error_correlation: None,
        }
    }
}

impl LikelihoodSettings {
    /// Checks that every number is in its range of docs/limits.md. That the half-width of soft edges is at most half of a bin depends on
    /// the track; [`TrackLikelihood::new`] checks it.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        let widest = *BIN_WIDTHS_DEG.end();
        self.edges
            .check("likelihood.edges.soft.half_width_deg", widest)?;
        self.coverage.check()?;
        in_range("likelihood.min_fraction", self.min_fraction, 0.0..=1.0)?;
        let floor = self.error_floor_percent;
        in_range("likelihood.error_floor_percent", floor, 0.0..=100.0)?;
        self.error_correlation.map_or(Ok(()), |c| c.check())
    }
}

/// Margin for rounding in the upper bound of ln L.
const BOUND_SLACK: f64 = 1e-6;

/// Data of one bin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DataBin {
    /// Number of the bin: it covers [bin, bin + 1) widths from the lower edge of bin 0.
    pub bin: i64,
    /// Measured mean radius, kpc.
    pub r_kpc: f64,
    /// Its standard error towards smaller radii, kpc.
    pub r_err_lo_kpc: f64,
    /// Its standard error towards larger radii, kpc.
    pub r_err_hi_kpc: f64,
}

impl DataBin {
    /// Its standard error in kpc on the side where the radius `r_kpc` of a model lies, with this jitter.
    #[must_use]
    pub fn r_err_towards_kpc(&self, r_kpc: f64, jitter: f64) -> f64 {
        let error = if r_kpc > self.r_kpc {
            self.r_err_hi_kpc
        } else {
            self.r_err_lo_kpc
        };
        error.hypot(jitter * self.r_kpc)
    }

    /// A radius with the same error to both sides.
    #[must_use]
    pub fn symmetric(bin: i64, r_kpc: f64, r_err_kpc: f64) -> Self {
        Self {
            bin,
            r_kpc,
            r_err_lo_kpc: r_err_kpc,
            r_err_hi_kpc: r_err_kpc,
        }
    }

    /// Whether the errors to both sides are the same.
    #[inline(always)]
    fn is_symmetric(&self) -> bool {
        self.r_err_lo_kpc.to_bits() == self.r_err_hi_kpc.to_bits()
    }

    /// The mean of both errors, which normalises the likelihood without jitter and model noise.
    #[inline(always)]
    fn mean_error_kpc(&self) -> f64 {
        0.5 * (self.r_err_lo_kpc + self.r_err_hi_kpc)
    }

    /// The variances towards smaller and towards larger radii with this jitter, kpc^2.
    #[inline(always)]
    fn variances_kpc2<S: Real>(&self, jitter: S) -> [S; 2] {
        let scatter = jitter * self.r_kpc;
        [self.r_err_lo_kpc, self.r_err_hi_kpc].map(|error| scatter * scatter + error * error)
    }

    /// With errors of at least `floor_kpc`.
    fn with_floor(self, floor_kpc: f64) -> Self {
        Self {
            r_err_lo_kpc: self.r_err_lo_kpc.max(floor_kpc),
            r_err_hi_kpc: self.r_err_hi_kpc.max(floor_kpc),
            ..self
        }
    }
}

/// The likelihood of a binned track.
#[derive(Clone, Debug)]
pub struct TrackLikelihood {
    settings: LikelihoodSettings,
    grid: BinGrid,
    /// Data by bin of the grid, `None` in gaps of the data.
    data: Vec<Option<DataBin>>,
    /// By bin of the grid the correlation of its error with that of the datum before; 0 for the first, and of independent errors.
    correlations: Vec<f64>,
    /// Velocities, widths and densities, in the order in which they were given.
    measurements: Vec<Measurement>,
    /// Number of bins with data.
    count: usize,
    /// Number of particles of the model.
    particles: f64,
    /// The weight of a covered bin.
    threshold: f64,
    /// [`SamplingScheme::variance_factor`](crate::spray::SamplingScheme::variance_factor) of the model.
    variance_factor: f64,
}

/// The contribution of one bin to ln L, and its cover (0 to 1), c of docs/physics.md, section 7.
struct BinTerm<S> {
    ln_likelihood: S,
    covered: S,
    /// Model minus data, kpc, and its variance; of correlated errors, beyond what the bins before let expect.
    residual: S,
    variance: S,
    /// The error of the datum as it is expected with this bin.
    error: ExpectedError<S>,
}

impl TrackLikelihood {
    /// The likelihood of data in bins of `width_deg` degrees, for models with these releases.
    ///
    /// # Errors
    /// Those of [`LikelihoodSettings::check`]; [`Error::OutOfRange`] if a width, half-width, angle, radius or error is out of its range;
    /// [`Error::Setting`] if there is no bin, one is given twice, or correlated errors are not the same to both sides.
    pub fn new(
        settings: &LikelihoodSettings,
        width_deg: f64,
        data: &[DataBin],
        releases: &TableSettings,
    ) -> Result<Self> {
        let fail = |key: &str, value: String, remedy: &str| {
            Err(Error::Setting {
                key: key.to_owned(),
                value,
                remedy: remedy.to_owned(),
            })
        };
        settings.check()?;
        in_range("track.bin_width_deg", width_deg, BIN_WIDTHS_DEG)?;
        settings
            .edges
            .check("likelihood.edges.soft.half_width_deg", width_deg)?;
        for d in data {
            // Its centre to half a width, by which the grid may be moved.
            let nearest = (d.bin as f64 + 0.5).abs() * width_deg - 0.5 * width_deg;
            in_range("track.phi_deg", nearest, ANGLES_DEG)?;
            in_range("track.r_kpc", d.r_kpc, RADII_KPC)?;
            for error in [d.r_err_lo_kpc, d.r_err_hi_kpc] {
                in_range("track.r_err_kpc", error, RADIUS_ERRORS_KPC)?;
            }
        }
        let (Some(first), Some(last)) = (
            data.iter().map(|d| d.bin).min(),
            data.iter().map(|d| d.bin).max(),
        ) else {
            return fail(
                "track",
                "no bins".to_owned(),
                "give at least one bin of data",
            );
        };
        let len = usize::try_from(last - first + 1).unwrap_or(0);
        let mut by_bin = vec![None; len];
        for d in data {
            let index = usize::try_from(d.bin - first).unwrap_or(0);
            let floored = d.with_floor(settings.error_floor_percent / 100.0 * d.r_kpc);
            if by_bin[index].replace(floored).is_some() {
                return fail(
                    "track",
                    format!("bin {} twice", d.bin),
                    "give each bin once",
                );
            }
            if settings.error_correlation.is_some() && !floored.is_symmetric() {
                return fail(
                    "likelihood.error_correlation",
                    format!("different errors to both sides in bin {}", d.bin),
                    "give one error `r_err` for each radius, or leave the correlation out",
                );
            }
        }
        let mut correlations = vec![0.0; len];
        if let Some(correlation) = settings.error_correlation {
            let places: Vec<usize> = (0..len).filter(|&i| by_bin[i].is_some()).collect();
            for pair in places.windows(2) {
                let apart_deg = (pair[1] - pair[0]) as f64 * width_deg;
                correlations[pair[1]] = correlation.at_distance(apart_deg);
            }
        }
        Ok(Self {
            settings: *settings,
            grid: BinGrid {
                width_deg,
                offset_deg: 0.0,
                first,
                len,
                edges: settings.edges,
            },
            data: by_bin,
            correlations,
            measurements: Vec::new(),
            count: data.len(),
            particles: 0.0,
            threshold: 0.0,
            variance_factor: 1.0,
        }
        .with_releases(releases))
    }

    /// The same data in bins of which the lower edge of bin 0 is at `offset_deg` from the progenitor, in place of at the progenitor; at
    /// most a bin to either side.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] beyond that.
    pub fn with_offset_deg(mut self, offset_deg: f64) -> Result<Self> {
        let width_deg = self.grid.width_deg;
        in_range("track.offset_deg", offset_deg, -width_deg..=width_deg)?;
        self.grid.offset_deg = offset_deg;
        Ok(self)
    }

    /// The same data with velocities, widths and densities in some of their bins.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a value or an error is out of its range of docs/limits.md; [`Error::Setting`] if a bin has no radius.
    pub fn with_measurements(mut self, measurements: &[BinMeasurement]) -> Result<Self> {
        for datum in measurements {
            datum.check()?;
            let index = usize::try_from(datum.bin - self.grid.first).ok();
            let Some(index) = index.filter(|i| self.data.get(*i).is_some_and(Option::is_some))
            else {
                return Err(Error::Setting {
                    key: "track".to_owned(),
                    value: format!("a velocity, a width or a density in bin {}", datum.bin),
                    remedy: "give them in bins that have a radius".to_owned(),
                });
            };
            self.measurements.push(Measurement {
                index,
                datum: *datum,
            });
        }
        Ok(self)
    }

    /// Whether there is a measurement of this quantity.
    #[must_use]
    pub fn has(&self, quantity: BinQuantity) -> bool {
        self.measurements().any(|datum| datum.quantity == quantity)
    }

    /// Velocities, widths and densities.
    pub fn measurements(&self) -> impl Iterator<Item = &BinMeasurement> {
        self.measurements.iter().map(|m| &m.datum)
    }

    fn rules(&self) -> MeasurementRules {
        MeasurementRules {
            coverage: self.settings.coverage,
            threshold: self.threshold,
            variance_factor: if self.settings.model_noise {
                self.variance_factor
            } else {
                0.0
            },
            fraction_per_weight: 1.0 / (self.particles * self.grid.width_deg),
        }
    }

    /// The same data and rules for models with other releases.
    #[must_use]
    pub fn with_releases(self, releases: &TableSettings) -> Self {
        let particles = releases.particles as f64;
        Self {
            particles,
            threshold: self.settings.min_fraction * particles,
            variance_factor: releases.sampling_scheme.variance_factor(),
            ..self
        }
    }

    /// The bins that a model must be summed in if the progenitor is at phi = 0 in the data.
    #[must_use]
    pub fn grid(&self) -> &BinGrid {
        &self.grid
    }

    /// The bins that a model must be summed in if the progenitor is at phi = `phi0_deg` in the data.
    #[must_use]
    pub fn grid_from(&self, phi0_deg: f64) -> BinGrid {
        BinGrid {
            offset_deg: self.grid.offset_deg - phi0_deg,
            ..self.grid
        }
    }

    /// An estimate of the memory of the sums of `threads` values that are computed at once: for each bin three sums, their derivatives,
    /// and the sums over a chunk of particles, lane by lane.
    #[must_use]
    pub fn memory(&self, threads: usize) -> Memory {
        let per_bin = (6 + 3 * LANES) * size_of::<f64>();
        let bytes = (per_bin * self.grid.len * threads) as f64;
        Memory::default().with("threads", bytes)
    }

    /// The weight of a covered bin.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// The data, in the order of the bins, with the error floor applied.
    pub fn data(&self) -> impl Iterator<Item = &DataBin> {
        self.data.iter().flatten()
    }

    /// An upper bound of ln L: that of a track through all points without jitter and model noise.
    #[must_use]
    pub fn ln_likelihood_bound(&self) -> f64 {
        let exact_fit = self
            .data()
            .map(|d| -d.mean_error_kpc().ln() - LN_SQRT_2PI)
            .sum::<f64>();
        // A datum whose error is expected from the bins before has a narrower distribution.
        let narrower = self.settings.error_correlation.map_or(0.0, |correlation| {
            let least = self
                .correlations
                .iter()
                .map(|c| correlation.least_variance(*c));
            least.map(|variance| -0.5 * variance.ln()).sum()
        });
        let measured: f64 = self
            .measurements()
            .map(BinMeasurement::ln_likelihood_bound)
            .sum();
        exact_fit + narrower + measured + BOUND_SLACK
    }

    /// ln L of a model's sums over the bins of [`grid_from`](Self::grid_from): the density of the data as they are given.
    ///
    /// # Errors
    /// [`Rejection::Uncovered`] under [`Coverage::Reject`] if a bin is not covered; [`Rejection::BadLikelihood`] if ln L is not finite.
    pub fn ln_likelihood<S: Real>(
        &self,
        sums: &Sums<S>,
        observation: &Observation<S>,
    ) -> std::result::Result<S, Rejection> {
        let mut total = S::zero();
        let mut mean_cover = S::zero();
        for term in self.bin_terms(sums, observation) {
            let term = term?;
            total += term.ln_likelihood;
            mean_cover += term.covered / self.count as f64;
        }
        for measurement in &self.measurements {
            total += measurement
                .term(sums, observation, &self.rules())?
                .ln_likelihood;
        }
        let total = total - self.settings.coverage.penalty(mean_cover);
        if total.re().is_finite() {
            Ok(total)
        } else {
            Err(Rejection::BadLikelihood)
        }
    }

    /// Appends the residual of each datum in standard errors, times the root of its cover: they are smooth, and
    /// `ln L + |residuals|^2 / 2` varies little where all bins are covered. Of correlated errors it is the residual beyond what the bins
    /// before let expect.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn residuals(
        &self,
        sums: &Sums<f64>,
        observation: &Observation<f64>,
        residuals: &mut Vec<f64>,
    ) -> std::result::Result<(), Rejection> {
        for datum in self.covers_and_residuals(sums, observation) {
            let [covered, residual, variance] = datum?;
            residuals.push(covered.sqrt() * residual / variance.sqrt());
        }
        Ok(())
    }

    /// Appends the square of the residual of each datum in standard errors, where an uncovered bin has the residual that the coverage rule gives it.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn squares(
        &self,
        sums: &Sums<f64>,
        observation: &Observation<f64>,
        squares: &mut Vec<f64>,
    ) -> std::result::Result<(), Rejection> {
        let missed = self.settings.coverage.square_of_missed();
        for datum in self.covers_and_residuals(sums, observation) {
            let [covered, residual, variance] = datum?;
            squares.push(covered * (residual * residual / variance) + (1.0 - covered) * missed);
        }
        Ok(())
    }

    /// Cover, residual and variance of each datum, in their order; residuals of measurements beside the radii are in standard errors.
    fn covers_and_residuals<'a>(
        &'a self,
        sums: &'a Sums<f64>,
        observation: &'a Observation<f64>,
    ) -> impl Iterator<Item = std::result::Result<[f64; 3], Rejection>> + 'a {
        let of_bins = (self.bin_terms(sums, observation))
            .map(|term| term.map(|term| [term.covered, term.residual, term.variance]));
        let of_others = self.measurements.iter().map(move |measurement| {
            let term = measurement.term(sums, observation, &self.rules())?;
            Ok([term.covered, term.residual, 1.0])
        });
        of_bins.chain(of_others)
    }

    /// ln L, with the same bits as from [`ln_likelihood`](Self::ln_likelihood), and its derivatives with respect to the observation at given
    /// sums. Those with respect to the sums are written into `sums_bar`.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn vjp(
        &self,
        sums: &Sums<f64>,
        observation: &Observation<f64>,
        sums_bar: &mut Sums<f64>,
    ) -> std::result::Result<(f64, Observation<f64>), Rejection> {
        // ln L by the function above, because dual numbers round otherwise.
        let total = self.ln_likelihood(sums, observation)?;
        sums_bar.reset(self.grid.len);
        sums_bar.mean_square_weight = 0.0;
        if sums.has_velocities() {
            sums_bar.reset_velocities();
        }
        let mut mean_cover = 0.0;
        // Derivatives of each bin's cover, for the penalty below.
        let mut cover_bar = vec![0.0; self.grid.len];
        // Derivatives of each bin's term and of the expected error after it, with respect to its sums, the observation and the expected
        // error before.
        let mut slopes = Vec::with_capacity(self.count);
        let mut error = ExpectedError::<f64>::unknown();
        for (i, d) in self.data.iter().enumerate() {
            if let Some(d) = d {
                let variables: [Dual<8>; 8] = lift(&[
                    sums.weight[i],
                    sums.r[i],
                    sums.r2[i],
                    sums.mean_square_weight,
                    observation.jitter,
                    observation.distance_factor,
                    error.mean,
                    error.variance,
                ]);
                let [
                    weight,
                    r,
                    r2,
                    mean_square_weight,
                    jitter,
                    distance_factor,
                    mean,
                    variance,
                ] = variables;
                let observation = Observation {
                    jitter,
                    distance_factor,
                    phi0_deg: Dual::from_re(observation.phi0_deg),
                    v_host_km_s: Dual::from_re(observation.v_host_km_s),
                    log10_n_stars: Dual::from_re(observation.log10_n_stars),
                };
                let before = ExpectedError { mean, variance }.next(self.correlations[i]);
                let term =
                    self.bin_term(d, [weight, r, r2, mean_square_weight], &observation, before)?;
                mean_cover += term.covered.re / self.count as f64;
                // The cover depends on the weight alone.
                cover_bar[i] = gradient_of(&term.covered)[0];
                let after = [&term.error.mean, &term.error.variance];
                slopes.push((i, gradient_of(&term.ln_likelihood), after.map(gradient_of)));
                (error.mean, error.variance) = (term.error.mean.re, term.error.variance.re);
            }
        }
        let mut observation_bar = Observation {
            jitter: 0.0,
            distance_factor: 0.0,
            // The sums have it already.
            phi0_deg: 0.0,
            v_host_km_s: 0.0,
            log10_n_stars: 0.0,
        };
        // Derivatives with respect to the expected error after the bin.
        let mut error_bar = [0.0; 2];
        for (i, mut bar, [by_mean, by_variance]) in slopes.into_iter().rev() {
            for k in 0..bar.len() {
                bar[k] += error_bar[0] * by_mean[k] + error_bar[1] * by_variance[k];
            }
            let [
                weight,
                r,
                r2,
                mean_square_weight,
                jitter,
                distance_factor,
                mean,
                variance,
            ] = bar;
            sums_bar.mean_square_weight += mean_square_weight;
            (sums_bar.weight[i], sums_bar.r[i], sums_bar.r2[i]) = (weight, r, r2);
            observation_bar.jitter += jitter;
            observation_bar.distance_factor += distance_factor;
            error_bar = [mean, variance];
        }
        let rules = self.rules();
        for measurement in &self.measurements {
            measurement.vjp(sums, observation, &rules, sums_bar, &mut observation_bar)?;
        }
        let mean_cover = crate::scalar::variable::<1>(mean_cover, 0);
        let penalty = self.settings.coverage.penalty(mean_cover);
        let [mean_cover_bar] = gradient_of(&penalty);
        for (weight_bar, cover_bar) in sums_bar.weight.iter_mut().zip(&cover_bar) {
            *weight_bar -= mean_cover_bar * cover_bar / self.count as f64;
        }
        Ok((total, observation_bar))
    }

    /// The contributions of the bins with data, in order: each needs the error that the bins before let expect.
    fn bin_terms<S: Real>(
        &self,
        sums: &Sums<S>,
        observation: &Observation<S>,
    ) -> impl Iterator<Item = std::result::Result<BinTerm<S>, Rejection>> {
        let mut error = ExpectedError::unknown();
        self.data.iter().enumerate().filter_map(move |(i, d)| {
            let d = d.as_ref()?;
            let of_bin = [
                sums.weight[i],
                sums.r[i],
                sums.r2[i],
                sums.mean_square_weight,
            ];
            let before = error.next(self.correlations[i]);
            let term = self.bin_term(d, of_bin, observation, before);
            if let Ok(term) = &term {
                error = term.error;
            }
            Some(term)
        })
    }

    /// The contribution of one bin, from its sums of weights, radii and squares of radii, the mean of the squares of all weights, and what the
    /// bins before say about its error.
    ///
    /// # Errors
    /// [`Rejection::Uncovered`] under [`Coverage::Reject`] if it is not covered.
    fn bin_term<S: Real>(
        &self,
        d: &DataBin,
        [weight, r, r2, mean_square_weight]: [S; 4],
        observation: &Observation<S>,
        error: ExpectedError<S>,
    ) -> std::result::Result<BinTerm<S>, Rejection> {
        let covered = self.settings.coverage.of(weight, self.threshold)?;
        let bounded_weight = weight.max(least_weight(self.threshold));
        // Radii of the model as the data have them.
        let factor = observation.distance_factor;
        let mean = r / bounded_weight / factor;
        let mut noise = S::zero();
        if self.settings.model_noise {
            let mean_square = r2 / bounded_weight / (factor * factor);
            let variance_of_r = (mean_square - mean * mean).max(S::zero());
            noise += variance_of_r * self.variance_factor * mean_square_weight / bounded_weight;
        }
        let residual = mean - d.r_kpc;
        let of_data = d.variances_kpc2(observation.jitter);
        let lower = noise + of_data[0];
        let of_normal = |residual: S, variance: S| {
            -(residual * residual / variance + variance.ln()) * 0.5 - LN_SQRT_2PI
        };
        let mut after = error;
        let (residual, variance, ln_covered) = if let Some(c) = self.settings.error_correlation {
            // Of the correlated part of the error; the rest is independent, as model noise and jitter are.
            let sd = c.fraction.sqrt() * d.r_err_lo_kpc;
            let (residual, variance) = error.remainder(residual, sd, lower - sd * sd);
            after = error.learn((residual, variance), sd, covered);
            (residual, variance, of_normal(residual, variance))
        } else if d.is_symmetric() {
            (residual, lower, of_normal(residual, lower))
        } else {
            let upper = noise + of_data[1];
            let variance = if residual.re() > 0.0 { upper } else { lower };
            let mean_sd = (lower.sqrt() + upper.sqrt()) * 0.5;
            let ln_covered = -residual * residual / variance * 0.5 - mean_sd.ln() - LN_SQRT_2PI;
            (residual, variance, ln_covered)
        };
        let mean_error = (of_data[0].sqrt() + of_data[1].sqrt()) * 0.5;
        let coverage = self.settings.coverage;
        Ok(BinTerm {
            ln_likelihood: coverage.ln_likelihood(covered, ln_covered, mean_error),
            covered,
            residual,
            variance,
            error: after,
        })
    }
}
