//! `oblate export`.

use super::exit::Exit;
use super::options::{JsonFlag, refuse_existing, write_file};
use super::output::{Output, shown};
use crate::error::Result;
use crate::posterior::{DrawTable, TableFormat};
use crate::run::RunFolder;
use serde_json::json;
use std::path::PathBuf;

/// Flags of `oblate export`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate export runs/track --out draws.fits\n\n\
The name of the file chooses the format: .ecsv (text, for astropy and any reader of CSV) or .fits (a binary table, for TOPCAT and astropy)."
)]
pub struct Args {
    /// A finished run
    run: PathBuf,
    /// The table to write; its name ends in .ecsv or .fits
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    output: JsonFlag,
}

/// Writes the draws of a run as a table.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    let format = TableFormat::of(&args.out)?;
    refuse_existing(&args.out, args.force)?;
    let stored = RunFolder::open(&args.run)?.read()?;
    let table = DrawTable::new(&stored.run, &stored.summary);
    write_file(&args.out, &table.bytes(format)?, args.force)?;
    if args.output.json {
        let columns: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        out.json(&json!({"table": shown(&args.out), "draws": table.len(), "columns": columns}))?;
    } else {
        out.line(&format!(
            "{}: {} draws of equal weight, {} columns",
            args.out.display(),
            table.len(),
            table.columns.len()
        ))?;
    }
    Ok(Exit::Done)
}
