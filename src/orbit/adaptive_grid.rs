//! An adaptive time grid along the progenitor's orbit, the same for all particles of a release time.
//!
//! Most equal steps fall where the acceleration is small. Here the steps are even in a phase whose rate follows the orbital frequency
//! of the progenitor: `d phase / dt = sqrt(omega)`, `omega^2 = acceleration / radius`, that is steps proportional to
//! (r / a)^(1/4). Particles stay close enough to their progenitor that one grid is used for all of a release time, and each
//! particle is still integrated by one fixed sequence of leapfrog maps. The grid depends on the parameters, and its derivative is included.

use super::dense_orbit::{CORE2, TINY_DDX2, clear_and_reserve, locate};
use super::{DenseOrbit, Node, OrbitTime};
use crate::scalar::Real;

/// The phase at the nodes of an orbit.
#[derive(Clone, Debug)]
pub struct AdaptiveGrid<S> {
    /// Rate at every node, in arbitrary but common units.
    rate: Vec<S>,
    /// Phase at every node, from 0 at the oldest, by the trapezoidal rule; between nodes it is linear in time.
    phase: Vec<S>,
    /// One over the phase between a node and the next.
    inverse: Vec<S>,
}

/// The rate of the phase at a node, up to a factor common to all.
fn rate_at<S: Real>(node: &Node<S>) -> S {
    node.turn4().sqrt().sqrt().sqrt()
}

impl<S: Real> AdaptiveGrid<S> {
    /// The grid of an orbit, in the buffers of another one if there is one.
    #[must_use]
    pub fn of(orbit: &DenseOrbit<S>, spare: Option<Self>) -> Self {
        let spare = spare.map_or_else(Default::default, |s| (s.rate, s.phase, s.inverse));
        let (mut rate, mut phase, mut inverse) = spare;
        for column in [&mut rate, &mut phase, &mut inverse] {
            clear_and_reserve(column, orbit.nodes.len());
        }
        rate.extend(orbit.nodes.iter().map(rate_at));
        let mut sum = S::zero();
        phase.push(sum);
        for pair in rate.windows(2) {
            let before = sum;
            sum += (pair[0] + pair[1]) * 0.5;
            phase.push(sum);
            inverse.push(S::one() / (sum - before));
        }
        Self {
            rate,
            phase,
            inverse,
        }
    }

    /// The largest angle, in radians, that a circular orbit through a node would turn by if all of the phase were one step; in
    /// `n` steps from the oldest node to today it turns by the `n`-th part of it at most.
    #[must_use]
    pub fn max_orbital_phase(&self) -> f64 {
        let rates = self.rate.iter().map(|rate| rate.re());
        let all = self.phase.last().map_or(0.0, |phase| phase.re());
        // The rate is the root of the turn in an interval, and a step takes `step in phase / rate` intervals.
        rates.fold(0.0, f64::max) * all
    }

    /// Writes `steps + 1` times from `tau` to today, evenly spaced in phase. The first and the last are `tau` and today
    /// exactly.
    #[inline(always)]
    pub fn orbit_times(&self, tau: f64, steps: usize, out: &mut Vec<OrbitTime<S>>) {
        let last = self.phase.len() - 1;
        let (first, share) = locate(tau, last);
        let start = self.phase[first] * (1.0 - share) + self.phase[first + 1] * share;
        let stride = (self.phase[last] - start) / steps as f64;
        let mut node = first;
        out.clear();
        out.push(OrbitTime {
            node,
            share: S::from_f64(share),
        });
        for j in 1..steps {
            let target = start + stride * j as f64;
            while node + 1 < last && self.phase[node + 1].re() <= target.re() {
                node += 1;
            }
            let share = (target - self.phase[node]) * self.inverse[node];
            out.push(OrbitTime { node, share });
        }
        out.push(OrbitTime {
            node: last - 1,
            share: S::one(),
        });
    }
}

impl AdaptiveGrid<f64> {
    /// Adds, to the derivatives with respect to the phases at the nodes, what comes from those with respect to the times of
    /// one release time's [`orbit_times`](Self::orbit_times), as fractions of the age.
    pub fn times_vjp(
        &self,
        orbit_times: &[OrbitTime<f64>],
        times_bar: &[f64],
        phase_bar: &mut [f64],
    ) {
        let steps = times_bar.len() - 1;
        let last = self.phase.len() - 1;
        let first = orbit_times[0];
        for (j, (orbit_time, time_bar)) in orbit_times
            .iter()
            .zip(times_bar)
            .enumerate()
            .take(steps)
            .skip(1)
        {
            let OrbitTime { node, share } = *orbit_time;
            let done = j as f64 / steps as f64;
            let target_bar = time_bar * self.inverse[node] / last as f64;
            phase_bar[node] += target_bar * (share - 1.0);
            phase_bar[node + 1] -= target_bar * share;
            let start_bar = target_bar * (1.0 - done);
            phase_bar[first.node] += start_bar * (1.0 - first.share);
            phase_bar[first.node + 1] += start_bar * first.share;
            phase_bar[last] += target_bar * done;
        }
    }

    /// Adds, to the derivatives with respect to the nodes of the orbit, what comes from those with respect to the phases.
    pub fn vjp(&self, orbit: &DenseOrbit<f64>, phase_bar: &[f64], nodes: &mut [Node<f64>]) {
        // A rate is in every phase after its node, half by the interval before it and half by the one after.
        let mut later = 0.0;
        for (i, node_bar) in nodes.iter_mut().enumerate().rev() {
            let after = later;
            later += phase_bar[i];
            let before = if i > 0 { later } else { 0.0 };
            let rate_bar = 0.5 * (after + before);
            let node = &orbit.nodes[i];
            let scale = 0.25 * self.rate[i] * rate_bar;
            node_bar.add(0, node.x() * (-scale / (node.x().norm2() + CORE2)));
            node_bar.add(2, node.ddx() * (scale / (node.ddx().norm2() + TINY_DDX2)));
        }
    }
}
