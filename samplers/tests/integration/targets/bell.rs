//! A Gaussian likelihood of any precision about any centre.

use super::smooth;
use oblate_samplers::{Marginal, Outcome, Prior, Target};

/// `l = -p |z - c|^2 / 2` under a normal prior.
pub struct Bell {
    prior: Prior,
    precision: f64,
    centre: f64,
}

impl Bell {
    pub fn new(dim: usize, precision: f64, centre: f64) -> Self {
        let normals = smooth::normals(dim, 0.0).into_iter().enumerate();
        let named: Vec<(String, &str, Marginal)> =
            normals.map(|(i, m)| (format!("x{i}"), "", m)).collect();
        Self {
            prior: Prior::new(named).unwrap(),
            precision,
            centre,
        }
    }

    /// Exact: the datum has variance `1 + 1/p` a priori.
    pub fn ln_z(&self) -> f64 {
        let (p, c) = (self.precision, self.centre);
        -0.5 * self.dim() as f64 * ((1.0 + p).ln() + p * c * c / (1.0 + p))
    }
}

impl Target for Bell {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let square: f64 = theta.iter().map(|x| (x - self.centre).powi(2)).sum();
        Outcome::Value(-0.5 * self.precision * square)
    }
}
