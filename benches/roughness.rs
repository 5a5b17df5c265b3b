//! How rough is ln L along a short line, by setting?
//!
//! `cargo bench --bench roughness` prints a table: for mocks that meet the paper's criteria, lines through the truth in six
//! random directions of z, .05 to both sides (the prior is a unit normal in z), 41 points each. The roughness is the rms of ln L
//! about the best cubic on the line: what a step of a sampler meets beside the posterior's own shape. Quantiles over all lines;
//! lines with a rejected point are counted, not measured. Not a timing.

use nalgebra::{DMatrix, DVector};
use oblate::config::{FitConfig, Profile};
use oblate::data::{Mock, MockSettings, mocks};
use oblate::likelihood::{LikelihoodSettings, StreamLikelihood};
use oblate::params::{DIM, PriorSettings, StreamPrior};
use oblate::run::target;
use oblate::spray::{Design, TableSettings};
use oblate::stream::ModelSettings;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use rayon::prelude::*;

const MOCKS: usize = 60;
const LINES: u64 = 6;
const POINTS: usize = 41;
const REACH: f64 = 0.05;

/// Rms about the best cubic of ln L on line number `line` through a mock's truth; None where a point is rejected.
fn roughness(
    likelihood: &StreamLikelihood,
    prior: &StreamPrior,
    mock: &Mock,
    line: u64,
) -> Option<f64> {
    let mut rng = stream(1, Domain::Prior, 0, line);
    let direction: [f64; DIM] = std::array::from_fn(|_| standard_normal(&mut rng));
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    let mut truth = [0.0; DIM];
    prior
        .prior()
        .z_from_theta(&mock.params.to_array(), &mut truth);
    let places: Vec<f64> = (0..POINTS)
        .map(|k| 2.0 * k as f64 / (POINTS - 1) as f64 - 1.0)
        .collect();
    let values: Option<Vec<f64>> = places
        .iter()
        .map(|place| {
            let z: [f64; DIM] =
                std::array::from_fn(|i| truth[i] + REACH * place * direction[i] / length);
            let mut theta = [0.0; DIM];
            prior.prior().theta_from_z(&z, &mut theta);
            Some(likelihood.ln_likelihood(&theta).ok()?.ln_likelihood)
        })
        .collect();
    let values = DVector::from_vec(values?);
    let powers = DMatrix::from_fn(POINTS, 4, |k, power| places[k].powf(power as f64));
    let cubic = powers.clone().svd(true, true).solve(&values, 1e-12).ok()?;
    Some((&values - powers * cubic).norm() / (POINTS as f64).sqrt())
}

fn main() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let drawn = mocks(&prior, &MockSettings::default(), MOCKS, 1).expect("mocks");
    let quiet = LikelihoodSettings {
        model_noise: false,
        ..LikelihoodSettings::default()
    };
    let with = |settings: ModelSettings, particles, design| ModelSettings {
        releases: TableSettings {
            particles,
            epochs: 0,
            design,
            ..settings.releases
        },
        ..settings
    };
    let fast = Profile::Fast.model();
    let paper = ModelSettings {
        orbit: fast.orbit,
        orbit_steps: fast.orbit_steps,
        ..Profile::Paper.model()
    };
    let soft = Profile::Fast.likelihood();
    let rows = [
        ("fast", fast, soft),
        (
            "fast, 400 steps per age",
            ModelSettings { steps: 400, ..fast },
            soft,
        ),
        (
            "1,024 Sobol particles",
            with(fast, 1_024, Design::Sobol),
            soft,
        ),
        ("10,000 random x 100", paper, soft),
        ("fast, no model noise", fast, quiet),
        ("10,000 random x 100, no model noise", paper, quiet),
        (
            "paper, penalty",
            Profile::Paper.model(),
            LikelihoodSettings {
                coverage: soft.coverage,
                ..Profile::Paper.likelihood()
            },
        ),
    ];
    println!("| setting | 25 % | median | 75 % | 95 % | rejected |\n|---|---|---|---|---|---|");
    for (name, settings, rules) in rows {
        let config = FitConfig {
            model: settings,
            likelihood: rules,
            ..FitConfig::default()
        };
        let lines: Vec<Option<f64>> = drawn
            .mocks
            .par_iter()
            .flat_map_iter(|mock| {
                let target = target(&mock.track, &config).expect("a mock's track is data");
                let prior = &prior;
                (0..LINES).map(move |line| roughness(target.likelihood(), prior, mock, line))
            })
            .collect();
        let mut rough: Vec<f64> = lines.iter().flatten().copied().collect();
        rough.sort_by(f64::total_cmp);
        let at = |percent: usize| rough[(rough.len() - 1) * percent / 100];
        println!(
            "| {name} | {:.2} | {:.2} | {:.2} | {:.1} | {} |",
            at(25),
            at(50),
            at(75),
            at(95),
            lines.len() - rough.len()
        );
    }
}
