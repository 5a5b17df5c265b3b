//! Summaries of runs with known answers, and their files.

use crate::runs;
use oblate::data::ObservedTrack;
use oblate::params::QPrior;
use oblate::posterior::{
    Interval, Summary, SummaryContext, columns, compare, modes, run_from_parts, zarr,
};
use oblate_samplers::output::{Check, History, Run};

fn summary(run: &Run) -> Summary {
    Summary::new(
        run,
        &SummaryContext {
            q_prior: Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }),
            ..SummaryContext::default()
        },
    )
}

#[test]
fn quantiles_of_weighted_normals_are_those_of_the_normal() {
    let run = runs::nested(20_000, 11);
    let summary = summary(&run);
    // Error of a quantile at density f: sqrt(p (1 - p) / ESS) / f, largest here at 2.5 %: 0.0234 sd at ESS 15,000.
    let limit = 4.0 * 0.0234;
    for ((name, _, mean, sd), (got_name, got)) in runs::PARAMETERS.iter().zip(&summary.parameters) {
        assert_eq!(name, got_name);
        let normal = [
            (got.median, 0.0),
            (got.lo68, -0.994_457_9),
            (got.hi68, 0.994_457_9),
            (got.lo95, -1.959_964),
            (got.hi95, 1.959_964),
        ];
        for (value, z) in normal {
            assert!(
                ((value - mean) / sd - z).abs() < limit,
                "{name} at {z}: {value}"
            );
        }
    }
    assert_eq!(summary.q, summary.derived.first().map(|d| d.1.clone()));
}

#[test]
fn summary_has_the_keys_that_scripts_rely_on() {
    let run = runs::tempered(800, 3);
    let json = serde_json::to_value(summary(&run)).unwrap();
    assert_eq!(json["ln_z"]["value"], -31.25);
    assert_eq!(json["ln_z"]["error"], 0.125);
    assert!(json["ess"].is_number());
    for key in ["median", "lo68", "hi68", "lo95", "hi95"] {
        assert!(json["q"][key].is_number(), "q.{key}");
        assert!(
            json["parameters"]["age_gyr"][key].is_number(),
            "age_gyr.{key}"
        );
    }
    for key in ["calls", "gradients", "cpu_seconds", "wall_seconds"] {
        assert!(json["cost"][key].is_number(), "cost.{key}");
    }
    assert_eq!(json["converged"], true);
    for key in ["name", "value", "limit", "pass", "message"] {
        assert!(!json["checks"][0][key].is_null(), "checks[0].{key}");
    }
    assert_eq!(json["q_prior"]["kind"], "uniform");
    assert_eq!(json["q_prior"]["hi"], 1.5);
    let names: Vec<&str> = runs::PARAMETERS.iter().map(|p| p.0).collect();
    let text = serde_json::to_string(&summary(&run)).unwrap();
    let places: Vec<usize> = names
        .iter()
        .map(|n| text.find(&format!("\"{n}\":")).unwrap())
        .collect();
    assert!(
        places.windows(2).all(|w| w[0] < w[1]),
        "parameters keep their order"
    );
}

#[test]
fn a_failed_gate_keeps_its_infinite_value_and_leads_the_verdict() {
    let mut run = runs::nested(500, 5);
    run.checks
        .push(Check::at_most("r_hat", f64::INFINITY, 1.01, "run longer"));
    let before = summary(&run);
    assert!(!before.converged);
    assert!(before.verdict().starts_with("NOT CONVERGED"));
    assert!(before.verdict().contains("r_hat"));
    let text = serde_json::to_string(&before).unwrap();
    let after: Summary = serde_json::from_str(&text).unwrap();
    assert_eq!(after.checks, before.checks);
    assert!(after.ln_z_estimates["stepping_stone"].is_nan());
}

#[test]
fn mode_weights_add_up_and_match_the_cells_probabilities() {
    for run in [runs::nested(20_000, 7), runs::tempered(20_000, 7)] {
        let weights = modes::mode_weights(&run).unwrap();
        let total: f64 = weights.iter().map(|w| w.probability.weight).sum();
        assert!((total - 1.0).abs() < 1e-9);
        for cell in &weights {
            let side = |positive: bool, z: f64| {
                let p = oblate_samplers::normal::cdf(z);
                if positive { p } else { 1.0 - p }
            };
            let truth = side(cell.mode.dir_x_positive, 0.4 / 0.3)
                * side(cell.mode.dir_y_positive, -0.2 / 0.4)
                * side(cell.mode.prolate, -0.2 / 0.1);
            // The error comes from four chains at worst: t with 3 degrees of freedom passes 12 once in 1,600, and a
            // binomial floor keeps chance agreement between chains from tightening it. Independent draws: ESS > 15,000.
            let floor = (truth * (1.0 - truth) / 15_000.0).sqrt();
            let limit = 4.0 * floor.max(cell.probability.error);
            assert!(
                (cell.probability.weight - truth).abs() < limit,
                "{cell:?} {truth}"
            );
            assert!(
                cell.probability.error < 12.0 * floor + 1e-12,
                "{cell:?} {floor}"
            );
        }
    }
}

