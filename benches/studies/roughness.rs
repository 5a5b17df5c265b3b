//! Roughness of ln L along short lines, by setting.
//!
//! `cargo bench --bench roughness` prints a table: for draws of the posteriors of five gala tracks (`benches/draws.csv`, twelve
//! each), lines in six random directions of z, 0.05 to both sides (the prior is a unit normal in z), 41 points each. The roughness
//! is the rms of ln L about the best cubic on the line. Quantiles are over all lines; lines with a rejected point are counted, not
//! measured. `off` is ln L at the draws minus that of `fast`: the median, and half of the central 68 per cent range. Not a timing.
//! The recorded table is in benches/RESULTS.md.

mod draws;

use draws::{Draw, draws};
use nalgebra::{DMatrix, DVector};
use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, Profile, StreamTarget};
use oblate::likelihood::{Coverage, LikelihoodSettings, StreamLikelihood};
use oblate::params::{DIM, PriorSettings, StreamPrior};
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::ModelSettings;
use oblate::track::BinEdges;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

const LINES: u64 = 6;
const POINTS: usize = 41;
const REACH: f64 = 0.05;

/// Rms of ln L about its best cubic on line number `line` through a draw; `None` if a point is rejected.
fn roughness(
    likelihood: &StreamLikelihood,
    prior: &StreamPrior,
    draw: &Draw,
    line: u64,
) -> Option<f64> {
    let mut rng = stream(1, Domain::Prior, 0, line);
    let direction: [f64; DIM] = std::array::from_fn(|_| standard_normal(&mut rng));
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    let mut middle = [0.0; DIM];
    prior.prior().z_from_theta(&draw.theta, &mut middle);
    let places: Vec<f64> = (0..POINTS)
        .map(|k| 2.0 * k as f64 / (POINTS - 1) as f64 - 1.0)
        .collect();
    let values: Option<Vec<f64>> = places
        .iter()
        .map(|place| {
            let z: [f64; DIM] =
                std::array::from_fn(|i| middle[i] + REACH * place * direction[i] / length);
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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let draws = draws();
    let tracks: BTreeMap<&str, ObservedTrack> = draws
        .iter()
        .map(|draw| {
            let file = folder.join(format!("examples/tracks/{}.ecsv", draw.track));
            let track = ObservedTrack::read(&file).expect("a gala track");
            (draw.track.as_str(), track)
        })
        .collect();
    let quiet = LikelihoodSettings {
        model_noise: false,
        ..LikelihoodSettings::default()
    };
    let with = |settings: ModelSettings, particles, sampling_scheme| ModelSettings {
        releases: TableSettings {
            particles,
            release_times: 0,
            sampling_scheme,
            ..settings.releases
        },
        ..settings
    };
    let fast = Profile::Fast.model();
    let paper = ModelSettings {
        orbit: fast.orbit,
        orbit_steps: 192,
        ..Profile::Paper.model()
    };
    let soft = Profile::Fast.likelihood();
    let wide = LikelihoodSettings {
        edges: BinEdges::Soft {
            half_width_deg: 5.0,
        },
        ..soft
    };
    let harsh = LikelihoodSettings {
        coverage: Coverage::Penalty {
            z_miss: 30.0,
            lambda: 1_000.0,
        },
        ..soft
    };
    // The bins of all gala tracks are 10 degrees wide.
    let coarse = FitSettings::default().coarse(10.0).expect("a coarse model");
    let rows = [
        ("fast", fast, soft),
        ("fast, a missing bin 30 sigma", fast, harsh),
        ("fast, edges of 5 degrees", fast, wide),
        (
            "fast, step_phase 0.4",
            ModelSettings {
                step_phase: 0.4,
                ..fast
            },
            soft,
        ),
        (
            "fast, without neighbours",
            with(fast, fast.releases.particles, SamplingScheme::Sobol),
            soft,
        ),
        (
            "3,584 particles, no neighbours",
            with(fast, 3_584, SamplingScheme::Sobol),
            soft,
        ),
        (
            "1,024 particles, smeared",
            with(fast, 1_024, SamplingScheme::SobolSmeared),
            soft,
        ),
        (
            "1,024 particles, no neighbours",
            with(fast, 1_024, SamplingScheme::Sobol),
            soft,
        ),
        ("coarse model of a fit", coarse.model, coarse.likelihood),
        (
            "the same, without neighbours",
            with(coarse.model, 512, SamplingScheme::Sobol),
            coarse.likelihood,
        ),
        (
            "the same, edges of 2 degrees",
            coarse.model,
            LikelihoodSettings {
                edges: soft.edges,
                ..coarse.likelihood
            },
        ),
        (
            "512 particles, smeared",
            with(fast, 512, SamplingScheme::SobolSmeared),
            soft,
        ),
        (
            "512 particles, no neighbours",
            with(fast, 512, SamplingScheme::Sobol),
            soft,
        ),
        ("10,000 random x 100", paper, soft),
        ("10,000 random x 100, edges of 5 degrees", paper, wide),
        ("10,000 random x 100, a missing bin 30 sigma", paper, harsh),
        (
            "10,000 particles, no neighbours",
            with(fast, 10_000, SamplingScheme::Sobol),
            soft,
        ),
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
    // ln L at each draw.
    let values = |config: &FitSettings| -> Vec<Option<f64>> {
        let value = |draw: &Draw| {
            let target = StreamTarget::from_track(&tracks[draw.track.as_str()], config)
                .expect("a gala track is data");
            let evaluation = target.likelihood().ln_likelihood(&draw.theta).ok()?;
            Some(evaluation.ln_likelihood)
        };
        draws.par_iter().map(value).collect()
    };
    let of_fast = values(&FitSettings::default());
    println!(
        "| setting | 25 % | median | 75 % | 95 % | rejected | off, median | robust sd |\n|---|---|---|---|---|---|---|---|"
    );
    for (name, settings, rules) in rows {
        let config = FitSettings {
            model: settings,
            likelihood: rules,
            ..FitSettings::default()
        };
        let lines: Vec<Option<f64>> = draws
            .par_iter()
            .flat_map_iter(|draw| {
                let track = &tracks[draw.track.as_str()];
                let target =
                    StreamTarget::from_track(track, &config).expect("a gala track is data");
                let prior = &prior;
                (0..LINES).map(move |line| roughness(target.likelihood(), prior, draw, line))
            })
            .collect();
        let mut rough: Vec<f64> = lines.iter().flatten().copied().collect();
        rough.sort_by(f64::total_cmp);
        let at = |percent: usize| rough[(rough.len() - 1) * percent / 100];
        let pairs = values(&config).into_iter().zip(&of_fast);
        let mut off: Vec<f64> = pairs
            .filter_map(|(ours, fast)| Some(ours? - (*fast)?))
            .collect();
        off.sort_by(f64::total_cmp);
        println!(
            "| {name} | {:.2} | {:.2} | {:.2} | {:.1} | {} | {:.1} | {:.1} |",
            at(25),
            at(50),
            at(75),
            at(95),
            lines.len() - rough.len(),
            off[off.len() / 2],
            (off[off.len() * 84 / 100] - off[off.len() * 16 / 100]) / 2.0
        );
    }
}
