//! The progenitor's dense orbit, integrated once from today back to the first release (docs/physics.md, section 3).
//!
//! Times are fractions `tau` of the age: -1 at the first release, 0 today. Nodes are equidistant in `tau`; between them the position is
//! the quintic Hermite interpolant of position, velocity and acceleration. Its weights do not depend on the parameters:
//! [`HermiteWeights`].

use super::nystrom::nystrom_step;
use super::{State, crossing};
use crate::potential::Potential;
use crate::scalar::{Real, Scalar, Vec3};
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

/// One node of the orbit, in rows: position in kpc, velocity times the node spacing (kpc), acceleration times the spacing
/// squared (kpc). Each row has a zero as fourth number, so that it fills a register of four.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node<S>(pub [[S; 4]; 3]);

impl<S: Scalar> Node<S> {
    /// All zeros.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self([[S::zero(); 4]; 3])
    }

    /// The node of position, velocity and acceleration in units of the spacing.
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

    /// Acceleration times the spacing squared, kpc.
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

/// Clears a vector and reserves memory for `n` elements.
#[inline(always)]
fn clear_and_reserve<T>(vector: &mut Vec<T>, n: usize) {
    vector.clear();
    vector.reserve_exact(n);
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
    /// The weights at the time `tau` in [-1, 0] on an orbit of `intervals` intervals.
    #[inline(always)]
    #[must_use]
    pub fn at(tau: f64, intervals: usize) -> Self {
        let (node, t) = locate(tau, intervals);
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

/// The interval of `tau` and the fraction within it.
#[inline(always)]
fn locate(tau: f64, intervals: usize) -> (usize, f64) {
    let position = (tau + 1.0).clamp(0.0, 1.0) * intervals as f64;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the node range just above"
    )]
    let node = (position as usize).min(intervals - 1);
    (node, position - node as f64)
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
    pub winding_numbers: Vec<S>,
    /// Spacing of the nodes in Gyr.
    pub spacing_gyr: S,
}

impl<S: Scalar> Default for DenseOrbit<S> {
    /// Without nodes: buffers.
    fn default() -> Self {
        Self {
            nodes: Vec::new(),
            winding_numbers: Vec::new(),
            spacing_gyr: S::zero(),
        }
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
        orbit.integrate_resolved(host, today, age_gyr, steps, method, f64::INFINITY);
        orbit
    }

    /// As [`integrate`](Self::integrate), in these buffers, until the phase of an interval at a node, in radians, exceeds `max_phase`
    /// (docs/physics.md, section 3). Returns the largest phase.
    #[inline(always)]
    pub fn integrate_resolved(
        &mut self,
        host: &impl Potential<S>,
        today: State<S>,
        age_gyr: S,
        steps: usize,
        method: OrbitMethod,
        max_phase: f64,
    ) -> f64 {
        let spacing = age_gyr / steps as f64;
        let spacing2 = spacing * spacing;
        self.spacing_gyr = spacing;
        clear_and_reserve(&mut self.nodes, steps + 1);
        clear_and_reserve(&mut self.winding_numbers, steps + 1);
        let mut vectors = [
            today.x,
            today.v * spacing,
            host.acceleration(today.x) * spacing2,
        ];
        let mut winding_number = S::zero();
        let mut phase2 = 0.0;
        for left in (0..=steps).rev() {
            let node = Node::from_vectors(vectors);
            self.nodes.push(node);
            self.winding_numbers.push(winding_number);
            phase2 = f64::max(phase2, node.phase2().re());
            if left == 0 || phase2 > max_phase * max_phase {
                break;
            }
            let [after, ..] = vectors;
            vectors = match method {
                OrbitMethod::Accurate => nystrom_step(host, vectors, spacing2),
                OrbitMethod::Leapfrog => leapfrog_step(host, vectors, spacing2),
            };
            winding_number += crossing(after, vectors[0]);
        }
        self.nodes.reverse();
        self.winding_numbers.reverse();
        phase2.sqrt()
    }

    /// State and winding number at the time `tau` in [-1, 0].
    #[inline(always)]
    pub fn at(&self, tau: f64) -> (State<S>, S) {
        let (node, t) = locate(tau, self.intervals());
        let x = vector(&self.combine(node, constants(quintic(t))));
        let dx = vector(&self.combine(node, constants(quintic_slope(t))));
        let v = dx * (S::one() / self.spacing_gyr);
        (
            State { x, v },
            self.winding_numbers[node] + crossing(self.nodes[node].x(), x),
        )
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

    /// Number of intervals between nodes.
    #[inline]
    #[must_use]
    pub fn intervals(&self) -> usize {
        self.nodes.len() - 1
    }

    /// Largest relative difference of the energy at a node from that today; `host` is the potential that the orbit was integrated in.
    #[must_use]
    pub fn energy_error(&self, host: &impl Potential<S>) -> f64 {
        let energies = self.nodes.iter().map(|node| {
            let v = node.vector(1) * (S::one() / self.spacing_gyr);
            (v.norm2() * 0.5 + host.value(node.x())).re()
        });
        let today = energies.clone().next_back().unwrap_or(f64::NAN);
        energies
            .map(|energy| ((energy - today) / today).abs())
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

/// As [`nystrom_step`], by the second-order leapfrog: kick, drift, kick.
#[inline(always)]
fn leapfrog_step<S: Scalar>(
    host: &impl Potential<S>,
    [x, dx, ddx]: [Vec3<S>; 3],
    step2: S,
) -> [Vec3<S>; 3] {
    let half = S::from_f64(0.5);
    let kicked = dx - ddx * half;
    let x = x - kicked;
    let ddx = host.acceleration(x) * step2;
    [x, kicked - ddx * half, ddx]
}
