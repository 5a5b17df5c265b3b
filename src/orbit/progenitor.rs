//! The progenitor's orbit, integrated once from today back to the first release and kept as a dense curve.
//!
//! Times are fractions `tau` of the age: -1 at the first release, 0 today. Nodes are equidistant in `tau`, and between
//! them the curve is the quintic Hermite interpolant of position, velocity and acceleration. So the weights of an
//! interpolated position are pure numbers, the same for every parameter: [`Placement`].

use super::{State, crossing};
use crate::potential::Potential;
use crate::scalar::{Real, Scalar, Vec3};
use serde::{Deserialize, Serialize};

/// How the progenitor is carried back in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OrbitMethod {
    /// A 4th-order symplectic method with a small error constant (PEFRL: Omelyan, Mryglod & Folk 2002).
    #[default]
    Accurate,
    /// The paper's kick-drift-kick leapfrog, for reproduction: use it with 100 steps.
    Leapfrog,
}

/// One node: position, and velocity and acceleration times the node spacing in Gyr (once, twice).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node<S> {
    /// Position in kpc.
    pub x: Vec3<S>,
    /// Velocity times spacing, kpc.
    pub dx: Vec3<S>,
    /// Acceleration times spacing squared, kpc.
    pub ddx: Vec3<S>,
}

impl<S: Scalar> Node<S> {
    /// The node of a state, `spacing` Gyr from the next.
    #[inline(always)]
    fn of(host: &impl Potential<S>, s: State<S>, spacing: S) -> Self {
        Self {
            x: s.x,
            dx: s.v * spacing,
            ddx: host.acceleration(s.x) * (spacing * spacing),
        }
    }
}

/// Energy per mass, (kpc/Gyr)^2.
#[inline(always)]
fn energy<S: Real>(host: &impl Potential<S>, s: State<S>) -> f64 {
    (s.v.norm2() * 0.5 + host.value(s.x)).re()
}

/// Where a time lies between two nodes, and the weights of their six vectors in the position then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The earlier node.
    pub node: usize,
    /// Weights of (x, dx, ddx) of the earlier node, then of the later one.
    pub weights: [f64; 6],
}

impl Placement {
    /// The placement of the time `tau` in [-1, 0] on `steps` intervals.
    #[must_use]
    pub fn at(tau: f64, steps: usize) -> Self {
        let (node, t) = locate(tau, steps);
        Self {
            node,
            weights: quintic(t),
        }
    }
}

/// The interval of `tau` and the fraction within it.
pub(super) fn locate(tau: f64, steps: usize) -> (usize, f64) {
    let position = (tau + 1.0).clamp(0.0, 1.0) * steps as f64;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the node range just above"
    )]
    let node = (position as usize).min(steps - 1);
    (node, position - node as f64)
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

/// Its derivative.
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

/// The orbit on [-age, 0].
#[derive(Clone, Debug)]
pub struct DenseOrbit<S> {
    /// Nodes, oldest first.
    pub nodes: Vec<Node<S>>,
    /// Winding count of the projected orbit at each node: 0 today, counted at the negative x axis.
    pub turns: Vec<S>,
    /// Spacing of the nodes in Gyr.
    pub spacing_gyr: S,
    /// Largest relative change of the energy along the nodes.
    pub energy_error: f64,
}

impl<S: Real> DenseOrbit<S> {
    /// The real parts.
    #[must_use]
    pub fn real_part(&self) -> DenseOrbit<f64> {
        let v = |a: Vec3<S>| a.map(Real::re);
        DenseOrbit {
            nodes: self
                .nodes
                .iter()
                .map(|n| Node {
                    x: v(n.x),
                    dx: v(n.dx),
                    ddx: v(n.ddx),
                })
                .collect(),
            turns: self.turns.iter().map(|t| t.re()).collect(),
            spacing_gyr: self.spacing_gyr.re(),
            energy_error: self.energy_error,
        }
    }