#[test]
fn a_comparison_holds_distances_against_chance_and_sums_the_prolate_side() {
    let (a, b) = (runs::nested(20_000, 7), runs::tempered(20_000, 8));
    let c = compare("a", &a, "b", &b).unwrap();
    for row in &c.marginals {
        // A distance is nearly Gaussian in few numbers: five times its mean is far outside of chance.
        assert!(row.wasserstein < 5.0 * row.wasserstein_expected, "{row:?}");
        assert!(row.wasserstein_expected < 0.1, "{row:?}");
    }
    for row in &c.modes {
        // Of the tempered run's four chains, so with a few degrees of freedom.
        let error = row.error[0].hypot(row.error[1]);
        let by_error = (row.weight[0] - row.weight[1]) / error.max(0.01);
        assert!(
            row.sigma.abs() < 4.0 && row.sigma.abs() <= by_error.abs() + 1e-12,
            "{row:?}"
        );
        assert!(row.sigma * by_error >= 0.0, "{row:?}");
    }
    let prolate = c.modes.last().unwrap();
    assert_eq!(prolate.name, "prolate");
    for run in 0..2 {
        let cells = c.modes.iter().filter(|m| m.name.ends_with(" prolate"));
        let sum: f64 = cells.map(|m| m.weight[run]).sum();
        assert!((sum - prolate.weight[run]).abs() < 1e-9, "{prolate:?}");
        let rate = c.cost[run].q_ess_per_cpu_second.unwrap();
        let draws = rate * c.cost[run].cpu_seconds;
        assert!(draws > 10_000.0 && draws < 40_000.0, "{draws}");
    }
    // The same draws, moved.
    let mut moved = a.clone();
    for row in moved.draws.theta.chunks_exact_mut(a.draws.dim) {
        row[0] += 1.0;
    }
    let c = compare("a", &a, "moved", &moved).unwrap();
    let row = &c.marginals[0];
    assert!((row.wasserstein - row.shift.abs()).abs() < 1e-6, "{row:?}");
    assert!(row.wasserstein > 5.0 * row.wasserstein_expected, "{row:?}");
}

/// NaN is equal to itself here: the estimate that a run could not make must come back as one.
fn same(a: &Run, b: &Run) -> bool {
    a.bits() == b.bits()
}

#[test]
fn a_run_comes_back_from_its_files_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let track =
        ObservedTrack::new("toy", &[5.0, 15.0, 25.0], 10.0, &[60.0, 61.0, 62.0], None).unwrap();
    for (name, run) in [
        ("n", runs::nested(900, 1)),
        ("t", runs::tempered(400, 2)),
        ("r", runs::refined(400, 4)),
    ] {
        // What tests/peers/read_back.py opens.
        if let Ok(kept) = std::env::var("OBLATE_FIGURES") {
            let kept = std::path::Path::new(&kept);
            std::fs::create_dir_all(kept).unwrap();
            let beside = zarr::Extras {
                track: Some(&track),
                prior: Some(&run.draws),
            };
            let path = kept.join(format!("{name}.zarr"));
            let _ = std::fs::remove_dir_all(&path);
            zarr::write(&path, &run, beside).unwrap();
            track.write(&kept.join("track.ecsv")).unwrap();
        }
        let path = folder.path().join(name);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        let text = serde_json::to_string(&summary(&run)).unwrap();
        let back = run_from_parts(
            &serde_json::from_str(&text).unwrap(),
            zarr::read(&path).unwrap(),
        )
        .unwrap();
        assert!(same(&back, &run));
        assert_eq!(back.cost, run.cost);
    }
}

#[test]
fn draws_are_written_to_a_new_folder_and_their_arrays_into_their_groups() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    let run = runs::nested(100, 1);
    let refused = |run: &Run| {
        let error = zarr::write(&path, run, zarr::Extras::default()).unwrap_err();
        error.to_string()
    };
    for name in ["../../escaped", "/escaped", "..", "", "chain", "q", "dir_x"] {
        let mut named = run.clone();
        named.names[0] = name.to_owned();
        let words = refused(&named);
        assert!(words.contains("the name of an array"), "{words}");
        assert!(!path.exists());
    }
    zarr::write(&path, &run, zarr::Extras::default()).unwrap();
    assert!(refused(&run).contains("exists already"));
    assert_eq!(zarr::read(&path).unwrap().draws, run.draws);
}

