//! Name, unit, range and index of each parameter, in one table: the thirteen that every stream has, and optional ones.

use crate::scalar::{Scalar, Vec3};
use serde::de::Error as _;
use serde::ser::SerializeStruct;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::ops::RangeInclusive;

/// Number of parameters, the optional ones included.
pub const DIM: usize = 30;

/// Number of parameters that every stream has: the first ones of [`PARAMETERS`].
pub const REQUIRED: usize = 13;

/// Name, unit and range of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// The name in files, flags and columns.
    pub name: &'static str,
    /// The unit as astropy reads it; empty where there is none.
    pub unit: &'static str,
    /// Values that it may be fixed at, and the bounds and means of its prior (docs/limits.md).
    pub range: RangeInclusive<f64>,
    /// The value that an optional parameter has while it is absent; none: every stream has this parameter.
    pub absent: Option<f64>,
}

/// Defines the table, the struct and the conversions from one list, so that they agree. An optional parameter is one line of it, after those
/// of every stream, and the place where it acts.
macro_rules! parameters {
    ($($(#[$doc:meta])* $name:ident, $unit:literal, $range:expr, $absent:expr;)*) => {
        /// Names, units and ranges, in the order of the table of priors.
        pub const PARAMETERS: [Parameter; DIM] = [
            $(Parameter { name: stringify!($name), unit: $unit, range: $range, absent: $absent },)*
        ];

        /// The names alone, in the same order.
        pub const NAMES: [&str; DIM] = [$(stringify!($name),)*];

        /// One entry per parameter of a stream: values (`f64`, duals), marginals, or optional fixed values.
        ///
        /// In files it is a TOML table or JSON object with the thirteen keys of every stream. An optional parameter that is absent has no
        /// key; as a value it has then [`Parameter::absent`].
        ///
        /// ```
        /// use oblate::params::{StreamParams, index_of};
        ///
        /// let params = StreamParams::from([
        ///     12.5, 15.0, 0.3, -0.8, 0.6, 8.0, 2.0, 60.0, 40.0, -30.0, 150.0, 20.0, 2.5,
        /// ]);
        /// assert_eq!(params.to_array()[index_of("age_gyr").unwrap()], params.age_gyr);
        /// assert_eq!(params.distance_factor, 1.0);
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct StreamParams<S> {
            $($(#[$doc])* pub $name: S,)*
        }

        impl<S> StreamParams<S> {
            /// From the entries in the order of [`PARAMETERS`], optional parameters too.
            pub fn from_array([$($name),*]: [S; DIM]) -> Self {
                Self { $($name),* }
            }

            /// The entries in the order of [`PARAMETERS`], optional parameters too.
            pub fn to_array(self) -> [S; DIM] {
                [$(self.$name),*]
            }

            /// The entry of one parameter, to change it; `index` counts as in [`PARAMETERS`].
            pub fn get_mut(&mut self, index: usize) -> Option<&mut S> {
                [$(&mut self.$name),*].into_iter().nth(index)
            }

            fn entries(&self) -> [&S; DIM] {
                [$(&self.$name),*]
            }
        }

        impl StreamParams<f64> {
            /// Absent optional parameters, to complete a value that names the thirteen of every stream; those are NaN here.
            pub const ABSENT: Self = Self {
                $($name: match $absent {
                    Some(value) => value,
                    None => f64::NAN,
                },)*
            };
        }

        /// What a file has: any of the keys.
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields, expecting = "a table of parameters")]
        struct Given<S> {
            $($name: Option<S>,)*
        }

        impl<'de, S: Entry + Deserialize<'de>> Deserialize<'de> for StreamParams<S> {
            fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
                let given = Given::<S>::deserialize(source)?;
                Ok(Self {
                    $($name: match given.$name.or_else(|| S::left_out($absent)) {
                        Some(entry) => entry,
                        None => return Err(D::Error::missing_field(stringify!($name))),
                    },)*
                })
            }
        }
    };
}

/// An entry of a parameter in a file.
pub trait Entry: Sized {
    /// The entry where the file has no key, by [`Parameter::absent`]; `None` if it must have one.
    fn left_out(absent: Option<f64>) -> Option<Self>;

    /// Whether the file needs no key for this entry of a parameter with this [`Parameter::absent`].
    fn may_be_left_out(&self, absent: Option<f64>) -> bool;
}

impl Entry for f64 {
    fn left_out(absent: Option<f64>) -> Option<Self> {
        absent
    }

    fn may_be_left_out(&self, absent: Option<f64>) -> bool {
        absent.is_some_and(|absent| self.total_cmp(&absent).is_eq())
    }
}

impl<T> Entry for Option<T> {
    fn left_out(_: Option<f64>) -> Option<Self> {
        Some(None)
    }

    fn may_be_left_out(&self, absent: Option<f64>) -> bool {
        self.is_none() && absent.is_some()
    }
}

impl<S: Entry + Serialize> Serialize for StreamParams<S> {
    fn serialize<Z: Serializer>(&self, target: Z) -> Result<Z::Ok, Z::Error> {
        let mut fields = target.serialize_struct("StreamParams", DIM)?;
        for (Parameter { name, absent, .. }, entry) in PARAMETERS.iter().zip(self.entries()) {
            if entry.may_be_left_out(*absent) {
                fields.skip_field(name)?;
            } else {
                fields.serialize_field(name, entry)?;
            }
        }
        fields.end()
    }
}

