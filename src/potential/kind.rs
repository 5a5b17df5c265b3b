//! The kinds of haloes that settings can name.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The kind of the host's halo, and with it what q means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HaloKind {
    /// NFW, flattened in its potential, as in Chemaly et al. (2026).
    #[default]
    Nfw,
    /// NFW, flattened in its density, whose potential is rounder.
    NfwDensity,
    /// NFW, triaxial in its density: with a second axis ratio and its direction.
    NfwTriaxial,
    /// Logarithmic, flattened in its potential: a flat rotation curve.
    Logarithmic,
}

impl HaloKind {
    /// What q is the axis ratio of: surfaces of equal `potential` or of equal `density`.
    #[must_use]
    pub const fn flattened(self) -> &'static str {
        match self {
            Self::Nfw | Self::Logarithmic => "potential",
            Self::NfwDensity | Self::NfwTriaxial => "density",
        }
    }

    /// Whether it is that of settings that name none.
    #[must_use]
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for HaloKind {
    /// As settings name it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nfw => "nfw",
            Self::NfwDensity => "nfw_density",
            Self::NfwTriaxial => "nfw_triaxial",
            Self::Logarithmic => "logarithmic",
        })
    }
}
