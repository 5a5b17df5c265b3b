//! `oblate population`.

use super::exit::Exit;
use super::folder::FolderFlags;
use super::options::{Common, sampler};
use super::output::Output;
use crate::config::{PopulationConfig, read};
use crate::error::Result;
use crate::inference::Sampler;
use crate::run::population;
use std::path::PathBuf;

/// Flags of `oblate population`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate population runs/mock_* --sampler nested --out runs/population"
)]
pub struct Args {
    /// Finished fits
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// nested or pt-hmc
    #[arg(long, value_parser = sampler)]
    sampler: Option<Sampler>,
    /// Settings file (TOML); flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Master seed
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Samples the population of finished fits: a truncated Gaussian of q.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut Output<'_>) -> Result<Exit> {
    let mut config: PopulationConfig = match &args.config {
        Some(path) => read(path)?,
        None => PopulationConfig::default(),
    };
    config.sampling.sampler = args.sampler.unwrap_or(config.sampling.sampler);
    config.seed = args.seed.unwrap_or(config.seed);
    let label = format!("population {}", config.sampling.sampler.name());
    args.folder
        .fill(&label, command, common, out, |destination, monitor| {
            population(
                &args.runs,
                &config,
                args.folder.allow_unconverged,
                destination,
                monitor,
            )
        })
}
