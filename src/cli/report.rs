//! `oblate report`.

use super::exit::Exit;
use super::options::{Common, refuse_existing, say, say_json};
use crate::error::Result;
use crate::run::render_report;
use std::io::Write;
use std::path::PathBuf;

/// Flags of `oblate report`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate report runs/track_nested runs/track_pt --out report.html\n\n\
Each figure is also written as SVG into its run folder."
)]
pub struct Args {
    /// Finished runs
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
pub fn run(args: &Args, common: &Common, out: &mut dyn Write) -> Result<Exit> {
    refuse_existing(&args.out, args.force)?;
    render_report(&args.title, &args.runs, &args.out)?;
    if common.json {
        say_json(out, &serde_json::json!({"report": args.out}))?;
    } else {
        say(out, &format!("{}", args.out.display()))?;
    }
    Ok(Exit::Done)
}
