//! `oblate merge`.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::folder::FolderFlags;
use super::next::after_merge;
use super::options::LimitFlags;
use super::output::Output;
use crate::error::Result;
use crate::run::merge;
use std::path::PathBuf;

/// Flags of `oblate merge`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate fit track.ecsv --sampler nested --seed 1 --out runs/one\n  oblate fit track.ecsv --sampler nested --seed 2 --out runs/two\n  oblate merge runs/one runs/two --out runs/both"
)]
pub struct Args {
    /// Finished nested fits of one track, each with another seed
    #[arg(required = true, num_args = 2..)]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Merges fits.
pub fn run(args: &Args, command: &CommandLine, out: &mut Output<'_>) -> Result<Exit> {
    args.folder.fill(
        "merge",
        command,
        &LimitFlags::default(),
        out,
        |destination, monitor| merge(&args.runs, destination, monitor),
        |fit, folder| after_merge(&fit.summary, &args.runs, folder),
    )
}
