//! An estimate of the memory of a model and its streams, before any of it is allocated.

use super::lane_groups::{LaneGroup, RELEASE_TIME_CHUNKS, UNROLL};
use super::progenitor_solution::ReleaseFrame;
use super::settings::{ModelSettings, StepRule, StepsPer};
use super::system::SYSTEM_LEN;
use crate::orbit::{HermiteWeights, Node, STAGES};
use crate::scalar::LANES;
use crate::spray::{Release, ReleaseOffset};
use oblate_samplers::limits::Memory;

/// Size in bytes of `count` values of a type.
fn bytes<T>(count: f64) -> f64 {
    count * size_of::<T>() as f64
}

impl ModelSettings {
    /// An estimate of the memory of a [`Model`](super::Model) with these settings, and of `threads` streams with their gradients that are
    /// computed at once.
    ///
    /// The model has, for each particle, its release (its uniform and normal numbers and twice its offset while the table is made) and its lanes
    /// in a lane group, and the Hermite weights of every equal step of every release time. Each thread has up to 19 numbers per particle (state,
    /// winding number, two derivatives, ten of the bins with their derivatives), the orbit and its derivatives, and the step schedules of the
    /// gradient's chunks. Trajectories are not stored. Adaptive steps are counted as if all were as short as possible.
    #[must_use]
    pub fn memory(&self, threads: usize) -> Memory {
        let n = self.releases.particles as f64;
        let (longest, nodes) = (self.steps as f64, self.orbit_steps as f64);
        let (steps, nodes) = match self.step_rule {
            StepRule::Uniform => (longest, nodes),
            StepRule::Adaptive => {
                let shortest = longest * f64::from(self.max_halvings).exp2();
                // The phase of an orbit step may have to be three quarters of that of the shortest step, and the number of orbit steps is doubled.
                (STAGES as f64 * shortest, nodes.max(3.0 * shortest))
            }
        };
        let release_times = self.releases.number_of_release_times() as f64;
        let lane_groups = release_times * (n / release_times / LANES as f64).ceil();
        let mean_steps = match self.steps_per {
            StepsPer::Particle => steps,
            StepsPer::Age => 0.5 * steps + 1.0,
        };
        let threads = threads as f64;
        let table = bytes::<Release>(n)
            + bytes::<[ReleaseOffset; 2]>(n)
            + bytes::<[f64; 5]>(n)
            + bytes::<LaneGroup>(lane_groups);
        let weights = match self.step_rule {
            StepRule::Uniform => bytes::<HermiteWeights>(release_times * (mean_steps + 1.0)),
            StepRule::Adaptive => threads * bytes::<u8>(lane_groups * steps / STAGES as f64),
        };
        let chunks = RELEASE_TIME_CHUNKS as f64;
        // The derivative by the progenitor's position in lanes and summed; position, drift and kick, and the Hermite weights.
        let schedule = bytes::<[f64; 3]>((LANES * UNROLL + UNROLL) as f64)
            + UNROLL as f64 * (bytes::<[f64; 6]>(1.0) + bytes::<HermiteWeights>(1.0));
        // The orbit of the value, its derivatives in each chunk, and the orbit on dual numbers.
        let node =
            bytes::<Node<f64>>(2.0 + chunks + (1 + SYSTEM_LEN.next_multiple_of(LANES)) as f64);
        Memory::default()
            .with(
                "model.releases.particles",
                table + threads * bytes::<f64>(19.0 * n),
            )
            .with("model.steps", weights + threads * chunks * steps * schedule)
            .with("model.orbit_steps", threads * nodes * node)
            .with(
                "model.releases.release_times",
                threads * bytes::<ReleaseFrame<f64>>(2.0 * release_times),
            )
    }
}
