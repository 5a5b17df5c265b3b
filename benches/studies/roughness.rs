//! Roughness of ln L along short lines, by setting.
//!
//! `cargo bench --bench roughness` prints a table: for draws of the posteriors of five gala tracks (`benches/draws.csv`, twelve
//! each), lines in six random directions of z, 0.05 to both sides (the prior is a unit normal in z), 41 points each. The roughness
//! is the rms of ln L about the best cubic on the line. Quantiles are over all lines; lines with a rejected point are counted, not
//! measured. `off` is ln L at the draws minus that of `fast`: the median, and half of the central 68 per cent range. Not a timing.
//! The recorded table is in benches/RESULTS.md.

mod draws;
mod lines;

use draws::{Draw, draws};
use lines::roughness;
use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, Profile, StreamTarget};
use oblate::likelihood::{Coverage, LikelihoodSettings};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::ModelSettings;
use oblate::track::BinEdges;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

const LINES: u64 = 6;

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
                (0..LINES).map(move |line| roughness(target.likelihood(), prior, &draw.theta, line))
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
