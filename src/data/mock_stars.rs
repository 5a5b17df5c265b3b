//! Single stars of mocks, whose line-of-sight velocities are measured.

use super::ObservedTrack;
use super::check::star_faults;
use super::measured::Measured;
use super::star::{MAX_STARS, StarVelocity};
use crate::error::Result;
use crate::params::StreamParams;
use crate::stream::Particles;
use crate::units::km_s_from_kpc_per_gyr;
use oblate_samplers::limits::in_range;
use oblate_samplers::rng::{standard_normal, unit_open};
use rand::Rng;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Noises that velocities of mocks may have, km/s.
pub(super) const VELOCITY_NOISES_KM_S: RangeInclusive<f64> = 0.01..=1_000.0;

/// Stars of a mock with line-of-sight velocities of their own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MockStars {
    /// Their number: fewer, if the bins of the track have fewer particles.
    pub count: usize,
    /// Gaussian noise of each velocity, km/s.
    pub velocity_noise_km_s: f64,
}

impl MockStars {
    /// Checks both numbers.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        in_range("stars.count", self.count, 1..=MAX_STARS)?;
        in_range(
            "stars.velocity_noise_km_s",
            self.velocity_noise_km_s,
            VELOCITY_NOISES_KM_S,
        )?;
        Ok(())
    }

    /// Particles at random, in proportion to their weights, among those in the bins of the track; ordered by angle.
    pub(super) fn draw(
        &self,
        particles: &Particles,
        params: &StreamParams<f64>,
        track: &ObservedTrack,
        rng: &mut impl Rng,
    ) -> Vec<StarVelocity> {
        // Efraimidis & Spirakis 2006: those with the smallest of these numbers are a sample by weight without replacement.
        let mut order: Vec<(f64, usize)> = (0..particles.len())
            .map(|i| {
                let weight = particles.weights.get(i).copied().unwrap_or(1.0);
                (-unit_open(rng).ln() / weight, i)
            })
            .collect();
        // Particles without weight have not left the progenitor.
        order.retain(|(number, _)| number.is_finite());
        order.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let fault = star_faults(track);
        let mut stars: Vec<StarVelocity> = order
            .into_iter()
            .map(|(_, i)| {
                let v_km_s = km_s_from_kpc_per_gyr(-particles.v[2][i]) + params.v_host_km_s;
                StarVelocity {
                    phi_deg: particles.angle(i).to_degrees() + params.phi0_deg,
                    v_km_s: Measured {
                        value: v_km_s + self.velocity_noise_km_s * standard_normal(rng),
                        error: self.velocity_noise_km_s,
                    },
                }
            })
            .filter(|star| fault(star).is_none())
            .take(self.count)
            .collect();
        stars.sort_by(|a, b| a.phi_deg.total_cmp(&b.phi_deg));
        stars
    }
}
