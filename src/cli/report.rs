//! `oblate report`.

use super::exit::Exit;
use super::options::{JsonFlag, parsed, refuse_existing, write_file};
use super::output::{Output, note, shown};
use super::run_folders::{finished, run_folders};
use crate::error::Result;
use crate::report::FigureFormat;
use crate::run::{Rendered, render_report};
use std::path::PathBuf;

/// Flags of `oblate report`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate report runs/track_nested runs/track_pt --format svg,pdf --out report.html\n\n\
Each figure is also written into its run folder, if that is writable."
)]
pub struct Args {
    /// Finished runs; unfinished ones, and files and folders that are no runs, are skipped with a note
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The page to write
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Replace the page if it exists
    #[arg(long)]
    force: bool,
    /// Formats of the figures in the run folders, with commas or repeated: svg, pdf
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', default_value = "svg", value_parser = parsed::<FigureFormat>)]
    format: Vec<FigureFormat>,
    /// Title of the page
    #[arg(long, default_value = "oblate report")]
    title: String,
    #[command(flatten)]
    output: JsonFlag,
}

/// Writes the page.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    refuse_existing(&args.out, args.force)?;
    let runs = finished(&run_folders(&args.runs));
    let rendered = render_report(&args.title, &runs, &args.format, &[])?;
    write_file(&args.out, rendered.page.as_bytes(), args.force)?;
    tell_without_figures(&rendered);
    if args.output.json {
        out.json(&serde_json::json!({"report": shown(&args.out)}))?;
    } else {
        out.line(&format!("{}", args.out.display()))?;
    }
    Ok(Exit::Done)
}

/// Says which run folders have no figures.
pub fn tell_without_figures(rendered: &Rendered) {
    for folder in &rendered.without_figures {
        note(&format!(
            "{}: not writable, so that its figures are on the page alone",
            folder.display()
        ));
    }
}
