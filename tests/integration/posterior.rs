//! Summaries of runs with known answers, and their files.

mod compare;

use crate::runs;
use oblate::data::ObservedTrack;
use oblate::params::QPrior;
use oblate::posterior::{Interval, Summary, SummaryContext, assemble_run, columns, modes, zarr};
use oblate_samplers::output::{Check, ESS_BULK, History, Run};
use oblate_samplers::{Marginal, Prior};
use std::f64::consts::PI;
use std::path::Path;

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
fn a_model_that_is_not_accurate_enough_is_told_apart_from_a_run_that_has_not_converged() {
    let check = |value| Check::at_most("steps-q", value, 0.5, "decrease `model.step_phase`");
    let summary = |checks: &[Check]| {
        let context = SummaryContext {
            model_checks: checks.to_vec(),
            ..SummaryContext::default()
        };
        Summary::new(&runs::nested(2_000, 11), &context)
    };
    let good = summary(&[check(0.1)]);
    assert!(
        good.to_string()
            .contains("\nModel accurate enough: all 1 checks passed.\n")
    );
    let bad = summary(&[check(0.1), check(0.7)]);
    assert_eq!(bad.converged, good.converged);
    assert!(bad.to_string().contains(
        "\nMODEL NOT ACCURATE ENOUGH: 1 of 2 checks failed (steps-q).\n    steps-q = 0.7, limit 0.5: decrease `model.step_phase`\n"
    ));
    assert_eq!(summary(&[]).model_verdict(), None);
}

