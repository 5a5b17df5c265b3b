//! Gaussian in radius per bin, with the coverage rule chosen by name (docs/physics.md, section 7).

use crate::data::{RADII_KPC, RADIUS_ERRORS_KPC};
use crate::error::{Error, Rejection, Result};
use crate::scalar::{Dual, Real, gradient_of, lift, smooth_step};
use crate::spray::TableSettings;
use crate::track::{ANGLES_DEG, BIN_WIDTHS_DEG, BinEdges, BinGrid, Sums};
use oblate_samplers::limits::{Memory, in_range};
use oblate_samplers::normal::LN_SQRT_2PI;
use serde::{Deserialize, Serialize};

/// The rule for a data bin that the model does not cover.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coverage {
    /// The rule of Chemaly et al. (2026): the likelihood is zero, with a hard threshold on the number of particles.
    Reject,
    /// Finite and smooth everywhere: between threshold and zero weight, a bin's likelihood is interpolated to that of a residual
    /// of `z_miss` sigma, and the uncovered fraction of the bins costs `-lambda (1 - overlap)^2`.
    Penalty {
        /// Residual of a missing bin, in sigma.
        z_miss: f64,
        /// Depth of the penalty on the uncovered length.
        lambda: f64,
    },
}

impl Default for Coverage {
    fn default() -> Self {
        Self::Penalty {
            z_miss: 10.0,
            lambda: 1_000.0,
        }
    }
}

/// How a track is compared with data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LikelihoodSettings {
    /// Edges of the bins.
    pub edges: BinEdges,
    /// Missing bins.
    pub coverage: Coverage,
    /// Whether the model's own Monte-Carlo variance of each bin's mean is added to the data's. The releases of a fit are fixed,
    /// so their error is the same at every point, and with a few thousand particles it is as large as the data's errors.
    pub model_noise: bool,
    /// The threshold on a bin's weight, as a fraction of all particles: half of a mock's 1 %.
    pub min_fraction: f64,
}

impl Default for LikelihoodSettings {
    fn default() -> Self {
        Self {
            edges: BinEdges::default(),
            coverage: Coverage::default(),
            model_noise: true,
            min_fraction: 0.005,
        }
    }
}

impl LikelihoodSettings {
    /// Checks every number by itself: the ranges of docs/limits.md. In addition, soft edges are at most half of a bin
    /// wide, which depends on the track ([`BinEdges::check`]).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        let widest = *BIN_WIDTHS_DEG.end();
        self.edges
            .check("likelihood.edges.soft.half_width_deg", widest)?;
        if let Coverage::Penalty { z_miss, lambda } = self.coverage {
            in_range("likelihood.coverage.penalty.z_miss", z_miss, 1e-3..=1e3)?;
            in_range("likelihood.coverage.penalty.lambda", lambda, 0.0..=1e7)?;
        }
        in_range("likelihood.min_fraction", self.min_fraction, 0.0..=1.0)?;
        Ok(())
    }
}

/// Margin of the upper bound for rounding.
const BOUND_SLACK: f64 = 1e-6;

/// Data of one bin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DataBin {
    /// Number of the bin: it covers [bin, bin + 1) widths from the progenitor.
    pub bin: i64,
    /// Measured mean radius, kpc.
    pub r_kpc: f64,
    /// Its standard error, kpc.
    pub r_err_kpc: f64,
}

/// The likelihood of a binned track.
#[derive(Clone, Debug)]
pub struct TrackLikelihood {
    settings: LikelihoodSettings,
    grid: BinGrid,
    /// Data by bin of the grid, `None` where a gap in the data is.
    data: Vec<Option<DataBin>>,
    count: usize,
    /// The weight that a bin must have.
    threshold: f64,
    /// The model's variance of a bin's mean over that of independent particles.
    variance_factor: f64,
}

/// The contribution of one bin: the product of its cover (0 to 1) and its log-likelihood, and the cover.
struct BinTerm<S> {
    ln_likelihood: S,
    covered: S,
}

