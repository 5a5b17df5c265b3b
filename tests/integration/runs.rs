//! Runs with known answers: draws of a product of normals, in the form of results of each sampler.

use oblate::posterior::{Summary, SummaryContext, zarr};
use oblate_samplers::normal;
use oblate_samplers::output::{Check, Cost, Draws, Ess, Evidence, History, Method, Run, Status};
use oblate_samplers::rng::{Domain, standard_normal, stream, unit_open};
use std::collections::BTreeMap;
use std::path::Path;

/// (name, unit, mean, standard deviation) of each parameter: the thirteen of a stream, at plausible values.
pub const PARAMETERS: [(&str, &str, f64, f64); 13] = [
    ("log10_m_halo", "dex(Msun)", 12.1, 0.2),
    ("r_s_halo_kpc", "kpc", 16.0, 2.0),
    ("dir_x", "", 0.4, 0.3),
    ("dir_y", "", -0.2, 0.4),
    ("dir_z", "", 1.5, 0.2),
    ("log10_m_prog", "dex(Msun)", 8.0, 0.3),
    ("r_s_prog_kpc", "kpc", 2.5, 0.5),
    ("x0_kpc", "kpc", 59.0, 1.0),
    ("z0_kpc", "kpc", 53.0, 12.0),
    ("vx0_km_s", "km/s", -41.0, 20.0),
    ("vy0_km_s", "km/s", 156.0, 25.0),
    ("vz0_km_s", "km/s", -29.0, 40.0),
    ("age_gyr", "Gyr", 2.5, 0.4),
];

/// Draws of the product of [`PARAMETERS`] with q ~ N(0.8, 0.1) and axis as derived quantities.
fn draws(rows: usize, chains: u32, seed: u64) -> Draws {
    let mut draws = Draws {
        dim: PARAMETERS.len(),
        derived_dim: 2,
        ..Draws::default()
    };
    for row in 0..rows {
        let mut rng = stream(seed, Domain::Test, 1, row as u64);
        let mut ln_l = 0.0;
        for (_, _, mean, sd) in PARAMETERS {
            let z = standard_normal(&mut rng);
            draws.theta.push(mean + sd * z);
            ln_l += normal::ln_pdf(z);
        }
        draws.derived.push(0.8 + 0.1 * standard_normal(&mut rng));
        draws.derived.push(2.0 * unit_open(&mut rng) - 1.0);
        draws.ln_likelihood.push(ln_l);
        draws.ln_weight.push(-(rows as f64).ln());
        draws.chain.push(u32::try_from(row).unwrap() % chains);
        draws.cluster.push(u32::try_from(row).unwrap() % chains);
    }
    draws
}

/// The common part of all kinds of runs.
fn run(method: Method, draws: Draws, history: History, seed: u64) -> Run {
    let kish = oblate_samplers::diagnostics::kish_ess(&draws.ln_weight);
    Run {
        method,
        status: Status::Complete,
        seed,
        stream_version: oblate_samplers::rng::STREAM_VERSION,
        names: PARAMETERS.iter().map(|p| p.0.to_owned()).collect(),
        units: PARAMETERS.iter().map(|p| p.1.to_owned()).collect(),
        derived_names: vec![
            ("q".to_owned(), String::new()),
            ("axis_z".to_owned(), String::new()),
        ],
        draws,
        evidence: Evidence {
            ln_z: -31.25,
            error: 0.125,
            error_parts: BTreeMap::from([("information".to_owned(), 0.125)]),
            estimates: BTreeMap::from([("stepping_stone".to_owned(), f64::NAN)]),
            information: 18.5,
        },
        ess: Ess {
            kish,
            quoted: kish,
            ..Ess::default()
        },
        cost: Cost {
            calls: 123_456,
            gradients: 789,
            cpu_seconds: 61.5,
            wall_seconds: 33.25,
            rejected: BTreeMap::from([("bad_orbit".to_owned(), 12)]),
        },
        history,
        checks: vec![Check::at_least(
            "ess",
            kish,
            400.0,
            "enough draws to quote 95 % intervals",
        )],
        warnings: Vec::new(),
        surrogate: None,
    }
}

