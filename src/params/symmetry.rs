//! Symmetries of the posterior that samplers use as moves: the exact degeneracy of mass, velocity and age, and two
//! involutions between orientation modes, which a projected track barely distinguishes (docs/physics.md, section 9).

use super::layout::NAMES;
use super::prior::StreamPrior;
use super::shape::{length_cdf, length_quantile, length_sf};
use oblate_samplers::rng::{RandomStream, unit_open};
use oblate_samplers::target::{Involution, Orbit};
use oblate_samplers::{Marginal, Prior, Symmetry};

/// All moves that are valid under the given prior. A likelihood of lengths alone, that of a track on the sky, is constant along the degeneracy
/// of mass, velocity and age; one of `velocities` is not.
#[must_use]
pub fn symmetries(prior: &StreamPrior, velocities: bool) -> Vec<Symmetry> {
    let mut moves = Vec::new();
    if !velocities && let Some(orbit) = MassVelocityAge::new(prior) {
        moves.push(Symmetry::Orbit(Box::new(orbit)));
    }
    if let Some(turn) = HalfTurn::new(prior) {
        moves.push(Symmetry::Involution(Box::new(turn)));
    }
    if let Some(twin) = QuarterTurnTwin::new(prior) {
        moves.push(Symmetry::Involution(Box::new(twin)));
    }
    moves
}

/// The logarithms of masses; the first is the host's.
const MASSES: [&str; 4] = [
    "log10_m_halo",
    "log10_m_prog",
    "log10_m_disc",
    "log10_m_bulge",
];

/// The exact degeneracy of mass, velocity and age. Masses times `s`, velocities times `sqrt s`, age over `sqrt s`:
/// every length of the model is unchanged, at any number of steps.
///
/// How to move along this group orbit (Liu and Sabatti 2000, theorem 1): if `x` follows the density `p`, so does `g x` with
/// `g` drawn from `p(g x) |J_g(x)|` with respect to the group's left Haar measure. Here the group is the
/// multiplicative one, with Haar measure `ds / s`. In the coordinates (log10 M, log10 m, .., vx, vy, vz, T) the masses
/// are shifted, three velocities are multiplied by `s^(1/2)` each and one age by `s^(-1/2)`: `J = s^(3/2 - 1/2) = s`.
/// The likelihood is constant on the orbit, at any temperature, so `p` is the prior there: constant in the uniform
/// log10 M, log10 m and T inside their bounds, and `exp(-s k)`, `k = sum_i v_i^2 / (2 w_i^2)`, in the normal
/// velocities of zero mean. Together `exp(-s k) s ds / s = exp(-s k) ds`: in `s` itself an exponential, truncated to
/// where both masses and the age stay inside their bounds, and drawn by inversion.
#[derive(Clone, Debug)]
pub struct MassVelocityAge {
    prior: Prior,
    /// Places among the free parameters, with bounds.
    masses: Vec<(usize, f64, f64)>,
    /// Places among the free parameters, with standard deviations.
    velocities: [(usize, f64); 3],
    age: (usize, f64, f64),
}

impl MassVelocityAge {
    /// The move under a prior; `None` unless all masses, the three velocities and the age are free, masses and age
    /// uniform, and velocities normal or half-normal around zero.
    #[must_use]
    pub fn new(prior: &StreamPrior) -> Option<Self> {
        let marginal = |name: &str| {
            let place = prior.free_index(name)?;
            Some((place, prior.prior().marginals()[place]))
        };
        let uniform = |name: &str| match marginal(name)? {
            (place, Marginal::Uniform { lo, hi }) => Some((place, lo, hi)),
            _ => None,
        };
        let centred = |name: &str| match marginal(name)? {
            (place, Marginal::HalfNormal { sd }) => Some((place, sd)),
            (place, Marginal::Normal { mean, sd }) if mean.abs() <= 0.0 => Some((place, sd)),
            _ => None,
        };
        let is_mass = |&&place: &&usize| MASSES.contains(&NAMES[place]);
        let masses = (prior.present().iter().filter(is_mass))
            .map(|&place| uniform(NAMES[place]))
            .collect::<Option<_>>()?;
        Some(Self {
            masses,
            velocities: [
                centred("vx0_km_s")?,
                centred("vy0_km_s")?,
                centred("vz0_km_s")?,
            ],
            age: uniform("age_gyr")?,
            prior: prior.prior().clone(),
        })
    }

