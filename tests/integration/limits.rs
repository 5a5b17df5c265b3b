//! The ranges of docs/limits.md are those of the code: values at their ends pass, values beyond fail, and no number is left out.

use oblate::Error;
use oblate::config::{PopulationConfig, SlurmSettings, StudyConfig, to_toml};
use oblate::data::{MockSettings, MockStars, ObservedTrack, QPopulation, Selection, mocks};
use oblate::inference::{FitSettings, SamplerSettings};
use oblate::likelihood::{
    DataBin, ErrorCorrelation, LikelihoodSettings, StreamLikelihood, TrackLikelihood,
};
use oblate::params::{
    DIM, NAMES, PARAMETERS, PriorSettings, QRange, StreamParams, StreamPrior, without_optional,
};
use oblate::potential::{DiscProfile, log10_m200};
use oblate::samplers::control::Silent;
use oblate::samplers::limits::OutOfRange;
use oblate::samplers::{Control, Marginal, Outcome, Prior, Run, Target, nested, pt};
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::{DiscPlane, DiscSettings, Model, ModelSettings, StepRule};
use oblate::track::{BinEdges, Track};
use proptest::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use toml::{Table, Value};

/// A row of a table of the page.
struct Row {
    key: String,
    lo: f64,
    hi: f64,
}

/// The rows of a section of docs/limits.md.
fn rows(section: &str) -> Vec<Row> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/limits.md");
    let page = std::fs::read_to_string(path).expect("the page");
    let heading = format!("## {section}\n");
    let text = page.split(&heading).nth(1).expect("the section");
    let text = text.split("\n## ").next().expect("its text");
    let rows: Vec<Row> = text
        .lines()
        .filter_map(|line| {
            let mut cells = line.strip_prefix('|')?.split('|').map(str::trim);
            let key = cells.next()?.trim_matches('`').to_owned();
            let (lo, hi) = cells.next()?.split_once(" to ")?;
            let number = |text: &str| text.replace(',', "").parse::<f64>().expect("a number");
            Some(Row {
                key,
                lo: number(lo),
                hi: number(hi),
            })
        })
        .collect();
    assert!(rows.len() > 2, "{section}: only {} rows", rows.len());
    rows
}

/// The value at a dotted path.
fn at<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let mut parts = key.split('.');
    let first = table.get(parts.next()?)?;
    parts.try_fold(first, |value, part| value.get(part))
}

/// Settings with one number changed; `None` if their type cannot hold it.
fn with<T: Serialize + DeserializeOwned>(defaults: &T, key: &str, value: Value) -> Option<T> {
    let mut table: Table = toml::from_str(&to_toml(defaults).expect("TOML")).expect("a table");
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().expect("a key");
    let mut inner = &mut table;
    for part in parts {
        inner = inner
            .entry(part)
            .or_insert_with(|| Table::new().into())
            .as_table_mut()
            .expect("a table");
    }
    inner.insert(last.to_owned(), value);
    table.try_into().ok()
}

/// A number, or two of it where a pair is needed.
fn doubled(value: Value, pair: bool) -> Value {
    if pair {
        vec![value.clone(), value].into()
    } else {
        value
    }
}

