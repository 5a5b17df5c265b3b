//! Dynamical friction on the progenitor (Chandrasekhar 1943; docs/physics.md, section 3).

use super::mass_loss::MassOverTime;
use crate::error::Result;
use crate::orbit::OrbitForce;
use crate::params::StreamPrior;
use crate::potential::{HaloKind, HaloParameters, Potential};
use crate::scalar::{Real, Subroutine, Vec3};
use crate::units::G;
use std::f64::consts::{FRAC_2_SQRT_PI, PI};

/// Checks that a prior has the Coulomb logarithm if there is friction, and otherwise not.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) if it lacks a value or a distribution, or has one in vain.
pub(super) fn check_prior(friction: bool, prior: &StreamPrior) -> Result<()> {
    prior.check_belongs(
        "coulomb_logarithm",
        friction,
        "`model.dynamical_friction = true`",
        Some("{ kind = \"uniform\", lo = 0, hi = 5 }"),
    )
}

/// The friction of a progenitor in a halo of which density and velocity dispersion are those of the spherical one of the same mass and
/// scale radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct Friction<S> {
    pub kind: HaloKind,
    pub halo: HaloParameters<S>,
    /// The mass of the progenitor at the first release, Msun.
    pub mass: S,
    pub mass_loss: MassOverTime<S>,
    pub coulomb_logarithm: S,
}

/// `V_max^2` of an NFW halo over `G M / R_s`, at 2.1626 scale radii, where M is its mass scale.
const V_MAX2: f64 = 0.216_216_595_501_873_2;

/// The dispersion of an NFW halo over `V_max`, at `x = r / R_s`: `A x^B / (1 + C x^D)` (Zentner & Bullock 2003).
const DISPERSION: [f64; 4] = [1.4393, 0.354, 1.1756, 0.725];

impl<S: Real> Friction<S> {
    /// The density in Msun/kpc^3 and the square of the one-dimensional velocity dispersion in (kpc/Gyr)^2 at the radius `r` kpc.
    #[inline(always)]
    fn density_and_dispersion2(&self, r: S) -> (S, S) {
        let HaloParameters { mass, r_s, .. } = self.halo;
        if self.kind == HaloKind::Logarithmic {
            let (r2, core2) = (r * r, r_s * r_s);
            let outer = r2 + core2;
            let density = mass / r_s * (r2 + core2 * 3.0) / (outer * outer) * (0.25 / PI);
            (density, mass * G / r_s * 0.5)
        } else {
            let outer = r + r_s;
            let density = mass / (r * outer * outer) * (0.25 / PI);
            let ln_x = (r / r_s).ln();
            let [a, b, c, d] = DISPERSION;
            let shape = (ln_x * b).exp() * a / ((ln_x * d).exp() * c + 1.0);
            (density, mass * G / r_s * V_MAX2 * shape * shape)
        }
    }

    /// The deceleration over the velocity, 1/Gyr.
    #[inline(always)]
    fn rate(&self, x: Vec3<S>, v: Vec3<S>, tau: f64) -> S {
        let (density, dispersion2) = self.density_and_dispersion2(x.norm2().sqrt());
        let twice = dispersion2 * 2.0;
        let mass = self.mass * self.mass_loss.fraction(tau).value;
        mass * density * self.coulomb_logarithm * slower_share(v.norm2() / twice)
            / (twice * twice.sqrt())
            * (4.0 * PI * G * G)
    }
}

/// Where this is the square of the speed over that of the most probable one, the halo's matter that is slower, over the cube of this ratio:
/// `[erf(X) - 2 X exp(-X^2) / sqrt(pi)] / X^3` with `u = X^2`.
#[inline(always)]
fn slower_share<S: Real>(u: S) -> S {
    let at = u.re();
    let value = if at < 0.1 {
        // The series of 4 / sqrt(pi) times the integral of t^2 exp(-u t^2) from 0 to 1.
        let (mut term, mut sum) = (1.0, 0.0);
        for n in 0..10 {
            sum += term / f64::from(2 * n + 3);
            term *= -at / f64::from(n + 1);
        }
        2.0 * FRAC_2_SQRT_PI * sum
    } else {
        let x = at.sqrt();
        (libm::erf(x) - FRAC_2_SQRT_PI * x * (-at).exp()) / (at * x)
    };
    let derivative = if at < 1e-4 {
        2.0 * FRAC_2_SQRT_PI * (-0.2 + at / 7.0)
    } else {
        (2.0 * FRAC_2_SQRT_PI * (-at).exp() - 3.0 * value) / (2.0 * at)
    };
    u.with_derivative(value, derivative)
}

/// A host with the friction of the progenitor.
pub(super) struct WithFriction<'a, S, P> {
    pub host: &'a P,
    pub friction: Friction<S>,
}

impl<S: Real, P: Potential<S>> OrbitForce<S> for WithFriction<'_, S, P> {
    const DEPENDS_ON_VELOCITY: bool = true;

    #[inline(always)]
    fn orbit_acceleration(&self, x: Vec3<S>, v: Vec3<S>, tau: f64) -> Vec3<S> {
        let rate = S::call(Rate {
            friction: &self.friction,
            x,
            v,
            tau,
        });
        self.host.acceleration(x).add_scaled(v, -rate)
    }
}

struct Rate<'a, S> {
    friction: &'a Friction<S>,
    x: Vec3<S>,
    v: Vec3<S>,
    tau: f64,
}

impl<S: Real> Subroutine for Rate<'_, S> {
    type Output = S;

    #[inline(always)]
    fn run(self) -> S {
        self.friction.rate(self.x, self.v, self.tau)
    }
}