/// A nested run's shape: weights that rise and fall over the dead points.
pub fn nested(rows: usize, seed: u64) -> Run {
    let mut draws = draws(rows, 1, seed);
    let mut order: Vec<usize> = (0..rows).collect();
    order.sort_by(|a, b| draws.ln_likelihood[*a].total_cmp(&draws.ln_likelihood[*b]));
    let ln_likelihood: Vec<f64> = order.iter().map(|i| draws.ln_likelihood[*i]).collect();
    let live = 400_u32;
    let ln_x: Vec<f64> = (0..rows)
        .map(|i| -((i + 1) as f64) / f64::from(live))
        .collect();
    // Weights that do not depend on theta keep the known answer; they only make the rows unequal.
    let raw: Vec<f64> = (0..rows)
        .map(|i| unit_open(&mut stream(seed, Domain::Test, 2, i as u64)))
        .collect();
    let total: f64 = raw.iter().sum();
    draws.ln_weight = raw.iter().map(|w| (w / total).ln()).collect();
    let insertion_rank = (0..rows)
        .map(|i| unit_open(&mut stream(seed, Domain::Test, 3, i as u64)))
        .collect();
    let history = History::Nested {
        ln_x,
        ln_likelihood_birth: (0..rows)
            .map(|i| {
                if i < live as usize {
                    f64::NEG_INFINITY
                } else {
                    ln_likelihood[i - live as usize]
                }
            })
            .collect(),
        ln_likelihood,
        live: vec![live; rows],
        insertion_rank,
    };
    run(Method::Nested, draws, history, seed)
}

/// A tempered run: four chains of equal weight, eight temperatures.
pub fn tempered(rows: usize, seed: u64) -> Run {
    let draws = draws(rows, 4, seed);
    let count = 8;
    let beta: Vec<f64> = (0..count)
        .map(|k| (k as f64 / (count - 1) as f64).powi(4))
        .collect();
    let rejection: Vec<f64> = (1..count).map(|k| 0.3 + 0.05 * (k as f64).sin()).collect();
    let mut communication_barrier = vec![0.0];
    for r in &rejection {
        communication_barrier.push(communication_barrier[communication_barrier.len() - 1] + r);
    }
    let trace = (0..4)
        .map(|c| {
            (0..rows / 4)
                .map(|i| draws.ln_likelihood[4 * i + c])
                .collect()
        })
        .collect();
    let history = History::Tempered {
        mean_ln_likelihood: beta.iter().map(|b| -40.0 + 20.0 * b).collect(),
        variance_ln_likelihood: beta.iter().map(|b| 6.0 / (b + 0.1)).collect(),
        swap_rejection: rejection,
        acceptance: beta.iter().map(|b| 0.95 - 0.2 * b).collect(),
        step_size: beta.iter().map(|b| 0.8 - 0.5 * b).collect(),
        mean_leapfrogs: beta.iter().map(|b| 8.0 + 8.0 * b).collect(),
        divergences: vec![0; count],
        communication_barrier,
        round_trips: vec![31, 28, 35, 30],
        trace,
        beta,
    };
    run(Method::PtHmc, draws, history, seed)
}

/// A bridged run: equal weights, three steps.
pub fn bridged(rows: usize, seed: u64) -> Run {
    let history = History::Bridge {
        fraction: vec![0.3, 0.7, 1.0],
        ln_ratio: vec![1.0, 1.8, 2.1],
        ancestors: vec![600.0, 450.0, 400.0],
        correlation: vec![0.3, 0.25, 0.2],
    };
    run(Method::Bridge, draws(rows, 1, seed), history, seed)
}

/// Replaces the draws of a run folder, and what its summary says about them.
pub fn store(folder: &Path, run: &Run) {
    let (draws, summary) = (folder.join("posterior.zarr"), folder.join("summary.json"));
    let before = Summary::read(&summary).unwrap();
    std::fs::remove_dir_all(&draws).unwrap();
    zarr::write(&draws, run, zarr::Extras::default()).unwrap();
    let entries = zarr::entries(&draws).unwrap();
    let after = Summary {
        halo: before.halo,
        q_prior: before.q_prior,
        input_hash: before.input_hash,
        posterior: Some(zarr::Checksum::of(&draws, &entries).unwrap()),
        ..Summary::new(run, &SummaryContext::default())
    };
    std::fs::write(&summary, serde_json::to_vec(&after).unwrap()).unwrap();
}
