//! Particles as samples of the stream around them: each is smeared over an angle, along a slope, both from the places of its neighbours
//! in release space (docs/physics.md, section 6).

use crate::scalar::Scalar;
use crate::spray::MAX_NORMALS;

/// Distance at which a neighbour counts by 1/sqrt(2): twice the sine of half its angle, and a fraction of the radius. Neighbours in release
/// space may be far from each other on the sky, and the stream between them is then no straight line.
const REACH_ANGLE: f64 = 30.0 * DEGREE;
const REACH_RADII: f64 = 0.3;

/// Largest width: the standard deviation of the angle, radians.
const MAX_WIDTH: f64 = 10.0 * DEGREE;

/// Largest half-width of a kernel with soft edges of up to half a bin, and no more than 60 degrees of them.
pub(super) const MAX_REACH_DEG: f64 = 90.0;

/// Largest difference of the radius that a slope makes over a width, as a fraction of the radius.
const MAX_RISE: f64 = 0.1;

/// Smallest width, so that slopes are smooth where all neighbours are in one place.
const MIN_WIDTH: f64 = 0.1 * DEGREE;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Share of the partner at the next release time: the variance of a uniform distribution over the time to it and as much before.
const PARTNER_SHARE: f64 = 1.0 / 3.0;

/// A particle's direction on the sky, a unit vector, and its radius in kpc.
#[derive(Clone, Copy, Debug)]
pub struct Sky<S> {
    pub x: S,
    pub y: S,
    pub r: S,
}

/// Where a neighbour is: the sine of its angle from the particle, and its radius less the particle's; both times a factor that falls with
/// distance.
#[derive(Clone, Copy, Debug)]
pub struct Apart<S> {
    pub angle: S,
    pub r: S,
}

impl<S: Scalar> Sky<S> {
    /// Where another particle is. Periodic: neighbours that are whole turns apart are near.
    #[inline(always)]
    pub fn apart(self, other: Self) -> Apart<S> {
        let (sine, cosine) = self.turn(other);
        let dr = other.r - self.r;
        let factor = self.factor(cosine, dr);
        Apart {
            angle: factor * sine,
            r: factor * dr,
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

    #[inline(always)]
    fn factor(self, cosine: S, dr: S) -> S {
        let radii = dr / (self.r * REACH_RADII);
        let angle2 = (S::one() - cosine) * (2.0 / (REACH_ANGLE * REACH_ANGLE));
        S::one() / (S::one() + angle2 + radii * radii).sqrt()
    }
}

/// How the stream around a particle lies on the sky: its extent in angle and radius along each random number of a release, for a change of
/// a standard deviation of the smearing, and to the partner.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<S> {
    pub angle: [S; MAX_NORMALS],
    pub r: [S; MAX_NORMALS],
    pub partner: Apart<S>,
}

impl<S: Scalar> Surroundings<S> {
    #[inline(always)]
    pub fn of_partner(partner: Apart<S>) -> Self {
        Self {
            angle: [S::zero(); MAX_NORMALS],
            r: [S::zero(); MAX_NORMALS],
            partner,
        }
    }

    /// Adds a neighbour with its weight along one random number.
    #[inline(always)]
    pub fn add(&mut self, number: usize, weight: S, apart: Apart<S>) {
        self.angle[number] = weight.mul_add(apart.angle, self.angle[number]);
        self.r[number] = weight.mul_add(apart.r, self.r[number]);
    }

    /// Variance of the angle and its covariance with the radius.
    #[inline(always)]
    pub fn moments(&self) -> (S, S) {
        let Apart { angle, r } = self.partner;
        let share = angle * PARTNER_SHARE;
        let (mut variance, mut covariance) = (share * angle + MIN_WIDTH * MIN_WIDTH, share * r);
        for k in 0..MAX_NORMALS {
            variance = self.angle[k].mul_add(self.angle[k], variance);
            covariance = self.angle[k].mul_add(self.r[k], covariance);
        }
        (variance, covariance)
    }
}

impl Surroundings<f64> {
    /// Reverse mode of [`moments`](Self::moments) for the partner.
    pub fn partner_vjp(&self, variance: f64, covariance: f64) -> Apart<f64> {
        let Apart { angle, r } = self.partner;
        Apart {
            angle: PARTNER_SHARE * (2.0 * angle * variance + r * covariance),
            r: PARTNER_SHARE * angle * covariance,
        }
    }
}

/// What a particle is smeared over: the square of a width in radians^2, and the slope of the radius along the angle, kpc.
#[derive(Clone, Copy, Debug)]
pub struct Smear<S> {
    pub width2: S,
    pub slope: S,
}

impl<S: Scalar> Smear<S> {
    /// All of a narrow distribution, and smoothly less of a wider or steeper one, of a particle at radius `r`.
    #[inline(always)]
    pub fn new((variance, covariance): (S, S), r: S) -> Self {
        let width2 = variance / (variance * (1.0 / (MAX_WIDTH * MAX_WIDTH)) + 1.0);
        let slope = covariance / variance;
        let rise = slope / (r * MAX_RISE);
        Self {
            width2,
            slope: slope / (rise * rise * width2 + 1.0).sqrt(),
        }
    }

    /// Half-width in radians of a kernel of this width, for an edge that is soft by itself over `soft` radians to both sides.
    #[inline(always)]
    pub fn half_width(&self, soft: f64) -> S {
        (self.width2 * 7.0 + soft * soft).sqrt()
    }
}

/// Moments of the part of a biweight kernel below `u` half-widths above its middle: the integrals of k(u) = (15/16) (1 - u^2)^2, of u k
/// and of u^2 k.
#[inline(always)]
pub fn below<S: Scalar>(u: S) -> [S; 3] {
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

/// Those of the whole kernel.
pub const WHOLE: [f64; 3] = [1.0, 0.0, 1.0 / 7.0];

/// Reverse mode of [`Sky::apart`]: derivatives with respect to the angle from the particle to its neighbour, and both radii.
pub fn apart_vjp(here: Sky<f64>, other: Sky<f64>, by: Apart<f64>) -> [f64; 3] {
    let (sine, cosine) = here.turn(other);
    let dr = other.r - here.r;
    let factor = here.factor(cosine, dr);
    let cube = factor * factor * factor;
    let reach = here.r * REACH_RADII;
    // Through the factor, then directly.
    let factor_bar = by.angle * sine + by.r * dr;
    let pull = cube * dr / (reach * reach);
    let angle =
        -cube * sine / (REACH_ANGLE * REACH_ANGLE) * factor_bar + by.angle * factor * cosine;
    let other_r = -pull * factor_bar + by.r * factor;
    let here_r = pull * (1.0 + dr / here.r) * factor_bar - by.r * factor;
    [angle, here_r, other_r]
}
