//! The sum of two potentials.

use super::Potential;
use crate::scalar::{Scalar, Vec3};

/// The sum of two potentials; sums can be nested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sum<A, B>(pub A, pub B);

impl<S: Scalar, A: Potential<S>, B: Potential<S>> Potential<S> for Sum<A, B> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        self.0.value(x) + self.1.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        self.0.acceleration(x) + self.1.acceleration(x)
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        self.0.hessian_product(x, v) + self.1.hessian_product(x, v)
    }
}
