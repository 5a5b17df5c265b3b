//! `oblate selection`.

use super::exit::Exit;
use super::options::{JsonFlag, ModelFlags, WorkFlags, fit_settings, refuse_existing, write_file};
use super::output::Output;
use super::progress::Progress;
use super::set::SetFlags;
use crate::config::to_toml;
use crate::data::{MockSettings, Selection, selection};
use crate::error::Result;
use crate::params::StreamPrior;
use oblate_samplers::{Event, Observer};
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;

/// Flags of `oblate selection`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate selection --draws 2000 --out selection.toml\n  \
oblate population runs/mock_* --config selection.toml --out runs/population"
)]
pub struct Args {
    /// Streams that are made at each value of q
    #[arg(long, default_value_t = 1000)]
    draws: usize,
    /// Number of values of q
    #[arg(long, default_value_t = 20)]
    points: usize,
    /// Seed of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Settings file to make, with the table [selection] of a population
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    /// Settings file of a fit (TOML), for prior, halo, disc and bulge
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    set: SetFlags,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

/// The settings that are written.
#[derive(Serialize)]
struct Settings<'a> {
    selection: &'a Selection,
}

/// Estimates which fraction of streams is kept at each q.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    let mut settings = MockSettings::default();
    let fit = fit_settings(args.config.as_deref())?;
    settings.model = settings.model.with_host_of(&fit.model);
    args.model.apply_to_mocks(&mut settings.model);
    args.set.apply(&mut settings)?;
    let prior = StreamPrior::new(&fit.prior)?;
    refuse_existing(&args.out, args.force)?;
    args.work
        .tell_memory(&settings.model.memory(rayon::current_num_threads()));
    let mut progress = Progress::new("selection", args.work.quiet);
    let found = selection(
        &prior,
        &settings,
        args.points,
        args.draws,
        args.seed,
        &mut |done| {
            let _ = progress.event(&Event::Advanced {
                done: done as u64,
                of: args.points as u64,
            });
        },
    )?;
    drop(progress);
    let text = to_toml(&Settings { selection: &found })?;
    write_file(&args.out, text.as_bytes(), args.force)?;
    if args.output.json {
        out.json(&json!({"seed": args.seed, "draws": args.draws, "settings": settings, "selection": found}))?;
    } else {
        out.line("     q   kept")?;
        for ((q, kept), error) in found.q.iter().zip(&found.kept).zip(&found.error) {
            out.line(&format!("{q:.4}   {kept:.4} +- {error:.4}"))?;
        }
    }
    Ok(Exit::Done)
}
