//! The fits of a population, read and compared: each of another track, all with one prior and one recipe.

use super::folder::{StoredRun, distinct_names};
use super::stored_fit::StoredFit;
use crate::data::ObservedTrack;
use crate::error::{Error, PosteriorFault, Result};
use crate::inference::FitSettings;
use crate::params::{PARAMETERS, QPrior};
use crate::population::QPosterior;
use crate::posterior::column;
use std::path::PathBuf;

/// The posterior of q of a finished fit, with the prior of that fit.
///
/// # Errors
/// [`Error::NoColumn`] if the run has no q.
pub fn q_posterior(stored: &StoredRun) -> Result<QPosterior> {
    let q = column(&stored.run, "q")?;
    Ok(QPosterior {
        name: stored.name.clone(),
        q: q.values,
        ln_weight: stored.run.draws.ln_weight.clone(),
        // A run of a single lineage cannot tell, and states 0: like a single draw, which fails the check of the variance of its sum.
        effective_size: stored.summary.ess.max(1.0),
        prior: stored.summary.q_prior.unwrap_or(QPrior::Unknown),
    })
}

/// Reads the fits of a population.
///
/// # Errors
/// As of [`StoredFit::read`]; [`Error::Posterior`] for two fits of one track, or with different priors or recipes.
pub(super) fn read(paths: &[PathBuf]) -> Result<Vec<StoredRun>> {
    Ok(read_fits(paths)?
        .into_iter()
        .map(|fit| fit.stored)
        .collect())
}

/// As [`read`], with tracks and settings.
///
/// # Errors
/// As of [`read`].
pub(super) fn read_fits(paths: &[PathBuf]) -> Result<Vec<StoredFit>> {
    let mut fits = paths
        .iter()
        .map(|path| StoredFit::read(path))
        .collect::<Result<Vec<_>>>()?;
    let names = {
        let stored: Vec<&StoredRun> = fits.iter().map(|fit| &fit.stored).collect();
        distinct_names(paths, &stored)
    };
    for (fit, name) in fits.iter_mut().zip(names) {
        fit.stored.name = name;
    }
    for (i, fit) in fits.iter().enumerate() {
        for other in &fits[..i] {
            belongs_with(fit, other).map_err(|fault| Error::Posterior {
                name: fit.stored.name.clone(),
                fault,
            })?;
        }
    }
    Ok(fits)
}

/// Checks that two fits are of two streams, whose q have one meaning and one prior.
///
/// The numbers of particles and steps may differ, because the error that they make is checked in every fit; so may the values of fixed
/// parameters, and all about optional ones, which are what is known of each stream, but the prior of the second axis, which q is measured
/// beside.
fn belongs_with(fit: &StoredFit, other: &StoredFit) -> std::result::Result<(), PosteriorFault> {
    let differs = |part| PosteriorFault::OtherFit {
        other: other.stored.name.clone(),
        part,
    };
    if is_one_track(&fit.track, &other.track) {
        return Err(PosteriorFault::SameTrack {
            other: other.stored.name.clone(),
        });
    }
    if !same_prior(&fit.settings, &other.settings) {
        return Err(differs("[prior]"));
    }
    if fit.settings.model.halo != other.settings.model.halo {
        return Err(differs("model.halo"));
    }
    let recipe = |fit: &StoredFit| fit.settings.model.releases.recipe;
    if recipe(fit) != recipe(other) {
        return Err(differs("model.releases.recipe"));
    }
    Ok(())
}

/// Largest difference of two tables of one track that were written in other units or with fewer digits: of the radii as a fraction, and of phi
/// in degrees.
const SAME_RADIUS: f64 = 1e-3;
const SAME_PHI_DEG: f64 = 0.01;

/// Whether two tracks are of one stream: more than half of the bins of the shorter one have the same radii at the same phi, or at phi of the
/// opposite sign, as in fits of both senses of one track.
pub(super) fn is_one_track(one: &ObservedTrack, other: &ObservedTrack) -> bool {
    let (phi_deg, r_kpc) = (&other.phi_deg, &other.r_kpc);
    let shared = |sign: f64| {
        let is_there = |(phi, r): (&f64, &f64)| {
            phi_deg.iter().zip(r_kpc).any(|(other_phi, other_r)| {
                (phi - sign * other_phi).abs() < SAME_PHI_DEG
                    && (r - other_r).abs() < SAME_RADIUS * r
            })
        };
        (one.phi_deg.iter().zip(&one.r_kpc))
            .filter(|row| is_there(*row))
            .count()
    };
    2 * shared(1.0).max(shared(-1.0)) > one.phi_deg.len().min(phi_deg.len())
}

fn same_prior(one: &FitSettings, other: &FitSettings) -> bool {
    let prior = |settings: &FitSettings| {
        let prior = &settings.prior;
        let parameters = PARAMETERS.iter().zip(prior.marginals.to_array());
        let required: Vec<_> = parameters
            .zip(prior.fixed.to_array())
            .filter(|((parameter, _), _)| parameter.absent.is_none() || parameter.name == "p_halo")
            .map(|((_, marginal), fixed)| (marginal, fixed.is_some()))
            .collect();
        ([prior.q_min, prior.q_max], required)
    };
    prior(one) == prior(other)
}
