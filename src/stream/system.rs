//! The system: host, progenitor, its state today, and the age.

use super::mass_loss;
use super::second_axis::second_axis;
use super::settings::ModelSettings;
use crate::orbit::State;
use crate::params::{QRange, StreamParams};
use crate::potential::{
    Baryons, HaloParameters, Hernquist, Host, HostParts, Nfw, Plummer, SecondAxis,
};
use crate::scalar::{Real, Scalar, Vec3};
use crate::units::KM_S_IN_KPC_PER_GYR;
use std::f64::consts::LN_10;

/// Host, progenitor, its state today, and the age: everything physical that a stream depends on.
///
/// `H` is the kind of host, by default that of Chemaly et al. (2026).
#[derive(Clone, Copy, Debug)]
pub struct System<S: Scalar, H: Host = Nfw> {
    /// The host.
    pub host: H::In<S>,
    /// The progenitor's own gravity at the first release.
    pub progenitor: Plummer<S>,
    /// The parameter of the law by which it loses mass; 1 without one.
    pub mass_loss: S,
    /// The power of the tidal rate of releases; 0 without it.
    pub release_peaking: S,
    /// The Coulomb logarithm of its friction; 0 without friction.
    pub coulomb_logarithm: S,
    /// The progenitor today, kpc and kpc/Gyr.
    pub today: State<S>,
    /// Time since the first release, Gyr.
    pub age_gyr: S,
}

impl<S: Real> System<S> {
    /// The system of 13 parameters (docs/physics.md, section 1).
    pub fn from_params(params: &StreamParams<S>, q_range: QRange) -> Self {
        Self::with_host(params, q_range, &ModelSettings::default())
    }
}

impl<S: Real, H: Host> System<S, H> {
    /// As [`from_params`](System::from_params), with a host of another kind, which may have the halo, the disc and the bulge of a model's
    /// settings.
    pub fn with_host(params: &StreamParams<S>, q_range: QRange, model: &ModelSettings) -> Self {
        let mass = |log10: S| (log10 * LN_10).exp();
        let shape = q_range.shape(params.dir());
        let halo = HaloParameters::from_q(
            mass(params.log10_m_halo),
            params.r_s_halo_kpc,
            shape.q,
            shape.axis,
        );
        Self {
            host: H::from_parts(HostParts {
                halo: HaloParameters {
                    second: second_axis(model.halo, params, shape.axis),
                    ..halo
                },
                kind: model.halo,
                baryons: model.baryons.at(params, shape.axis),
                has_baryons: !model.baryons.is_none(),
            }),
            progenitor: Plummer {
                mass: mass(params.log10_m_prog),
                r_s: params.r_s_prog_kpc,
            },
            mass_loss: mass_loss::parameter_of(model.mass_loss, params),
            release_peaking: params.release_peaking,
            coulomb_logarithm: params.coulomb_logarithm,
            today: State {
                x: params.position_kpc(),
                v: params.velocity_km_s() * S::from_f64(KM_S_IN_KPC_PER_GYR),
            },
            age_gyr: params.age_gyr,
        }
    }
}

/// Length of the vector of a system without baryons.
pub const HALO_LEN: usize = 15;

/// Length of the vector of a system.
pub const SYSTEM_LEN: usize = HALO_LEN + 14;

impl<S: Scalar, H: Host> System<S, H> {
    /// The system as a vector: mass (Msun), scale radius (kpc), flattening 1/q^2 - 1 and axis of the halo; mass (Msun) and scale radius
    /// (kpc) of the progenitor, its position (kpc) and velocity (kpc/Gyr) today; the age (Gyr); mass (Msun), scale length (kpc) and normal
    /// of the disc; mass (Msun) and scale radius (kpc) of the bulge; flattening 1/p^2 - 1 and direction of the second axis of the halo; the
    /// parameter of the progenitor's loss of mass; the power of the rate of releases; the Coulomb logarithm.
    #[inline(always)]
    pub fn to_vector(&self) -> [S; SYSTEM_LEN] {
        let Self {
            progenitor,
            mass_loss,
            release_peaking,
            coulomb_logarithm,
            today: State { x, v },
            age_gyr,
            ..
        } = *self;
        let HostParts { halo, baryons, .. } = H::parts(&self.host);
        let HaloParameters {
            mass,
            r_s,
            flattening,
            axis: n,
            second,
        } = halo;
        let Baryons { disc, bulge } = baryons;
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
            disc.mass,
            disc.r_s,
            disc.normal.x,
            disc.normal.y,
            disc.normal.z,
            bulge.mass,
            bulge.r_s,
            second.flattening,
            second.axis.x,
            second.axis.y,
            second.axis.z,
            mass_loss,
            release_peaking,
            coulomb_logarithm,
        ]
    }

    /// The same kind of system with the numbers of another [vector](Self::to_vector).
    #[inline(always)]
    pub fn with_vector<T: Scalar>(&self, vector: [T; SYSTEM_LEN]) -> System<T, H> {
        let [
            mass,
            r_s,
            flattening,
            axis_x,
            axis_y,
            axis_z,
            m,
            a,
            x,
            y,
            z,
            v_x,
            v_y,
            v_z,
            age_gyr,
            disc_mass,
            disc_r,
            n_x,
            n_y,
            n_z,
            bulge_mass,
            bulge_r,
            second_flattening,
            second_x,
            second_y,
            second_z,
            mass_loss,
            release_peaking,
            coulomb_logarithm,
        ] = vector;
        let HostParts {
            kind,
            baryons,
            has_baryons,
            ..
        } = H::parts(&self.host);
        let normal = Vec3::new(n_x, n_y, n_z);
        let baryons = Baryons {
            disc: baryons.disc.with_numbers(disc_mass, disc_r, normal),
            bulge: Hernquist {
                mass: bulge_mass,
                r_s: bulge_r,
            },
        };
        System {
            host: H::from_parts(HostParts {
                kind,
                has_baryons,
                halo: HaloParameters {
                    mass,
                    r_s,
                    flattening,
                    axis: Vec3::new(axis_x, axis_y, axis_z),
                    second: SecondAxis {
                        flattening: second_flattening,
                        axis: Vec3::new(second_x, second_y, second_z),
                    },
                },
                baryons,
            }),
            progenitor: Plummer { mass: m, r_s: a },
            mass_loss,
            release_peaking,
            coulomb_logarithm,
            today: State {
                x: Vec3::new(x, y, z),
                v: Vec3::new(v_x, v_y, v_z),
            },
            age_gyr,
        }
    }
}
