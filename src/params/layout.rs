//! Name, unit, range and index of each of the thirteen parameters, in one table.

use crate::scalar::{Scalar, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Number of parameters of a stream.
pub const DIM: usize = 13;

/// Name, unit and range of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// The name in files, flags and columns.
    pub name: &'static str,
    /// The unit as astropy reads it; empty where there is none.
    pub unit: &'static str,
    /// Values that it may be fixed at, and the bounds and means of its prior (docs/limits.md).
    pub range: RangeInclusive<f64>,
}

/// Defines the table, the struct and the conversions from one list, so that they agree.
macro_rules! parameters {
    ($($(#[$doc:meta])* $name:ident, $unit:literal, $range:expr;)*) => {
        /// Names, units and ranges, in the order of the table of priors.
        pub const PARAMETERS: [Parameter; DIM] = [
            $(Parameter { name: stringify!($name), unit: $unit, range: $range },)*
        ];

        /// The names alone, in the same order.
        pub const NAMES: [&str; DIM] = [$(stringify!($name),)*];

        /// One entry per parameter of a stream: values (`f64`, duals), marginals, or optional fixed values.
        ///
        /// In files it is a TOML table or JSON object with exactly these thirteen keys.
        ///
        /// ```
        /// use oblate::params::{StreamParams, index_of};
        ///
        /// let params = StreamParams::from_array([
        ///     12.5, 15.0, 0.3, -0.8, 0.6, 8.0, 2.0, 60.0, 40.0, -30.0, 150.0, 20.0, 2.5,
        /// ]);
        /// assert_eq!(params.to_array()[index_of("age_gyr").unwrap()], params.age_gyr);
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct StreamParams<S> {
            $($(#[$doc])* pub $name: S,)*
        }

        impl<S> StreamParams<S> {
            /// From the thirteen entries in the order of [`PARAMETERS`].
            pub fn from_array([$($name),*]: [S; DIM]) -> Self {
                Self { $($name),* }
            }

            /// The thirteen entries in the order of [`PARAMETERS`].
            pub fn to_array(self) -> [S; DIM] {
                [$(self.$name),*]
            }

            /// The entry of one parameter, to change it; `index` counts as in [`PARAMETERS`].
            pub fn get_mut(&mut self, index: usize) -> Option<&mut S> {
                [$(&mut self.$name),*].into_iter().nth(index)
            }
        }
    };
}

parameters! {
    /// log10 of the NFW mass scale `4 pi rho_0 r_s^3` in solar masses; not M200.
    log10_m_halo, "dex(solMass)", 8.0..=17.0;
    /// NFW scale radius in kpc.
    r_s_halo_kpc, "kpc", 0.01..=1_000.0;
    /// Shape vector, component along the sky's x axis; see [`Shape`](crate::params::Shape).
    dir_x, "", -10.0..=10.0;
    /// Shape vector, component along the sky's y axis.
    dir_y, "", -10.0..=10.0;
    /// Shape vector, component towards the observer.
    dir_z, "", -10.0..=10.0;
    /// log10 of the progenitor's Plummer mass in solar masses.
    log10_m_prog, "dex(solMass)", 2.0..=13.0;
    /// Plummer scale radius in kpc.
    r_s_prog_kpc, "kpc", 0.0001..=100.0;
    /// The progenitor's x today in kpc; its y is zero by the choice of the sky's axes.
    x0_kpc, "kpc", -10_000.0..=10_000.0;
    /// The progenitor's z today in kpc.
    z0_kpc, "kpc", -10_000.0..=10_000.0;
    /// The progenitor's velocity today along x in km/s.
    vx0_km_s, "km / s", -10_000.0..=10_000.0;
    /// The progenitor's velocity today along y in km/s.
    vy0_km_s, "km / s", -10_000.0..=10_000.0;
    /// The progenitor's velocity today along z in km/s.
    vz0_km_s, "km / s", -10_000.0..=10_000.0;
    /// Age of the stream in Gyr: its first particles left that long ago.
    age_gyr, "Gyr", 0.001..=100.0;
}

impl<S: Copy> StreamParams<S> {
    /// Applies `f` to each entry.
    pub fn map<T>(&self, f: impl FnMut(S) -> T) -> StreamParams<T> {
        StreamParams::from_array(self.to_array().map(f))
    }

    /// The shape vector.
    #[must_use]
    pub fn dir(&self) -> Vec3<S> {
        Vec3::from([self.dir_x, self.dir_y, self.dir_z])
    }

    /// The progenitor's velocity today in km/s.
    #[must_use]
    pub fn velocity_km_s(&self) -> Vec3<S> {
        Vec3::from([self.vx0_km_s, self.vy0_km_s, self.vz0_km_s])
    }
}

impl<S: Scalar> StreamParams<S> {
    /// The progenitor's position today in kpc, `(x0, 0, z0)`.
    #[must_use]
    pub fn position_kpc(&self) -> Vec3<S> {
        Vec3::new(self.x0_kpc, S::zero(), self.z0_kpc)
    }
}

/// The index of a parameter in [`PARAMETERS`] by its name; `None` for an unknown name.
#[must_use]
pub fn index_of(name: &str) -> Option<usize> {
    NAMES.iter().position(|n| *n == name)
}
