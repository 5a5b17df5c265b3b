//! The command line, one file per verb. A verb parses its flags, calls the library and writes to the given writer.

mod bridge;
mod compare;
mod evaluate;
mod exit;
mod fit;
mod folder;
mod merge;
mod message;
mod mock;
mod options;
mod population;
mod progress;
mod report;
mod stream;
mod study;

pub use exit::Exit;
pub use message::message;

use crate::error::Result;
use clap::{CommandFactory, Parser, Subcommand};
use options::Common;
use std::io::Write;

/// The shapes of dark-matter haloes from the projected tracks of stellar streams.
#[derive(Parser, Debug)]
#[command(name = "oblate", version, about, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
    #[command(flatten)]
    common: Common,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// Draws mock streams from the prior or a population of q, and keeps those that meet the criteria of Chemaly et al. 2026
    Mock(mock::Args),
    /// Computes one stream from parameters: its track, and diagnostics of the model
    Stream(stream::Args),
    /// Evaluates ln L (and its gradient) for parameters given as JSON lines on standard input
    Evaluate(evaluate::Args),
    /// Samples the posterior of one stream into a run folder
    Fit(fit::Args),
    /// Continues a finished fit to a finer model of its stream, by sequential Monte Carlo
    Bridge(bridge::Args),
    /// Merges nested fits of one track with several seeds into one fit
    Merge(merge::Args),
    /// Compares runs: evidence, marginals, mode weights, cost
    Compare(compare::Args),
    /// Samples the population of q of finished fits into a run folder
    Population(population::Args),
    /// Writes one self-contained HTML page of runs, and each of its figures
    Report(report::Args),
    /// Runs a study: mocks or tracks, their fits, a population and a report; it can be repeated to continue
    Run(study::Args),
    /// Prints completions for a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Prints the manual page
    Man,
}

/// Runs the command line `args` (the first is the program's name) with `out` as standard output.
///
/// # Errors
/// Those of the verb's library function; the caller prints the error and exits with [`Exit::of`].
pub fn run(args: &[String], out: &mut dyn Write) -> Result<Exit> {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) => {
            let exit = if e.use_stderr() {
                Exit::Usage
            } else {
                Exit::Done
            };
            // Clap writes help to standard output and errors to standard error; a closed pipe is no failure.
            let _ = e.print();
            return Ok(exit);
        }
    };
    let command = args.get(1..).unwrap_or_default().join(" ");
    cli.common.in_pool(|| match &cli.verb {
        Verb::Mock(a) => mock::run(a, &cli.common, out),
        Verb::Stream(a) => stream::run(a, &cli.common, out),
        Verb::Evaluate(a) => evaluate::run(a, &cli.common, &mut std::io::stdin().lock(), out),
        Verb::Fit(a) => fit::run(a, &cli.common, &command, out),
        Verb::Bridge(a) => bridge::run(a, &cli.common, &command, out),
        Verb::Merge(a) => merge::run(a, &cli.common, &command, out),
        Verb::Compare(a) => compare::run(a, &cli.common, out),
        Verb::Population(a) => population::run(a, &cli.common, &command, out),
        Verb::Report(a) => report::run(a, &cli.common, out),
        Verb::Run(a) => study::run(a, &cli.common, &command, out),
        Verb::Completions { shell } => {
            clap_complete::generate(*shell, &mut Cli::command(), "oblate", &mut *out);
            Ok(Exit::Done)
        }
        Verb::Man => {
            let page = clap_mangen::Man::new(Cli::command());
            page.render(&mut *out).map_err(options::output)?;
            Ok(Exit::Done)
        }
    })
}
