//! The NFW halo, flattened in its density along one axis (docs/physics.md, section 2).

use super::halo::{Halo, HaloCotangent, HaloParameters};
use super::{Potential, nfw, tiny_m2};
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// Number of nodes of the quadrature.
const NODES: usize = 12;

/// Points p in (0, 1) and weights of the quadrature: Gauss-Legendre nodes u with `p = (201^u - 1) / 200`, which are dense near 0, where
/// the integrand of a distant point changes fast.
const POINTS: [(f64, f64); NODES] = [
    (0.000_250_549_311_460_698_25, 0.000_656_804_846_416_461_3),
    (0.001_447_455_938_612_884_5, 0.001_828_278_814_916_426_5),
    (0.004_203_428_255_147_932, 0.003_906_598_451_650_995),
    (0.009_935_296_014_870_19, 0.008_046_083_145_284_152),
    (0.021_728_464_120_281_947, 0.016_548_689_541_036_36),
    (0.045_856_853_463_582_85, 0.033_598_650_191_537_06),
    (0.093_806_742_017_538_69, 0.065_276_810_017_157_75),
    (0.183_001_823_725_702_12, 0.116_399_647_955_247_7),
    (0.331_451_316_063_431_53, 0.181_256_217_532_704_6),
    (0.540_992_195_591_818_7, 0.231_758_449_871_052_07),
    (0.774_377_175_717_634_4, 0.221_004_810_697_552),
    (0.952_042_721_040_943_7, 0.119_718_958_935_444_42),
];

/// One node of the quadrature for a halo.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node<S> {
    /// t / Rs, in 1/kpc.
    scaled: S,
    /// 1/w - 1.
    across: S,
    /// The weight of the node with all factors that do not depend on the position, kpc/Gyr^2.
    strength: S,
    /// Derivatives of `ln scaled`, `across` and `ln strength` with respect to 1/q^2 - 1.
    slopes: [S; 3],
}

/// A halo with the NFW density on similar spheroids; docs/physics.md, section 2, has the symbols M, Rs, q, n, t, w and mu.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsoidalNfw<S> {
    parameters: HaloParameters<S>,
    nodes: [Node<S>; NODES],
}

/// The kind of halo with the potential [`EllipsoidalNfw`].
#[derive(Clone, Copy, Debug, Default)]
pub struct NfwDensity;

impl<S: Scalar> EllipsoidalNfw<S> {
    /// A halo of these parameters: the spheroid of semi-axis `m` has the mass `M g(m / Rs)`, whatever the axis ratio q of the density is.
    #[inline(always)]
    pub fn new(parameters: HaloParameters<S>) -> Self {
        let HaloParameters {
            mass,
            r_s,
            flattening,
            ..
        } = parameters;
        let one = S::one();
        let q2 = one / (flattening + 1.0);
        let q2_slope = -(q2 * q2);
        let prolate = one.lt(q2);
        let inverse_r_s = one / r_s;
        let strength = mass * G * (inverse_r_s * inverse_r_s);
        let node = |(p, weight): (f64, f64)| {
            let p2 = p * p;
            // q^2 + (1 - q^2) p^2 with t = p / spread^(1/2) and w = q^2 / spread of an oblate halo, whose nodes are moved towards t = 1, where 1/w is
            // steep; 1 / w of a prolate one, with t = p, is `narrow`.
            let spread = q2.mul_add(S::from_f64(1.0 - p2), S::from_f64(p2));
            let inverse = one / spread;
            let narrow = one / (q2 - 1.0).mul_add(S::from_f64(p2), one);
            let either = |a: S, b: S| S::select(prolate, a, b);
            let moved = either(one, inverse);
            let t = moved.sqrt() * p;
            let factor = either(narrow, q2 * (inverse * inverse * inverse));
            Node {
                scaled: t * inverse_r_s,
                across: either((one - q2) * narrow, flattening) * p2,
                strength: strength * factor.sqrt() * (p * weight),
                slopes: [
                    either(S::zero(), q2_slope * inverse * (0.5 * (p2 - 1.0))),
                    either(narrow * narrow * (q2 * q2), one) * p2,
                    q2_slope
                        * either(
                            narrow * (-0.5 * p2),
                            inverse * (1.5 * (p2 - 1.0)) + S::from_f64(0.5) / q2,
                        ),
                ],
            }
        };
        Self {
            parameters,
            nodes: POINTS.map(node),
        }
    }

    /// mu of a node at a point with these `|x|^2` and `(n.x)^2`.
    #[inline(always)]
    fn mu(node: &Node<S>, r2: S, along2: S) -> S {
        let mu2 = node.across.mul_add(along2, r2);
        mu2.max(S::from_f64(tiny_m2::<S>())).sqrt()
    }
}

