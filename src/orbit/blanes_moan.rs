//! The coefficients of a step of fourth order of Blanes & Moan 2002 (docs/physics.md, section 5).

/// Force evaluations of a step; the force of its first kick is the last one of the step before.
pub const STAGES: usize = 6;

const A: [f64; 2] = [0.245_298_957_184_271, 0.604_872_665_711_080];
const A_3: f64 = 0.5 - (A[0] + A[1]);
const B: [f64; 3] = [
    0.082_984_406_417_405_2,
    0.396_309_801_498_368,
    -0.039_056_304_922_348_6,
];

/// Lengths of the drifts over the length of the step.
pub const DRIFTS: [f64; STAGES] = [A[0], A[1], A_3, A_3, A[1], A[0]];

/// Lengths of the kicks over the length of the step: before the first drift, and after each.
pub const KICKS: [f64; STAGES + 1] = [
    B[0],
    B[1],
    B[2],
    1.0 - 2.0 * (B[0] + B[1] + B[2]),
    B[2],
    B[1],
    B[0],
];

/// Times of the kicks over the length of the step: the sums of the drifts before them.
pub const TIMES: [f64; STAGES + 1] = [0.0, A[0], A[0] + A[1], 0.5, 0.5 + A_3, 1.0 - A[0], 1.0];