/// Checks the rows of a section against the code.
fn agree<T: Serialize + DeserializeOwned>(
    section: &str,
    defaults: &T,
    check: impl Fn(&T) -> Result<(), Error>,
) {
    let table: Table = toml::from_str(&to_toml(defaults).expect("TOML")).expect("a table");
    for Row { key, lo, hi } in rows(section) {
        if section == "4. Mocks" && (key == "count" || key == "seed") {
            continue;
        }
        // An optional number has no default; all of them are floating-point numbers.
        let default = at(&table, &key);
        let whole = default.is_some_and(Value::is_integer);
        let pair = default.is_some_and(Value::is_array);
        let refused = |value: Value| {
            let settings = with(defaults, &key, doubled(value, pair))?;
            match check(&settings) {
                Err(Error::OutOfRange(wrong)) if wrong.key == key => Some(wrong),
                // Another rule may be broken where the range is not.
                _ => None,
            }
        };
        let number = |value: f64| {
            if whole {
                Value::Integer(value as i64)
            } else {
                Value::Float(value)
            }
        };
        for end in [lo, hi] {
            let settings = with(defaults, &key, doubled(number(end), pair));
            assert!(settings.is_some(), "{key} = {end}");
            assert_eq!(refused(number(end)), None, "{key} = {end} is allowed");
        }
        let beyond = if whole {
            let (lo, hi) = (lo as i64, hi as i64);
            [lo.checked_sub(1), hi.checked_add(1)]
                .into_iter()
                .flatten()
                .map(Value::Integer)
                .collect()
        } else {
            vec![
                Value::Float(lo.next_down()),
                Value::Float(hi.next_up()),
                Value::Float(f64::NAN),
                Value::Float(f64::INFINITY),
                Value::Float(f64::NEG_INFINITY),
                Value::Float(1e300),
            ]
        };
        for value in beyond {
            // No unsigned number is below zero: the reader refuses it.
            if with(defaults, &key, doubled(value.clone(), pair)).is_none() {
                assert!(whole && value.as_integer() < Some(0), "{key} = {value}");
                continue;
            }
            let wrong = refused(value.clone()).unwrap_or_else(|| panic!("{key} = {value}"));
            let number = |text: &str| text.parse::<f64>().expect("a number");
            assert_eq!((number(&wrong.lo), number(&wrong.hi)), (lo, hi), "{key}");
            let text = wrong.to_string();
            assert!(text.starts_with(&format!("{key} = ")) && text.contains(": allowed "));
        }
    }
}

/// The dotted paths of all numbers of a table.
fn numbers(table: &Table, under: &str, found: &mut BTreeSet<String>) {
    for (name, value) in table {
        let key = format!("{under}{name}");
        match value {
            Value::Table(inner) => numbers(inner, &format!("{key}."), found),
            Value::Integer(_) | Value::Float(_) | Value::Array(_) => {
                found.insert(key);
            }
            _ => {}
        }
    }
}

/// Asserts that the rows of a section name all numbers of these settings, but for those of some tables.
fn complete(section: &str, settings: &impl Serialize, but: &[&str]) {
    let table: Table = toml::from_str(&to_toml(settings).expect("TOML")).expect("a table");
    let mut all = BTreeSet::new();
    numbers(&table, "", &mut all);
    let rows = rows(section);
    for key in all {
        let elsewhere = but.iter().any(|table| key.starts_with(table));
        let named = rows.iter().any(|row| row.key == key);
        assert!(elsewhere || named, "{section}: {key}");
    }
}

#[test]
fn the_ranges_of_a_fit_are_those_of_the_page() {
    let mut settings = FitSettings::default();
    settings.likelihood.error_correlation = Some(ErrorCorrelation {
        angle_deg: 30.0,
        fraction: 1.0,
    });
    settings.model.baryons.disc = Some(DiscSettings {
        profile: DiscProfile::Exponential,
        thickness: 0.1,
        plane: DiscPlane::default(),
    });
    agree("1. A fit", &settings, FitSettings::check);
    settings.sampling.nested.target_ess = Some(1.0);
    settings.sampling.nested.target_ln_z_error = Some(1.0);
    complete("1. A fit", &settings, &["prior.marginals."]);
}

#[test]
fn the_ranges_of_parameters_are_those_of_the_page() {
    let rows = rows("2. Parameters");
    assert_eq!(rows.len(), NAMES.len());
    for (row, parameter) in rows.iter().zip(&PARAMETERS) {
        assert_eq!(row.key, parameter.name);
        assert_eq!(row.lo..=row.hi, parameter.range, "{}", row.key);
    }
    let out_of_range = |settings: &PriorSettings| match settings.check() {
        Err(Error::OutOfRange(OutOfRange { key, .. })) => Some(key),
        _ => None,
    };
    for (i, parameter) in PARAMETERS.iter().enumerate() {
        let name = parameter.name;
        let (lo, hi) = (*parameter.range.start(), *parameter.range.end());
        let fixed = |value: f64| {
            let mut settings = PriorSettings::default();
            settings.fix(name, value).expect("a parameter");
            out_of_range(&settings)
        };
        let free = |marginal: Marginal| {
            let mut settings = PriorSettings::default();
            *settings.marginals.get_mut(i).expect("a parameter") = Some(marginal);
            out_of_range(&settings)
        };
        for end in [lo, hi] {
            assert_eq!(fixed(end), None);
            assert_eq!(
                free(Marginal::Normal {
                    mean: end,
                    sd: 1e-3
                }),
                None
            );
        }
        assert_eq!(free(Marginal::Uniform { lo, hi }), None);
        assert_eq!(free(Marginal::HalfNormal { sd: hi - lo }), None);
        let key = |part: &str| Some(format!("prior.marginals.{name}.{part}"));
        for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
            assert_eq!(fixed(wrong), Some(format!("prior.fixed.{name}")));
            assert_eq!(free(Marginal::Uniform { lo: wrong, hi }), key("lo"));
            assert_eq!(free(Marginal::Uniform { lo, hi: wrong }), key("hi"));
            assert_eq!(
                free(Marginal::Normal {
                    mean: wrong,
                    sd: 1.0
                }),
                key("mean")
            );
        }
        for sd in [0.0, -1.0, f64::NAN, (hi - lo).next_up(), f64::INFINITY] {
            assert_eq!(free(Marginal::HalfNormal { sd }), key("sd"));
        }
    }
}