    /// Integrates back from `today` over `age_gyr` in `steps` steps.
    #[inline(always)]
    pub fn integrate(
        host: &impl Potential<S>,
        today: State<S>,
        age_gyr: S,
        steps: usize,
        method: OrbitMethod,
    ) -> Self {
        let spacing = age_gyr / steps as f64;
        let first_energy = energy(host, today);
        let mut energy_error = 0.0_f64;
        let mut state = today;
        let (mut nodes, mut turns) = (Vec::with_capacity(steps + 1), Vec::with_capacity(steps + 1));
        nodes.push(Node::of(host, today, spacing));
        turns.push(S::zero());
        let mut wound = S::zero();
        for _ in 0..steps {
            let before = state.x;
            state = match method {
                OrbitMethod::Accurate => pefrl(host, state, -spacing),
                OrbitMethod::Leapfrog => kick_drift_kick(host, state, -spacing),
            };
            wound += crossing(before, state.x);
            energy_error =
                energy_error.max(((energy(host, state) - first_energy) / first_energy).abs());
            nodes.push(Node::of(host, state, spacing));
            turns.push(wound);
        }
        nodes.reverse();
        turns.reverse();
        Self {
            nodes,
            turns,
            spacing_gyr: spacing,
            energy_error,
        }
    }

    /// State and winding count at the time `tau` in [-1, 0].
    #[inline(always)]
    pub fn at(&self, tau: f64) -> (State<S>, S) {
        let steps = self.nodes.len() - 1;
        let (node, t) = locate(tau, steps);
        let x = self.position(&Placement {
            node,
            weights: quintic(t),
        });
        let v = self.position(&Placement {
            node,
            weights: quintic_slope(t),
        }) * (S::one() / self.spacing_gyr);
        (
            State { x, v },
            self.turns[node] + crossing(self.nodes[node].x, x),
        )
    }

    /// Position at a time `tau` in [-1, 0] that has derivatives of its own.
    #[inline(always)]
    pub fn position_at(&self, tau: S) -> Vec3<S> {
        let steps = self.nodes.len() - 1;
        let (node, _) = locate(tau.re(), steps);
        self.combine(node, quintic((tau + 1.0) * steps as f64 - node as f64))
    }

    /// Derivative of the position with respect to `tau`.
    #[inline(always)]
    pub fn slope(&self, tau: f64) -> Vec3<S> {
        let steps = self.nodes.len() - 1;
        let (node, t) = locate(tau, steps);
        self.combine(node, quintic_slope(t).map(S::from_f64)) * S::from_f64(steps as f64)
    }

    /// Position at a placement.
    #[inline(always)]
    pub fn position(&self, place: &Placement) -> Vec3<S> {
        self.combine(place.node, place.weights.map(S::from_f64))
    }

    #[inline(always)]
    fn combine(&self, node: usize, w: [S; 6]) -> Vec3<S> {
        let (a, b) = (&self.nodes[node], &self.nodes[node + 1]);
        (a.x * w[0])
            .add_scaled(a.dx, w[1])
            .add_scaled(a.ddx, w[2])
            .add_scaled(b.x, w[3])
            .add_scaled(b.dx, w[4])
            .add_scaled(b.ddx, w[5])
    }

    /// Whether every node is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.nodes.iter().all(|n| {
            (n.x.norm2() + n.dx.norm2() + n.ddx.norm2())
                .re()
                .is_finite()
        })
    }
}

/// One step of the position-extended Forest-Ruth-like method, 4 forces.
#[inline(always)]
fn pefrl<S: Scalar>(host: &impl Potential<S>, s: State<S>, h: S) -> State<S> {
    // Omelyan, Mryglod & Folk 2002, Comput. Phys. Commun. 146, 188, their "PEFRL".
    const XI: f64 = 0.178_617_895_844_809_1;
    const LAMBDA: f64 = -0.212_341_831_062_605_4;
    const CHI: f64 = -0.066_264_582_669_818_5;
    let outer = h * (0.5 - LAMBDA);
    let inner = h * LAMBDA;
    let x = s.x.add_scaled(s.v, h * XI);
    let v = s.v.add_scaled(host.acceleration(x), outer);
    let x = x.add_scaled(v, h * CHI);
    let v = v.add_scaled(host.acceleration(x), inner);
    let x = x.add_scaled(v, h * (1.0 - 2.0 * (CHI + XI)));
    let v = v.add_scaled(host.acceleration(x), inner);
    let x = x.add_scaled(v, h * CHI);
    let v = v.add_scaled(host.acceleration(x), outer);
    State {
        x: x.add_scaled(v, h * XI),
        v,
    }
}

/// One step of the second-order leapfrog.
#[inline(always)]
fn kick_drift_kick<S: Scalar>(host: &impl Potential<S>, s: State<S>, h: S) -> State<S> {
    let v = s.v.add_scaled(host.acceleration(s.x), h * 0.5);
    let x = s.x.add_scaled(v, h);
    State {
        x,
        v: v.add_scaled(host.acceleration(x), h * 0.5),
    }
}
