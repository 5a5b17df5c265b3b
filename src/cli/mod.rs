//! The command line: one file per verb. Verbs parse, call the library, and write to the writer they are handed.

mod boost;
mod compare;
mod evaluate;
mod fit;
mod merge;
mod mock;
mod options;
mod population;
mod progress;
mod refine;
mod report;
mod stream;
mod study;

use crate::error::{Error, Result};
use clap::{CommandFactory, Parser, Subcommand};
use options::Common;
use std::io::Write;

/// What a command ended as: the process's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: done.
    Done,
    /// 1: it failed, or a run has not converged.
    Failed,
    /// 2: bad usage or input.
    Usage,
    /// 130: interrupted, with a checkpoint written.
    Interrupted,
}

impl Exit {
    /// The number for the operating system.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failed => 1,
            Self::Usage => 2,
            Self::Interrupted => 130,
        }
    }

    /// The exit that an error deserves: what the user can mend in the command or its inputs is usage.
    #[must_use]
    pub fn of(error: &Error) -> Self {
        use oblate_samplers::Error as S;
        match error {
            Error::Sampler(S::Interrupted) => Self::Interrupted,
            Error::Sampler(S::Fatal(_) | S::Infinite { .. } | S::Io { .. }) | Error::NoTrack(_) => {
                Self::Failed
            }
            Error::Io { source, .. } if source.kind() == std::io::ErrorKind::StorageFull => {
                Self::Failed
            }
            _ => Self::Usage,
        }
    }
}

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
    /// Draws mock streams from the prior or a population of q, and keeps those that meet the paper's criteria
    Mock(mock::Args),
    /// Makes one stream from parameters: its track and what the model says about itself
    Stream(stream::Args),
    /// Evaluates ln L (and its gradient) for parameters given as JSON lines on stdin
    Evaluate(evaluate::Args),
    /// Samples the posterior of one stream into a run folder
    Fit(fit::Args),
    /// Makes more effective draws of a finished fit by importance sampling, or says that it cannot
    Boost(boost::Args),
    /// Carries a finished fit to a finer model of its stream: most of the work at a fraction of the price
    Refine(refine::Args),
    /// Makes one fit of nested fits of one track from several seeds
    Merge(merge::Args),
    /// Says whether runs agree: evidence, marginals, mode weights, cost
    Compare(compare::Args),
    /// Samples a population of q from finished fits into a run folder
    Population(population::Args),
    /// Draws one self-contained HTML page and every figure
    Report(report::Args),
    /// Runs a whole study: mocks or tracks, fits, population, report; resumable
    Run(study::Args),
    /// Prints a shell's completions
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
/// What the verb refuses; the caller prints it and exits with [`Exit::of`] it.
pub fn run(args: &[String], out: &mut dyn Write) -> Result<Exit> {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) => {
            let exit = if e.use_stderr() {
                Exit::Usage
            } else {
                Exit::Done
            };
            // Clap writes help to stdout and mistakes to stderr; a closed pipe is nobody's failure.
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
        Verb::Boost(a) => boost::run(a, &cli.common, &command, out),
        Verb::Refine(a) => refine::run(a, &cli.common, &command, out),
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
