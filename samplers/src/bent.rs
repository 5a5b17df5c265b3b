//! For tests of moves: a target with a bent posterior, a surrogate that is wrong about it, and the comparison of a chain with the exact means.

use crate::rng::{Domain, standard_normal, stream};
use crate::surrogate::{Examples, Surrogate};
use crate::target::{Involution, Marginal, Outcome, Prior, Symmetry, Target};

/// `ln L = -(z0 - 1)^2 / 2 - 2 (z1 - z0^2 / 4)^2` over standard normals, with an involution that changes it.
pub struct Bent {
    prior: Prior,
    symmetries: [Symmetry; 1],
}

/// Changes the sign of the first coordinate.
struct Mirror;

impl Involution for Mirror {
    fn name(&self) -> &'static str {
        "mirror"
    }
    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        z[0] = -z[0];
        Some(0.0)
    }
}

impl Bent {
    pub fn new() -> Self {
        let unit = Marginal::Normal { mean: 0.0, sd: 1.0 };
        Self {
            prior: Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap(),
            symmetries: [Symmetry::Involution(Box::new(Mirror))],
        }
    }
}

impl Target for Bent {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        Outcome::Value(ln_likelihood(theta))
    }
}

/// ln L, where parameters and standard-normal coordinates are the same.
pub fn ln_likelihood(z: &[f64]) -> f64 {
    -0.5 * (z[0] - 1.0).powi(2) - 2.0 * (z[1] - 0.25 * z[0] * z[0]).powi(2)
}

/// A surrogate whose likelihood lies elsewhere and is wider.
pub fn wrong_surrogate() -> Surrogate {
    let mut rng = stream(1, Domain::Test, 0, 0);
    let mut examples = Examples::default();
    for _ in 0..4_000 {
        let z = [0; 2].map(|_| 1.5 * standard_normal(&mut rng));
        let wrong = -0.3 * (z[0] - 0.6).powi(2) - 0.5 * (z[1] - 0.2).powi(2);
        examples.push(&z, wrong, &[]);
    }
    Surrogate::fit(&examples, None, &mut rng).unwrap()
}

/// Sums of z0, z1 and z0^2 over batches of states of a chain, whose scatter gives the error of each mean.
pub struct Batches {
    length: usize,
    sums: Vec<[f64; 3]>,
    states: usize,
}

impl Batches {
    /// Of so many states each.
    pub fn new(length: usize) -> Self {
        Self {
            length,
            sums: Vec::new(),
            states: 0,
        }
    }

    pub fn push(&mut self, z: &[f64]) {
        if self.states.is_multiple_of(self.length) {
            self.sums.push([0.0; 3]);
        }
        self.states += 1;
        let last = self.sums.last_mut().unwrap();
        for (sum, x) in last.iter_mut().zip(moments(z)) {
            *sum += x / self.length as f64;
        }
    }

    /// Asserts that the means are those of `N(z; 0, I) L^beta`, and that their errors are at most `most`.
    pub fn assert_exact(&self, beta: f64, most: f64) {
        let (count, exact) = (self.sums.len() as f64, exact_means(beta));
        for k in 0..3 {
            let mean = self.sums.iter().map(|b| b[k]).sum::<f64>() / count;
            let squares = self.sums.iter().map(|b| (b[k] - mean).powi(2)).sum::<f64>();
            let error = (squares / (count - 1.0) / count).sqrt();
            assert!(
                (mean - exact[k]).abs() < 4.0 * error && error < most,
                "{k}: {mean} +- {error}, {}",
                exact[k]
            );
        }
    }
}

fn moments(z: &[f64]) -> [f64; 3] {
    [z[0], z[1], z[0] * z[0]]
}

/// Means by summation over a grid.
fn exact_means(beta: f64) -> [f64; 3] {
    let (mut total, mut sums) = (0.0, [0.0; 3]);
    for i in -160..=160 {
        for j in -160..=160 {
            let z = [i, j].map(|place| f64::from(place) / 32.0);
            let weight = (beta * ln_likelihood(&z) - 0.5 * (z[0] * z[0] + z[1] * z[1])).exp();
            total += weight;
            for (sum, x) in sums.iter_mut().zip(moments(&z)) {
                *sum += weight * x;
            }
        }
    }
    sums.map(|sum| sum / total)
}
