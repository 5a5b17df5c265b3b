//! Several runs in one folder: what is refused before the first of them.

use oblate::config::PopulationConfig;
use oblate::population::FamilyName;
use oblate::run::{Destination, IfExists, Monitor, PopulationFits, populations, senses};
use oblate::{Error, FitSettings};
use std::fs;

#[test]
fn an_interrupt_before_the_first_draws_is_no_error() {
    let temporary = tempfile::tempdir().unwrap();
    let destination = Destination {
        folder: temporary.path(),
        if_exists: IfExists::Refuse,
        command: "",
    };
    let mut interrupted = |_: &str, _: &mut dyn FnMut(&mut Monitor<'_>) -> oblate::Result<()>| {
        Err(Error::Sampler(oblate::samplers::Error::Interrupted))
    };
    let track = super::track();
    let settings = FitSettings::default();
    let fitted = senses([&track, &track], &settings, destination, &mut interrupted).unwrap();
    assert!(fitted.is_none());
    let fits = PopulationFits {
        folders: &[],
        missing: &[],
        allow_unconverged: true,
    };
    let config = PopulationConfig::default();
    let families = [FamilyName::Beta];
    let sampled = populations(&fits, &config, &families, destination, &mut interrupted).unwrap();
    assert!(sampled.is_none());
}

#[test]
fn the_folder_of_a_later_family_is_refused_before_the_first_is_sampled() {
    let temporary = tempfile::tempdir().unwrap();
    let beta = temporary.path().join("beta");
    fs::create_dir(&beta).unwrap();
    fs::write(beta.join("config.toml"), "seed = 1\n").unwrap();
    let fits = PopulationFits {
        folders: &[],
        missing: &[],
        allow_unconverged: true,
    };
    let families = [FamilyName::Uniform, FamilyName::Beta];
    let begun = |if_exists| {
        let destination = Destination {
            folder: temporary.path(),
            if_exists,
            command: "",
        };
        let mut labels = Vec::new();
        let config = PopulationConfig::default();
        let result = populations(&fits, &config, &families, destination, &mut |label, _| {
            labels.push(label.to_owned());
            Ok(())
        });
        (labels.len(), result.err())
    };
    let (runs, error) = begun(IfExists::Refuse);
    assert!(
        matches!(&error, Some(Error::Exists { path }) if *path == beta),
        "{error:?}"
    );
    assert_eq!(runs, 0);
    assert_eq!(begun(IfExists::Resume).0, 1);
}
