//! Settings, studies, parameter sets, JSON lines and versions.

use crate::harness::Verdict;
use crate::mutate;
use oblate::FitSettings;
use oblate::config::{PopulationConfig, StudyConfig, read, to_toml};
use oblate::data::ObservedTrack;
use oblate::inference::StreamTarget;
use oblate::params::{ParameterLines, PriorSettings, StreamParams, StreamPrior};
use oblate_samplers::rng::{RandomStream, below};
use serde::{Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

fn example(file: &str) -> String {
    std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("examples")
            .join(file),
    )
    .unwrap()
}

/// A damaged text: of its bytes, or of its values.
fn damaged(rng: &mut RandomStream, seeds: &[String]) -> Vec<u8> {
    let own = &seeds[below(rng, seeds.len())];
    let other = &seeds[below(rng, seeds.len())];
    if below(rng, 2) == 0 {
        let tree: serde_json::Value = toml::from_str(own).unwrap();
        // A null has no form in TOML.
        if let Ok(text) = toml::to_string(&mutate::tree(rng, &tree)) {
            return text.into_bytes();
        }
    }
    mutate::bytes(rng, own.as_bytes(), other.as_bytes())
}

/// Reads damaged settings; those that are accepted are written and read again to the same.
fn settings<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(
    path: &Path,
) -> Option<T> {
    let settings: T = read(path).ok()?;
    if let Ok(text) = to_toml(&settings) {
        std::fs::write(path, text).unwrap();
        // A NaN is not equal to itself.
        let again = to_toml(&read::<T>(path).unwrap()).unwrap();
        assert_eq!(again, to_toml(&settings).unwrap());
    }
    Some(settings)
}

/// Settings of fits.
pub fn fit_seeds() -> Vec<String> {
    vec![
        example("quick_fit.toml"),
        example("gala_fit.toml"),
        to_toml(&FitSettings::default()).unwrap(),
        "[prior]\nq_min = 0.6\nmarginals.age_gyr = { kind = \"uniform\", lo = 2.0, hi = 3.0 }\nfixed.r_s_halo_kpc = 15.0\n".to_owned(),
    ]
}

/// Reads damaged settings of a fit, and begins one with those that are accepted.
pub fn fit_case(
    rng: &mut RandomStream,
    seeds: &[String],
    track: &ObservedTrack,
    path: &Path,
) -> Verdict {
    std::fs::write(path, damaged(rng, seeds)).unwrap();
    let Some(settings) = settings::<FitSettings>(path) else {
        return Verdict::Refused;
    };
    let Ok(prior) = StreamPrior::new(&settings.prior) else {
        return Verdict::Refused;
    };
    let dim = prior.prior().dim();
    if settings.sampling.check(dim).is_err() || settings.sampling.bridge.check(dim).is_err() {
        return Verdict::Refused;
    }
    let model = &settings.model;
    let small = model
        .releases
        .particles
        .max(model.steps)
        .max(model.orbit_steps)
        <= 4096
        && model.releases.release_times <= 4096;
    if small && StreamTarget::from_track(track, &settings).is_err() {
        return Verdict::Refused;
    }
    Verdict::Accepted
}

/// Studies and populations.
pub fn study_seeds() -> Vec<String> {
    vec![
        example("quickstart.toml"),
        "title = \"t\"\nout = \"o\"\n[tracks]\nfiles = [\"a.ecsv\"]\nsamplers = [\"nested\", \"pt-hmc\"]\n".to_owned(),
    ]
}

/// Reads a damaged study.
pub fn study_case(rng: &mut RandomStream, seeds: &[String], path: &Path) -> Verdict {
    std::fs::write(path, damaged(rng, seeds)).unwrap();
    let Some(study) = settings::<StudyConfig>(path) else {
        return Verdict::Refused;
    };
    if let Some(population) = study.population {
        let settings: PopulationConfig = population.settings;
        if settings
            .family
            .dim()
            .map_or(true, |dim| settings.sampling.check(dim).is_err())
        {
            return Verdict::Refused;
        }
    }
    Verdict::Accepted
}

/// Parameter sets.
pub fn parameter_seeds() -> Vec<String> {
    vec![example("stream.toml")]
}

/// Reads a damaged parameter set; one that is accepted has a place in the prior.
pub fn parameter_case(rng: &mut RandomStream, seeds: &[String], path: &Path) -> Verdict {
    std::fs::write(path, damaged(rng, seeds)).unwrap();
    let Some(params) = settings::<StreamParams<f64>>(path) else {
        return Verdict::Refused;
    };
    inside(&params)
}

/// Whether parameters are inside the prior, which then has coordinates for them.
fn inside(params: &StreamParams<f64>) -> Verdict {
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    if prior.check_inside(params).is_err() {
        return Verdict::Refused;
    }
    let theta = params.to_array();
    let mut z = vec![0.0; theta.len()];
    prior.prior().z_from_theta(&theta, &mut z);
    assert!(z.iter().all(|z| !z.is_nan()), "{params:?}");
    Verdict::Accepted
}

/// Lines of parameters.
pub fn line_seeds() -> Vec<Vec<u8>> {
    vec![example("points.jsonl").into_bytes(), b"\n \n{}\n".to_vec()]
}

/// Reads damaged lines until one is refused.
pub fn line_case(rng: &mut RandomStream, seeds: &[Vec<u8>]) -> Verdict {
    let own = &seeds[below(rng, seeds.len())];
    let bytes = mutate::bytes(rng, own, &seeds[0]);
    let mut input = bytes.as_slice();
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    let mut verdict = Verdict::Refused;
    for line in ParameterLines::new(&mut input, PathBuf::from("lines")) {
        let Ok(line) = line else {
            return Verdict::Refused;
        };
        for given in &line.points {
            let Ok(params) = prior.complete(given) else {
                return Verdict::Refused;
            };
            verdict = inside(&params);
            if verdict == Verdict::Refused {
                return verdict;
            }
        }
    }
    verdict
}
