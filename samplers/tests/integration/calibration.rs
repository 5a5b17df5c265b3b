//! Simulation-based calibration (Talts et al. 2018; Modrak et al. 2023): parameters drawn from the prior, data simulated from
//! them, and the posterior sampled. The rank of the true parameter, and that of its ln L, among a few posterior draws is then
//! uniform.

use oblate_samplers::control::Silent;
use oblate_samplers::diagnostics::chi2_p_value;
use oblate_samplers::rng::{Domain, below, standard_normal, stream, unit_open};
use oblate_samplers::{Control, Marginal, Outcome, Prior, Run, Target, nested, pt};
use rayon::prelude::*;

/// Simulations.
const COUNT: u64 = 400;

/// Posterior draws that a truth is ranked among, and bins of the ranks 0 to 19.
const DRAWS: usize = 19;
const BINS: usize = 10;

/// Smallest probability of the ranks' chi-square. Twelve tests with fixed seeds, each of which fails by chance once in ten thousand.
const RARE: f64 = 1e-4;

/// Data about two parameters: the second with noise, and either the first or its magnitude, which leaves two modes.
struct Measured {
    prior: Prior,
    data: [f64; 2],
    two_modes: bool,
    /// Standard deviation of the noise by which the likelihood goes.
    noise: f64,
}

/// Standard deviation of the noise of the data.
const NOISE: f64 = 0.3;

impl Measured {
    /// A truth from the prior and data from it.
    fn simulated(two_modes: bool, noise: f64, number: u64) -> (Self, [f64; 2]) {
        let mut rng = stream(71, Domain::Test, number, u64::from(two_modes));
        // The prior's mean is not 0, so that two modes have unequal weights.
        let (mean, sd) = (0.4, 1.0);
        let prior = Prior::new([
            ("a", "", Marginal::Normal { mean, sd }),
            ("b", "", Marginal::Uniform { lo: 0.0, hi: 2.0 }),
        ]);
        let truth = [
            mean + sd * standard_normal(&mut rng),
            2.0 * unit_open(&mut rng),
        ];
        let mut target = Self {
            prior: prior.unwrap(),
            data: [0.0; 2],
            two_modes,
            noise,
        };
        let seen = target.seen(&truth);
        target.data = seen.map(|x| x + NOISE * standard_normal(&mut rng));
        (target, truth)
    }

    fn seen(&self, theta: &[f64]) -> [f64; 2] {
        let a = if self.two_modes {
            theta[0].abs()
        } else {
            theta[0]
        };
        [a, theta[1]]
    }

    fn deviations(&self, theta: &[f64]) -> [f64; 2] {
        let seen = self.seen(theta);
        [0, 1].map(|i| (self.data[i] - seen[i]) / self.noise)
    }
}

impl Target for Measured {
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let [a, b] = self.deviations(theta);
        Outcome::Value(-0.5 * (a * a + b * b))
    }

    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let [a, b] = self.deviations(theta);
        let sign = if self.two_modes {
            theta[0].signum()
        } else {
            1.0
        };
        gradient[0] = sign * a / self.noise;
        gradient[1] = b / self.noise;
        self.ln_likelihood(theta)
    }

    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
}

fn nested(target: &Measured, seed: u64) -> Run {
    let settings = nested::Settings {
        n_live: 100,
        // Ellipsoids around a hundred points do not follow two modes in opposite corners of the unit cube.
        kernel: nested::Kernel::Differential,
        steps: Some(10),
        simulations: 20,
        bootstraps: 20,
        ..nested::Settings::default()
    };
    nested::run(target, &settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

fn tempered(target: &Measured, seed: u64) -> Run {
    let settings = pt::Settings {
        chain_sets: 2,
        rounds: 7,
        temperatures: 5,
        min_temperatures: 5,
        max_temperatures: 5,
        ..pt::Settings::default()
    };
    pt::run(target, &settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

/// The probabilities of the ranks of both parameters and of ln L.
fn p_values(sample: fn(&Measured, u64) -> Run, two_modes: bool, noise: f64) -> [f64; 3] {
    let ranks: Vec<[usize; 3]> = (0..COUNT)
        .into_par_iter()
        .map(|number| {
            let (target, truth) = Measured::simulated(two_modes, noise, number);
            let draws = sample(&target, number + 1).draws;
            let rows = draws.resample(4_000, 0.5);
            let mut rng = stream(72, Domain::Test, number, 0);
            let Outcome::Value(ln_likelihood) = target.ln_likelihood(&truth) else {
                panic!("the truth has a likelihood");
            };
            let mut ranks = [0; 3];
            for _ in 0..DRAWS {
                let row = rows[below(&mut rng, rows.len())];
                let theta = draws.theta_row(row);
                ranks[0] += usize::from(theta[0] < truth[0]);
                ranks[1] += usize::from(theta[1] < truth[1]);
                ranks[2] += usize::from(draws.ln_likelihood[row] < ln_likelihood);
            }
            ranks
        })
        .collect();
    [0, 1, 2].map(|quantity| {
        let mut counts = [0.0; BINS];
        for ranks in &ranks {
            counts[ranks[quantity] * BINS / (DRAWS + 1)] += 1.0;
        }
        let expected = COUNT as f64 / BINS as f64;
        let chi2 = counts.map(|n: f64| (n - expected).powi(2) / expected);
        chi2_p_value(chi2.iter().sum(), BINS)
    })
}

#[test]
fn ranks_of_the_truth_among_nested_draws_are_uniform() {
    for two_modes in [false, true] {
        let p = p_values(nested, two_modes, NOISE);
        assert!(p.iter().all(|p| *p > RARE), "{two_modes} {p:?}");
    }
}

#[test]
fn ranks_of_the_truth_among_tempered_draws_are_uniform() {
    for two_modes in [false, true] {
        let p = p_values(tempered, two_modes, NOISE);
        assert!(p.iter().all(|p| *p > RARE), "{two_modes} {p:?}");
    }
}

/// A likelihood with half of the noise of the data has a posterior that is too narrow, and the ranks show it.
#[test]
fn ranks_under_a_wrong_likelihood_are_not_uniform() {
    for sample in [nested, tempered] {
        let p = p_values(sample, true, 0.5 * NOISE);
        assert!(p.iter().any(|p| *p < 1e-3 * RARE), "{p:?}");
    }
}
