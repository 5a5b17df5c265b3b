//! The progenitor's dense orbit, integrated once from today back to the first release (docs/physics.md, section 3).
//!
//! Between nodes the position is the quintic Hermite interpolant of position, velocity and acceleration. Its weights depend on times
//! alone: [`HermiteWeights`].

use super::State;
use super::node_times::{NodeTimes, Place};
use super::nystrom::{OrbitStep, nystrom_step};
use super::orbit_force::{Conservative, OrbitForce};
use super::winding::Crossings;
use crate::potential::Potential;
use crate::scalar::{Isa, LANES, LaneArray, Lanes, Real, Scalar, Vec3};
use serde::{Deserialize, Serialize};

/// Added to the squared radius, kpc^2, in the phase of an interval, which stays finite for a progenitor at the centre.
const CORE2: f64 = 1e-4;

/// How the progenitor is integrated back in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OrbitMethod {
    /// A Runge-Kutta-Nystrom method of 6th order (Dormand, El-Mikkawy & Prince 1987).
    #[default]
    Accurate,
    /// The leapfrog (kick, drift, kick) of Chemaly et al. (2026), who take 100 steps.
    Leapfrog,
}

/// One node of the orbit, in rows: position in kpc, velocity times the length of an interval (kpc), acceleration times its
/// square (kpc). Each row has a zero as fourth number, so that it fills a register of four.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node<S>(pub [[S; 4]; 3]);

impl<S: Scalar> Node<S> {
    /// All zeros.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self([[S::zero(); 4]; 3])
    }

    /// The node of position, velocity and acceleration in units of the interval.
    #[inline(always)]
    fn from_vectors([x, dx, ddx]: [Vec3<S>; 3]) -> Self {
        Self([row(x), row(dx), row(ddx)])
    }

    /// The vector in a row.
    #[inline(always)]
    #[must_use]
    pub fn vector(&self, row: usize) -> Vec3<S> {
        vector(&self.0[row])
    }

    /// Position, kpc.
    #[inline(always)]
    #[must_use]
    pub fn x(&self) -> Vec3<S> {
        self.vector(0)
    }

    /// Acceleration times the square of the interval, kpc.
    #[inline(always)]
    #[must_use]
    pub fn ddx(&self) -> Vec3<S> {
        self.vector(2)
    }

    /// The square of the phase of an interval with the values at this node (docs/physics.md, section 3).
    #[inline(always)]
    fn phase2(&self) -> S {
        let (x, dx) = (self.x(), self.vector(1));
        (dx.norm2() - x.dot(self.ddx())) / (x.norm2() + CORE2)
    }

    /// Adds a vector to a row.
    #[inline(always)]
    pub fn add(&mut self, row: usize, vector: Vec3<S>) {
        let addend = self::row(vector);
        for c in 0..4 {
            self.0[row][c] += addend[c];
        }
    }
}

/// The vector in a row.
#[inline(always)]
pub(super) fn vector<S: Scalar>(row: &[S; 4]) -> Vec3<S> {
    Vec3::new(row[0], row[1], row[2])
}

/// A vector as a row.
#[inline(always)]
fn row<S: Scalar>(v: Vec3<S>) -> [S; 4] {
    [v.x, v.y, v.z, S::zero()]
}

/// The two nodes around a time, and the weights of their six vectors in the position at that time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HermiteWeights {
    /// The earlier node.
    pub node: usize,
    /// Weights of (x, dx, ddx) of the earlier node, then of the later one.
    pub weights: [f64; 6],
}

impl HermiteWeights {
    /// The weights at the time `tau` in [-1, 0] on an orbit with nodes at these times.
    #[inline(always)]
    #[must_use]
    pub fn at(tau: f64, times: &NodeTimes) -> Self {
        let Place { node, t, .. } = times.locate(tau);
        Self {
            node,
            weights: quintic(t),
        }
    }
}

/// Reverse mode of [`DenseOrbit::position`]: adds the derivative with respect to a position to those with respect to its two nodes.
#[inline]
pub fn position_vjp(
    nodes_bar: &mut [Node<f64>],
    weights: &HermiteWeights,
    position_bar: Vec3<f64>,
) {
    let position_bar = row(position_bar);
    let HermiteWeights { node, weights } = *weights;
    for k in 0..6 {
        let row_bar = &mut nodes_bar[node + k / 3].0[k % 3];
        for c in 0..4 {
            row_bar[c] += weights[k] * position_bar[c];
        }
    }
}

/// Weights as numbers of another type.
#[inline(always)]
fn constants<S: Scalar>(weights: [f64; 6]) -> [S; 6] {
    let mut numbers = [S::zero(); 6];
    for k in 0..6 {
        numbers[k] = S::from_f64(weights[k]);
    }
    numbers
}

