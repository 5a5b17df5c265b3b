//! Smeared particles: each is spread over an angle, with a slope in radius, both from the places of its neighbours and its partner on the
//! sky (docs/physics.md, section 6).

use crate::scalar::{Isa, LANES, Lanes, Scalar};
use crate::spray::MAX_NORMALS;

/// Distance to a neighbour on the unit circle at which it has a weight of 1/sqrt(2). Neighbours may be far from each other on the sky, and
/// the stream between them is then curved.
const REACH_ANGLE: f64 = 30.0 * DEGREE;

/// Difference in radius, over the radius, at which a neighbour has a weight of 1/sqrt(2).
const REACH_RADII: f64 = 0.3;

/// Upper bound of the width, the standard deviation of the angle, radians.
const MAX_WIDTH: f64 = 10.0 * DEGREE;

/// Upper bound of the half-width of a kernel in degrees, for soft edges of at most 60 degrees: half of the widest bin.
pub(super) const MAX_REACH_DEG: f64 = 90.0;

/// Upper bound of slope times width over the radius.
const MAX_RISE: f64 = 0.1;

/// Upper bound of slope times width for velocities, km/s.
const MAX_VELOCITY_RISE: f64 = 20.0;

/// Standard deviation of the angle that is added, radians, so that slopes are smooth where all neighbours are in one place.
const MIN_WIDTH: f64 = 0.1 * DEGREE;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Variance of a uniform distribution on [-1, 1]: a particle stands for release times from its partner's to as far on the other side.
const PARTNER_VARIANCE: f64 = 1.0 / 3.0;

/// A particle's direction on the sky, a unit vector, and its radius in kpc.
#[derive(Clone, Copy, Debug)]
pub struct Sky<S> {
    pub x: S,
    pub y: S,
    pub r: S,
    /// The inverse of the difference in radius at which a neighbour has a weight of 1/sqrt(2), 1/kpc.
    per_reach: S,
}

/// The numbers of a [`Sky`] in memory, in its order.
pub type SkyRow = [f64; 4];

/// From a particle to another: the sine of the angle, and the change of the quantity that is averaged, the radius in kpc or the line-of-sight
/// velocity in km/s, both times a factor that falls with distance: a and b of docs/physics.md, section 6.
#[derive(Clone, Copy, Debug)]
pub struct Displacement<S> {
    pub angle: S,
    pub change: S,
}

impl<S: Scalar> Sky<S> {
    /// The particle at the position (`x`, `y`) of length `r`.
    #[inline(always)]
    pub fn new(x: S, y: S, r: S) -> Self {
        let inverse = S::one() / r;
        Self {
            x: x * inverse,
            y: y * inverse,
            r,
            per_reach: inverse * (1.0 / REACH_RADII),
        }
    }

    /// The displacement to another particle, periodic in the angle, with the change of the radius.
    #[inline(always)]
    pub fn displacement_to(self, other: Self) -> Displacement<S> {
        self.displacement_with(other, other.r - self.r)
    }

    /// The displacement to another particle with this change of the quantity that is averaged.
    #[inline(always)]
    pub fn displacement_with(self, other: Self, change: S) -> Displacement<S> {
        let (sine, cosine) = self.turn(other);
        let factor = self.factor(cosine, other.r - self.r);
        Displacement {
            angle: factor * sine,
            change: factor * change,
        }
    }

    /// Sine and cosine of the angle to another particle.
    #[inline(always)]
    fn turn(self, other: Self) -> (S, S) {
        (
            self.x * other.y - self.y * other.x,
            self.x * other.x + self.y * other.y,
        )
    }

    /// The factor that falls with distance, at the cosine of the angle and the difference in radius.
    #[inline(always)]
    fn factor(self, cosine: S, dr: S) -> S {
        let radii = dr * self.per_reach;
        let angle2 = (S::one() - cosine) * (2.0 / (REACH_ANGLE * REACH_ANGLE));
        (S::one() + angle2 + radii * radii).inverse_sqrt()
    }
}

impl<I: Isa> Sky<Lanes<I, 1>> {
    /// From rows of `x`, `y`, `r` and the inverse reach.
    #[inline(always)]
    pub fn from_rows(rows: [&SkyRow; LANES]) -> Self {
        let [x, y, r, per_reach] = Lanes::columns(rows);
        Self { x, y, r, per_reach }
    }

    /// The rows.
    #[inline(always)]
    pub fn rows(self) -> [SkyRow; LANES] {
        Lanes::rows([self.x, self.y, self.r, self.per_reach])
    }
}

/// The extent of the stream around a particle: the change of the angle and of the quantity that is averaged along each standard normal of the
/// release, for a change by one standard deviation of the smearing, and the displacement to the partner. P and Q of docs/physics.md, section 6.
#[derive(Clone, Copy, Debug)]
pub struct StreamExtent<S> {
    pub angle: [S; MAX_NORMALS],
    pub change: [S; MAX_NORMALS],
    pub partner: Displacement<S>,
}

