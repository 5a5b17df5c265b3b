//! One call for either sampler; the bridge to a finer model; the merger of several nested runs.

use super::settings::{Sampler, SamplerSettings};
use crate::error::Result;
use oblate_samplers::{Control, Run, Target, bridge, nested, pt};

/// Samples a target with the sampler that the settings choose.
///
/// # Errors
/// [`Error::Sampler`](crate::Error::Sampler): a setting out of its range, a target that fails, an interrupt before the first result,
/// or a checkpoint that cannot be read or written.
pub fn sample(
    target: &dyn Target,
    settings: &SamplerSettings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    let run = match settings.sampler {
        Sampler::Nested => nested::run(target, &settings.nested, seed, control)?,
        Sampler::PtHmc => pt::run(target, &settings.pt_hmc, seed, control)?,
    };
    Ok(run)
}

/// Draws of a fine target from those of `parent`, a run on a coarse target, by SMC.
///
/// # Errors
/// [`Error::Sampler`](crate::Error::Sampler): as for [`sample`], and if `parent` is not a run on `coarse`.
pub fn bridge(
    fine: &dyn Target,
    coarse: &dyn Target,
    parent: &Run,
    settings: &SamplerSettings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    Ok(bridge::run(
        fine,
        coarse,
        parent,
        &settings.bridge,
        seed,
        control,
    )?)
}

/// One nested run made of several on the same target, with different seeds.
///
/// # Errors
/// [`Error::Sampler`](crate::Error::Sampler): fewer than two runs, two with the same seed, or one that is not a nested run on the
/// target.
pub fn merge(target: &dyn Target, runs: &[&Run]) -> Result<Run> {
    Ok(nested::merge(target, runs)?)
}