#[test]
fn every_file_that_is_written_is_known_as_our_own_and_in_the_checksum() {
    let folder = tempfile::tempdir().unwrap();
    let track =
        ObservedTrack::new("toy", &[5.0, 15.0, 25.0], 10.0, &[60.0, 61.0, 62.0], None).unwrap();
    for (name, run) in [
        ("n", runs::nested(90, 1)),
        ("t", runs::tempered(40, 2)),
        ("r", runs::refined(40, 4)),
    ] {
        let path = folder.path().join(name);
        let beside = zarr::Extras {
            track: Some(&track),
            prior: Some(&run.draws),
        };
        zarr::write(&path, &run, beside).unwrap();
        let entries = zarr::entries(&path).unwrap();
        assert_eq!(entries.foreign, Vec::<std::path::PathBuf>::new());
        let checksum = zarr::Checksum::of(&path, &entries).unwrap();
        assert!(checksum.agrees(&path, &entries).unwrap());
        let mut bytes = 0;
        for file in &entries.files {
            let file = path.join(file);
            let content = std::fs::read(&file).unwrap();
            bytes += content.len() as u64;
            // Every one of them counts, by its content and by its name.
            let mut damaged = content.clone();
            damaged[content.len() / 2] ^= 1;
            std::fs::write(&file, damaged).unwrap();
            assert!(!checksum.agrees(&path, &entries).unwrap(), "{file:?}");
            std::fs::write(&file, content).unwrap();
        }
        assert_eq!(checksum.bytes, bytes);
        std::fs::remove_file(path.join("weighted/zarr.json")).unwrap();
        let fewer = zarr::entries(&path).unwrap();
        assert!(!checksum.agrees(&path, &fewer).unwrap());
    }
}

#[test]
fn an_empty_and_ragged_trace_comes_back() {
    let mut run = runs::tempered(40, 2);
    if let History::Tempered { trace, .. } = &mut run.history {
        *trace = vec![vec![], vec![1.0, -2.0], vec![3.5]];
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    zarr::write(&path, &run, zarr::Extras::default()).unwrap();
    assert_eq!(zarr::read(&path).unwrap().history, run.history);
}

#[test]
fn parts_of_different_runs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    zarr::write(&path, &runs::nested(100, 1), zarr::Extras::default()).unwrap();
    let other = summary(&runs::nested(100, 2));
    let words = run_from_parts(&other, zarr::read(&path).unwrap())
        .unwrap_err()
        .to_string();
    assert!(
        words.contains("different runs") && words.contains("restore"),
        "{words}"
    );
}

#[test]
fn an_array_that_is_damaged_or_not_ours_is_refused_by_name_and_cause() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    let metadata = path.join("weighted/theta/zarr.json");
    let chunk = path.join("weighted/theta/c/0/0");
    let replace = |from: &str, to: &str| {
        let text = std::fs::read_to_string(&metadata).unwrap();
        assert!(text.contains(from), "{from} in {text}");
        std::fs::write(&metadata, text.replace(from, to)).unwrap();
    };
    let damages: [(&dyn Fn(), &str); 9] = [
        (
            &|| std::fs::remove_file(&chunk).unwrap(),
            "chunk is missing",
        ),
        (&|| std::fs::write(&chunk, [0; 8]).unwrap(), "has 8 bytes"),
        (&|| replace("float64", "float32"), "data_type"),
        (&|| replace("little", "big"), "codecs"),
        (&|| replace("\"bytes\"", "\"zstd\""), "codecs"),
        (&|| replace("\"regular\"", "\"rectangular\""), "chunk_grid"),
        (&|| replace("\"default\"", "\"v2\""), "chunk_key_encoding"),
        (&|| replace("100", "1000000000000"), "has"),
        (
            &|| std::fs::write(&metadata, [0xff; 100]).unwrap(),
            "zarr.json cannot be read",
        ),
    ];
    for (damage, cause) in damages {
        let run = runs::nested(100, 1);
        let _ = std::fs::remove_dir_all(&path);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        damage();
        let message = zarr::read(&path).unwrap_err().to_string();
        assert!(
            message.contains("weighted/theta") && message.contains(cause),
            "{cause}: {message}"
        );
    }
}

#[test]
fn a_damaged_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    zarr::write(&path, &runs::nested(100, 1), zarr::Extras::default()).unwrap();
    std::fs::remove_dir_all(path.join("weighted/theta")).unwrap();
    let words = zarr::read(&path).unwrap_err().to_string();
    assert!(
        words.contains("p.zarr") && words.contains("weighted/theta"),
        "{words}"
    );
}

#[test]
fn intervals_of_columns_are_named_with_units() {
    let run = runs::nested(300, 4);
    let all = columns(&run);
    assert_eq!(all.len(), 15);
    assert_eq!((all[13].name.as_str(), all[1].unit.as_str()), ("q", "kpc"));
    let interval = Interval::new(&all[1].values, &run.draws.weights(), &all[1].unit);
    assert!(interval.lo95 < interval.lo68 && interval.lo68 < interval.median);
    assert_eq!(interval.unit, "kpc");
}
