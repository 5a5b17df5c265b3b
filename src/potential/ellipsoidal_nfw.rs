//! The NFW halo, flattened in its density along one axis or along two (docs/physics.md, section 2).

use super::halo::{Halo, HaloCotangent, HaloParameters};
use super::{Potential, nfw, tiny_m2};
use crate::scalar::{Scalar, Tangent, Vec3};
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

/// Number of axes with an axis ratio: that of q, and the second one.
const AXES: usize = 2;

/// One node of the quadrature for a halo.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node<S> {
    /// t / Rs, in 1/kpc.
    scaled: S,
    /// 1/w - 1 of each axis.
    across: [S; AXES],
    /// The weight of the node with all factors that do not depend on the position, kpc/Gyr^2.
    strength: S,
    /// Derivatives of `ln scaled`, of both `across` and of `ln strength` with respect to 1/q^2 - 1 and 1/p^2 - 1.
    slopes: [[S; AXES]; 2 + AXES],
}

/// A halo with the NFW density on similar ellipsoids; docs/physics.md, section 2, has the symbols M, Rs, q, p, n, t, w and mu.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsoidalNfw<S> {
    parameters: HaloParameters<S>,
    nodes: [Node<S>; NODES],
}

/// The kind of halo with the potential [`EllipsoidalNfw`]: symmetric around its axis, or triaxial if its parameters have a second axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct NfwDensity;

/// t, 1/w - 1 of each axis, and the strength but for `G M / Rs^2`, of the node with the point `u` and its weight.
#[inline(always)]
fn node_numbers<S: Scalar>(flattenings: [S; AXES], (u, weight): (f64, f64)) -> [S; 2 + AXES] {
    let one = S::one();
    let [q2, p2] = [one / (flattenings[0] + 1.0), one / (flattenings[1] + 1.0)];
    // Nodes are moved towards t = 1, where 1/w of the shorter axis is steep, by t = u / spread^(1/2).
    let least2 = q2.min(p2).min(one);
    let u2 = u * u;
    let spread = least2.mul_add(S::from_f64(1.0 - u2), S::from_f64(u2));
    // w = denominator / spread.
    let denominators = [
        (q2 - least2).mul_add(S::from_f64(u2), least2),
        (p2 - least2).mul_add(S::from_f64(u2), least2),
    ];
    [
        S::from_f64(u) / spread.sqrt(),
        flattenings[0] * q2 * u2 / denominators[0],
        flattenings[1] * p2 * u2 / denominators[1],
        least2 * (u * weight) / (spread * (denominators[0] * denominators[1]).sqrt()),
    ]
}

impl<S: Scalar> EllipsoidalNfw<S> {
    /// A halo of these parameters: the ellipsoid of semi-axis `m` has the mass `M g(m / Rs)`, whatever the axis ratios of the density are.
    #[inline(always)]
    pub fn new(parameters: HaloParameters<S>) -> Self {
        let HaloParameters {
            mass,
            r_s,
            flattening,
            second,
            ..
        } = parameters;
        let inverse_r_s = S::one() / r_s;
        let strength = mass * G * (inverse_r_s * inverse_r_s);
        let flattenings = [
            Tangent::<S, AXES>::along(flattening, 0, S::one()),
            Tangent::along(second.flattening, 1, S::one()),
        ];
        let node = |point: (f64, f64)| {
            let [t, across, second_across, factor] = node_numbers(flattenings, point);
            let of_logarithm = |number: Tangent<S, AXES>| number.eps.map(|slope| slope / number.re);
            Node {
                scaled: t.re * inverse_r_s,
                across: [across.re, second_across.re],
                strength: strength * factor.re,
                slopes: [
                    of_logarithm(t),
                    across.eps,
                    second_across.eps,
                    of_logarithm(factor),
                ],
            }
        };
        Self {
            parameters,
            nodes: POINTS.map(node),
        }
    }

    /// The axes of both axis ratios.
    #[inline(always)]
    fn axes(&self) -> [Vec3<S>; AXES] {
        [self.parameters.axis, self.parameters.second.axis]
    }

    /// The components of a vector along both axes.
    #[inline(always)]
    fn along(&self, x: Vec3<S>) -> [S; AXES] {
        let [n, second] = self.axes();
        [n.dot(x), second.dot(x)]
    }

    /// mu of a node at a point with this `|x|^2` and these components along the axes.
    #[inline(always)]
    fn mu(node: &Node<S>, r2: S, along: [S; AXES]) -> S {
        let mu2 = node.across[0].mul_add(along[0] * along[0], r2);
        let mu2 = node.across[1].mul_add(along[1] * along[1], mu2);
        mu2.max(S::from_f64(tiny_m2::<S>())).sqrt()
    }

    /// A vector with the components along the axes multiplied by 1/w: half of the gradient of mu^2 if it is the position.
    #[inline(always)]
    fn stretched(&self, node: &Node<S>, x: Vec3<S>, along: [S; AXES]) -> Vec3<S> {
        let [n, second] = self.axes();
        x.add_scaled(n, node.across[0] * along[0])
            .add_scaled(second, node.across[1] * along[1])
    }
}

