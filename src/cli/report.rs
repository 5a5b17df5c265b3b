//! `oblate report`.

use super::exit::Exit;
use super::options::{Common, refuse_existing};
use super::output::{Output, note, shown};
use crate::error::Result;
use crate::run::{RunFolder, render_report};
use std::path::{Path, PathBuf};

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
    render_report(&args.title, &runs(&args.runs), &args.out)?;
    if common.json {
        out.json(&serde_json::json!({"report": shown(&args.out)}))?;
    } else {
        out.line(&format!("{}", args.out.display()))?;
    }
    Ok(Exit::Done)
}

/// The paths that are run folders, so that a pattern such as `runs/*` can be given. A path where nothing is stays, and is an error; so do
/// all where none is a run.
fn runs(given: &[PathBuf]) -> Vec<PathBuf> {
    let is_other = |path: &Path| path.exists() && RunFolder::open(path).is_err();
    let (others, runs): (Vec<PathBuf>, Vec<PathBuf>) =
        given.iter().cloned().partition(|path| is_other(path));
    if runs.is_empty() {
        return given.to_vec();
    }
    for path in others {
        note(&format!("skipped: {} is no run folder", path.display()));
    }
    runs
}