#[test]
fn the_ranges_of_a_population_are_those_of_the_page() {
    let settings = PopulationConfig {
        selection: Some(Selection {
            q: vec![0.5, 1.5],
            kept: vec![0.5, 1.0],
            error: vec![0.01, 0.01],
        }),
        ..PopulationConfig::default()
    };
    agree("3. A population", &settings, PopulationConfig::check);
    complete("3. A population", &settings, &["sampling."]);
}

#[test]
fn the_ranges_of_mocks_are_those_of_the_page() {
    let settings = MockSettings {
        population: Some(QPopulation {
            other_mu: Some(1.2),
            ..QPopulation::gaussian(0.8, 0.1)
        }),
        stars: Some(MockStars {
            count: 50,
            velocity_noise_km_s: 5.0,
        }),
        ..MockSettings::default()
    };
    agree("4. Mocks", &settings, MockSettings::check);
    complete("4. Mocks", &settings, &["model."]);
}

#[test]
fn the_ranges_of_slurm_are_those_of_the_page() {
    let settings = SlurmSettings {
        at_once: Some(10),
        ..SlurmSettings::default()
    };
    agree("8. Slurm", &settings, SlurmSettings::check);
    complete("8. Slurm", &settings, &["options"]);
}

/// Whether a study of this many mocks, with this seed, may be run: the error's words otherwise.
fn study(count: u64, seed: u64) -> Result<(), String> {
    let text = format!(
        "title = 'a'\nout = 'b'\n[mocks]\ncount = {count}\nseed = {seed}\nsamplers = ['nested']"
    );
    let config: StudyConfig = toml::from_str(&text).map_err(|e| e.to_string())?;
    config.check().map_err(|e| e.to_string())
}

#[test]
fn the_number_of_mocks_of_a_study_is_that_of_the_page() {
    for Row { key, lo, hi } in rows("4. Mocks") {
        let (lo, hi) = (lo as u64, hi as u64);
        let of = |value: u64| match key.as_str() {
            "count" => study(value, 1),
            _ => study(1, value),
        };
        if key == "count" || key == "seed" {
            assert_eq!((of(lo), of(hi.min(i64::MAX as u64))), (Ok(()), Ok(())));
        }
        if key == "count" {
            assert!(of(hi + 1).unwrap_err().contains("count = 100001"));
            assert!(of(lo - 1).unwrap_err().contains("allowed 1 to 100000"));
        }
    }
}