impl<S: Scalar> Potential<S> for EllipsoidalNfw<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let along = self.parameters.axis.dot(x);
        let (r2, along2) = (x.norm2(), along * along);
        let mut sum = S::zero();
        for node in &self.nodes {
            let outside = node.scaled.mul_add(Self::mu(node, r2, along2), S::one());
            sum += node.strength / (node.scaled * outside);
        }
        -sum
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let along = self.parameters.axis.dot(x);
        let (r2, along2) = (x.norm2(), along * along);
        let (mut all, mut across) = (S::zero(), S::zero());
        for node in &self.nodes {
            let mu = Self::mu(node, r2, along2);
            let outside = node.scaled.mul_add(mu, S::one());
            let k = node.strength / (mu * (outside * outside));
            all += k;
            across = k.mul_add(node.across, across);
        }
        (x * -all).add_scaled(self.parameters.axis, -(across * along))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let along = self.parameters.axis.dot(x);
        let v_along = self.parameters.axis.dot(v);
        let (r2, along2) = (x.norm2(), along * along);
        let mut product = Vec3::zero();
        for node in &self.nodes {
            let mu = Self::mu(node, r2, along2);
            let outside = node.scaled.mul_add(mu, S::one());
            let inverse = S::one() / (mu * outside);
            let k = node.strength * inverse / outside;
            // k'(mu) / mu.
            let dk = -(k * inverse) * (node.scaled * mu * 3.0 + 1.0) / mu;
            let y = x.add_scaled(self.parameters.axis, node.across * along);
            let dy = v.add_scaled(self.parameters.axis, node.across * v_along);
            product = product + dy * k + y * (dk * y.dot(v));
        }
        product
    }
}

impl Halo for NfwDensity {
    type In<S: Scalar> = EllipsoidalNfw<S>;

    #[inline(always)]
    fn new<S: Scalar>(parameters: HaloParameters<S>) -> EllipsoidalNfw<S> {
        EllipsoidalNfw::new(parameters)
    }

    #[inline(always)]
    fn parameters<S: Scalar>(halo: &EllipsoidalNfw<S>) -> HaloParameters<S> {
        halo.parameters
    }

    #[inline(always)]
    fn broadcast<S: Scalar>(halo: &EllipsoidalNfw<f64>) -> EllipsoidalNfw<S> {
        let node = |node: Node<f64>| Node {
            scaled: S::from_f64(node.scaled),
            across: S::from_f64(node.across),
            strength: S::from_f64(node.strength),
            slopes: node.slopes.map(S::from_f64),
        };
        EllipsoidalNfw {
            parameters: halo.parameters.map(S::from_f64),
            nodes: halo.nodes.map(node),
        }
    }

    /// A formula instead of the default, which would make the nodes anew at each evaluation.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &EllipsoidalNfw<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let along = halo.parameters.axis.dot(x);
        let n_lambda = halo.parameters.axis.dot(lambda);
        let x_lambda = x.dot(lambda);
        let (r2, along2) = (x.norm2(), along * along);
        // Sums over the nodes of k and of k'(mu) / mu times y.lambda; `across` has them with 1/w - 1.
        let (mut all, mut all_across) = (S::zero(), S::zero());
        let (mut pull, mut pull_across) = (S::zero(), S::zero());
        for node in &halo.nodes {
            let mu = EllipsoidalNfw::mu(node, r2, along2);
            let scaled_mu = node.scaled * mu;
            let inverse_outside = S::one() / (scaled_mu + 1.0);
            let inverse_mu = S::one() / mu;
            let k = node.strength * inverse_mu * (inverse_outside * inverse_outside);
            let y_lambda = (node.across * along).mul_add(n_lambda, x_lambda);
            let k_lambda = k * y_lambda;
            let dk_lambda =
                -(k_lambda * inverse_outside * (inverse_mu * inverse_mu)) * (scaled_mu * 3.0 + 1.0);
            all += k;
            all_across = k.mul_add(node.across, all_across);
            pull += dk_lambda;
            pull_across = dk_lambda.mul_add(node.across, pull_across);
            let by_scaled = k_lambda * (scaled_mu * inverse_outside) * 2.0;
            let by_across = -(dk_lambda * along2 * 0.5 + k * along * n_lambda);
            cotangent.ln_mass -= k_lambda;
            cotangent.ln_r_s += k_lambda * 2.0 - by_scaled;
            cotangent.flattening +=
                by_scaled * node.slopes[0] + by_across * node.slopes[1] - k_lambda * node.slopes[2];
        }
        let across = pull_across.mul_add(along, all_across * n_lambda);
        cotangent.axis = cotangent
            .axis
            .add_scaled(x, -across)
            .add_scaled(lambda, -(all_across * along));
        let x_bar = (lambda * -all)
            .add_scaled(x, -pull)
            .add_scaled(halo.parameters.axis, -across);
        let acceleration = (x * -all).add_scaled(halo.parameters.axis, -(all_across * along));
        (acceleration, x_bar)
    }

    /// That of the spheroid whose mean density is 200 times the critical one: its mass does not depend on q.
    fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
        nfw::log10_m200(log10_mass, r_s)
    }
}
