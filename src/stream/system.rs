//! What makes a stream: a halo, a progenitor, and where it is today.

use crate::orbit::State;
use crate::params::{QRange, StreamParams};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Real, Vec3};
use crate::units::KM_S_IN_KPC_PER_GYR;
use std::f64::consts::LN_10;

/// What makes a stream: a host, a progenitor, and where it is today.
#[derive(Clone, Copy, Debug)]
pub struct System<S> {
    /// The halo.
    pub host: FlattenedNfw<S>,
    /// The progenitor's own gravity.
    pub progenitor: Plummer<S>,
    /// The progenitor today, kpc and kpc/Gyr.
    pub today: State<S>,
    /// Time since the first release.
    pub age_gyr: S,
}

impl<S: Real> System<S> {
    /// The galaxy of 13 parameters (physics.md 1): masses from their logarithms, the halo's shape from its vector, the
    /// progenitor today at y = 0.
    pub fn from_params(params: &StreamParams<S>, q_range: QRange) -> Self {
        let mass = |log10: S| (log10 * LN_10).exp();
        let shape = q_range.shape(params.dir());
        Self {
            host: FlattenedNfw::new(
                mass(params.log10_m_halo),
                params.r_s_halo_kpc,
                shape.q,
                shape.axis,
            ),
            progenitor: Plummer {
                mass: mass(params.log10_m_prog),
                r_s: params.r_s_prog_kpc,
            },
            today: State {
                x: params.position_kpc(),
                v: params.velocity_km_s() * S::from_f64(KM_S_IN_KPC_PER_GYR),
            },
            age_gyr: params.age_gyr,
        }
    }
}

impl From<&StreamParams<f64>> for System<f64> {
    /// As [`System::from_params`], with the range of q of the default prior.
    fn from(params: &StreamParams<f64>) -> Self {
        Self::from_params(params, QRange::default())
    }
}

impl<S: Real> System<S> {
    /// How many numbers a galaxy is.
    pub const LEN: usize = 15;

    /// The numbers: mass, scale radius, flattening 1/q^2 - 1 and axis of the halo, mass and scale radius of the
    /// progenitor, its position and velocity today, the age.
    #[inline(always)]
    pub fn numbers(&self) -> [S; 15] {
        let Self {
            host,
            progenitor,
            today: State { x, v },
            age_gyr,
        } = *self;
        let n = host.axis;
        [
            host.mass,
            host.r_s,
            host.flattening,
            n.x,
            n.y,
            n.z,
            progenitor.mass,
            progenitor.r_s,
            x.x,
            x.y,
            x.z,
            v.x,
            v.y,
            v.z,
            age_gyr,
        ]
    }

    /// The galaxy of its [numbers](Self::numbers).
    #[inline(always)]
    pub fn from_vector(numbers: [S; 15]) -> Self {
        let [
            mass,
            r_s,
            flattening,
            n_x,
            n_y,
            n_z,
            m,
            a,
            x,
            y,
            z,
            v_x,
            v_y,
            v_z,
            age_gyr,
        ] = numbers;
        let axis = Vec3::new(n_x, n_y, n_z);
        Self {
            host: FlattenedNfw::from_flattening(mass, r_s, flattening, axis),
            progenitor: Plummer { mass: m, r_s: a },
            today: State {
                x: Vec3::new(x, y, z),
                v: Vec3::new(v_x, v_y, v_z),
            },
            age_gyr,
        }
    }
}
