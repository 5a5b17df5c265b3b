//! The ranges of settings: of a fit, a population, mocks and Slurm.

use super::{Row, rows};
use oblate::Error;
use oblate::config::{PopulationConfig, SlurmSettings, to_toml};
use oblate::data::{MockSettings, MockStars, QPopulation, Selection};
use oblate::inference::FitSettings;
use oblate::likelihood::ErrorCorrelation;
use oblate::potential::DiscProfile;
use oblate::stream::{DiscPlane, DiscSettings};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use toml::{Table, Value};

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
        profile: DiscProfile::MiyamotoNagai,
        thickness: 0.1,
        plane: DiscPlane::default(),
    });
    agree("1. A fit", &settings, FitSettings::check);
    settings.sampling.nested.target_ess = Some(1.0);
    settings.sampling.nested.target_ln_z_error = Some(1.0);
    complete("1. A fit", &settings, &["prior.marginals."]);
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
        velocity_noise_km_s: Some(5.0),
        width_noise: Some(0.1),
        density_noise: Some(0.1),
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