    /// The interval of `s` inside the bounds, and the rate `k` of the exponential, at physical parameters.
    fn conditional(&self, theta: &[f64]) -> (f64, f64, f64) {
        let (place, lo, hi) = self.age;
        let mut s_lo = (theta[place] / hi).powi(2);
        let mut s_hi = (theta[place] / lo).powi(2);
        for &(place, lo, hi) in &self.masses {
            s_lo = s_lo.max(10_f64.powf(lo - theta[place]));
            s_hi = s_hi.min(10_f64.powf(hi - theta[place]));
        }
        let rate = self
            .velocities
            .iter()
            .map(|&(place, sd)| 0.5 * (theta[place] / sd).powi(2))
            .sum();
        (s_lo, s_hi, rate)
    }

    /// The places that move along the orbit.
    fn moved(&self) -> impl Iterator<Item = usize> {
        let velocities = self.velocities.iter().map(|v| v.0);
        let masses = self.masses.iter().map(|m| m.0);
        masses.chain(velocities).chain([self.age.0])
    }

    /// Moves physical parameters along the orbit by the factor `s`, in place.
    pub fn scale(&self, theta: &mut [f64], s: f64) {
        for &(place, ..) in &self.masses {
            theta[place] += s.log10();
        }
        for (place, _) in self.velocities {
            theta[place] *= s.sqrt();
        }
        theta[self.age.0] /= s.sqrt();
    }
}

/// The quantile of probability `u` of the density proportional to `exp(-rate s)` on `[lo, hi]`, for `rate >= 0`.
#[must_use]
pub fn truncated_exponential(u: f64, rate: f64, lo: f64, hi: f64) -> f64 {
    let width = hi - lo;
    let x = rate * width;
    // Below this the density is constant to rounding, and the formula is 0/0.
    if x < 1e-16 {
        return lo + u * width;
    }
    // -ln(1 - u (1 - e^-x)) / rate, without loss for small x.
    (lo - (u * (-x).exp_m1()).ln_1p() / rate).min(hi)
}

impl Orbit for MassVelocityAge {
    fn name(&self) -> &str {
        "mass-velocity-age"
    }

    /// Always uses one random number. If rounding puts a parameter onto its bound (probability 1e-15), the point is not
    /// moved.
    fn refresh(&self, z: &mut [f64], rng: &mut RandomStream) {
        let u = unit_open(rng);
        let mut theta = vec![0.0; z.len()];
        self.prior.theta_from_z(z, &mut theta);
        let (lo, hi, rate) = self.conditional(&theta);
        let s = truncated_exponential(u, rate, lo, hi);
        self.move_by(z, theta, s);
    }

    /// The parameters moved along the orbit until the host has one solar mass.
    fn invariants(&self, z: &[f64], out: &mut [f64]) {
        let mut theta = vec![0.0; z.len()];
        self.prior.theta_from_z(z, &mut theta);
        let (host, ..) = self.masses[0];
        let s = 10_f64.powf(-theta[host]);
        self.scale(&mut theta, s);
        out.copy_from_slice(z);
        for place in self.moved() {
            out[place] = theta[place];
        }
    }

    fn has_levels(&self) -> bool {
        true
    }

    /// Moves to the host mass of `to`.
    fn align(&self, z: &mut [f64], to: &[f64]) -> bool {
        let (place, ..) = self.masses[0];
        let level = self.prior.marginals()[place].theta_from_z(to[place]);
        let mut theta = vec![0.0; z.len()];
        self.prior.theta_from_z(z, &mut theta);
        let s = 10_f64.powf(level - theta[place]);
        let could = self.move_by(z, theta, s);
        if could {
            // Exactly, without the rounding of the factor.
            z[place] = to[place];
        }
        could
    }
}

