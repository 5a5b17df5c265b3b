//! `oblate report`.

use super::Exit;
use super::options::Common;
use crate::error::Result;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Flags of `oblate report`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Finished runs
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The page to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace a page that is there
    #[arg(long)]
    force: bool,
    /// Title of the page
    #[arg(long, default_value = "oblate report")]
    title: String,
}
pub fn run(args: &Args, _: &Common, _out: &mut dyn Write) -> Result<Exit> {
    super::options::refuse_existing(&args.out, args.force)?;
    write(&args.title, &args.runs, &args.out)?;
    Ok(Exit::Done)
}
pub fn write(_title: &str, _folders: &[PathBuf], _page: &Path) -> Result<()> {
    Ok(())
}
