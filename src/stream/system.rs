//! The system: host, progenitor, its state today, and the age.

use crate::orbit::State;
use crate::params::{QRange, StreamParams};
use crate::potential::{Halo, HaloParameters, Nfw, Plummer};
use crate::scalar::{Real, Scalar, Vec3};
use crate::units::KM_S_IN_KPC_PER_GYR;
use std::f64::consts::LN_10;

/// Host, progenitor, its state today, and the age: everything physical that a stream depends on.
///
/// `H` is the kind of halo, by default that of Chemaly et al. (2026).
#[derive(Clone, Copy, Debug)]
pub struct System<S: Scalar, H: Halo = Nfw> {
    /// The host.
    pub host: H::In<S>,
    /// The progenitor's own gravity.
    pub progenitor: Plummer<S>,
    /// The progenitor today, kpc and kpc/Gyr.
    pub today: State<S>,
    /// Time since the first release, Gyr.
    pub age_gyr: S,
}

impl<S: Real> System<S> {
    /// The system of 13 parameters (docs/physics.md, section 1).
    pub fn from_params(params: &StreamParams<S>, q_range: QRange) -> Self {
        Self::with_halo(params, q_range)
    }
}

impl<S: Real, H: Halo> System<S, H> {
    /// As [`from_params`](System::from_params), with a halo of another kind.
    pub fn with_halo(params: &StreamParams<S>, q_range: QRange) -> Self {
        let mass = |log10: S| (log10 * LN_10).exp();
        let shape = q_range.shape(params.dir());
        Self {
            host: H::new(HaloParameters::from_q(
                mass(params.log10_m_halo),
                params.r_s_halo_kpc,
                shape.q,
                shape.axis,
            )),
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

/// Length of the vector of a system.
pub const SYSTEM_LEN: usize = 15;

impl<S: Real, H: Halo> System<S, H> {
    /// The system as a vector: mass (Msun), scale radius (kpc), flattening 1/q^2 - 1 and axis of the halo; mass (Msun) and scale radius
    /// (kpc) of the progenitor, its position (kpc) and velocity (kpc/Gyr) today; the age (Gyr).
    #[inline(always)]
    pub fn to_vector(&self) -> [S; SYSTEM_LEN] {
        let Self {
            progenitor,
            today: State { x, v },
            age_gyr,
            ..
        } = *self;
        let HaloParameters {
            mass,
            r_s,
            flattening,
            axis: n,
        } = H::parameters(&self.host);
        [
            mass,
            r_s,
            flattening,
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

    /// The system of a [vector](Self::to_vector).
    #[inline(always)]
    pub fn from_vector(vector: [S; SYSTEM_LEN]) -> Self {
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
        ] = vector;
        Self {
            host: H::new(HaloParameters {
                mass,
                r_s,
                flattening,
                axis: Vec3::new(n_x, n_y, n_z),
            }),
            progenitor: Plummer { mass: m, r_s: a },
            today: State {
                x: Vec3::new(x, y, z),
                v: Vec3::new(v_x, v_y, v_z),
            },
            age_gyr,
        }
    }
}
