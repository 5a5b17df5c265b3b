//! The common part of the subcommands that fill a run folder: its flags, the work under a progress display, and the
//! printed result.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::next::Step;
use super::options::{JsonFlag, LimitFlags, WorkFlags};
use super::output::{Output, note};
use super::progress::{Progress, interrupt};
use crate::error::{Error, Result};
use crate::inference::Fit;
use crate::run::{Destination, IfExists, Monitor, Monitored};
use oblate_samplers::output::Status;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Flags of a run folder.
#[derive(clap::Args, Debug)]
pub struct FolderFlags {
    /// The run folder to make
    #[arg(long, value_name = "FOLDER", required = true)]
    out: Option<PathBuf>,
    /// Replace the run folder if it exists
    #[arg(long, conflicts_with = "resume")]
    force: bool,
    /// Continue the run in the folder from its checkpoint
    #[arg(long)]
    resume: bool,
    /// Exit with 0 even if the run has not converged; a population takes fits that have not
    #[arg(long)]
    pub allow_unconverged: bool,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

impl FolderFlags {
    /// Does `work` into the folder under a progress display called `label`, prints the result, says what `next` proposes after it, and
    /// chooses the exit code.
    ///
    /// # Errors
    /// Those of `work`; [`Error::Output`] if standard output cannot be written.
    pub fn fill(
        &self,
        label: &str,
        command: &CommandLine,
        limits: &LimitFlags,
        out: &mut Output<'_>,
        work: impl FnOnce(Destination<'_>, &mut Monitor<'_>) -> Result<Fit>,
        next: impl FnOnce(&Fit, &Path) -> Result<Vec<Step>>,
    ) -> Result<Exit> {
        let text = command.without_folder_flags().text();
        let destination = self.begin(limits, &text)?;
        let mut progress = Progress::new(label, self.work.quiet);
        let done = work(destination, &mut progress.monitor(limits));
        let stopped_at = progress.current().to_owned();
        // The display ends before anything else is written.
        drop(progress);
        let fit = match done {
            // Stopped before the first result, of which there is no part.
            Err(Error::Sampler(oblate_samplers::Error::Interrupted)) => {
                return Ok(interrupted(command, &stopped_at));
            }
            done => done?,
        };
        if fit.run.status == Status::Interrupted {
            return Ok(interrupted(command, &stopped_at));
        }
        if self.output.json {
            out.json(&fit.summary)?;
        } else {
            out.line(&format!(
                "{}\nin {}",
                fit.summary,
                destination.folder.display()
            ))?;
        }
        for step in next(&fit, destination.folder)? {
            step.tell();
        }
        Ok(Exit::from_converged(
            fit.summary.converged || self.allow_unconverged,
        ))
    }

    /// Does several runs in the folder, each under a progress display of its own; `None` if one was interrupted.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn fill_several<T>(
        &self,
        command: &CommandLine,
        limits: &LimitFlags,
        work: impl FnOnce(Destination<'_>, &mut Monitored<'_>) -> Result<Option<T>>,
    ) -> Result<Option<T>> {
        let text = command.without_folder_flags().text();
        let destination = self.begin(limits, &text)?;
        work(destination, &mut |label, work| {
            let mut progress = Progress::new(label, self.work.quiet);
            work(&mut progress.monitor(limits))
        })
    }

    /// Whether the result is to be JSON.
    pub fn json(&self) -> bool {
        self.output.json
    }

    /// Checks the flags and starts the threads; `command` is the command line for the summary.
    fn begin<'a>(&'a self, limits: &LimitFlags, command: &'a str) -> Result<Destination<'a>> {
        limits.check()?;
        self.work.start_threads()?;
        let Some(folder) = &self.out else {
            return Err(Error::Setting {
                key: "--out".to_owned(),
                value: "missing".to_owned(),
                remedy: "name the run folder to make".to_owned(),
            });
        };
        Ok(Destination {
            folder,
            if_exists: self.if_exists(),
            command,
        })
    }

    fn if_exists(&self) -> IfExists {
        if self.force {
            IfExists::Replace
        } else if self.resume {
            IfExists::Resume
        } else {
            IfExists::Refuse
        }
    }
}

/// Says at which point a run was stopped, and how it is continued.
pub fn interrupted(command: &CommandLine, stopped_at: &str) -> Exit {
    let (cause, exit) = if interrupt().load(Ordering::Relaxed) {
        ("Interrupted", Exit::Interrupted)
    } else {
        ("The time limit was reached", Exit::Failed)
    };
    note(&format!(
        "{cause} before the result, at {stopped_at}; the work so far is kept."
    ));
    Step::resume(command).tell();
    exit
}
