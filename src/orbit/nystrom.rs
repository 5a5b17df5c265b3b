//! One step of the progenitor's orbit back in time, by a Runge-Kutta-Nystrom method of sixth order (docs/physics.md, section 3).

use super::orbit_force::OrbitForce;
use crate::scalar::{Scalar, Vec3};

/// Stages of a step; the first is the last of the step before.
const STAGES: usize = 6;

/// Times of the stages after the first, over the length of the step. The last stage is the end of the step.
const TIMES: [f64; STAGES - 1] = [0.1, 0.3, 0.7, 17.0 / 25.0, 1.0];

/// Weights of the accelerations of the stages before in the position of each stage after the first: RKN6(4)6FM of Dormand, El-Mikkawy &
/// Prince 1987.
const POSITION: [[f64; STAGES - 1]; STAGES - 1] = [
    [1.0 / 200.0, 0.0, 0.0, 0.0, 0.0],
    [-1.0 / 2_200.0, 1.0 / 22.0, 0.0, 0.0, 0.0],
    [637.0 / 6_600.0, -7.0 / 110.0, 7.0 / 33.0, 0.0, 0.0],
    [
        225_437.0 / 1_968_750.0,
        -30_073.0 / 281_250.0,
        65_569.0 / 281_250.0,
        -9_367.0 / 984_375.0,
        0.0,
    ],
    [
        151.0 / 2_142.0,
        5.0 / 116.0,
        385.0 / 1_368.0,
        55.0 / 168.0,
        -6_250.0 / 28_101.0,
    ],
];

/// Weights of the accelerations of all stages in the velocity at the end.
const VELOCITY: [f64; STAGES] = [
    151.0 / 2_142.0,
    25.0 / 522.0,
    275.0 / 684.0,
    275.0 / 252.0,
    -78_125.0 / 112_404.0,
    1.0 / 12.0,
];

/// `sum + vector * factor`, with a factor that has no derivatives.
#[inline(always)]
fn add<S: Scalar>(sum: Vec3<S>, vector: Vec3<S>, factor: f64) -> Vec3<S> {
    Vec3::new(
        sum.x + vector.x * factor,
        sum.y + vector.y * factor,
        sum.z + vector.z * factor,
    )
}

/// Weights of the accelerations of the stages before in the velocity at each stage after the first: the integrals of the polynomial
/// through them. For accelerations that depend little on the velocity.
const STAGE_VELOCITY: [[f64; STAGES - 1]; STAGES - 1] = {
    let mut weights = [[0.0; STAGES - 1]; STAGES - 1];
    let times = [0.0, TIMES[0], TIMES[1], TIMES[2], TIMES[3]];
    let mut stage = 1;
    while stage < STAGES {
        let mut k = 0;
        while k < stage {
            weights[stage - 1][k] = basis_integral(&times, stage, k, TIMES[stage - 1]);
            k += 1;
        }
        stage += 1;
    }
    weights
};

/// The integral from 0 to `end` of the polynomial that is 1 at `times[k]` and 0 at the others of the first `count`.
const fn basis_integral(times: &[f64; STAGES - 1], count: usize, k: usize, end: f64) -> f64 {
    let mut polynomial = [0.0; STAGES];
    polynomial[0] = 1.0;
    let mut j = 0;
    while j < count {
        if j != k {
            let scale = 1.0 / (times[k] - times[j]);
            let mut power = STAGES - 1;
            while power > 0 {
                polynomial[power] = (polynomial[power - 1] - times[j] * polynomial[power]) * scale;
                power -= 1;
            }
            polynomial[0] *= -times[j] * scale;
        }
        j += 1;
    }
    let (mut sum, mut power, mut of_end) = (0.0, 0, end);
    while power < STAGES {
        sum += polynomial[power] * of_end / (power + 1) as f64;
        of_end *= end;
        power += 1;
    }
    sum
}

/// A step of the orbit.
#[derive(Clone, Copy)]
pub(super) struct OrbitStep<S> {
    /// The square of its length, Gyr^2.
    pub length2: S,
    /// Its end, from -1 at the first release to 0 today.
    pub tau: f64,
    /// Its length in the same unit.
    pub tau_length: f64,
}

impl<S: Scalar> OrbitStep<S> {
    /// The acceleration in units of the step, at a time before its end in units of the step, where position and velocity are these.
    #[inline(always)]
    pub fn acceleration<F: OrbitForce<S>>(
        &self,
        force: &F,
        x: Vec3<S>,
        dx: Vec3<S>,
        before: f64,
    ) -> Vec3<S> {
        let v = if F::DEPENDS_ON_VELOCITY {
            dx * (S::one() / self.length2.sqrt())
        } else {
            dx
        };
        force.orbit_acceleration(x, v, self.tau - before * self.tau_length) * self.length2
    }
}

/// Position, velocity and acceleration one step earlier, in units of the length of the step.
#[inline(always)]
pub(super) fn nystrom_step<S: Scalar, F: OrbitForce<S>>(
    force: &F,
    [x, dx, ddx]: [Vec3<S>; 3],
    step: OrbitStep<S>,
) -> [Vec3<S>; 3] {
    let mut accelerations = [ddx; STAGES];
    let mut earlier_x = x;
    for stage in 1..STAGES {
        earlier_x = add(x, dx, -TIMES[stage - 1]);
        for k in 0..stage {
            earlier_x = add(earlier_x, accelerations[k], POSITION[stage - 1][k]);
        }
        let mut stage_dx = dx;
        if F::DEPENDS_ON_VELOCITY {
            for k in 0..stage {
                stage_dx = add(stage_dx, accelerations[k], -STAGE_VELOCITY[stage - 1][k]);
            }
        }
        accelerations[stage] = step.acceleration(force, earlier_x, stage_dx, TIMES[stage - 1]);
    }
    let mut earlier_dx = dx;
    for k in 0..STAGES {
        earlier_dx = add(earlier_dx, accelerations[k], -VELOCITY[k]);
    }
    [earlier_x, earlier_dx, accelerations[STAGES - 1]]
}
