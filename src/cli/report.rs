//! `oblate report`.

use super::exit::Exit;
use super::options::{Common, refuse_existing};
use super::output::{Output, shown};
use super::run_folders::run_folders;
use crate::error::Result;
use crate::run::render_report;
use std::path::PathBuf;

/// Flags of `oblate report`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate report runs/track_nested runs/track_pt --out report.html\n\n\
Each figure is also written as SVG into its run folder."
)]
pub struct Args {
    /// Finished runs; files and folders that are no runs are skipped with a note
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The page to write
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Replace the page if it exists
    #[arg(long)]
    force: bool,
    /// Title of the page
    #[arg(long, default_value = "oblate report")]
    title: String,
}

/// Writes the page.
pub fn run(args: &Args, common: &Common, out: &mut Output<'_>) -> Result<Exit> {
    refuse_existing(&args.out, args.force)?;
    render_report(&args.title, &run_folders(&args.runs), &args.out)?;
    if common.json {
        out.json(&serde_json::json!({"report": shown(&args.out)}))?;
    } else {
        out.line(&format!("{}", args.out.display()))?;
    }
    Ok(Exit::Done)
}