/// The values of all parameters from those of the thirteen that every stream has; optional ones are absent.
#[must_use]
pub const fn without_optional(required: [f64; REQUIRED]) -> [f64; DIM] {
    let mut all = [f64::NAN; DIM];
    let mut i = 0;
    while i < DIM {
        all[i] = match PARAMETERS[i].absent {
            Some(value) => value,
            None => required[i],
        };
        i += 1;
    }
    all
}

impl From<[f64; REQUIRED]> for StreamParams<f64> {
    /// As [`without_optional`].
    fn from(required: [f64; REQUIRED]) -> Self {
        Self::from_array(without_optional(required))
    }
}

impl<T> Default for StreamParams<Option<T>> {
    fn default() -> Self {
        Self::from_array(std::array::from_fn(|_| None))
    }
}

parameters! {
    /// log10 of the NFW mass scale `4 pi rho_0 r_s^3` in solar masses; not M200.
    log10_m_halo, "dex(solMass)", 8.0..=17.0, None;
    /// NFW scale radius in kpc.
    r_s_halo_kpc, "kpc", 0.01..=1_000.0, None;
    /// Shape vector, component along the sky's x axis; see [`Shape`](crate::params::Shape).
    dir_x, "", -10.0..=10.0, None;
    /// Shape vector, component along the sky's y axis.
    dir_y, "", -10.0..=10.0, None;
    /// Shape vector, component towards the observer.
    dir_z, "", -10.0..=10.0, None;
    /// log10 of the progenitor's Plummer mass in solar masses.
    log10_m_prog, "dex(solMass)", 2.0..=13.0, None;
    /// Plummer scale radius in kpc.
    r_s_prog_kpc, "kpc", 0.0001..=100.0, None;
    /// The progenitor's x today in kpc; its y is zero by the choice of the sky's axes.
    x0_kpc, "kpc", -10_000.0..=10_000.0, None;
    /// The progenitor's z today in kpc.
    z0_kpc, "kpc", -10_000.0..=10_000.0, None;
    /// The progenitor's velocity today along x in km/s.
    vx0_km_s, "km / s", -10_000.0..=10_000.0, None;
    /// The progenitor's velocity today along y in km/s.
    vy0_km_s, "km / s", -10_000.0..=10_000.0, None;
    /// The progenitor's velocity today along z in km/s.
    vz0_km_s, "km / s", -10_000.0..=10_000.0, None;
    /// Age of the stream in Gyr: its first particles left that long ago.
    age_gyr, "Gyr", 0.001..=100.0, None;
    /// Scatter of the radii beyond their errors, as a fraction of the radius.
    jitter, "", 0.0..=1.0, Some(0.0);
    /// The true distance over that by which the radii were converted to kpc.
    distance_factor, "", 0.1..=10.0, Some(1.0);
    /// phi of the progenitor in the data, degrees.
    phi0_deg, "deg", -360.0..=360.0, Some(0.0);
    /// log10 of the mass of the host's disc in solar masses.
    log10_m_disc, "dex(solMass)", 2.0..=14.0, Some(2.0);
    /// Scale length of the disc in kpc.
    r_disc_kpc, "kpc", 0.01..=1_000.0, Some(0.01);
    /// Angle between the normal of the disc and the line of sight, degrees; between 0 and 90 if the side of the disc at `phi_disc_deg` + 90 is
    /// the far one, between -90 and 0 if it is the near one.
    inclination_disc_deg, "deg", -180.0..=180.0, Some(0.0);
    /// phi of the major axis of the disc in the data, degrees.
    phi_disc_deg, "deg", -360.0..=360.0, Some(0.0);
    /// log10 of the mass of the host's bulge in solar masses.
    log10_m_bulge, "dex(solMass)", 2.0..=14.0, Some(2.0);
    /// Scale radius of the bulge in kpc.
    r_bulge_kpc, "kpc", 0.001..=1_000.0, Some(0.001);
    /// Line-of-sight velocity of the host beyond that which the velocities of the data are relative to, km/s.
    v_host_km_s, "km / s", -10_000.0..=10_000.0, Some(0.0);
    /// log10 of the number of stars of the sample that the whole stream has: the scale of the densities of the data.
    log10_n_stars, "dex", 0.0..=12.0, Some(0.0);
    /// Second axis ratio p of a triaxial halo, as q.
    p_halo, "", 0.01..=100.0, Some(1.0);
    /// Angle of the second axis around that of q, degrees (docs/physics.md, section 2).
    psi_halo_deg, "deg", -360.0..=360.0, Some(0.0);
    /// Fraction of the progenitor's mass that is left today.
    m_prog_left, "", 0.001..=1.0, Some(1.0);
    /// Fraction of the age after which nothing of the progenitor is left.
    dissolved_at, "", 0.01..=1.0, Some(1.0);
    /// Power of the frequency of orbits at the tidal radius that stars leave in proportion to.
    release_peaking, "", 0.0..=10.0, Some(0.0);
    /// Coulomb logarithm of the dynamical friction.
    coulomb_logarithm, "", 0.0..=100.0, Some(0.0);
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
