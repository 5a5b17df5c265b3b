//! The disc of a galaxy: one disc of Miyamoto & Nagai (1975, PASJ 27, 533), or three that approximate an exponential disc
//! (docs/physics.md, section 2).

use super::Potential;
use crate::scalar::{Scalar, Vec3};
use crate::units::G;
use serde::{Deserialize, Serialize};

/// Largest number of Miyamoto-Nagai discs of a disc.
const RINGS: usize = 3;

/// How the mass of a disc is distributed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DiscProfile {
    /// The disc of Miyamoto and Nagai: the scale length is its a, the thickness b / a.
    MiyamotoNagai,
    /// Exponential in radius and in height, by three Miyamoto-Nagai discs of Smith et al. (2015, MNRAS 448, 2934) with a density that is nowhere
    /// negative: the scale length is that of the surface density, the thickness the scale height over it.
    Exponential,
}

/// Coefficients of the fourth-degree polynomials in b / Rd, the highest power first: three masses over that of the disc, and three lengths a over
/// Rd (Smith et al. 2015, table 1, lower half).
const EXPONENTIAL: [[f64; 5]; 2 * RINGS] = [
    [0.0036, -0.0330, 0.1117, -0.1335, 0.1749],
    [-0.0131, 0.1090, -0.3035, 0.2921, -5.7976],
    [-0.0048, 0.0454, -0.1425, 0.1012, 6.7120],
    [-0.0158, 0.0993, -0.2070, -0.7089, 0.6445],
    [-0.0319, 0.1514, -0.1279, -0.9325, 2.6836],
    [-0.0326, 0.1816, -0.2943, -0.6329, 2.3193],
];

/// b / Rd of an exponential scale height over Rd, the same way (Smith et al. 2015, equation 6).
const HEIGHT_OF_EXPONENTIAL: [f64; 4] = [-0.269, 1.08, 1.092, 0.0];

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().fold(0.0, |sum, c| sum.mul_add(x, *c))
}

/// The distribution of a disc's mass in units of its mass and scale length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscShape {
    masses: [f64; RINGS],
    lengths: [f64; RINGS],
    /// Their common b.
    height: f64,
}

impl DiscShape {
    /// Of a disc without mass.
    const MASSLESS: Self = Self {
        masses: [0.0; RINGS],
        lengths: [1.0; RINGS],
        height: 1.0,
    };

    /// Of a profile with a thickness.
    #[must_use]
    pub fn new(profile: DiscProfile, thickness: f64) -> Self {
        match profile {
            DiscProfile::MiyamotoNagai => Self {
                masses: [1.0, 0.0, 0.0],
                lengths: [1.0; RINGS],
                height: thickness,
            },
            DiscProfile::Exponential => {
                let height = polynomial(&HEIGHT_OF_EXPONENTIAL, thickness);
                let number = |i: usize| polynomial(&EXPONENTIAL[i], height);
                Self {
                    masses: std::array::from_fn(number),
                    lengths: std::array::from_fn(|i| number(RINGS + i)),
                    height,
                }
            }
        }
    }
}

/// A disc: `Phi = -sum_i G M_i / sqrt(R^2 + (a_i + sqrt(z^2 + b^2))^2)`, with z along the normal and R perpendicular to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc<S> {
    /// Mass in Msun.
    pub mass: S,
    /// Scale length in kpc.
    pub r_s: S,
    /// Unit vector perpendicular to the disc.
    pub normal: Vec3<S>,
    shape: DiscShape,
    /// G `M_i`.
    strengths: [S; RINGS],
    /// `a_i` in kpc.
    lengths: [S; RINGS],
    /// b^2 in kpc^2.
    height2: S,
}

/// Derivatives of a result with respect to the parameters of a disc, summed over force evaluations.
#[derive(Clone, Copy, Debug)]
pub struct DiscCotangent<S> {
    /// With respect to ln mass.
    pub ln_mass: S,
    /// With respect to ln `r_s`.
    pub ln_r_s: S,
    /// With respect to the normal, its three components taken as independent.
    pub normal: Vec3<S>,
}

/// Sums over the Miyamoto-Nagai discs at a point, with `k_i = G M_i / d_i^3` and the distances `d_i` in the potential.
struct Sums<S> {
    /// z / sqrt(z^2 + b^2).
    slope: S,
    /// sqrt(z^2 + b^2).
    height: S,
    /// Sum of `k_i`, and of `k_i a_i`.
    k: S,
    k_a: S,
    /// Sums of `3 k_i a_i^j / d_i^2` for j of 0, 1 and 2.
    dk: [S; 3],
}

impl<S: Scalar> Disc<S> {
    /// A disc of `mass` (Msun) and scale length `r_s` (kpc) whose unit normal is `normal`.
    #[inline(always)]
    pub fn new(mass: S, r_s: S, normal: Vec3<S>, shape: DiscShape) -> Self {
        let (mut strengths, mut lengths) = ([S::zero(); RINGS], [S::zero(); RINGS]);
        for i in 0..RINGS {
            strengths[i] = mass * (G * shape.masses[i]);
            lengths[i] = r_s * shape.lengths[i];
        }
        let height = r_s * shape.height;
        Self {
            mass,
            r_s,
            normal,
            shape,
            strengths,
            lengths,
            height2: height * height,
        }
    }