#[test]
fn subsets_of_a_study_are_as_the_page_says() {
    let study = |sizes: &str, repeats: usize| {
        let text = format!(
            "title = 'a'\nout = 'b'\n[population]\nsamplers = ['nested']\nsubsets = {{ sizes = {sizes}, repeats = {repeats} }}"
        );
        let config: StudyConfig = toml::from_str(&text).expect("a study");
        config.check().map_err(|e| e.to_string())
    };
    assert_eq!(study("[1, 100000]", 1), Ok(()));
    assert_eq!(study("[]", 1_000), Ok(()));
    for (sizes, repeats, words) in [
        ("[0]", 1, "[population.subsets] sizes = 0"),
        ("[5, 100001]", 1, "sizes = 100001"),
        ("[10, 5, 10]", 1, "sizes = 10: name each value"),
        ("[5]", 0, "repeats = 0"),
        ("[5]", 1_001, "repeats = 1001"),
    ] {
        let error = study(sizes, repeats).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn a_study_is_refused_as_a_whole_for_settings_that_it_uses_late() {
    let text = "title = 'a'\nout = 'b'\n[population]\nsamplers = ['nested']\n\
                settings = { reweighting = { max_draws = 0 } }";
    let config: StudyConfig = toml::from_str(text).expect("a study");
    let error = config.check().unwrap_err().to_string();
    assert!(
        error.starts_with("[population.settings] reweighting.max_draws = 0"),
        "{error}"
    );
}

#[test]
fn the_ranges_of_flags_are_those_of_the_page() {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/stream.toml");
    let params = params.display().to_string();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out").display().to_string();
    for Row { key, lo, hi } in rows("5. Flags") {
        let arguments: &[&str] = match key.as_str() {
            "--threads" => &["stream", "nowhere"],
            "--seconds" => &["doctor"],
            "--checkpoint-every" | "--max-minutes" => &["population", "nowhere", "--out", &out],
            _ => &["stream", &params, "--particles", "64"],
        };
        let words = |value: f64| {
            let command = Command::new(env!("CARGO_BIN_EXE_oblate"))
                .args(arguments)
                .arg(format!("{key}={value}"))
                .output()
                .expect("the command");
            String::from_utf8(command.stderr).expect("text")
        };
        let refusal = format!("error: {key} = ");
        for end in [lo, hi] {
            // The edge may be half of the bin width at most, which is that of the default here.
            let end = if key == "--edge" { end.min(5.0) } else { end };
            let words = words(end);
            assert!(!words.contains(&refusal), "{words}");
        }
        let step = if key.starts_with("--bin") || key == "--edge" || key == "--min-fraction" {
            1e-3
        } else {
            1.0
        };
        let least = if step < 1.0 || lo > 0.0 {
            lo - step
        } else {
            hi + 2.0
        };
        for beyond in [least, hi + step] {
            let words = words(beyond);
            assert!(words.contains(&refusal), "{key}={beyond}: {words}");
            assert!(words.contains(": allowed "), "{words}");
        }
    }
}

#[test]
fn more_threads_in_the_environment_than_in_a_flag_are_refused_too() {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/stream.toml");
    let params = params.display().to_string();
    let words = |threads: &str| {
        let command = Command::new(env!("CARGO_BIN_EXE_oblate"))
            .args(["stream", &params, "--particles", "64"])
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .expect("the command");
        String::from_utf8(command.stderr).expect("text")
    };
    assert_eq!(words("0"), "");
    assert_eq!(words("1024"), "");
    let refused = words("1000000");
    assert!(
        refused.contains("RAYON_NUM_THREADS = 1000000: allowed 0 to 1024"),
        "{refused}"
    );
}

/// Reads columns as a track.
fn track(text: &str) -> Result<ObservedTrack, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("track.csv");
    std::fs::write(&path, text).expect("a file");
    ObservedTrack::read(&path).map_err(|e| e.to_string())
}

#[test]
fn the_ranges_of_a_track_are_those_of_the_page() {
    let good = |column: &str, value: f64| {
        let cell = |name: &str, usual: f64| if name == column { value } else { usual };
        let (r, r_err, n) = (cell("r", 60.0), cell("r_err", 1.0), cell("n", 9.0));
        track(&format!(
            "phi,r,r_err,n\n-15,60,1,9\n-5,60,1,9\n5,{r:?},{r_err:?},{n:?}\n"
        ))
    };
    for Row { key, lo, hi } in rows("6. A track") {
        match key.as_str() {
            "r" | "r_err" | "n" => {
                assert!(good(&key, lo).is_ok() && good(&key, hi).is_ok(), "{key}");
                for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
                    let words = good(&key, wrong).unwrap_err();
                    assert!(words.contains("line 4") && words.contains(&format!("`{key}`")));
                    assert!(words.contains("; give"), "{words}");
                }
            }
            "v" | "v_err" | "width" | "width_err" | "density" | "density_err" => {
                let name = key.trim_end_matches("_err");
                let of = |number: f64| {
                    let pair = if key == name {
                        format!("{number:?},1")
                    } else {
                        format!("1,{number:?}")
                    };
                    track(&format!(
                        "phi,r,r_err,{name},{name}_err\n-15,60,1,,\n-5,60,1,,\n5,60,1,{pair}\n"
                    ))
                };
                assert!(of(lo).is_ok() && of(hi).is_ok(), "{key}");
                for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
                    let words = of(wrong).unwrap_err();
                    assert!(words.contains("line 4") && words.contains(&format!("`{key}`")));
                    assert!(words.contains("; give"), "{words}");
                }
            }
            "phi" => {
                // 7,200 is the centre of the bin number 112 of 64 degrees.
                let at = |end: f64| {
                    let sign = end.signum();
                    let mut phi = [end - 128.0 * sign, end - 64.0 * sign, end];
                    phi.sort_by(f64::total_cmp);
                    ObservedTrack::new("far", &phi, 64.0, &[60.0; 3], &[1.2; 3])
                };
                for end in [lo, hi] {
                    assert!(at(end).is_ok());
                    let words = at(end + 64.0 * end.signum()).unwrap_err().to_string();
                    assert!(words.contains("7264") && words.contains("7200"), "{words}");
                }
            }
            "bin_width" => {
                let of = |width: f64| {
                    let phi = [0.5 * width, 1.5 * width, 2.5 * width];
                    ObservedTrack::new("wide", &phi, width, &[60.0; 3], &[1.2; 3])
                };
                assert!(of(lo).is_ok() && of(hi).is_ok());
                for wrong in [lo.next_down(), hi.next_up(), 0.0, f64::NAN] {
                    let words = of(wrong).unwrap_err().to_string();
                    assert!(
                        words.contains("bin_width") || words.contains("phi"),
                        "{words}"
                    );
                }
            }
            _ => {
                let of = |rows: usize| {
                    let row = |i: usize| format!("{},60,1\n", (i as f64 + 0.5) * 0.25);
                    track(&format!(
                        "phi,r,r_err\n{}",
                        (0..rows).map(row).collect::<String>()
                    ))
                };
                let (lo, hi) = (lo as usize, hi as usize);
                assert!(of(lo).is_ok() && of(hi).is_ok());
                assert!(of(lo - 1).unwrap_err().contains("at least 3 bins"));
                let words = of(hi + 1).unwrap_err();
                assert!(words.contains("line 10002") && words.contains("at most 10000 bins"));
            }
        }
    }
}

