//! The coarse model that a fit starts with.
//!
//! A likelihood of few particles and long steps, in single precision, costs little. But it is rough, and rough likelihoods are slow to
//! explore. Bin edges as wide as the bins allow and a smaller penalty for uncovered bins make it smoother (`cargo bench --bench
//! roughness`). The SMC bridge then corrects its posterior to that of the model itself.

use super::settings::FitSettings;
use crate::likelihood::Coverage;
use crate::spray::SamplingScheme;
use crate::stream::Precision;
use crate::track::BinEdges;

/// Phase of a coarse model's steps, radians: they change ln L by less than its few particles do, at three fifths of the price
/// (docs/decisions.md, section 1).
const STEP_PHASE: f64 = 1.6;

/// Effective draws that the coarse fit aims at, as a fraction of those of the fit: the MCMC steps of the bridge make more of them, at less cost
/// (docs/decisions.md, section 4).
const COARSE_ESS: f64 = 0.5;

/// A target of at most so many is not halved: with fewer draws the checks of the coarse fit could not judge.
const FEWEST_DRAWS: f64 = 50.0;

/// Effective draws that the coarse fit aims at where the fit aims at so many.
fn of_coarse(target_ess: f64) -> f64 {
    (COARSE_ESS * target_ess).max(target_ess.min(FEWEST_DRAWS))
}

/// Maximum residual of an uncovered bin in the coarse model, in standard deviations: with few particles, bins are often uncovered by
/// chance.
const MAX_Z_MISS: f64 = 5.0;

impl FitSettings {
    /// Settings of the coarse fit to a track with bins of `bin_width_deg` degrees; `None` if the fit has no coarse
    /// stage ([`FitSettings::coarse_particles`]), or if its likelihood has zeros: a coarse model has its zeros
    /// elsewhere, and the bridge cannot recover what they exclude.
    #[must_use]
    pub fn coarse(&self, bin_width_deg: f64) -> Option<Self> {
        let Coverage::Penalty { z_miss, lambda } = self.likelihood.coverage else {
            return None;
        };
        let many = self.model.releases.particles >= 2 * self.coarse_particles;
        (self.coarse_particles > 0 && many).then(|| {
            let mut coarse = self.clone();
            coarse.coarse_particles = 0;
            let (pt_hmc, nested) = (&mut coarse.sampling.pt_hmc, &mut coarse.sampling.nested);
            pt_hmc.target_ess = of_coarse(pt_hmc.target_ess);
            nested.target_ess = nested.target_ess.map(of_coarse);
            let releases = &mut coarse.model.releases;
            // 0: the number of release times follows from the number of particles.
            releases.release_times = 0;
            releases.particles = self.coarse_particles;
            if releases.sampling_scheme == SamplingScheme::Random {
                // Their number of release times does not follow from that of the particles.
                let both_tails = 2 * releases.number_of_release_times();
                releases.particles = releases.particles.next_multiple_of(both_tails);
            }
            coarse.model.step_phase = coarse.model.step_phase.max(STEP_PHASE);
            coarse.model.precision = Precision::Single;
            coarse.likelihood.edges = BinEdges::Soft {
                half_width_deg: 0.5 * bin_width_deg,
            };
            coarse.likelihood.coverage = Coverage::Penalty {
                z_miss: z_miss.min(MAX_Z_MISS),
                lambda,
            };
            coarse
        })
    }
}
