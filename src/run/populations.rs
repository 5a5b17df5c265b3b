//! One population by several families: each a run folder of its own, in one folder.

use super::monitor::{Monitored, unless_interrupted};
use super::population::{PopulationFits, check, population};
use super::session::Destination;
use crate::config::{PopulationConfig, each_once};
use crate::error::Result;
use crate::population::FamilyName;
use crate::posterior::Summary;
use std::path::PathBuf;

/// A finished population of one family.
#[derive(Clone, Debug)]
pub struct FamilyRun {
    /// The family.
    pub family: FamilyName,
    /// Its run folder.
    pub folder: PathBuf,
    /// Its summary.
    pub summary: Summary,
}

/// Samples the population of finished fits by several families, each into the run folder of its name in the destination. `None` if a run was
/// interrupted; those before it are finished. All have the same data, so that differences of their ln Z are ln Bayes factors.
///
/// # Errors
/// As of [`population`]; [`Error::Exists`] before the first run if one of the folders is there already and that is refused;
/// [`Error::Setting`] for a family that is named twice; [`Error::OutputPath`] if the destination itself is a run folder.
///
/// [`Error::Exists`]: crate::Error::Exists
/// [`Error::Setting`]: crate::Error::Setting
/// [`Error::OutputPath`]: crate::Error::OutputPath
pub fn populations(
    fits: &PopulationFits<'_>,
    config: &PopulationConfig,
    families: &[FamilyName],
    destination: Destination<'_>,
    monitored: &mut Monitored<'_>,
) -> Result<Option<Vec<FamilyRun>>> {
    let of = |family: FamilyName| {
        let mut config = config.clone();
        config.family.name = family;
        config
    };
    each_once("family", families, |family| family.name().to_owned())?;
    for family in families {
        check(&of(*family))?;
    }
    destination.is_apart_from(fits.folders)?;
    destination.is_no_run()?;
    let folder = |family: &FamilyName| destination.folder.join(family.name());
    let folders: Vec<PathBuf> = families.iter().map(folder).collect();
    destination.may_hold(&folders)?;
    let mut runs = Vec::new();
    for (family, folder) in families.iter().zip(folders) {
        let config = of(*family);
        let own = Destination {
            folder: &folder,
            ..destination
        };
        let label = format!("{} {}", family.name(), config.sampling.sampler.name());
        let done = unless_interrupted(monitored, &label, &mut |monitor| {
            population(fits, &config, own, monitor)
        })?;
        match done {
            Some(fit) => runs.push(FamilyRun {
                family: *family,
                folder,
                summary: fit.summary,
            }),
            None => return Ok(None),
        }
    }
    Ok(Some(runs))
}