#[test]
fn a_bin_at_any_distance_is_refused_with_its_line() {
    for far in ["1e10", "1e300", "-1e300"] {
        let words = track(&format!("phi,r,r_err\n5,60,1\n15,60,1\n{far},60,1\n")).unwrap_err();
        assert!(words.contains("line 4"), "{words}");
    }
    // The same through the library, where bins are numbered.
    for bin in [i64::MAX, i64::MIN, 1_000_000_000] {
        let data = [0, 1, bin].map(|bin| DataBin::symmetric(bin, 60.0, 1.0));
        let likelihood = TrackLikelihood::new(
            &LikelihoodSettings::default(),
            10.0,
            &data,
            &TableSettings::default(),
        );
        assert!(matches!(likelihood, Err(Error::OutOfRange(_))));
    }
}

#[test]
fn particles_far_around_the_centre_make_no_bins_there() {
    let mut settings = ModelSettings::default();
    settings.releases.particles = 64;
    let params = StreamParams::from([
        12.0, 15.0, 0.3, 0.0, 1.2, 8.0, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
    ]);
    let model = Model::new(&settings).expect("a model");
    let mut particles = model.stream(&params).expect("a stream");
    let narrow = Track::new(&particles, 0.1, BinEdges::Hard, 1.0).expect("a track");
    particles.winding_numbers[0] = 1e12;
    particles.winding_numbers[1] = -1e12;
    let track = Track::new(&particles, 0.1, BinEdges::Hard, 1.0).expect("a track");
    assert!(track.bins.len() <= narrow.bins.len());
    for width in [0.0, 1e-5, f64::NAN, 1e300] {
        assert!(Track::new(&particles, width, BinEdges::Hard, 1.0).is_err());
        assert!(particles.track(width).is_err());
    }
}

