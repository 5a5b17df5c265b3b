//! More draws of a finished fit, from its run folder to another one.

use super::fit::{Existing, close, target, watched};
use super::{Opened, RunFolder, Versions, Watch, open_or_create};
use crate::config::{FitConfig, read, text};
use crate::error::Result;
use crate::inference::boosted;
use crate::posterior::Summary;
use oblate_samplers::Run;
use std::path::Path;

/// Draws more of the posterior of the finished fit in `parent` into the folder `out`; `change` may change the settings of the
/// parent's importance sampling and its seed.
///
/// # Errors
/// What the folders and the importance sampling refuse; [`Error::Mismatch`](crate::error::Error::Mismatch) if `parent` is not a fit.
pub fn boost(
    parent: &Path,
    change: impl FnOnce(&mut FitConfig),
    out: &Path,
    existing: Existing,
    command: &str,
    watch: &mut Watch<'_>,
) -> Result<(Run, Summary)> {
    let from = RunFolder::open(parent)?;
    let stored = from.read()?;
    let track = from.read_track()?;
    let mut config: FitConfig = read(&from.config())?;
    change(&mut config);
    config.sampling.boost.check()?;
    let target = target(&track, &config)?;
    let config_text = text(&config)?;
    let versions = Versions::of(&[
        config_text.as_bytes(),
        b"boost",
        stored.summary.input_hash.as_bytes(),
    ]);
    let folder = match open_or_create(out, existing, &versions)? {
        Opened::Finished(run, summary) => return Ok((*run, *summary)),
        Opened::Folder(folder) => folder,
    };
    folder.begin(&config_text, &versions)?;
    track.write(&folder.track())?;
    let run = watched(&folder, &versions, watch, existing, |control| {
        boosted(&target, &stored.run, &config.sampling, config.seed, control)
    })?;
    let summary = close(&folder, &target, &track, &run, &versions, command)?;
    Ok((run, summary))
}
