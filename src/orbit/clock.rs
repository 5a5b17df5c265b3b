//! When particles step: a time grid along the progenitor's orbit, shared by the particles of an epoch.
//!
//! Equal steps spend most of them where little happens. Here the steps are even in a phase that runs as fast as the
//! progenitor's orbit turns: `d phase / dt = sqrt(omega)`, `omega^2 = acceleration / radius`, that is steps proportional to
//! (r / a)^(1/4). Particles stay close enough to their progenitor for one grid to serve all of an epoch, and so each still
//! goes through one fixed sequence of leapfrog maps. The grid depends on the parameters, and its derivative is taken along.

use super::progenitor::locate;
use super::{DenseOrbit, Node};
use crate::scalar::Real;

/// Square of a radius, kpc^2, below which the rate rises no more: a progenitor through the very centre has a phase.
const CORE2: f64 = 1e-4;

/// The phase at the nodes of an orbit.
#[derive(Clone, Debug)]
pub struct Clock<S> {
    /// Rate at every node, in arbitrary but common units.
    rate: Vec<S>,
    /// Phase at every node, from 0 at the oldest, by the trapezoidal rule; between nodes it is linear in time.
    phase: Vec<S>,
}

/// The rate of the phase at a node, up to a factor common to all.
fn rate<S: Real>(node: &Node<S>) -> S {
    (node.ddx.norm2() / (node.x.norm2() + CORE2))
        .sqrt()
        .sqrt()
        .sqrt()
}

impl<S: Real> Clock<S> {
    /// The clock of an orbit.
    #[must_use]
    pub fn of(orbit: &DenseOrbit<S>) -> Self {
        let rate: Vec<S> = orbit.nodes.iter().map(rate).collect();
        let mut phase = Vec::with_capacity(rate.len());
        let mut sum = S::zero();
        phase.push(sum);
        for pair in rate.windows(2) {
            sum += (pair[0] + pair[1]) * 0.5;
            phase.push(sum);
        }
        Self { rate, phase }
    }

    /// The real parts.
    #[must_use]
    pub fn real_part(&self) -> Clock<f64> {
        let real = |column: &[S]| column.iter().map(|s| s.re()).collect();
        Clock {
            rate: real(&self.rate),
            phase: real(&self.phase),
        }
    }

    /// Writes `steps + 1` times from `tau` to today, as fractions of the age, evenly spaced in phase. The ends are `tau`
    /// and 0 exactly.
    pub fn times(&self, tau: f64, steps: usize, out: &mut Vec<S>) {
        let intervals = (self.phase.len() - 1) as f64;
        let (first, share) = locate(tau, self.phase.len() - 1);
        let start = self.phase[first] * (1.0 - share) + self.phase[first + 1] * share;
        let end = self.phase[self.phase.len() - 1];
        let mut node = first;
        out.clear();
        out.push(S::from_f64(tau));
        for j in 1..steps {
            let done = j as f64 / steps as f64;
            let target = start * (1.0 - done) + end * done;
            while node + 2 < self.phase.len() && self.phase[node + 1].re() <= target.re() {
                node += 1;
            }
            let (a, b) = (self.phase[node], self.phase[node + 1]);
            let within = (target - a) / (b - a);
            out.push((within + node as f64) / intervals - 1.0);
        }
        out.push(S::zero());
    }
}

impl Clock<f64> {
    /// Adds, to the derivatives with respect to the phases at the nodes, what comes from those with respect to the
    /// [`times`](Self::times) of one epoch.
    pub fn pull_back_times(&self, tau: f64, by_times: &[f64], by_phase: &mut [f64]) {
        let steps = by_times.len() - 1;
        let last = self.phase.len() - 1;
        let intervals = last as f64;
        let (first, share) = locate(tau, last);
        let start = self.phase[first] * (1.0 - share) + self.phase[first + 1] * share;
        let end = self.phase[last];
        let mut node = first;
        for (j, by_time) in by_times.iter().enumerate().take(steps).skip(1) {
            let done = j as f64 / steps as f64;
            let target = start * (1.0 - done) + end * done;
            while node + 2 < self.phase.len() && self.phase[node + 1] <= target {
                node += 1;
            }
            let (a, b) = (self.phase[node], self.phase[node + 1]);
            let within = (target - a) / (b - a);
            let by_target = by_time / (intervals * (b - a));
            by_phase[node] += by_target * (within - 1.0);
            by_phase[node + 1] -= by_target * within;
            let by_start = by_target * (1.0 - done);
            by_phase[first] += by_start * (1.0 - share);
            by_phase[first + 1] += by_start * share;
            by_phase[last] += by_target * done;
        }
    }

    /// Adds, to the derivatives with respect to the nodes of the orbit, what comes from those with respect to the phases.
    pub fn pull_back(&self, orbit: &DenseOrbit<f64>, by_phase: &[f64], nodes: &mut [Node<f64>]) {
        // A rate is in every phase after its node, half by the interval before it and half by the one after.
        let mut later = 0.0;
        for (i, by_node) in nodes.iter_mut().enumerate().rev() {
            let after = later;
            later += by_phase[i];
            let before = if i > 0 { later } else { 0.0 };
            let by_rate = 0.5 * (after + before);
            let node = &orbit.nodes[i];
            let scale = 0.25 * self.rate[i] * by_rate;
            by_node.ddx = by_node.ddx.add_scaled(node.ddx, scale / node.ddx.norm2());
            by_node.x = by_node
                .x
                .add_scaled(node.x, -scale / (node.x.norm2() + CORE2));
        }
    }
}