#[test]
fn settings_that_need_too_much_memory_together_are_refused_before_it_is_taken() {
    let refused = |change: &dyn Fn(&mut ModelSettings)| {
        let mut settings = ModelSettings::default();
        settings.releases.sampling_scheme = SamplingScheme::Random;
        change(&mut settings);
        match Model::new(&settings) {
            Err(Error::TooMuchMemory(much)) => much.to_string(),
            other => panic!("{other:?}"),
        }
    };
    let steps = refused(&|s| {
        (s.releases.particles, s.releases.release_times, s.steps) = (1_000_000, 500_000, 100_000);
    });
    assert!(
        steps.contains("GB") && steps.contains("`model.steps`"),
        "{steps}"
    );
    // All limits at once.
    let all = refused(&|s| {
        (s.releases.particles, s.releases.release_times) = (10_000_000, 5_000_000);
        (s.steps, s.orbit_steps) = (100_000, 100_000);
    });
    assert!(all.contains("GB are allowed"), "{all}");
}

#[test]
fn too_much_memory_of_a_bridge_is_refused_with_the_table_of_its_setting() {
    let mut sampling = SamplerSettings::for_streams();
    assert!(sampling.check_bridge(13).is_ok());
    (sampling.bridge.smc_particles, sampling.bridge.max_batches) = (1_000_000, 1_000);
    match sampling.check_bridge(13) {
        Err(Error::TooMuchMemory(much)) => assert_eq!(much.key, "sampling.bridge.smc_particles"),
        other => panic!("{other:?}"),
    }
}

/// The most memory that `work` holds at once.
fn peak(work: impl FnOnce()) -> f64 {
    allocation_counter::measure(work).bytes_max as f64
}

#[test]
fn the_memory_of_a_model_and_its_gradient_is_what_was_estimated() {
    let mut dense = ModelSettings::default();
    dense.releases.sampling_scheme = SamplingScheme::Random;
    dense.step_rule = StepRule::Uniform;
    dense.steps = 120;
    let mut few = dense;
    dense.releases.particles = 40_000;
    (few.releases.particles, few.releases.release_times) = (1_000, 500);
    (few.steps, few.orbit_steps) = (2_000, 4_000);
    let params = without_optional([
        12.0, 15.0, 0.3, 0.0, 1.2, 8.0, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
    ]);
    for settings in [dense, few, ModelSettings::default()] {
        let measured = peak(|| {
            let model = Model::new(&settings).expect("a model");
            let stream = model
                .stream(&StreamParams::from_array(params))
                .expect("a stream");
            let data: Vec<DataBin> = stream
                .track(10.0)
                .expect("a track")
                .bins
                .iter()
                .map(|b| DataBin::symmetric(b.bin, b.r_kpc, 1.0))
                .collect();
            let track = TrackLikelihood::new(
                &LikelihoodSettings::default(),
                10.0,
                &data,
                &settings.releases,
            );
            let q_range = QRange::default();
            let likelihood = StreamLikelihood::new(model, track.expect("data"), q_range);
            likelihood.gradient(&params).expect("a gradient");
        });
        // The stream of the data is in memory as well.
        let estimate = settings.memory(1).bytes() + 56.0 * settings.releases.particles as f64;
        let ratio = measured / estimate;
        // Adaptive steps are estimated as if all were halved as often as they may be.
        let adaptive = settings.step_rule == StepRule::Adaptive;
        let least = if adaptive { 0.0 } else { 0.5 };
        assert!((least..1.05).contains(&ratio), "{measured} of {estimate}");
    }
}

/// A normal likelihood in the middle of a wide normal prior.
struct Bell(Prior);

impl Bell {
    fn new() -> Self {
        let wide = Marginal::Normal {
            mean: 0.0,
            sd: 10.0,
        };
        Self(Prior::new(["a", "b", "c"].map(|name| (name, "", wide))).expect("a prior"))
    }
}

impl Target for Bell {
    fn prior(&self) -> &Prior {
        &self.0
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        Outcome::from_ln_likelihood(-0.5 * theta.iter().map(|x| x * x).sum::<f64>())
    }

    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        for (slot, x) in gradient.iter_mut().zip(theta) {
            *slot = -x;
        }
        self.ln_likelihood(theta)
    }

    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
}

/// The most memory that a run of one thread holds at once.
fn peak_of_run(work: impl FnOnce() -> Run + Send) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.expect("a pool").install(|| peak(|| drop(work())))
}