impl TrackLikelihood {
    /// A likelihood of data in bins of `width_deg`, for models with these releases.
    ///
    /// # Errors
    /// As of [`LikelihoodSettings::check`]; [`Error::OutOfRange`] for a width, an edge, an angle, a radius or an error out of its range;
    /// [`Error::Setting`] if there is no data or a bin twice.
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
            in_range(
                "track.phi_deg",
                (d.bin as f64 + 0.5) * width_deg,
                ANGLES_DEG,
            )?;
            in_range("track.r_kpc", d.r_kpc, RADII_KPC)?;
            in_range("track.r_err_kpc", d.r_err_kpc, RADIUS_ERRORS_KPC)?;
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
        let mut slots = vec![None; len];
        for d in data {
            let slot = usize::try_from(d.bin - first).unwrap_or(0);
            if slots[slot].replace(*d).is_some() {
                return fail(
                    "track",
                    format!("bin {} twice", d.bin),
                    "give each bin once",
                );
            }
        }
        Ok(Self {
            settings: *settings,
            grid: BinGrid {
                width_deg,
                first,
                len,
                edges: settings.edges,
            },
            data: slots,
            count: data.len(),
            threshold: 0.0,
            variance_factor: 1.0,
        }
        .with_releases(releases))
    }

    /// The same data and rules for models with other releases.
    #[must_use]
    pub fn with_releases(self, releases: &TableSettings) -> Self {
        Self {
            threshold: self.settings.min_fraction * releases.particles as f64,
            variance_factor: releases.sampling_scheme.variance_factor(),
            ..self
        }
    }

    /// The bins that a model must be summed in.
    #[must_use]
    pub fn grid(&self) -> &BinGrid {
        &self.grid
    }

    /// An estimate of the memory of the sums of `threads` values that are computed at once: for each bin three sums, their derivatives,
    /// and the sums over some of the particles.
    #[must_use]
    pub fn memory(&self, threads: usize) -> Memory {
        let per_bin = 14 * size_of::<f64>();
        let bytes = (per_bin * self.grid.len * threads) as f64;
        Memory::default().with("threads", bytes)
    }

    /// The weight that a bin must have to count as covered.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// The data, in order.
    pub fn data(&self) -> impl Iterator<Item = &DataBin> {
        self.data.iter().flatten()
    }

    /// An upper bound of ln L: a track through all points, without noise of its own.
    #[must_use]
    pub fn ln_likelihood_bound(&self) -> f64 {
        let most = self
            .data()
            .map(|d| -d.r_err_kpc.ln() - LN_SQRT_2PI)
            .sum::<f64>();
        most + BOUND_SLACK
    }

    /// ln L of a model's sums.
    ///
    /// # Errors
    /// [`Rejection::Uncovered`] under [`Coverage::Reject`]; [`Rejection::BadLikelihood`] if it is not finite.
    pub fn ln_likelihood<S: Real>(&self, sums: &Sums<S>) -> std::result::Result<S, Rejection> {
        let mut total = S::zero();
        let mut overlap = S::zero();
        for (i, d) in self.data.iter().enumerate() {
            if let Some(d) = d {
                let term = self.bin_term(d, sums.weight[i], sums.r[i], sums.r2[i])?;
                total += term.ln_likelihood;
                overlap += term.covered / self.count as f64;
            }
        }
        let total = total - self.length_penalty(overlap);
        if total.re().is_finite() {
            Ok(total)
        } else {
            Err(Rejection::BadLikelihood)
        }
    }

    /// ln L, with the same bits as from [`ln_likelihood`](Self::ln_likelihood), and its derivatives with respect to the sums, written
    /// into `sums_bar`.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn vjp(&self, sums: &Sums<f64>, by: &mut Sums<f64>) -> std::result::Result<f64, Rejection> {
        // The value is that of the function without derivatives: dual numbers round otherwise.
        let total = self.ln_likelihood(sums)?;
        by.reset(self.grid.len);
        let mut overlap = 0.0;
        // Derivatives of each bin's cover, for the penalty below.
        let mut cover_bar = vec![0.0; self.grid.len];
        for (i, d) in self.data.iter().enumerate() {
            if let Some(d) = d {
                let [weight, r, r2]: [Dual<3>; 3] = lift(&[sums.weight[i], sums.r[i], sums.r2[i]]);
                let term = self.bin_term(d, weight, r, r2)?;
                overlap += term.covered.re / self.count as f64;
                [by.weight[i], by.r[i], by.r2[i]] = gradient_of(&term.ln_likelihood);
                // The cover depends on the weight alone.
                cover_bar[i] = gradient_of(&term.covered)[0];
            }
        }
        let penalty = self.length_penalty(crate::scalar::variable::<1>(overlap, 0));
        let [overlap_bar] = gradient_of(&penalty);
        for (slot, cover) in by.weight.iter_mut().zip(&cover_bar) {
            *slot -= overlap_bar * cover / self.count as f64;
        }
        Ok(total)
    }

    /// One bin.
    fn bin_term<S: Real>(
        &self,
        d: &DataBin,
        weight: S,
        r: S,
        r2: S,
    ) -> std::result::Result<BinTerm<S>, Rejection> {
        let covered = match self.settings.coverage {
            Coverage::Reject => {
                // No bin without a particle has a mean, whatever the threshold.
                if weight.re() < self.threshold || weight.re() <= 0.0 {
                    return Err(Rejection::Uncovered);
                }
                S::one()
            }
            Coverage::Penalty { .. } if self.threshold > 0.0 => {
                smooth_step(weight / self.threshold)
            }
            Coverage::Penalty { .. } => smooth_step(weight),
        };
        // Where the cover is zero the mean does not count; keep it finite.
        let safe = weight.max(S::from_f64(0.25 * self.threshold).max(S::from_f64(1e-9)));
        let mean = r / safe;
        let mut variance = S::from_f64(d.r_err_kpc * d.r_err_kpc);
        if self.settings.model_noise {
            let scatter2 = (r2 / safe - mean * mean).max(S::zero());
            variance += scatter2 * self.variance_factor / safe;
        }
        let residual = mean - d.r_kpc;
        let hit = -(residual * residual / variance + variance.ln()) * 0.5 - LN_SQRT_2PI;
        let ln_likelihood = match self.settings.coverage {
            Coverage::Reject => hit,
            Coverage::Penalty { z_miss, .. } => {
                let miss = -0.5 * z_miss * z_miss - d.r_err_kpc.ln() - LN_SQRT_2PI;
                covered * (hit - miss) + miss
            }
        };
        Ok(BinTerm {
            ln_likelihood,
            covered,
        })
    }

    /// The penalty on the uncovered fraction of the length.
    fn length_penalty<S: Real>(&self, overlap: S) -> S {
        match self.settings.coverage {
            Coverage::Reject => S::zero(),
            Coverage::Penalty { lambda, .. } => {
                let missing = (S::one() - overlap).max(S::zero());
                missing * missing * lambda
            }
        }
    }
}
