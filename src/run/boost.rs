//! More draws of a finished fit, from its run folder to another one.

use super::Watch;
use super::fit::{Existing, target};
use super::job::{Fit, Job};
use crate::config::FitConfig;
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
    let Fit {
        stored,
        track,
        mut config,
    } = Fit::read(parent)?;
    change(&mut config);
    config.sampling.boost.check()?;
    let target = target(&track, &config)?;
    let job = Job {
        out,
        existing,
        command,
    };
    let inputs = [b"boost".as_slice(), stored.summary.input_hash.as_bytes()];
    job.run(&target, &track, &config, &inputs, watch, |control| {
        boosted(&target, &stored.run, &config.sampling, config.seed, control)
    })
}
