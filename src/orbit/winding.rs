//! Winding numbers: how often the projection of a trajectory goes around the halo's centre (docs/physics.md, section 6).

use super::State;
use crate::scalar::{Scalar, Vec3};

/// Number of chords of a step that turns far.
const CHORDS: usize = 8;

/// One for a negative number, zero for others.
#[inline(always)]
fn is_negative<S: Scalar>(s: S) -> S {
    S::select(s.lt(S::zero()), S::one(), S::zero())
}

/// The scalar product of the projections: negative if they are more than 90 degrees apart.
#[inline(always)]
fn projected_dot<S: Scalar>(from: Vec3<S>, to: Vec3<S>) -> S {
    from.x * to.x + from.y * to.y
}

/// +1 if the straight line from (x0, y0) to (x1, y1) crosses the negative x axis counter-clockwise, -1 if clockwise, else 0.
#[inline(always)]
pub fn crossing<S: Scalar>(from: Vec3<S>, to: Vec3<S>) -> S {
    let side = is_negative(to.y) - is_negative(from.y);
    let turn = from.x * to.y - to.x * from.y;
    S::select(S::zero().lt(side * turn), side, S::zero())
}

/// Whether any particle turns by more than 90 degrees around the projected centre from one position to the next. If none does, the straight
/// line is on the same side of the centre as the path.
#[inline(always)]
fn turns_far<S: Scalar>(from: Vec3<S>, to: Vec3<S>) -> bool {
    S::any(projected_dot(from, to).lt(S::zero()))
}

/// The crossings of the negative x axis on a part of a trajectory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossings<S> {
    /// Counter-clockwise ones less clockwise ones.
    pub number: S,
    /// Number of chords that turn by more than 90 degrees, so that the path may pass the centre on the other side.
    pub ambiguous: S,
}

impl<S: Scalar> Crossings<S> {
    /// Those between two states that are `h` apart in time: of the straight line where no particle turns far, else of eight chords of the
    /// cubic Hermite interpolant.
    #[inline(always)]
    pub fn between(from: State<S>, to: State<S>, h: S) -> Self {
        if turns_far(from.x, to.x) {
            return Self::of_chords(from, to, h);
        }
        Self {
            number: crossing(from.x, to.x),
            ambiguous: S::zero(),
        }
    }

    #[inline(always)]
    fn of_chords(from: State<S>, to: State<S>, h: S) -> Self {
        let (v_from, v_to) = (from.v * h, to.v * h);
        let mut crossings = Self {
            number: S::zero(),
            ambiguous: S::zero(),
        };
        let mut before = from.x;
        for chord in 1..=CHORDS {
            let t = chord as f64 / CHORDS as f64;
            let later = t * t * (3.0 - 2.0 * t);
            let x = from.x * S::from_f64(1.0 - later)
                + to.x * S::from_f64(later)
                + v_from * S::from_f64(t * (1.0 - t) * (1.0 - t))
                - v_to * S::from_f64(t * t * (1.0 - t));
            crossings.number += crossing(before, x);
            crossings.ambiguous += is_negative(projected_dot(before, x));
            before = x;
        }
        crossings
    }
}
