//! Vectors of three components.

use super::Scalar;
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// A vector in the frame of docs/physics.md, section 1: x and y in the plane of the sky, z towards the observer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3<S> {
    /// Along the sky's x axis.
    pub x: S,
    /// Along the sky's y axis.
    pub y: S,
    /// Towards the observer.
    pub z: S,
}

impl<S: Scalar> Vec3<S> {
    /// From components.
    #[inline(always)]
    pub fn new(x: S, y: S, z: S) -> Self {
        Self { x, y, z }
    }

    /// The null vector.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self::new(S::zero(), S::zero(), S::zero())
    }

    /// A constant vector.
    #[inline(always)]
    #[must_use]
    pub fn from_f64(v: Vec3<f64>) -> Self {
        Self::new(S::from_f64(v.x), S::from_f64(v.y), S::from_f64(v.z))
    }

    /// Inner product.
    #[inline(always)]
    #[must_use]
    pub fn dot(self, other: Self) -> S {
        self.x
            .mul_add(other.x, self.y.mul_add(other.y, self.z * other.z))
    }

    /// Cross product.
    #[inline(always)]
    #[must_use]
    pub fn cross(self, o: Self) -> Self {
        Self::new(
            self.y * o.z - self.z * o.y,
            self.z * o.x - self.x * o.z,
            self.x * o.y - self.y * o.x,
        )
    }

    /// Squared length.
    #[inline(always)]
    #[must_use]
    pub fn norm2(self) -> S {
        self.dot(self)
    }

    /// `self + other * factor`.
    #[inline(always)]
    #[must_use]
    pub fn add_scaled(self, other: Self, factor: S) -> Self {
        Self::new(
            other.x.mul_add(factor, self.x),
            other.y.mul_add(factor, self.y),
            other.z.mul_add(factor, self.z),
        )
    }

    /// `a` where the mask is set, `b` elsewhere.
    #[inline(always)]
    #[must_use]
    pub fn select(mask: S::Mask, a: Self, b: Self) -> Self {
        Self::new(
            S::select(mask, a.x, b.x),
            S::select(mask, a.y, b.y),
            S::select(mask, a.z, b.z),
        )
    }

    /// Applies `f` to each component.
    #[inline(always)]
    pub fn map<T>(self, mut f: impl FnMut(S) -> T) -> Vec3<T> {
        Vec3 {
            x: f(self.x),
            y: f(self.y),
            z: f(self.z),
        }
    }

    /// The components in order.
    #[inline(always)]
    pub fn to_array(self) -> [S; 3] {
        [self.x, self.y, self.z]
    }
}

impl<S> From<[S; 3]> for Vec3<S> {
    #[inline(always)]
    fn from([x, y, z]: [S; 3]) -> Self {
        Self { x, y, z }
    }
}

impl<S: Scalar> Add for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl<S: Scalar> Sub for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl<S: Scalar> Neg for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl<S: Scalar> Mul<S> for Vec3<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, f: S) -> Self {
        Self::new(self.x * f, self.y * f, self.z * f)
    }
}

impl<S: Scalar> AddAssign for Vec3<S> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
