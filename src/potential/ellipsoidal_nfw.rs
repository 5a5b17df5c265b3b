//! The NFW halo, flattened in its density along one axis or along two (docs/physics.md, section 2).

use super::halo::{Halo, HaloCotangent, HaloParameters, squared_axis_ratio};
use super::{Potential, TINY_M2, nfw};
use crate::scalar::{Scalar, Tangent, Vec3};
use crate::units::G;

/// Number of nodes of the quadrature.
const NODES: usize = 8;

/// Points p in (0, 1) and weights of the quadrature, by least squares over haloes and positions (`ellipsoidal_nfw_nodes.py`): they are dense
/// near 0, where the integrand of a distant point changes fast.
const POINTS: [(f64, f64); NODES] = [
    (0.000_778_801_424_776_861_7, 0.002_147_716_913_145_650_3),
    (0.005_548_050_045_444_75, 0.008_502_802_264_258_232),
    (0.021_629_014_355_119_62, 0.026_569_766_973_125_516),
    (0.066_396_369_487_796_9, 0.067_390_233_240_007_8),
    (0.165_022_561_294_783_57, 0.133_984_460_921_460_52),
    (0.342_821_805_370_631_9, 0.225_385_571_493_432_66),
    (0.614_482_277_557_446_2, 0.307_855_476_240_840_86),
    (0.904_393_931_229_504_7, 0.228_164_333_513_791_2),
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
    let [q2, p2] = [
        squared_axis_ratio(flattenings[0]),
        squared_axis_ratio(flattenings[1]),
    ];
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
        mu2.max(S::from_f64(TINY_M2)).sqrt()
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