/// Quintic Hermite basis at `t` in [0, 1].
#[inline(always)]
fn quintic<S: Scalar>(t: S) -> [S; 6] {
    let (t2, t3) = (t * t, t * t * t);
    let later = t3 * (t * (t * 6.0 - 15.0) + 10.0);
    [
        -later + 1.0,
        t + t3 * (t * (t * -3.0 + 8.0) - 6.0),
        t2 * 0.5 + t3 * 0.5 * (t * (-t + 3.0) - 3.0),
        later,
        t3 * (t * (t * -3.0 + 7.0) - 4.0),
        t3 * 0.5 * (t * (t - 2.0) + 1.0),
    ]
}

/// Derivative of the basis by `t`.
#[inline]
fn quintic_slope(t: f64) -> [f64; 6] {
    let t2 = t * t;
    let later = 30.0 * t2 * (1.0 + t * (t - 2.0));
    [
        -later,
        1.0 + t2 * (t * (32.0 - 15.0 * t) - 18.0),
        t + 0.5 * t2 * (t * (12.0 - 5.0 * t) - 9.0),
        later,
        t2 * (t * (28.0 - 15.0 * t) - 12.0),
        0.5 * t2 * (3.0 + t * (5.0 * t - 8.0)),
    ]
}

/// The orbit from the time -age to today.
#[derive(Clone, Debug)]
pub struct DenseOrbit<S> {
    /// Nodes, oldest first.
    pub nodes: Vec<Node<S>>,
    /// Winding number of the projected orbit at each node: 0 today, counted at the negative x axis.
    winding_numbers: Vec<S>,
    times: NodeTimes,
    age_gyr: S,
    /// Number of intervals of each block, the latest first: a buffer.
    intervals: Vec<usize>,
}

impl<S: Scalar> Default for DenseOrbit<S> {
    /// Without nodes: buffers.
    fn default() -> Self {
        Self {
            nodes: Vec::new(),
            winding_numbers: Vec::new(),
            times: NodeTimes::default(),
            age_gyr: S::zero(),
            intervals: Vec::new(),
        }
    }
}

/// How an orbit is divided into intervals (docs/physics.md, section 3).
#[derive(Clone, Copy, Debug)]
pub struct Resolution {
    /// Number of equal blocks of the age.
    pub blocks: usize,
    /// Number of intervals that the latest block has at least. It is doubled as long as a limit is exceeded, and each block has at least
    /// half of that of the block after it.
    pub intervals: usize,
    /// Largest phase of an interval at a node, radians.
    pub max_phase: f64,
    /// Largest phase of the age at a node, radians.
    pub max_age_phase: f64,
}

impl Resolution {
    /// Equal intervals.
    #[must_use]
    pub fn uniform(intervals: usize) -> Self {
        Self {
            blocks: 1,
            intervals,
            max_phase: f64::INFINITY,
            max_age_phase: f64::INFINITY,
        }
    }
}

impl DenseOrbit<f64> {
    /// The positions in kpc at `N` times, as rows of a [`Node`]; the same bits as by [`HermiteWeights::at`], whose weights are computed in
    /// lanes here.
    #[inline(always)]
    #[must_use]
    pub fn positions<I: Isa, const N: usize>(&self, taus: [f64; N]) -> [[f64; 4]; N] {
        const { assert!(N <= LANES) };
        let mut nodes = [0; N];
        let mut fractions = LaneArray([[0.0; LANES]]);
        for k in 0..N {
            let Place { node, t, .. } = self.times.locate(taus[k]);
            nodes[k] = node;
            fractions.0[0][k] = t;
        }
        let basis = quintic(Lanes::<I, 1>::load(&fractions));
        let mut weights = [[0.0; LANES]; 6];
        for row in 0..6 {
            weights[row] = basis[row].store().0[0];
        }
        let mut positions = [[0.0; 4]; N];
        for k in 0..N {
            let mut of_time = [0.0; 6];
            for row in 0..6 {
                of_time[row] = weights[row][k];
            }
            positions[k] = self.combine(nodes[k], of_time);
        }
        positions
    }
}

impl<S: Real> DenseOrbit<S> {
    /// Integrates back from `today` over `age_gyr` in `steps` steps of equal length.
    #[inline(always)]
    pub fn integrate(
        host: &impl Potential<S>,
        today: State<S>,
        age_gyr: S,
        steps: usize,
        method: OrbitMethod,
    ) -> Self {
        let mut orbit = Self::default();
        let resolution = Resolution::uniform(steps);
        orbit.integrate_resolved(&Conservative(host), today, age_gyr, resolution, method);
        orbit
    }