impl<S: Scalar> StreamExtent<S> {
    #[inline(always)]
    pub fn from_partner(partner: Displacement<S>) -> Self {
        Self {
            angle: [S::zero(); MAX_NORMALS],
            change: [S::zero(); MAX_NORMALS],
            partner,
        }
    }

    /// Adds a neighbour with its weight along standard normal `k`.
    #[inline(always)]
    pub fn add(&mut self, k: usize, weight: S, displacement: Displacement<S>) {
        self.angle[k] = weight.mul_add(displacement.angle, self.angle[k]);
        self.change[k] = weight.mul_add(displacement.change, self.change[k]);
    }

    /// Variance of the angle and its covariance with the quantity.
    #[inline(always)]
    pub fn moments(&self) -> (S, S) {
        let Displacement { angle, change } = self.partner;
        let scaled = angle * PARTNER_VARIANCE;
        let (mut variance, mut covariance) =
            (scaled * angle + MIN_WIDTH * MIN_WIDTH, scaled * change);
        for k in 0..MAX_NORMALS {
            variance = self.angle[k].mul_add(self.angle[k], variance);
            covariance = self.angle[k].mul_add(self.change[k], covariance);
        }
        (variance, covariance)
    }
}

impl StreamExtent<f64> {
    /// Reverse mode of [`moments`](Self::moments): the derivatives with respect to the displacement to the partner.
    pub fn partner_vjp(&self, variance_bar: f64, covariance_bar: f64) -> Displacement<f64> {
        let Displacement { angle, change } = self.partner;
        Displacement {
            angle: PARTNER_VARIANCE * (2.0 * angle * variance_bar + change * covariance_bar),
            change: PARTNER_VARIANCE * angle * covariance_bar,
        }
    }
}

/// The smearing of a particle: the square of its width in radians^2, and the slope of the quantity that is averaged along the angle, per
/// radian.
#[derive(Clone, Copy, Debug)]
pub struct Smear<S> {
    pub width2: S,
    pub slope: S,
}

impl<S: Scalar> Smear<S> {
    /// From the variance of the angle and its covariance with the radius, of a particle at radius `r`, with smooth upper bounds.
    #[inline(always)]
    pub fn of_radius((variance, covariance): (S, S), r: S) -> Self {
        Self::with_max_rise((variance, covariance), r * MAX_RISE)
    }

    /// From the variance of the angle and its covariance with the line-of-sight velocity, with smooth upper bounds.
    #[inline(always)]
    pub fn of_velocity((variance, covariance): (S, S)) -> Self {
        Self::with_max_rise((variance, covariance), S::from_f64(MAX_VELOCITY_RISE))
    }

    #[inline(always)]
    fn with_max_rise((variance, covariance): (S, S), max_rise: S) -> Self {
        let width2 = variance / (variance * (1.0 / (MAX_WIDTH * MAX_WIDTH)) + 1.0);
        let slope = covariance / variance;
        let rise = slope / max_rise;
        Self {
            width2,
            slope: slope / (rise * rise * width2 + 1.0).sqrt(),
        }
    }

    /// Half-width in radians of the kernel, for edges with the half-width `soft` in radians.
    #[inline(always)]
    pub fn half_width(&self, soft: f64) -> S {
        (self.width2 * 7.0 + soft * soft).sqrt()
    }
}

/// Moments 0, 1 and 2 of the biweight kernel below `u`, where `u` is the distance from its centre over its half-width
/// (docs/physics.md, section 6).
#[inline(always)]
pub fn moments_below<S: Scalar>(u: S) -> [S; 3] {
    let u = u.max(-S::one()).min(S::one());
    let y = (u + 1.0) * 0.5;
    let u2 = u * u;
    let rest = S::one() - u2;
    [
        y * y * y * (y * (y * 6.0 - 15.0) + 10.0),
        rest * rest * rest * (-5.0 / 32.0),
        u * u2 * (u2 * (u2 * (15.0 / 112.0) - 0.375) + 0.3125) + 1.0 / 14.0,
    ]
}

/// The moments of the whole kernel.
pub const WHOLE_MOMENTS: [f64; 3] = [1.0, 0.0, 1.0 / 7.0];

/// Reverse mode of [`Sky::displacement_with`] this change: derivatives with respect to the angle from `here` to `other`, the radius of `here`,
/// that of `other`, and the change.
pub fn displacement_vjp(
    here: Sky<f64>,
    other: Sky<f64>,
    change: f64,
    displacement_bar: Displacement<f64>,
) -> [f64; 4] {
    let (sine, cosine) = here.turn(other);
    let dr = other.r - here.r;
    let factor = here.factor(cosine, dr);
    let cube = factor * factor * factor;
    let factor_bar = displacement_bar.angle * sine + displacement_bar.change * change;
    let slope = cube * dr * here.per_reach * here.per_reach;
    let angle = -cube * sine / (REACH_ANGLE * REACH_ANGLE) * factor_bar
        + displacement_bar.angle * factor * cosine;
    let here_r = slope * (1.0 + dr / here.r) * factor_bar;
    [
        angle,
        here_r,
        -slope * factor_bar,
        displacement_bar.change * factor,
    ]
}
