//! Fits of one track from several seeds, as one fit.

use super::Watch;
use super::fit::{Existing, target};
use super::job::{Fit, Job};
use crate::error::{Error, Result};
use crate::inference::merged;
use crate::posterior::Summary;
use oblate_samplers::Run;
use oblate_samplers::output::Method;
use std::path::{Path, PathBuf};

/// Merges finished nested fits of one track, with the same settings of all but the sampler, into the folder `out`, whose
/// settings are the first one's.
///
/// # Errors
/// What the folders refuse; [`Error::Mismatch`] if one of them is not a fit, or of another track or model; as of
/// [`oblate_samplers::nested::merge`].
pub fn merge(
    parts: &[PathBuf],
    out: &Path,
    existing: Existing,
    command: &str,
    watch: &mut Watch<'_>,
) -> Result<(Run, Summary)> {
    let fits = parts
        .iter()
        .map(|p| Fit::read(p))
        .collect::<Result<Vec<_>>>()?;
    let Some((first, others)) = fits.split_first() else {
        return Err(Error::Setting {
            key: "RUN".to_owned(),
            value: "none".to_owned(),
            remedy: "give at least two run folders".to_owned(),
        });
    };
    for (fit, part) in fits.iter().zip(parts) {
        if fit.stored.run.method == Method::Refine {
            return Err(Error::Mismatch {
                what: format!("{} is a refinement, not a nested run", part.display()),
                remedy: format!(
                    "merge the coarse runs, {} and the like, and refine the result (`oblate refine`)",
                    part.join("coarse").display()
                ),
            });
        }
    }
    for other in others {
        first.matches(other)?;
    }
    let target = target(&first.track, &first.config)?;
    // Before anything is written: what does not belong together leaves no folder behind.
    let runs: Vec<&Run> = fits.iter().map(|f| &f.stored.run).collect();
    let run = merged(&target, &runs)?;
    if parts.iter().any(|part| same(part, out)) {
        return Err(Error::Setting {
            key: "--out".to_owned(),
            value: out.display().to_string(),
            remedy: "it is one of the runs to merge; choose another folder".to_owned(),
        });
    }
    let mut inputs = vec![b"merge".as_slice()];
    inputs.extend(fits.iter().map(|f| f.stored.summary.input_hash.as_bytes()));
    let job = Job {
        out,
        existing,
        command,
    };
    job.run(&target, &first.track, &first.config, &inputs, watch, |_| {
        Ok(run)
    })
}

/// Whether two paths lead to one folder.
fn same(one: &Path, other: &Path) -> bool {
    let real = |path: &Path| std::fs::canonicalize(path).ok();
    real(one).is_some_and(|path| real(other) == Some(path))
}

impl Fit {
    /// Refuses a fit of another posterior.
    fn matches(&self, other: &Self) -> Result<()> {
        let differs = if self.track != other.track {
            "track"
        } else if self.config.model != other.config.model {
            "[model]"
        } else if self.config.likelihood != other.config.likelihood {
            "[likelihood]"
        } else if self.config.prior != other.config.prior {
            "[prior]"
        } else {
            return Ok(());
        };
        Err(Error::Mismatch {
            what: format!(
                "{} and {} differ in their {differs}",
                self.stored.name, other.stored.name
            ),
            remedy:
                "merge fits of one track whose settings differ in the seed and the sampler's alone"
                    .to_owned(),
        })
    }
}
