//! Three coordinate systems for the same parameters, each with an exact inverse and Jacobian.

use oblate_samplers::{Prior, normal};

/// A coordinate system of the free parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinates {
    /// Physical parameters `theta`.
    Physical,
    /// The unit cube, `u` = cumulative prior probability.
    Cube,
    /// Standard normals, `z = Phi^-1(u)`: the prior is `N(0, I)`.
    Gaussian,
}

impl Coordinates {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Physical, Self::Cube, Self::Gaussian];

    /// Physical parameters at the point `x` of this system; one number per free parameter.
    #[must_use]
    pub fn to_theta(self, prior: &Prior, x: &[f64]) -> Vec<f64> {
        let mut theta = x.to_vec();
        match self {
            Self::Physical => {}
            Self::Cube => prior.theta_from_u(x, &mut theta),
            Self::Gaussian => prior.theta_from_z(x, &mut theta),
        }
        theta
    }

    /// The point of this system at physical parameters. In the cube the upper tail keeps only the digits of a number
    /// near 1.
    #[must_use]
    pub fn from_theta(self, prior: &Prior, theta: &[f64]) -> Vec<f64> {
        let mut x = theta.to_vec();
        match self {
            Self::Physical => {}
            Self::Cube => {
                for ((m, t), x) in prior.marginals().iter().zip(theta).zip(&mut x) {
                    *x = m.u_from_theta(*t);
                }
            }
            Self::Gaussian => prior.z_from_theta(theta, &mut x),
        }
        x
    }

    /// `d theta_i / d x_i` at physical parameters, per parameter: the Jacobian is diagonal. A gradient in `theta`
    /// times this is the gradient in this system.
    #[must_use]
    pub fn dtheta_dx(self, prior: &Prior, theta: &[f64]) -> Vec<f64> {
        let marginals = prior.marginals().iter().zip(theta);
        match self {
            Self::Physical => vec![1.0; theta.len()],
            // theta is the quantile function of u: its slope is one over the density.
            Self::Cube => marginals.map(|(m, t)| (-m.ln_pdf(*t)).exp()).collect(),
            Self::Gaussian => marginals
                .map(|(m, t)| (normal::ln_pdf(m.z_from_theta(*t)) - m.ln_pdf(*t)).exp())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{PriorSettings, StreamPrior};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn coordinates_invert_exactly_and_jacobians_match_central_differences(
            z in proptest::collection::vec(-4.0_f64..4.0, 13)
        ) {
            let stream = StreamPrior::new(&PriorSettings::default()).unwrap();
            let prior = stream.prior();
            let theta = Coordinates::Gaussian.to_theta(prior, &z);
            for system in Coordinates::ALL {
                let x = system.from_theta(prior, &theta);
                let back = system.to_theta(prior, &x);
                let slope = system.dtheta_dx(prior, &theta);
                for i in 0..13 {
                    // Half a unit in the last place of x, through the slope, and two of theta itself.
                    let grain = 1.2e-16 * x[i].abs() * slope[i] + 1e-15 * theta[i].abs().max(1.0);
                    prop_assert!((back[i] - theta[i]).abs() < 10.0 * grain, "{:?} {}", system, i);
                    // A step small against the distance to the cube's walls.
                    let room = if system == Coordinates::Cube { x[i].min(1.0 - x[i]) } else { 1.0 };
                    let h = 1e-4 * room;
                    let at = |dx: f64| {
                        let mut moved = x.clone();
                        moved[i] += dx;
                        system.to_theta(prior, &moved)[i]
                    };
                    let central = (at(h) - at(-h)) / (2.0 * h);
                    // Truncation of second order in the relative step; rounding of theta over the step.
                    let tolerance = 1e-6 * slope[i] + 10.0 * grain / h;
                    prop_assert!((central - slope[i]).abs() < tolerance, "{:?} {}: {} {}", system, i, central, slope[i]);
                }
            }
        }
    }
}
