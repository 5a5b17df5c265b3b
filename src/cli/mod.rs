//! The command line, one file per subcommand. A subcommand parses its flags, calls the library and writes its results to standard output.

mod bridge;
mod calibration;
mod command_line;
mod compare;
mod doctor;
pub mod eta;
mod evaluate;
mod excerpt;
mod exit;
mod export;
mod fit;
mod folder;
mod man;
mod merge;
mod message;
mod mock;
mod next;
mod options;
mod orientation;
mod output;
mod population;
pub mod progress;
mod report;
mod run_folders;
mod selection;
mod senses;
mod set;
mod several;
mod signals;
mod stream;
mod study;

pub use exit::Exit;

use crate::error::{Error, Result};
use clap::{CommandFactory, Parser, Subcommand};
use command_line::CommandLine;
use excerpt::excerpt;
use message::{Flags, with_flags};
use output::{Output, note};
use std::ffi::OsString;
use std::io::Write;

/// The shapes of dark-matter haloes from the projected tracks of stellar streams.
#[derive(Parser, Debug)]
#[command(name = "oblate", version, about, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// Draws mock streams from the prior or a population of q, and keeps those that meet the criteria of Chemaly et al. 2026
    Mock(mock::Args),
    /// Estimates which fraction of streams meets the criteria of mocks at each q, to correct a population for it
    Selection(selection::Args),
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
    /// Ranks the true values of mocks in their fits: whether intervals contain them as often as they should
    Calibration(calibration::Args),
    /// Samples the population of q of finished fits into a run folder
    Population(population::Args),
    /// Compares the minor axes of the haloes of finished fits with the line of sight or with the disc: isotropic, aligned, or a mixture
    Orientation(orientation::Args),
    /// Writes the draws of a run as a table, ECSV or FITS
    Export(export::Args),
    /// Writes one self-contained HTML page of runs, and each of its figures
    Report(report::Args),
    /// Runs a study: mocks or tracks, their fits, a population and a report; it can be repeated to continue
    Run(study::Args),
    /// Describes this machine: versions, instruction set, threads, speed, and how long a fit will take
    Doctor(doctor::Args),
    /// Prints completions for a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Prints the manual page, or writes those of all subcommands into a folder
    Man(man::Args),
}

/// The definition of the command line for clap: every subcommand with its flags.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// The message of an error of the command line `args`: the library's own, and which flags help.
#[must_use]
pub fn message(error: &Error, args: &[OsString]) -> String {
    with_flags(error, &Flags::of(command(), args))
}

/// Runs the command line `args` (the first is the program's name) with `out` as standard output. An error is written to
/// standard error.
pub fn run(args: &[OsString], out: &mut dyn Write) -> Exit {
    answer(args, &mut Output::new(out)).unwrap_or_else(|error| {
        note(&format!("error: {}", message(&error, args)));
        if let Some(lines) = excerpt(&error) {
            note(&lines);
        }
        Exit::from_error(&error)
    })
}

fn answer(args: &[OsString], out: &mut Output<'_>) -> Result<Exit> {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(wrong) if wrong.use_stderr() => {
            let _ = wrong.print();
            return Ok(Exit::Usage);
        }
        // Help and the version are results.
        Err(asked) => {
            out.settle(asked.print())?;
            return Ok(Exit::Done);
        }
    };
    let line = CommandLine::of(args);
    match &cli.verb {
        Verb::Mock(a) => mock::run(a, out),
        Verb::Selection(a) => selection::run(a, out),
        Verb::Stream(a) => stream::run(a, out),
        Verb::Evaluate(a) => evaluate::run(a, &mut std::io::stdin().lock(), out),
        Verb::Fit(a) => fit::run(a, &line, out),
        Verb::Bridge(a) => bridge::run(a, &line, out),
        Verb::Merge(a) => merge::run(a, &line, out),
        Verb::Compare(a) => compare::run(a, out),
        Verb::Calibration(a) => calibration::run(a, out),
        Verb::Population(a) => population::run(a, &line, out),
        Verb::Orientation(a) => orientation::run(a, out),
        Verb::Export(a) => export::run(a, out),
        Verb::Report(a) => report::run(a, out),
        Verb::Run(a) => study::run(a, &line, out),
        Verb::Doctor(a) => doctor::run(a, out),
        Verb::Completions { shell } => {
            // Into memory first: clap's generator panics where it cannot write.
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut command(), "oblate", &mut script);
            out.bytes(&script)?;
            Ok(Exit::Done)
        }
        Verb::Man(a) => man::run(a, command(), out),
    }
}
