//! Fits of one track from several seeds, as one fit.

use super::fit::{Existing, close, target};
use super::{Opened, RunFolder, StoredRun, Versions, open_or_create};
use crate::config::{FitConfig, read, text};
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::merged;
use crate::posterior::Summary;
use oblate_samplers::Run;
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
    for other in others {
        first.matches(other)?;
    }
    let target = target(&first.track, &first.config)?;
    let config_text = text(&first.config)?;
    let mut inputs = vec![config_text.as_bytes(), b"merge"];
    inputs.extend(fits.iter().map(|f| f.stored.summary.input_hash.as_bytes()));
    let versions = Versions::of(&inputs);
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
    let folder = match open_or_create(out, existing, &versions)? {
        Opened::Finished(run, summary) => return Ok((*run, *summary)),
        Opened::Folder(folder) => folder,
    };
    folder.begin(&config_text, &versions)?;
    first.track.write(&folder.track())?;
    let summary = close(&folder, &target, &first.track, &run, &versions, command)?;
    Ok((run, summary))
}

/// Whether two paths lead to one folder.
fn same(one: &Path, other: &Path) -> bool {
    let real = |path: &Path| std::fs::canonicalize(path).ok();
    real(one).is_some_and(|path| real(other) == Some(path))
}

/// A finished fit with what it was a fit of.
struct Fit {
    stored: StoredRun,
    track: ObservedTrack,
    config: FitConfig,
}

impl Fit {
    fn read(path: &Path) -> Result<Self> {
        let folder = RunFolder::open(path)?;
        let stored = folder.read()?;
        Ok(Self {
            track: folder.read_track()?,
            config: read(&folder.config())?,
            stored,
        })
    }

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
