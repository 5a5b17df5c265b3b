//! `oblate bridge`.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::folder::FolderFlags;
use super::next::after_bridge;
use super::options::{LimitFlags, ModelFlags};
use super::output::Output;
use super::set::SetFlags;
use crate::config::read;
use crate::error::Result;
use crate::inference::FitSettings;
use crate::run::bridge;
use std::path::PathBuf;

/// Flags of `oblate bridge`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate fit track.ecsv --particles 1024 --out runs/track_coarse\n  oblate bridge runs/track_coarse --profile fast --out runs/track"
)]
pub struct Args {
    /// A finished fit
    run: PathBuf,
    /// Settings file whose model, likelihood and bridge are used; flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Number of SMC particles of a batch, which are draws of the result
    #[arg(long)]
    smc_particles: Option<usize>,
    /// Number of MCMC steps of each SMC particle after each step of the bridge
    #[arg(long)]
    mcmc_steps: Option<usize>,
    /// Maximum number of batches of SMC particles, added while the effective sample size is too small; with --resume, more than before
    /// continue a bridge that has ended
    #[arg(long)]
    max_batches: Option<usize>,
    /// Master seed; the fit's own by default
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    set: SetFlags,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Continues one fit to a finer model.
pub fn run(args: &Args, command: &CommandLine, out: &mut Output<'_>) -> Result<Exit> {
    let given: Option<FitSettings> = args.config.as_deref().map(read).transpose()?;
    let change = |settings: &mut FitSettings| {
        if let Some(given) = given {
            settings.model = given.model;
            settings.likelihood = given.likelihood;
            settings.sampling.bridge = given.sampling.bridge;
        }
        args.model.apply_to_fit(settings);
        let bridge = &mut settings.sampling.bridge;
        bridge.smc_particles = args.smc_particles.unwrap_or(bridge.smc_particles);
        bridge.mcmc_steps = args.mcmc_steps.unwrap_or(bridge.mcmc_steps);
        bridge.max_batches = args.max_batches.unwrap_or(bridge.max_batches);
        settings.seed = args.seed.unwrap_or(settings.seed);
        args.set.apply(settings)
    };
    args.folder.fill(
        "bridge",
        command,
        &args.limits,
        out,
        |destination, monitor| bridge(&args.run, change, destination, monitor),
        |fit, folder| after_bridge(&fit.summary, &args.run, folder, command),
    )
}
