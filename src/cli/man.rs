//! `oblate man`.

use super::exit::Exit;
use super::options::write_file;
use super::output::Output;
use crate::error::{Error, Result};
use clap::Command;
use std::path::PathBuf;

/// Flags of `oblate man`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate man --out ~/.local/share/man/man1 --force\n\n\
The folder gets oblate.1 and a page for each subcommand, such as oblate-fit.1."
)]
pub struct Args {
    /// Write all pages into this folder instead, as files
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long, requires = "out")]
    force: bool,
}

/// Prints the first page of the command line `first`, or writes all of them.
pub fn run(args: &Args, mut first: Command, out: &mut Output<'_>) -> Result<Exit> {
    first.build();
    let Some(folder) = &args.out else {
        out.bytes(&page(first)?)?;
        return Ok(Exit::Done);
    };
    std::fs::create_dir_all(folder).map_err(Error::io(
        folder,
        "choose a folder whose parent is writable",
    ))?;
    let others: Vec<Command> = first.get_subcommands().cloned().collect();
    for verb in std::iter::once(first).chain(others) {
        // The page of the help is that of clap.
        if verb.get_name() == "help" {
            continue;
        }
        let name = verb
            .get_display_name()
            .unwrap_or(verb.get_name())
            .to_owned();
        let path = folder.join(format!("{name}.1"));
        write_file(&path, &page(verb)?, args.force)?;
        out.line(&path.display().to_string())?;
    }
    Ok(Exit::Done)
}

/// A page in roff.
fn page(verb: Command) -> Result<Vec<u8>> {
    let mut page = Vec::new();
    let written = clap_mangen::Man::new(verb).render(&mut page);
    written.map_err(|source| Error::Output { source })?;
    Ok(page)
}
