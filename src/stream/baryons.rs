//! Disc and bulge of the host: which there are, by the settings, and their parameters (docs/physics.md, section 2).

use super::angle::sin_cos_deg;
use crate::error::Result;
use crate::params::{StreamParams, StreamPrior};
use crate::potential::{Baryons, Disc, DiscProfile, DiscShape, Hernquist};
use crate::scalar::{Real, Vec3};
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};
use std::f64::consts::LN_10;

/// How a disc lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DiscPlane {
    /// By the parameters `inclination_disc_deg` and `phi_disc_deg`.
    #[default]
    Angles,
    /// Perpendicular to the symmetry axis of the halo.
    Halo,
}

/// The disc of the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscSettings {
    /// How its mass is distributed.
    pub profile: DiscProfile,
    /// Its height over its scale length, as the profile defines both.
    pub thickness: f64,
    /// How it lies.
    #[serde(default)]
    pub plane: DiscPlane,
}

/// The bulge of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BulgeProfile {
    /// Hernquist (1990).
    Hernquist,
}

/// The stars of the host galaxy whose mass is not part of the halo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BaryonSettings {
    /// The disc, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disc: Option<DiscSettings>,
    /// The bulge, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bulge: Option<BulgeProfile>,
}

/// The parameters of a disc, those of its plane, and those of a bulge.
const OF_DISC: [&str; 2] = ["log10_m_disc", "r_disc_kpc"];
const OF_PLANE: [&str; 2] = ["inclination_disc_deg", "phi_disc_deg"];
const OF_BULGE: [&str; 2] = ["log10_m_bulge", "r_bulge_kpc"];

impl BaryonSettings {
    /// Whether there is neither disc nor bulge.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.disc.is_none() && self.bulge.is_none()
    }

    /// Checks that every number is in its range of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        if let Some(disc) = self.disc {
            let most = match disc.profile {
                DiscProfile::MiyamotoNagai => 2.0,
                // Beyond, the three discs have a negative density.
                DiscProfile::Exponential => 0.8,
            };
            in_range("model.baryons.disc.thickness", disc.thickness, 0.001..=most)?;
        }
        Ok(())
    }

    /// Checks that a prior has the parameters of disc and bulge, if there are such, and no others of these.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) with the first parameter that lacks a value or a distribution, or that has one in vain.
    pub fn check_prior(&self, prior: &StreamPrior) -> Result<()> {
        let has_angles = self.disc.is_some_and(|d| d.plane == DiscPlane::Angles);
        let groups = [
            (OF_DISC, self.disc.is_some(), "`model.baryons.disc`"),
            (
                OF_PLANE,
                has_angles,
                "`model.baryons.disc` with `plane = \"angles\"`",
            ),
            (OF_BULGE, self.bulge.is_some(), "`model.baryons.bulge`"),
        ];
        for (names, is_there, part) in groups {
            for name in names {
                prior.check_belongs(name, is_there, part, None)?;
            }
        }
        self.check_sides(prior)
    }

    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) by [`StreamPrior::check_both_sides`] if the disc has a near side.
    fn check_sides(&self, prior: &StreamPrior) -> Result<()> {
        let has_side = match self.disc.map(|disc| disc.plane) {
            None | Some(DiscPlane::Halo) => false,
            Some(DiscPlane::Angles) => {
                let fixed = prior.settings().fixed.inclination_disc_deg;
                fixed.is_none_or(|deg| (deg / 90.0).fract().abs() > 0.0)
            }
        };
        if has_side {
            prior.check_both_sides("an inclined disc tells")
        } else {
            Ok(())
        }
    }

    /// Disc and bulge at these parameters, in a halo with this symmetry axis. One whose parameters are absent has the least mass of their range, which
    /// does nothing.
    pub fn at<S: Real>(&self, params: &StreamParams<S>, halo_axis: Vec3<S>) -> Baryons<S> {
        let mass = |log10: S| (log10 * LN_10).exp();
        let disc = self.disc.map_or_else(Disc::none, |disc| {
            let normal = match disc.plane {
                DiscPlane::Halo => halo_axis,
                DiscPlane::Angles => normal(
                    params.inclination_disc_deg,
                    params.phi_disc_deg - params.phi0_deg,
                ),
            };
            Disc::new(
                mass(params.log10_m_disc),
                params.r_disc_kpc,
                normal,
                DiscShape::new(disc.profile, disc.thickness),
            )
        });
        let bulge = match self.bulge {
            Some(BulgeProfile::Hernquist) => Hernquist {
                mass: mass(params.log10_m_bulge),
                r_s: params.r_bulge_kpc,
            },
            None => Hernquist::none(),
        };
        Baryons { disc, bulge }
    }
}

/// The unit normal of a disc whose major axis has the angle `phi_deg` from the sky's x axis, inclined by `inclination_deg`.
fn normal<S: Real>(inclination_deg: S, phi_deg: S) -> Vec3<S> {
    let (sin_i, cos_i) = sin_cos_deg(inclination_deg);
    let (sin_phi, cos_phi) = sin_cos_deg(phi_deg);
    Vec3::new(-(sin_phi * sin_i), cos_phi * sin_i, cos_i)
}
