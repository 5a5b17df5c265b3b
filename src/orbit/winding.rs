//! Winding numbers: how often the projection of a trajectory goes around the halo's centre (docs/physics.md, section 6).

use crate::scalar::{Scalar, Vec3};

/// One for a negative number, zero for others.
#[inline(always)]
pub(super) fn is_negative<S: Scalar>(s: S) -> S {
    S::select(s.lt(S::zero()), S::one(), S::zero())
}

/// +1 if the straight line from (x0, y0) to (x1, y1) crosses the negative x axis counter-clockwise, -1 if clockwise, else 0.
#[inline(always)]
pub fn crossing<S: Scalar>(from: Vec3<S>, to: Vec3<S>) -> S {
    let side = is_negative(to.y) - is_negative(from.y);
    let turn = from.x * to.y - to.x * from.y;
    S::select(S::zero().lt(side * turn), side, S::zero())
}