    /// As [`integrate`](Self::integrate), with nodes at these times.
    #[inline(always)]
    pub fn integrate_at(
        force: &impl OrbitForce<S>,
        today: State<S>,
        age_gyr: S,
        times: &NodeTimes,
        method: OrbitMethod,
    ) -> Self {
        let mut orbit = Self::default();
        let blocks = times.blocks();
        let mut now = orbit.begin(force, today, age_gyr, blocks.len());
        for block in (0..blocks.len()).rev() {
            let intervals = blocks[block].intervals;
            if let Some(earlier) = orbit.block(force, now, intervals, method, f64::INFINITY) {
                now = earlier;
            }
        }
        orbit.end();
        orbit
    }

    /// As [`integrate`](Self::integrate), in these buffers and with this resolution. Returns whether the phase of the age is within its
    /// limit; if not, the orbit is not complete.
    #[inline(always)]
    pub fn integrate_resolved(
        &mut self,
        force: &impl OrbitForce<S>,
        today: State<S>,
        age_gyr: S,
        resolution: Resolution,
        method: OrbitMethod,
    ) -> bool {
        let Resolution {
            blocks,
            mut intervals,
            max_phase,
            max_age_phase,
        } = resolution;
        let mut now = self.begin(force, today, age_gyr, blocks);
        for _ in 0..blocks {
            loop {
                let limit_by_age = max_age_phase / (intervals * blocks) as f64;
                let limit = f64::min(max_phase, limit_by_age);
                if let Some(earlier) = self.block(force, now, intervals, method, limit) {
                    now = earlier;
                    break;
                }
                if max_phase >= limit_by_age {
                    return false;
                }
                intervals *= 2;
            }
            intervals = usize::max(intervals / 2, 1);
        }
        self.end();
        true
    }

    /// Clears the buffers. Returns where the integration starts.
    #[inline(always)]
    fn begin(
        &mut self,
        force: &impl OrbitForce<S>,
        today: State<S>,
        age_gyr: S,
        blocks: usize,
    ) -> Moment<S> {
        self.nodes.clear();
        self.winding_numbers.clear();
        self.intervals.clear();
        self.age_gyr = age_gyr;
        let length = age_gyr * (1.0 / blocks as f64);
        let length2 = length * length;
        Moment {
            vectors: [
                today.x,
                today.v * length,
                force.orbit_acceleration(today.x, today.v, 0.0) * length2,
            ],
            winding_number: S::zero(),
            length2,
            tau: 0.0,
            tau_length: 1.0 / blocks as f64,
        }
    }

    /// Integrates the block before `now` and appends its nodes, the latest first. `None`, without nodes, if the phase of an interval
    /// exceeds `max_phase` at one of them.
    #[inline(always)]
    fn block(
        &mut self,
        force: &impl OrbitForce<S>,
        now: Moment<S>,
        intervals: usize,
        method: OrbitMethod,
        max_phase: f64,
    ) -> Option<Moment<S>> {
        let first = self.nodes.len();
        let per_interval = 1.0 / intervals as f64;
        let step2 = now.length2 * (per_interval * per_interval);
        let mut vectors = rescaled(now.vectors, per_interval);
        let mut winding_number = now.winding_number;
        for left in (0..=intervals).rev() {
            let node = Node::from_vectors(vectors);
            let phase2 = node.phase2().re();
            // An orbit that is not finite is found as a whole.
            if phase2 > max_phase * max_phase && phase2 < f64::INFINITY {
                self.nodes.truncate(first);
                self.winding_numbers.truncate(first);
                return None;
            }
            self.nodes.push(node);
            self.winding_numbers.push(winding_number);
            if left > 0 {
                let [after, dx_after, _] = vectors;
                let tau_length = now.tau_length * per_interval;
                let step = OrbitStep {
                    length2: step2,
                    tau: now.tau - (intervals - left) as f64 * tau_length,
                    tau_length,
                };
                vectors = match method {
                    OrbitMethod::Accurate => nystrom_step(force, vectors, step),
                    OrbitMethod::Leapfrog => leapfrog_step(force, vectors, step),
                };
                let [before, dx_before, _] = vectors;
                let before = State {
                    x: before,
                    v: dx_before,
                };
                let after = State {
                    x: after,
                    v: dx_after,
                };
                winding_number -= Crossings::between(before, after, S::one()).number;
            }
        }
        self.intervals.push(intervals);
        Some(Moment {
            vectors: rescaled(vectors, intervals as f64),
            winding_number,
            tau: now.tau - now.tau_length,
            ..now
        })
    }