impl<S: Scalar> Potential<S> for EllipsoidalNfw<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (r2, along) = (x.norm2(), self.along(x));
        let mut sum = S::zero();
        for node in &self.nodes {
            let outside = node.scaled.mul_add(Self::mu(node, r2, along), S::one());
            sum += node.strength / (node.scaled * outside);
        }
        -sum
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let (r2, along) = (x.norm2(), self.along(x));
        let (mut all, mut across) = (S::zero(), [S::zero(); AXES]);
        for node in &self.nodes {
            let mu = Self::mu(node, r2, along);
            let outside = node.scaled.mul_add(mu, S::one());
            let k = node.strength / (mu * (outside * outside));
            all += k;
            for axis in 0..AXES {
                across[axis] = k.mul_add(node.across[axis], across[axis]);
            }
        }
        let [n, second] = self.axes();
        (x * -all)
            .add_scaled(n, -(across[0] * along[0]))
            .add_scaled(second, -(across[1] * along[1]))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (r2, along, v_along) = (x.norm2(), self.along(x), self.along(v));
        let mut product = Vec3::zero();
        for node in &self.nodes {
            let mu = Self::mu(node, r2, along);
            let outside = node.scaled.mul_add(mu, S::one());
            let inverse = S::one() / (mu * outside);
            let k = node.strength * inverse / outside;
            // k'(mu) / mu.
            let dk = -(k * inverse) * (node.scaled * mu * 3.0 + 1.0) / mu;
            let y = self.stretched(node, x, along);
            let dy = self.stretched(node, v, v_along);
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
            across: node.across.map(S::from_f64),
            strength: S::from_f64(node.strength),
            slopes: node.slopes.map(|slopes| slopes.map(S::from_f64)),
        };
        EllipsoidalNfw {
            parameters: halo.parameters.map(S::from_f64),
            nodes: halo.nodes.map(node),
        }
    }

    /// A formula instead of the default, which would make the nodes anew at each evaluation, and has no second axis.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &EllipsoidalNfw<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (along, lambda_along) = (halo.along(x), halo.along(lambda));
        let x_lambda = x.dot(lambda);
        let r2 = x.norm2();
        // Sums over the nodes of k and of k'(mu) / mu times y.lambda; `across` has them with 1/w - 1 of each axis.
        let (mut all, mut all_across) = (S::zero(), [S::zero(); AXES]);
        let (mut pull, mut pull_across) = (S::zero(), [S::zero(); AXES]);
        for node in &halo.nodes {
            let mu = EllipsoidalNfw::mu(node, r2, along);
            let scaled_mu = node.scaled * mu;
            let inverse_outside = S::one() / (scaled_mu + 1.0);
            let inverse_mu = S::one() / mu;
            let k = node.strength * inverse_mu * (inverse_outside * inverse_outside);
            let y_lambda = (node.across[0] * along[0]).mul_add(lambda_along[0], x_lambda);
            let y_lambda = (node.across[1] * along[1]).mul_add(lambda_along[1], y_lambda);
            let k_lambda = k * y_lambda;
            let dk_lambda =
                -(k_lambda * inverse_outside * (inverse_mu * inverse_mu)) * (scaled_mu * 3.0 + 1.0);
            all += k;
            pull += dk_lambda;
            let by_scaled = k_lambda * (scaled_mu * inverse_outside) * 2.0;
            let mut by_across = [S::zero(); AXES];
            for axis in 0..AXES {
                all_across[axis] = k.mul_add(node.across[axis], all_across[axis]);
                pull_across[axis] = dk_lambda.mul_add(node.across[axis], pull_across[axis]);
                by_across[axis] =
                    -((dk_lambda * along[axis] * 0.5 + k * lambda_along[axis]) * along[axis]);
            }
            cotangent.ln_mass -= k_lambda;
            cotangent.ln_r_s += k_lambda * 2.0 - by_scaled;
            let [of_t, of_across, of_second_across, of_strength] = &node.slopes;
            cotangent.flattening += by_scaled * of_t[0] + by_across[0] * of_across[0]
                - k_lambda * of_strength[0]
                + by_across[1] * of_second_across[0];
            cotangent.second.flattening += by_scaled * of_t[1] + by_across[0] * of_across[1]
                - k_lambda * of_strength[1]
                + by_across[1] * of_second_across[1];
        }
        let axes = halo.axes();
        let (mut x_bar, mut acceleration) = ((lambda * -all).add_scaled(x, -pull), x * -all);
        let mut axes_bar = [Vec3::zero(); AXES];
        for axis in 0..AXES {
            let across =
                pull_across[axis].mul_add(along[axis], all_across[axis] * lambda_along[axis]);
            let force = -(all_across[axis] * along[axis]);
            axes_bar[axis] = (x * -across).add_scaled(lambda, force);
            x_bar = x_bar.add_scaled(axes[axis], -across);
            acceleration = acceleration.add_scaled(axes[axis], force);
        }
        cotangent.axis += axes_bar[0];
        cotangent.second.axis += axes_bar[1];
        (acceleration, x_bar)
    }

    /// That of the ellipsoid whose mean density is 200 times the critical one: its mass does not depend on the axis ratios.
    fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
        nfw::log10_m200(log10_mass, r_s)
    }
}
