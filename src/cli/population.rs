//! `oblate population`.

use super::Exit;
use super::fit::finish;
use super::options::{Common, FolderFlags, sampler};
use super::progress::Progress;
use crate::config::{PopulationConfig, read};
use crate::error::Result;
use crate::inference::Sampler;
use crate::run::population;
use std::io::Write;
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
    /// The family of populations
    #[arg(long, value_enum, default_value_t = FamilyName::TruncatedGaussian)]
    family: FamilyName,
    /// nested or pt-hmc
    #[arg(long, value_parser = sampler)]
    sampler: Option<Sampler>,
    /// Settings file (TOML)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Master seed
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    folder: FolderFlags,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum FamilyName {
    TruncatedGaussian,
}

/// Samples a population.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut dyn Write) -> Result<Exit> {
    let FamilyName::TruncatedGaussian = args.family;
    let mut config: PopulationConfig = match &args.config {
        Some(path) => read(path)?,
        None => PopulationConfig::default(),
    };
    if let Some(sampler) = args.sampler {
        config.sampling.sampler = sampler;
    }
    if let Some(seed) = args.seed {
        config.seed = seed;
    }
    let label = format!("population {}", config.sampling.sampler.name());
    let mut progress = Progress::new(&label, common);
    let (run, summary) = population(
        &args.runs,
        &config,
        &args.folder.out,
        args.folder.existing(),
        args.folder.allow_unconverged,
        command,
        &mut progress.watch(),
    )?;
    finish(run.status, &summary, &args.folder, common, out)
}
