//! One step of the progenitor's orbit back in time, by a Runge-Kutta-Nystrom method of sixth order (docs/physics.md, section 3).

use crate::potential::Potential;
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

/// Position, velocity and acceleration one step earlier, in units of the length of the step; `step2` is its square.
#[inline(always)]
pub(super) fn nystrom_step<S: Scalar>(
    host: &impl Potential<S>,
    [x, dx, ddx]: [Vec3<S>; 3],
    step2: S,
) -> [Vec3<S>; 3] {
    let mut accelerations = [ddx; STAGES];
    let mut earlier_x = x;
    for stage in 1..STAGES {
        earlier_x = add(x, dx, -TIMES[stage - 1]);
        for k in 0..stage {
            earlier_x = add(earlier_x, accelerations[k], POSITION[stage - 1][k]);
        }
        accelerations[stage] = host.acceleration(earlier_x) * step2;
    }
    let mut earlier_dx = dx;
    for k in 0..STAGES {
        earlier_dx = add(earlier_dx, accelerations[k], -VELOCITY[k]);
    }
    [earlier_x, earlier_dx, accelerations[STAGES - 1]]
}
