//! `oblate refine`.

use super::Exit;
use super::fit::finish;
use super::options::{Common, FolderFlags, ModelFlags};
use super::progress::Progress;
use crate::config::{FitConfig, read};
use crate::error::Result;
use crate::run::refine;
use std::io::Write;
use std::path::PathBuf;

/// Flags of `oblate refine`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate fit track.ecsv --particles 1024 --out runs/track_coarse\n  oblate refine runs/track_coarse --profile fast --out runs/track"
)]
pub struct Args {
    /// A finished fit
    run: PathBuf,
    /// Settings file whose model, likelihood and refinement are meant; flags go over it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Draws that are carried over
    #[arg(long)]
    members: Option<usize>,
    /// Slices of each draw after each step of the way
    #[arg(long)]
    sweeps: Option<usize>,
    /// Master seed; the fit's own by default
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Refines one fit.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut dyn Write) -> Result<Exit> {
    let given: Option<FitConfig> = args.config.as_deref().map(read).transpose()?;
    let mut progress = Progress::new("refine", common);
    let (run, summary) = refine(
        &args.run,
        |config| {
            if let Some(given) = given {
                config.model = given.model;
                config.likelihood = given.likelihood;
                config.sampling.refine = given.sampling.refine;
            }
            if let Some(profile) = args.model.profile() {
                config.model = profile.model();
                config.likelihood = profile.likelihood();
            }
            args.model.apply(&mut config.model);
            let settings = &mut config.sampling.refine;
            settings.members = args.members.unwrap_or(settings.members);
            settings.sweeps = args.sweeps.unwrap_or(settings.sweeps);
            config.seed = args.seed.unwrap_or(config.seed);
        },
        &args.folder.out,
        args.folder.existing(),
        command,
        &mut progress.watch(),
    )?;
    finish(run.status, &summary, &args.folder, common, out)
}
