//! How much memory a model and its streams take, before any of it is taken.

use super::gradient::PARTS;
use super::lane_groups::{Group, UNROLL};
use super::progenitor_solution::ReleaseFrame;
use super::settings::{ModelSettings, StepsPer};
use super::system::SYSTEM_LEN;
use crate::orbit::{HermiteWeights, Node, OrbitTime, StepCotangent};
use crate::scalar::LANES;
use crate::spray::{Release, ReleaseOffset};
use oblate_samplers::limits::Memory;

/// Bytes of `count` values of a type.
fn bytes<T>(count: f64) -> f64 {
    count * size_of::<T>() as f64
}

impl ModelSettings {
    /// An estimate of the memory of a [`Model`](super::Model) with these settings, and of `threads` streams with their gradients that are
    /// computed at once.
    ///
    /// The model has, for each particle, its release (its release offset besides, while the table is made) and its place in a lane group,
    /// and the interpolation weights of every step of every release time. Each thread has nine numbers per particle (state, winding number,
    /// two derivatives), the orbit and its derivatives, and the step schedules of the gradient's parts. Paths are not stored.
    #[must_use]
    pub fn memory(&self, threads: usize) -> Memory {
        let (n, steps, nodes) = (
            self.releases.particles as f64,
            self.steps as f64,
            self.orbit_steps as f64,
        );
        let release_times = self.releases.number_of_release_times() as f64;
        let groups = release_times * (n / release_times / LANES as f64).ceil();
        let mean_steps = match self.steps_per {
            StepsPer::Particle => steps,
            StepsPer::Age => 0.5 * steps + 1.0,
        };
        let threads = threads as f64;
        let table = bytes::<Release>(n) + bytes::<ReleaseOffset>(n) + bytes::<Group>(groups);
        let weights = bytes::<HermiteWeights>(release_times * (mean_steps + 1.0));
        let parts = PARTS as f64;
        let schedule = bytes::<StepCotangent<f64>>((LANES * UNROLL + UNROLL) as f64)
            + UNROLL as f64
                * (bytes::<[f64; 6]>(1.0)
                    + bytes::<OrbitTime<f64>>(1.0)
                    + bytes::<HermiteWeights>(1.0));
        // The orbit of the value, its derivatives in each part, and the orbit on dual numbers.
        let node =
            bytes::<Node<f64>>(2.0 + parts + (1 + SYSTEM_LEN.next_multiple_of(LANES)) as f64);
        Memory::default()
            .with(
                "model.releases.particles",
                table + threads * bytes::<f64>(9.0 * n),
            )
            .with("model.steps", weights + threads * parts * steps * schedule)
            .with("model.orbit_steps", threads * nodes * node)
            .with(
                "model.releases.release_times",
                threads * bytes::<ReleaseFrame<f64>>(2.0 * release_times),
            )
    }
}