    /// Puts the nodes in order of time.
    #[inline(always)]
    fn end(&mut self) {
        self.nodes.reverse();
        self.winding_numbers.reverse();
        self.times.set(&self.intervals);
    }

    /// State and winding number at the time `tau` in [-1, 0].
    #[inline(always)]
    pub fn at(&self, tau: f64) -> (State<S>, S) {
        let Place { node, t, per_age } = self.times.locate(tau);
        let x = vector(&self.combine(node, constants(quintic(t))));
        let dx = vector(&self.combine(node, constants(quintic_slope(t))));
        let node_state = State {
            x: self.nodes[node].x(),
            v: self.nodes[node].vector(1),
        };
        let since_node = Crossings::between(node_state, State { x, v: dx }, S::from_f64(t));
        let v = dx * (S::from_f64(per_age) / self.age_gyr);
        (
            State { x, v },
            self.winding_numbers[node] + since_node.number,
        )
    }

    /// The times of the nodes.
    #[inline(always)]
    #[must_use]
    pub fn times(&self) -> &NodeTimes {
        &self.times
    }

    /// Position in kpc at given Hermite weights, as a row of a [`Node`].
    #[inline(always)]
    pub fn position(&self, weights: &HermiteWeights) -> [S; 4] {
        self.combine(weights.node, constants(weights.weights))
    }

    /// The sum of the six rows of two nodes times their weights.
    #[inline(always)]
    fn combine(&self, node: usize, w: [S; 6]) -> [S; 4] {
        let ([a, b, c], [d, e, f]) = (&self.nodes[node].0, &self.nodes[node + 1].0);
        let mut sum = [S::zero(); 4];
        for k in 0..4 {
            let earlier = c[k].mul_add(w[2], b[k].mul_add(w[1], a[k] * w[0]));
            sum[k] = f[k].mul_add(w[5], e[k].mul_add(w[4], d[k].mul_add(w[3], earlier)));
        }
        sum
    }

    /// Largest difference of the energy at a node from that today, over the largest kinetic energy; `host` is the potential that the orbit was
    /// integrated in.
    #[must_use]
    pub fn energy_error(&self, host: &impl Potential<S>) -> f64 {
        let (mut energies, mut kinetic) = (Vec::with_capacity(self.nodes.len()), 0.0_f64);
        for block in self.times.blocks() {
            let per_gyr = S::from_f64(block.per_age) / self.age_gyr;
            for node in &self.nodes[block.first_node..=block.first_node + block.intervals] {
                let v = node.vector(1) * per_gyr;
                let of_motion = v.norm2() * 0.5;
                kinetic = kinetic.max(of_motion.re());
                energies.push((of_motion + host.value(node.x())).re());
            }
        }
        let today = energies.last().copied().unwrap_or(f64::NAN);
        energies
            .iter()
            .map(|energy| (energy - today).abs() / kinetic)
            .fold(0.0, f64::max)
    }

    /// Whether every node is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |v: Vec3<S>| v.norm2().re().is_finite();
        self.nodes
            .iter()
            .all(|n| (0..3).all(|row| finite(n.vector(row))))
    }
}

/// The orbit at the start of a block.
#[derive(Clone, Copy)]
struct Moment<S> {
    /// Position, velocity and acceleration in units of the block.
    vectors: [Vec3<S>; 3],
    winding_number: S,
    /// The square of the length of a block, Gyr^2.
    length2: S,
    /// The time, from -1 at the first release to 0 today.
    tau: f64,
    /// The length of a block in the same unit.
    tau_length: f64,
}

/// Position, velocity and acceleration in a unit of time that is `factor` times the present one.
#[inline(always)]
fn rescaled<S: Scalar>([x, dx, ddx]: [Vec3<S>; 3], factor: f64) -> [Vec3<S>; 3] {
    let factor2 = factor * factor;
    [
        x,
        Vec3::new(dx.x * factor, dx.y * factor, dx.z * factor),
        Vec3::new(ddx.x * factor2, ddx.y * factor2, ddx.z * factor2),
    ]
}

/// As [`nystrom_step`], by the second-order leapfrog: kick, drift, kick.
#[inline(always)]
fn leapfrog_step<S: Scalar>(
    force: &impl OrbitForce<S>,
    [x, dx, ddx]: [Vec3<S>; 3],
    step: OrbitStep<S>,
) -> [Vec3<S>; 3] {
    let half = S::from_f64(0.5);
    let kicked = dx - ddx * half;
    let x = x - kicked;
    // A force that depends on the velocity has that of the node by the acceleration so far, whose error is of second order.
    let ddx = step.acceleration(force, x, kicked - ddx * half, 1.0);
    [x, kicked - ddx * half, ddx]
}
