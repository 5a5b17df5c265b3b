//! A potential whose functions are called and not inlined.

use super::Potential;
use crate::scalar::{Scalar, Subroutine, Vec3};

/// A potential whose acceleration and Hessian are subroutines of a kernel ([`Scalar::call`]): for long ones that are evaluated in several
/// places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Called<P>(pub P);

impl<S: Scalar, P: Potential<S>> Potential<S> for Called<P> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        self.0.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        S::call(Acceleration {
            potential: &self.0,
            x,
        })
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        S::call(HessianProduct {
            potential: &self.0,
            x,
            v,
        })
    }
}

struct Acceleration<'a, S, P> {
    potential: &'a P,
    x: Vec3<S>,
}

impl<S: Scalar, P: Potential<S>> Subroutine for Acceleration<'_, S, P> {
    type Output = Vec3<S>;

    #[inline(always)]
    fn run(self) -> Vec3<S> {
        self.potential.acceleration(self.x)
    }
}

struct HessianProduct<'a, S, P> {
    potential: &'a P,
    x: Vec3<S>,
    v: Vec3<S>,
}

impl<S: Scalar, P: Potential<S>> Subroutine for HessianProduct<'_, S, P> {
    type Output = Vec3<S>;

    #[inline(always)]
    fn run(self) -> Vec3<S> {
        self.potential.hessian_product(self.x, self.v)
    }
}
