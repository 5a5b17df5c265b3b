//! Reweighting of streams' posteriors against a direct fit of hyperparameters and all streams together.

use super::{MEASURED, UNIFORM, by_quadrature, family, target};
use oblate::population::{Family, Population, QPosterior, TruncatedGaussian};
use oblate_samplers::control::Silent;
use oblate_samplers::nested::{self, Kernel};
use oblate_samplers::normal::{cdf, quantile};
use oblate_samplers::rng::{Domain, stream, unit_open};
use oblate_samplers::{Control, Marginal, Outcome, Prior, Run, Target};

const STREAMS: usize = MEASURED.len();
const SUPPORT: (f64, f64) = (0.5, 1.5);

/// Hyperparameters and q of every stream, with the prior of the streams' own fits for each q. The likelihood is that of the measurements
/// times the population's density over this prior, whose density is 1.
struct Joint {
    prior: Prior,
    family: TruncatedGaussian,
}

impl Joint {
    fn new() -> Self {
        let family = family();
        let hyperparameters = family.hyperparameters().into_iter();
        let hyperparameters =
            hyperparameters.map(|(name, marginal)| (name.to_owned(), "", marginal));
        let (lo, hi) = SUPPORT;
        let streams = (0..STREAMS).map(|n| (format!("q_{n}"), "", Marginal::Uniform { lo, hi }));
        Self {
            prior: Prior::new(hyperparameters.chain(streams)).unwrap(),
            family,
        }
    }
}

impl Target for Joint {
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let ln_pdf = self.family.ln_pdf([theta[0], theta[1]]);
        let of_stream = |(q, (measured, error)): (&f64, &(f64, f64))| {
            -0.5 * ((q - measured) / error).powi(2) + ln_pdf(*q)
        };
        let streams = theta[2..].iter().zip(&MEASURED);
        Outcome::from_ln_likelihood(streams.map(of_stream).sum())
    }
}

/// Independent draws of a stream's posterior under the uniform prior, and ln of its evidence there.
fn own_fit(n: usize) -> (QPosterior, f64) {
    let (measured, error) = MEASURED[n];
    let (lo, hi) = SUPPORT;
    let [a, b] = [lo, hi].map(|end| cdf((end - measured) / error));
    let mut rng = stream(3, Domain::Test, 0, n as u64);
    let q = (0..4_000).map(|_| measured + error * quantile(a + (b - a) * unit_open(&mut rng)));
    let name = format!("stream {n}");
    let ln_z = ((b - a) * error).ln() + 0.5 * std::f64::consts::TAU.ln();
    (QPosterior::equal_weights(&name, q.collect(), UNIFORM), ln_z)
}

fn mean(run: &Run, column: usize) -> f64 {
    let values = run.draws.column(column).into_iter();
    values.zip(run.draws.weights()).map(|(x, w)| x * w).sum()
}

#[test]
fn reweighted_fits_are_the_joint_fit_of_all_streams() {
    let (streams, own_ln_z): (Vec<QPosterior>, Vec<f64>) = (0..STREAMS).map(own_fit).unzip();
    let reweighted = target(&streams);
    let (ln_z, hyper_mean, hyper_sd) = by_quadrature(&reweighted);
    let settings = nested::Settings {
        n_live: 500,
        kernel: Kernel::RandomSlice,
        steps: Some(16),
        ..nested::Settings::default()
    };
    let mut silent = Silent;
    let joint = nested::run(&Joint::new(), &settings, 5, &mut Control::new(&mut silent)).unwrap();
    // The evidence of the joint fit is that of the population times those of the streams' own fits. The sums over 4,000 draws each
    // have an error of some 0.02.
    let z = (joint.evidence.ln_z - ln_z - own_ln_z.iter().sum::<f64>()) / joint.evidence.error;
    assert!(z.abs() < 4.0, "{z}");
    assert!(joint.ess.quoted > 100.0, "{:?}", joint.ess);
    for k in 0..2 {
        let error = hyper_sd[k] / joint.ess.bulk[k].sqrt();
        let off = mean(&joint, k) - hyper_mean[k];
        assert!(off.abs() < 4.0 * error, "{k}: {off} +- {error}");
    }
    // Each stream's q given the population, which the joint fit has as a parameter.
    let population = nested::run(
        &reweighted,
        &nested::Settings {
            n_live: 500,
            ..nested::Settings::default()
        },
        6,
        &mut Control::new(&mut silent),
    )
    .unwrap();
    let given = reweighted.streams_given_population(&population.draws);
    for (n, stream) in given.iter().enumerate() {
        let own = joint.draws.column(2 + n);
        let weights = joint.draws.weights();
        let below: f64 = own
            .iter()
            .zip(&weights)
            .filter(|(q, _)| **q < stream.q_given_population.median)
            .map(|(_, w)| w)
            .sum();
        // The median of the one in the other: four errors of a probability of a half, of both runs.
        let error = 0.5 * (1.0 / joint.ess.bulk[2 + n] + 1.0 / population.ess.quoted).sqrt();
        assert!((below - 0.5).abs() < 4.0 * error, "{n}: {below} +- {error}");
    }
}
