//! A fit with a coarse model, carried to a finer one: from its run folder to another one.

use super::Watch;
use super::fit::{Existing, target};
use super::job::{Fit, Job};
use crate::config::FitConfig;
use crate::error::{Error, Result};
use crate::inference::refined;
use crate::posterior::Summary;
use oblate_samplers::{Run, Target};
use std::path::Path;

/// Carries the finished fit in `parent` to another model of the stream, which `change` makes of the parent's settings, into the
/// folder `out`. Track and prior stay what they are.
///
/// # Errors
/// What the folders and the refinement refuse; [`Error::Mismatch`] if `parent` is not a fit, and
/// [`Error::Setting`] if `change` leaves the model and the likelihood as they are.
pub fn refine(
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
        config: coarse,
    } = Fit::read(parent)?;
    let mut config = coarse.clone();
    change(&mut config);
    if config.model == coarse.model && config.likelihood == coarse.likelihood {
        return Err(Error::Setting {
            key: "model".to_owned(),
            value: "that of the fit itself".to_owned(),
            remedy: "name a finer one: --profile fast, or more --particles or --steps".to_owned(),
        });
    }
    let (target, coarse) = (target(&track, &config)?, target(&track, &coarse)?);
    config.sampling.refine.check(target.dim())?;
    let job = Job {
        out,
        existing,
        command,
    };
    let inputs = [b"refine".as_slice(), stored.summary.input_hash.as_bytes()];
    job.run(&target, &track, &config, &inputs, watch, |control| {
        let (settings, seed) = (&config.sampling, config.seed);
        refined(&target, &coarse, &stored.run, settings, seed, control)
    })
}
