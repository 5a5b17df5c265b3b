//! The particles today as a table for users: names with units, velocities in km/s, angles in degrees.

use super::model::Model;
use super::particles::Particles;
use crate::spray::Tail;
use crate::units::km_s_from_kpc_per_gyr;

/// Particles today, in the order of the table of releases, with the columns of `oblate stream --particles-out`.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleTable {
    /// The tail of each particle.
    pub tails: Vec<Tail>,
    /// The columns of numbers: name and values.
    pub columns: [(&'static str, Vec<f64>); 9],
}

impl Model {
    /// The table of particles that this model has made.
    #[must_use]
    pub fn particle_table(&self, particles: &Particles) -> ParticleTable {
        let table = self.table();
        let rows = 0..particles.len();
        let [vx, vy, vz] = particles
            .v
            .each_ref()
            .map(|v| v.iter().copied().map(km_s_from_kpc_per_gyr).collect());
        let release_time = |i: usize| table.taus[i / table.per_release_time];
        ParticleTable {
            tails: table.releases.iter().map(|release| release.tail).collect(),
            columns: [
                (
                    "t_release_fraction",
                    rows.clone().map(release_time).collect(),
                ),
                ("x_kpc", particles.x.clone()),
                ("y_kpc", particles.y.clone()),
                ("z_kpc", particles.z.clone()),
                ("vx_km_s", vx),
                ("vy_km_s", vy),
                ("vz_km_s", vz),
                (
                    "phi_deg",
                    rows.clone()
                        .map(|i| particles.angle(i).to_degrees())
                        .collect(),
                ),
                ("weight", rows.map(|i| particles.weight(i)).collect()),
            ],
        }
    }
}