#[test]
fn a_summary_says_why_checks_failed_and_which_posteriors_are_only_priors() {
    let mut run = runs::nested(2_000, 11);
    run.checks
        .push(Check::at_least("p-value", 1.5e-4, 0.01, "raise `n_live`"));
    run.checks
        .push(Check::at_most("close", 3.004, 3.0, "add scans"));
    let context = SummaryContext {
        warnings: vec!["the density is negative: raise `prior.q_min`".to_owned()],
        marginal_information: vec![("age_gyr".to_owned(), 0.05), ("q".to_owned(), 0.2)],
        ..SummaryContext::default()
    };
    let summary = Summary::new(&run, &context);
    let text = summary.to_string();
    for line in [
        "\n    p-value = 1.5e-4, limit 0.01: raise `n_live`\n",
        "\n    close = 3.004, limit 3: add scans\n",
        "\nWarning: the density is negative: raise `prior.q_min`.\n",
        "\nNOT MEASURED: the posterior of age_gyr equals its prior (less than 0.1 nat",
        "quantity     median   68 % interval          95 % interval          unit\n",
    ] {
        assert!(text.contains(line), "{line} is not in {text}");
    }
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["marginal_information"]["q"], 0.2);
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
fn a_failed_check_keeps_its_infinite_value_and_leads_the_verdict() {
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
fn a_verdict_names_a_limit_of_effective_draws_that_was_lowered() {
    for (limit, is_said) in [(400.0, false), (50.0, true)] {
        let mut run = runs::nested(500, 5);
        run.checks = vec![Check::at_least(ESS_BULK, 450.0, limit, "run longer")];
        let verdict = summary(&run).verdict();
        assert!(verdict.starts_with("Converged: all 1 checks passed"));
        assert_eq!(
            verdict.contains("50 effective draws only"),
            is_said,
            "{verdict}"
        );
    }
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

/// NaN is equal to itself here: the estimate that a run could not make must come back as one.
fn same(a: &Run, b: &Run) -> bool {
    a.bits() == b.bits()
}

#[test]
fn a_run_comes_back_from_its_files_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let track = ObservedTrack::new(
        "toy",
        &[5.0, 15.0, 25.0],
        10.0,
        &[60.0, 61.0, 62.0],
        &[1.2, 1.22, 1.24],
    )
    .unwrap();
    for (name, run) in [
        ("n", runs::nested(900, 1)),
        ("t", runs::tempered(400, 2)),
        ("r", runs::bridged(400, 4)),
    ] {
        // What tests/peers/read_back.py opens.
        if let Ok(kept) = std::env::var("OBLATE_FIGURES") {
            let kept = std::path::Path::new(&kept);
            std::fs::create_dir_all(kept).unwrap();
            let extras = zarr::Extras {
                track: Some(&track),
                prior: Some(&run.draws),
                ..zarr::Extras::default()
            };
            let path = kept.join(format!("{name}.zarr"));
            let _ = std::fs::remove_dir_all(&path);
            zarr::write(&path, &run, extras).unwrap();
            track.write(&kept.join("track.ecsv")).unwrap();
        }
        let path = folder.path().join(name);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        let text = serde_json::to_string(&summary(&run)).unwrap();
        let back = assemble_run(
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
fn the_density_of_the_posterior_stands_beside_its_draws_where_the_prior_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let run = runs::tempered(40, 2);
    let marginal = Marginal::Normal { mean: 1.0, sd: 2.0 };
    let prior = Prior::new(run.names.iter().map(|name| (name, "", marginal))).unwrap();
    let numbers = |path: &Path| -> Vec<f64> {
        let bytes = std::fs::read(path).unwrap();
        let number = |b: &[u8]| f64::from_le_bytes(b.try_into().unwrap());
        bytes.chunks_exact(8).map(number).collect()
    };
    for (name, density) in [("with", Some(&prior)), ("without", None)] {
        let path = folder.path().join(name);
        let extras = zarr::Extras {
            density,
            ..zarr::Extras::default()
        };
        zarr::write(&path, &run, extras).unwrap();
        let lp = path.join("sample_stats/lp");
        assert_eq!(lp.exists(), density.is_some());
        if density.is_none() {
            continue;
        }
        let rows = zarr::equal_weight_rows(&run).concat();
        let expected = rows.into_iter().map(|row| {
            let theta = run.draws.theta_row(row).iter();
            let ln_normal = |t: &f64| -0.125 * (t - 1.0).powi(2) - (8.0 * PI).sqrt().ln();
            run.draws.ln_likelihood[row] + theta.map(ln_normal).sum::<f64>()
        });
        let written = numbers(&lp.join("c/0/0"));
        assert_eq!(written.len(), run.draws.len());
        for (lp, expected) in written.iter().zip(expected) {
            assert!((lp - expected).abs() < 1e-12 * expected.abs());
        }
    }
}

#[test]
fn every_file_that_is_written_is_known_as_our_own_and_in_the_checksum() {
    let folder = tempfile::tempdir().unwrap();
    let track = ObservedTrack::new(
        "toy",
        &[5.0, 15.0, 25.0],
        10.0,
        &[60.0, 61.0, 62.0],
        &[1.2, 1.22, 1.24],
    )
    .unwrap();
    for (name, run) in [
        ("n", runs::nested(90, 1)),
        ("t", runs::tempered(40, 2)),
        ("r", runs::bridged(40, 4)),
    ] {
        let path = folder.path().join(name);
        let extras = zarr::Extras {
            track: Some(&track),
            prior: Some(&run.draws),
            ..zarr::Extras::default()
        };
        zarr::write(&path, &run, extras).unwrap();
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
    let words = assemble_run(&other, zarr::read(&path).unwrap())
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
        (&|| replace("100", "1000000000000"), "shape"),
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

/// What is wrong with a run that is put together from a summary and from stored arrays.
fn fault_of_parts(summary: &Summary, run: &Run) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    zarr::write(&path, run, zarr::Extras::default()).unwrap();
    let error = zarr::read(&path).and_then(|stored| assemble_run(summary, stored));
    error.unwrap_err().to_string()
}

#[test]
fn numbers_that_no_run_has_are_refused_by_array_and_place() {
    let damages: [(&dyn Fn(&mut Run), &str); 12] = [
        (
            &|r| r.draws.theta[5] = f64::NAN,
            "`theta` is NaN in place 5",
        ),
        (
            &|r| r.draws.derived[3] = f64::INFINITY,
            "`derived` is inf in place 3",
        ),
        (
            &|r| r.draws.ln_likelihood[2] = f64::NAN,
            "`ln_likelihood` is NaN",
        ),
        (&|r| r.draws.ln_weight[4] = f64::NAN, "`ln_weight` is NaN"),
        (&|r| r.draws.ln_weight[4] = 1.0, "`ln_weight` is 1"),
        (&|r| r.draws.ln_weight.fill(-30.0), "weights add up to"),
        (
            &|r| r.draws.chain[7] = u32::MAX,
            "`chain` is 4294967295 in place 7",
        ),
        (
            &|r| r.draws.cluster[7] = u32::MAX,
            "`cluster` is 4294967295",
        ),
        (&|r| r.seed += 1, "different runs"),
        (
            &|r| history(r, |ln_x, _, _| ln_x[0] = f64::NAN),
            "`ln_x` is NaN",
        ),
        (
            &|r| history(r, |_, birth, _| birth[9] = 1e9),
            "`ln_likelihood_birth` is 1000000000 in place 9",
        ),
        (
            &|r| history(r, |_, _, rank| rank[0] = 1.5),
            "`insertion_rank` is 1.5",
        ),
    ];
    let sound = runs::nested(100, 1);
    for (damage, expected) in damages {
        let mut run = sound.clone();
        damage(&mut run);
        let found = fault_of_parts(&summary(&sound), &run);
        assert!(
            found.contains(expected) && found.contains("restore"),
            "{expected}: {found}"
        );
    }
}

/// Changes volumes, births and ranks of a nested run.
fn history(run: &mut Run, change: impl Fn(&mut Vec<f64>, &mut Vec<f64>, &mut Vec<f64>)) {
    if let History::Nested {
        ln_x,
        ln_likelihood_birth,
        insertion_rank,
        ..
    } = &mut run.history
    {
        change(ln_x, ln_likelihood_birth, insertion_rank);
    }
}

#[test]
fn a_summary_of_other_arrays_is_refused() {
    let run = runs::nested(100, 1);
    let damages: [(&dyn Fn(&mut Summary), &str); 5] = [
        (
            &|s| s.ess_bulk = vec![1.0; 3],
            "`ess_bulk` has 3 values where 13 are needed",
        ),
        (&|s| s.r_hat = vec![1.0; 14], "`r_hat` has 14"),
        (
            &|s| s.method = oblate_samplers::output::Method::PtHmc,
            "history",
        ),
        (&|s| drop(s.derived.pop()), "different runs"),
        (&|s| s.ess = f64::NAN, "`ess` is NaN"),
    ];
    for (damage, expected) in damages {
        let mut summary = summary(&run);
        damage(&mut summary);
        let found = fault_of_parts(&summary, &run);
        assert!(found.contains(expected), "{expected}: {found}");
    }
}

#[test]
fn arrays_of_other_shapes_are_refused_before_memory_is_taken_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    // Array, its shape, another shape, and the bytes that a chunk of that shape has; the file itself takes no space.
    for (array, from, to, bytes) in [
        ("chain", "[100]", "[99]", 4 * 99),
        ("ln_weight", "[100]", "[101]", 8 * 101),
        ("cluster", "[100]", "[100,1]", 4 * 100),
        ("theta", "[100,13]", "[13,100]", 8 * 1300),
        ("derived", "[100,2]", "[100,3]", 8 * 300),
        ("chain", "[100]", "[1000000000000]", 4_000_000_000_000),
        ("ln_likelihood", "[100]", "[1000000000]", 8_000_000_000),
    ] {
        let run = runs::nested(100, 1);
        let _ = std::fs::remove_dir_all(&path);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        let array = path.join("weighted").join(array);
        let metadata = array.join("zarr.json");
        let mut json: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&metadata).unwrap()).unwrap();
        assert_eq!(json["shape"].to_string(), from);
        json["shape"] = serde_json::from_str(to).unwrap();
        json["chunk_grid"]["configuration"]["chunk_shape"] = json["shape"].clone();
        std::fs::write(&metadata, json.to_string()).unwrap();
        let chunk = match from.matches(',').count() {
            0 => array.join("c/0"),
            _ => array.join("c/0/0"),
        };
        let file = std::fs::File::options().write(true).open(&chunk).unwrap();
        if file.set_len(bytes).is_err() {
            continue;
        }
        let mut words = String::new();
        let memory = allocation_counter::measure(|| {
            words = zarr::read(&path).unwrap_err().to_string();
        });
        assert!(
            words.contains("its shape is") || words.contains("longer than"),
            "{words}"
        );
        assert!(
            memory.bytes_max < 1 << 20,
            "{} bytes: {words}",
            memory.bytes_max
        );
    }
}

#[test]
fn a_chunk_that_is_missing_is_an_error_in_every_array() {
    let folder = tempfile::tempdir().unwrap();
    for (name, run) in [
        ("n", runs::nested(100, 1)),
        ("t", runs::tempered(40, 2)),
        ("r", runs::bridged(40, 4)),
    ] {
        let path = folder.path().join(name);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        let mut seen = 0;
        for group in ["weighted", "history"] {
            let arrays = std::fs::read_dir(path.join(group)).unwrap();
            let arrays: Vec<_> = arrays.map(|array| array.unwrap().path()).collect();
            for array in arrays {
                let chunks = array.join("c");
                if chunks.exists() {
                    std::fs::remove_dir_all(chunks).unwrap();
                    let words = zarr::read(&path).unwrap_err().to_string();
                    assert!(words.contains("chunk is missing"), "{words}");
                    std::fs::remove_dir_all(&path).unwrap();
                    zarr::write(&path, &run, zarr::Extras::default()).unwrap();
                    seen += 1;
                }
            }
        }
        assert!(seen >= 10, "{name}: {seen}");
    }
}

#[test]
fn lengths_of_traces_that_do_not_add_up_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.zarr");
    let run = runs::tempered(40, 2);
    for lengths in [[10_u64, 10, 10, 9], [10, 10, 10, 11], [u64::MAX, 0, 0, 0]] {
        let _ = std::fs::remove_dir_all(&path);
        zarr::write(&path, &run, zarr::Extras::default()).unwrap();
        let bytes: Vec<u8> = lengths.iter().flat_map(|n| n.to_le_bytes()).collect();
        std::fs::write(path.join("history/trace_length/c/0"), bytes).unwrap();
        let words = zarr::read(&path).unwrap_err().to_string();
        assert!(words.contains("traces have 40 values"), "{words}");
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