    /// A disc without mass.
    #[inline(always)]
    #[must_use]
    pub fn none() -> Self {
        let normal = Vec3::new(S::zero(), S::zero(), S::one());
        Self::new(S::zero(), S::one(), normal, DiscShape::MASSLESS)
    }

    /// The same disc with numbers of another type, each converted by `f`.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> Disc<T> {
        let normal = Vec3::new(f(self.normal.x), f(self.normal.y), f(self.normal.z));
        self.with_numbers(f(self.mass), f(self.r_s), normal)
    }

    /// The same disc with another mass, scale length and normal.
    #[inline(always)]
    pub fn with_numbers<T: Scalar>(&self, mass: T, r_s: T, normal: Vec3<T>) -> Disc<T> {
        Disc::new(mass, r_s, normal, self.shape)
    }

    /// z and sqrt(z^2 + b^2).
    #[inline(always)]
    fn heights(&self, x: Vec3<S>) -> (S, S) {
        let z = self.normal.dot(x);
        (z, z.mul_add(z, self.height2).sqrt())
    }

    /// `R^2 + (a_i + h)^2` with the height h.
    #[inline(always)]
    fn distance2(&self, i: usize, r2: S, height: S) -> S {
        // R^2 + h^2 = |x|^2 + b^2, without a difference of large numbers.
        let a = self.lengths[i];
        a.mul_add(height * 2.0 + a, r2 + self.height2)
    }

    #[inline(always)]
    fn sums(&self, x: Vec3<S>) -> Sums<S> {
        let (z, height) = self.heights(x);
        let r2 = x.norm2();
        let (mut k, mut k_a, mut dk) = (S::zero(), S::zero(), [S::zero(); 3]);
        for i in 0..RINGS {
            let a = self.lengths[i];
            let inverse = S::one() / self.distance2(i, r2, height);
            let k_i = self.strengths[i] * (inverse * inverse.sqrt());
            let dk_i = k_i * inverse * 3.0;
            k += k_i;
            k_a = k_i.mul_add(a, k_a);
            dk[0] += dk_i;
            dk[1] = dk_i.mul_add(a, dk[1]);
            dk[2] = (dk_i * a).mul_add(a, dk[2]);
        }
        Sums {
            slope: z / height,
            height,
            k,
            k_a,
            dk,
        }
    }

    /// The product of the Hessian with `v`; also the second derivatives of the potential by z and |x|^2, and by z, taken as independent.
    #[inline(always)]
    fn hessian_product_of(&self, sums: &Sums<S>, x: Vec3<S>, v: Vec3<S>) -> (Vec3<S>, S, S) {
        let Sums {
            slope, height, k, ..
        } = *sums;
        let across = -(slope * sums.dk[1]) * 0.5;
        let h3 = height * height * height;
        let along = self.height2 / h3 * sums.k_a - slope * slope * sums.dk[2];
        let (x_v, n_v) = (x.dot(v), self.normal.dot(v));
        let of_x = across * n_v * 2.0 - sums.dk[0] * x_v;
        let of_normal = across * x_v * 2.0 + along * n_v;
        let product = (v * k)
            .add_scaled(x, of_x)
            .add_scaled(self.normal, of_normal);
        (product, across, along)
    }

    #[inline(always)]
    fn acceleration_of(&self, sums: &Sums<S>, x: Vec3<S>) -> Vec3<S> {
        (x * -sums.k).add_scaled(self.normal, -(sums.slope * sums.k_a))
    }

    /// Reverse mode of the acceleration, as [`Halo::vjp`](super::Halo::vjp).
    #[inline(always)]
    pub fn vjp(
        &self,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut DiscCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let sums = self.sums(x);
        let a = self.acceleration_of(&sums, x);
        let (product, across, along) = self.hessian_product_of(&sums, x, lambda);
        let x_bar = -product;
        let pull = a.dot(lambda);
        cotangent.ln_mass += pull;
        // The acceleration at c x with the scale length c r_s is 1/c^2 times that at x with r_s.
        cotangent.ln_r_s -= pull * 2.0 + x.dot(x_bar);
        let turn = across * x.dot(lambda) * 2.0 + along * self.normal.dot(lambda);
        cotangent.normal = cotangent
            .normal
            .add_scaled(x, -turn)
            .add_scaled(lambda, -(sums.slope * sums.k_a));
        (a, x_bar)
    }
}

impl<S: Scalar> Potential<S> for Disc<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (_, height) = self.heights(x);
        let r2 = x.norm2();
        let mut sum = S::zero();
        for i in 0..RINGS {
            sum += self.strengths[i] / self.distance2(i, r2, height).sqrt();
        }
        -sum
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        self.acceleration_of(&self.sums(x), x)
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        self.hessian_product_of(&self.sums(x), x, v).0
    }
}

impl<S: Scalar> DiscCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            ln_mass: S::zero(),
            ln_r_s: S::zero(),
            normal: Vec3::zero(),
        }
    }
}