#[test]
fn the_memory_of_samplers_is_within_what_was_estimated() {
    let bell = Bell::new();
    let nested = nested::Settings {
        n_live: 400,
        steps: Some(3),
        ..nested::Settings::default()
    };
    let dynamic = nested::Settings {
        target_ess: Some(1e6),
        max_batches: 2,
        ..nested.clone()
    };
    let many = pt::Settings {
        smc_particles: 400,
        rounds: 3,
        ..pt::Settings::default()
    };
    let long = pt::Settings {
        rounds: 7,
        slice_updates: 2,
        mixture_rounds: 7,
        ..pt::Settings::default()
    };
    let surrogate = pt::Settings {
        surrogate: true,
        hmc_transitions: 0,
        slice_updates: 1,
        ..many.clone()
    };
    let control = |work: &dyn Fn(&mut Control<'_>) -> Run| work(&mut Control::new(&mut Silent));
    let run_nested = |settings: &nested::Settings| {
        peak_of_run(|| {
            control(&|control| nested::run(&Bell::new(), settings, 1, control).expect("a run"))
        })
    };
    let run_pt = |settings: &pt::Settings| {
        peak_of_run(|| {
            control(&|control| pt::run(&Bell::new(), settings, 1, control).expect("a run"))
        })
    };
    let dim = bell.dim();
    for (name, measured, estimate) in [
        ("nested", run_nested(&nested), nested.memory(dim)),
        ("dynamic", run_nested(&dynamic), dynamic.memory(dim)),
        ("many", run_pt(&many), many.memory(dim)),
        ("long", run_pt(&long), long.memory(dim)),
        ("surrogate", run_pt(&surrogate), surrogate.memory(dim)),
    ] {
        let ratio = measured / estimate.bytes();
        assert!(
            (0.05..1.0).contains(&ratio),
            "{name}: {measured} {estimate:?}"
        );
    }
}

#[test]
fn criteria_that_no_draw_meets_end_the_search_for_mocks() {
    let mut settings = MockSettings {
        min_length_kpc: 100_000.0,
        ..MockSettings::default()
    };
    let model = &mut settings.model;
    (model.releases.particles, model.releases.release_times) = (2, 1);
    (model.steps, model.orbit_steps) = (1, 1);
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    let error = mocks(&prior, &settings, 1, 1).unwrap_err();
    assert!(
        matches!(error, Error::TooFewMocks { found: 0, .. }),
        "{error}"
    );
}

#[test]
fn a_population_of_q_beyond_the_prior_is_at_its_nearer_end() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    for (mu, sigma, q) in [(0.0, 1e-3, 0.5), (3.0, 1e-3, 1.5), (1.2, 1e-300, 1.2)] {
        let mut settings = MockSettings {
            population: Some(QPopulation::gaussian(mu, sigma)),
            ..MockSettings::default()
        };
        settings.model.releases.particles = 200;
        let found = mocks(&prior, &settings, 1, 1).expect("a mock");
        assert!(
            (found.mocks[0].q - q).abs() < 1e-6,
            "{mu}: {}",
            found.mocks[0].q
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn at_the_ends_of_all_ranges_a_point_has_a_likelihood_or_a_cause(
        ends in prop::array::uniform30(0.0_f64..=1.0),
        corners in prop::array::uniform30(0..4),
    ) {
        let params: [f64; DIM] = std::array::from_fn(|i| {
            let (lo, hi) = (*PARAMETERS[i].range.start(), *PARAMETERS[i].range.end());
            match corners[i] {
                0 => lo,
                1 => hi,
                _ => lo + (hi - lo) * ends[i],
            }
        });
        let mut settings = ModelSettings::default();
        settings.releases.particles = 64;
        let data = [-1, 0, 1].map(|bin| DataBin::symmetric(bin, 60.0, 1e-9));
        let model = Model::new(&settings).unwrap();
        let track = TrackLikelihood::new(&LikelihoodSettings::default(), 10.0, &data, &settings.releases).unwrap();
        let likelihood = StreamLikelihood::new(model, track, QRange::default());
        if let Ok(value) = likelihood.ln_likelihood(&params) {
            prop_assert!(value.ln_likelihood.is_finite());
        }
        if let Ok((value, gradient)) = likelihood.gradient(&params) {
            prop_assert!(value.ln_likelihood.is_finite());
            prop_assert!(gradient.iter().all(|g| g.is_finite()));
        }
        prop_assert!(log10_m200(params[0], params[1]).is_finite());
    }
}
