//! The disc of Miyamoto & Nagai (1975, PASJ 27, 533).

use super::Potential;
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// `Phi = -G M / sqrt(R^2 + (a + sqrt(z^2 + b^2))^2)`, with z along `normal` and R perpendicular to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MiyamotoNagai<S> {
    /// Mass in Msun.
    pub mass: S,
    /// Scale length a in kpc.
    pub a: S,
    /// Scale height b in kpc; above zero.
    pub b: S,
    /// Unit vector perpendicular to the disc.
    pub normal: Vec3<S>,
}

impl<S: Scalar> MiyamotoNagai<S> {
    /// Height z, sqrt(z^2 + b^2), and the squared distance under the root of Phi.
    #[inline(always)]
    fn geometry(&self, x: Vec3<S>) -> (S, S, S) {
        let z = self.normal.dot(x);
        let height = (z * z + self.b * self.b).sqrt();
        let plane = x.add_scaled(self.normal, -z);
        let reach = self.a + height;
        (z, height, plane.norm2() + reach * reach)
    }

    /// The vector `y` with grad Phi = G M y / d^3.
    #[inline(always)]
    fn direction(&self, x: Vec3<S>, z: S, height: S) -> Vec3<S> {
        x.add_scaled(self.normal, self.a * z / height)
    }
}

impl<S: Scalar> Potential<S> for MiyamotoNagai<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (_, _, d2) = self.geometry(x);
        -(self.mass * G / d2.sqrt())
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let (z, height, d2) = self.geometry(x);
        self.direction(x, z, height) * (-(self.mass * G / (d2 * d2.sqrt())))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (z, height, d2) = self.geometry(x);
        let y = self.direction(x, z, height);
        let across = self.normal.dot(v) * self.a * self.b * self.b / (height * height * height);
        let dy = v.add_scaled(self.normal, across);
        (dy - y * (y.dot(v) * 3.0 / d2)) * (self.mass * G / (d2 * d2.sqrt()))
    }
}