impl MassVelocityAge {
    /// Moves `z`, whose physical parameters are `theta`, along the group orbit by the factor `s`, unless that crosses a bound.
    /// Returns whether it moved.
    fn move_by(&self, z: &mut [f64], mut theta: Vec<f64>, s: f64) -> bool {
        self.scale(&mut theta, s);
        let new: Vec<(usize, f64)> = self
            .moved()
            .map(|place| {
                (
                    place,
                    self.prior.marginals()[place].z_from_theta(theta[place]),
                )
            })
            .collect();
        let inside = new.iter().all(|(_, z)| z.is_finite());
        if inside {
            for (place, value) in new {
                z[place] = value;
            }
        }
        inside
    }
}

/// Turns the halo's axis by 180 degrees around the line of sight: `(dir_x, dir_y) -> -(dir_x, dir_y)`.
///
/// The projected flattening is the same for both axes; only the depth along the stream differs.
/// Its marginals are symmetric, so `z -> -z` for both and the Jacobian is 1.
#[derive(Clone, Debug)]
pub struct HalfTurn {
    places: [usize; 2],
}

impl HalfTurn {
    /// The move under a prior; `None` unless both components are free and symmetric around zero.
    #[must_use]
    pub fn new(prior: &StreamPrior) -> Option<Self> {
        let symmetric = |name: &str| prior.free_index(name).filter(|_| prior.is_even(name));
        Some(Self {
            places: [symmetric("dir_x")?, symmetric("dir_y")?],
        })
    }
}

impl Involution for HalfTurn {
    fn name(&self) -> &str {
        "half turn of the axis"
    }

    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        for place in self.places {
            z[place] = -z[place];
        }
        Some(0.0)
    }
}

/// Rotates the projected axis by 90 degrees and maps q to `q_min + q_max - q`, its reflection about the middle of the
/// range: in projection, a halo flattened along one direction resembles one elongated along the perpendicular direction.
///
/// A rotation by 90 degrees becomes its own inverse if its sense depends on the quadrant: anticlockwise from the first and
/// third, clockwise from the second and fourth. The length `r` of the shape vector goes to `r'` with
/// `F(r') = 1 - F(r)`. Both parts leave the prior `N(0, I)` of z unchanged (turns are isometries; F(r) is uniform,
/// and the vector's direction is kept), so `p(z) dz = p(z') dz'` and `ln J = (|z'|^2 - |z|^2) / 2`.
#[derive(Clone, Debug)]
pub struct QuarterTurnTwin {
    /// Places of the three components among the free parameters.
    places: [usize; 3],
    /// The marginal of the last component, a half-normal.
    depth: Marginal,
}

impl QuarterTurnTwin {
    /// The move under a prior; `None` unless the shape vector is free and has its default marginals.
    #[must_use]
    pub fn new(prior: &StreamPrior) -> Option<Self> {
        let standard = |name: &str, marginal: Marginal| {
            let place = prior.free_index(name)?;
            (prior.prior().marginals()[place] == marginal).then_some(place)
        };
        let normal = Marginal::Normal { mean: 0.0, sd: 1.0 };
        let depth = Marginal::HalfNormal { sd: 1.0 };
        Some(Self {
            places: [
                standard("dir_x", normal)?,
                standard("dir_y", normal)?,
                standard("dir_z", depth)?,
            ],
            depth,
        })
    }
}

impl Involution for QuarterTurnTwin {
    fn name(&self) -> &str {
        "quarter turn of the axis, with the twin of q"
    }

    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        let [i, j, k] = self.places;
        let before = [z[i], z[j], z[k]];
        let depth = self.depth.theta_from_z(before[2]);
        let r = before[0].hypot(before[1]).hypot(depth);
        let factor = length_quantile(length_sf(r), length_cdf(r)) / r;
        let sense = if (before[0] > 0.0) == (before[1] > 0.0) {
            factor
        } else {
            -factor
        };
        let after = [
            -sense * before[1],
            sense * before[0],
            self.depth.z_from_theta(factor * depth),
        ];
        if !after.iter().all(|a| a.is_finite()) {
            return None;
        }
        let norm2 = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        [z[i], z[j], z[k]] = after;
        Some(0.5 * (norm2(after) - norm2(before)))
    }
}
