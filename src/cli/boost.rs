//! `oblate boost`.

use super::Exit;
use super::fit::finish;
use super::options::{Common, FolderFlags};
use super::progress::Progress;
use crate::error::Result;
use crate::run::boost;
use std::io::Write;
use std::path::PathBuf;

/// Flags of `oblate boost`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate boost runs/track_nested --draws 40000 --out runs/track_boost"
)]
pub struct Args {
    /// A finished fit
    run: PathBuf,
    /// Independent draws, one likelihood call each
    #[arg(long)]
    draws: Option<usize>,
    /// Most components of the mixture
    #[arg(long)]
    components: Option<usize>,
    /// Master seed; the fit's own by default
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Boosts one fit.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut dyn Write) -> Result<Exit> {
    let mut progress = Progress::new("boost", common);
    let (run, summary) = boost(
        &args.run,
        |config| {
            let settings = &mut config.sampling.boost;
            settings.draws = args.draws.unwrap_or(settings.draws);
            settings.max_components = args.components.unwrap_or(settings.max_components);
            config.seed = args.seed.unwrap_or(config.seed);
        },
        &args.folder.out,
        args.folder.existing(),
        command,
        &mut progress.watch(),
    )?;
    finish(run.status, &summary, &args.folder, common, out)
}
