//! How the data of a track relate to the stream: the parameters of the observation (docs/physics.md, section 7).

use crate::error::Rejection;
use crate::params::StreamParams;
use crate::scalar::Real;
use crate::track::ANGLES_DEG;

/// Numbers of stars with larger logarithms would overflow when they are squared.
const MAX_LOG10_STARS: f64 = 100.0;

/// The parameters of the observation. By default all are absent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<S> {
    /// Scatter of the radii beyond their errors, as a fraction of the measured radius.
    pub jitter: S,
    /// The true distance over that by which the radii were converted to kpc.
    pub distance_factor: S,
    /// phi of the progenitor in the data, degrees.
    pub phi0_deg: S,
    /// Line-of-sight velocity of the host beyond that which the data are relative to, km/s.
    pub v_host_km_s: S,
    /// log10 of the number of stars of the sample that the whole stream has.
    pub log10_n_stars: S,
}

impl<S: Copy> From<&StreamParams<S>> for Observation<S> {
    fn from(params: &StreamParams<S>) -> Self {
        Self {
            jitter: params.jitter,
            distance_factor: params.distance_factor,
            phi0_deg: params.phi0_deg,
            v_host_km_s: params.v_host_km_s,
            log10_n_stars: params.log10_n_stars,
        }
    }
}

impl Default for Observation<f64> {
    fn default() -> Self {
        Self::from(&StreamParams::ABSENT)
    }
}

impl<S: Real> Observation<S> {
    /// Checks that data can have been observed so.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] if a number is not finite, or too large, the jitter negative, the distance factor not positive, or phi of the
    /// progenitor beyond twenty turns.
    pub fn check(&self) -> Result<(), Rejection> {
        let [jitter, factor, phi0_deg] =
            [self.jitter, self.distance_factor, self.phi0_deg].map(Real::re);
        let possible = jitter >= 0.0
            && jitter.is_finite()
            && factor > 0.0
            && factor.is_finite()
            && ANGLES_DEG.contains(&phi0_deg)
            && self.v_host_km_s.re().is_finite()
            && self.log10_n_stars.re().abs() < MAX_LOG10_STARS;
        if possible {
            Ok(())
        } else {
            Err(Rejection::BadParameter)
        }
    }
}
