//! The fits of a study by Slurm: array jobs of one fit each, submitted, watched, submitted again, and gathered.
//!
//! Nothing but the queue and the run folders says how far the fits are: a study that is begun again finds its jobs by their name.

use super::fits::{Outcome, one_fit};
use super::plan::PlannedFit;
use super::watch::{FitsSoFar, Pace, Watcher};
use crate::config::SlurmSettings;
use crate::error::{Error, Result};
use oblate_samplers::checkpoint::hash;
use oblate_samplers::files::write_atomically;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Fits of one array job. Slurm allows 1,000 unless its administrator chooses another number.
const FITS_OF_A_JOB: usize = 1_000;

/// How often the queue is asked before that it does not answer, as while Slurm restarts, is an error.
const MAX_TRIES: usize = 20;

/// Time between two looks at the interrupt.
const NAP: Duration = Duration::from_millis(200);

/// Largest part of a log that is searched for an error, from its end.
const MAX_LOG_BYTES: u64 = 1 << 16;

/// What a log's line with an error begins with.
const ERROR: &str = "error: ";

/// Gives fits to Slurm.
pub(super) struct Slurm<'a> {
    settings: &'a SlurmSettings,
    /// A shell command that does the fit whose number is in the variable `FIT`.
    task: &'a str,
    /// Folder of scripts and logs.
    folder: PathBuf,
    /// Name of the jobs, that of no other study.
    name: String,
}

/// Numbers of the fits in the queue.
#[derive(Debug, Default)]
struct Queue {
    all: BTreeSet<usize>,
    running: usize,
}

impl<'a> Slurm<'a> {
    /// For the study whose results are in `out`.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder of scripts and logs cannot be made.
    pub fn new(settings: &'a SlurmSettings, out: &Path, task: &'a str) -> Result<Self> {
        let folder = out.join("slurm");
        let remedy =
            "choose an `out` that is writable, on a disk that the cluster's computers share";
        let made = std::fs::create_dir_all(&folder).and_then(|()| std::fs::canonicalize(&folder));
        let folder = made.map_err(Error::io(&folder, remedy))?;
        let name = format!(
            "oblate-{:016x}",
            hash(folder.as_os_str().as_encoded_bytes())
        );
        Ok(Self {
            settings,
            task,
            folder,
            name,
        })
    }

    /// Submits the fits that have no result or go on from one and are not in the queue, until each is settled or its attempts are used up; then
    /// reads all back, and returns how each ended, in their order. An interrupt ends the watching, not the jobs.
    ///
    /// # Errors
    /// [`Error::Command`] if Slurm refuses a job or does not answer; [`Error::Sampler`] if a script cannot be written; as of [`one_fit`].
    pub fn all_fits(
        &self,
        fits: &[PlannedFit],
        command: &str,
        watcher: &dyn Watcher,
    ) -> Result<Vec<Outcome>> {
        let mut attempts = BTreeMap::new();
        let mut settled = vec![false; fits.len()];
        let mut pace = Pace::new();
        // Where there is no Slurm, that is an error at once.
        self.queue()?;
        loop {
            let Some(queue) = self.queue_in_time(watcher)? else {
                return Ok(interrupted(fits));
            };
            let mut so_far = FitsSoFar {
                of: fits.len(),
                running: queue.running,
                waiting: queue.all.len().saturating_sub(queue.running),
                ..FitsSoFar::default()
            };
            let mut to_submit = Vec::new();
            for (fit, settled) in fits.iter().zip(&mut settled) {
                *settled = *settled || fit.is_settled();
                if *settled {
                    so_far.done += 1;
                } else if !queue.all.contains(&fit.number) {
                    let attempt: &mut usize = attempts.entry(fit.number).or_default();
                    let again = *attempt < self.settings.attempts && self.error(fit).is_none();
                    if *attempt == 0 || again {
                        *attempt += 1;
                        to_submit.push(fit.number);
                    } else if self.has_result(fit) {
                        so_far.done += 1;
                    } else {
                        so_far.failed += 1;
                    }
                }
            }
            self.submit(&to_submit)?;
            so_far.waiting += to_submit.len();
            pace.estimate(&mut so_far);
            watcher.advanced(&so_far);
            if to_submit.is_empty() && queue.all.is_empty() {
                break;
            }
            if !self.rests(watcher) {
                return Ok(interrupted(fits));
            }
        }
        let gathered = fits.iter().map(|fit| {
            if fit.is_settled() {
                one_fit(fit, fits.len(), command, watcher)
            } else if self.has_result(fit) {
                // It would be sampled further, here.
                fit.read_back().map(Outcome::done)
            } else {
                Ok(Outcome::Failed(self.reason(fit)))
            }
        });
        gathered.collect()
    }

    /// Submits fits, one array job for each thousand numbers.
    fn submit(&self, numbers: &[usize]) -> Result<()> {
        let mut jobs: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for number in numbers {
            // An error of an earlier attempt is not one of this.
            let _ = std::fs::remove_file(self.log(*number));
            let (first, index) = place(*number);
            jobs.entry(first).or_default().push(index.to_string());
        }
        for (first, indices) in jobs {
            let script = self.folder.join(format!("fits_{first}.sh"));
            let text = format!(
                "#!/bin/sh\nFIT=$(({first} + SLURM_ARRAY_TASK_ID))\nexport FIT\n{}\n",
                self.task
            );
            write_atomically(&script, text.as_bytes())?;
            let mut array = format!("--array={}", indices.join(","));
            if let Some(at_once) = self.settings.at_once {
                array += &format!("%{at_once}");
            }
            let mut sbatch = Command::new("sbatch");
            // The last of two values counts: names, numbers and comments are how jobs are found again.
            sbatch
                .args(&self.settings.options)
                .arg(format!("--job-name={}", self.name))
                .arg(format!("--comment={first}"))
                .arg(array)
                .arg("--ntasks=1")
                .arg(format!("--output=fits_{first}_%a.log"))
                .arg("--chdir")
                .arg(&self.folder)
                .arg(&script);
            answer(
                &mut sbatch,
                "correct `options` in the table `[slurm]` of the study",
            )?;
        }
        Ok(())
    }

    /// The fits of this study that wait or run.
    fn queue(&self) -> Result<Queue> {
        let mut squeue = Command::new("squeue");
        squeue
            .args(["--me", "--noheader", "--array", "--format=%k %K %T"])
            .arg(format!("--name={}", self.name));
        let text = answer(&mut squeue, "repeat the study once Slurm answers")?;
        let mut queue = Queue::default();
        for line in text.lines() {
            let mut words = line.split_whitespace();
            let mut number = || words.next()?.parse::<usize>().ok();
            if let (Some(first), Some(index)) = (number(), number()) {
                queue.all.insert(first + index);
                queue.running += usize::from(words.next() != Some("PENDING"));
            }
        }
        Ok(queue)
    }

    /// The queue, also where Slurm does not answer for some time; none after an interrupt.
    fn queue_in_time(&self, watcher: &dyn Watcher) -> Result<Option<Queue>> {
        for _ in 1..MAX_TRIES {
            if let Ok(queue) = self.queue() {
                return Ok(Some(queue));
            }
            if !self.rests(watcher) {
                return Ok(None);
            }
        }
        self.queue().map(Some)
    }

    /// Waits until the next look at the queue; false after an interrupt.
    fn rests(&self, watcher: &dyn Watcher) -> bool {
        let end = Instant::now() + Duration::from_secs(self.settings.poll_seconds);
        while Instant::now() < end {
            if watcher.interrupted() {
                return false;
            }
            std::thread::sleep(NAP);
        }
        !watcher.interrupted()
    }

    fn log(&self, number: usize) -> PathBuf {
        let (first, index) = place(number);
        self.folder.join(format!("fits_{first}_{index}.log"))
    }

    /// Whether a fit whose attempts are used up has a result that stands: the last of them ended without an error.
    fn has_result(&self, fit: &PlannedFit) -> bool {
        fit.is_finished() && self.error(fit).is_none()
    }

    /// The error with which the last attempt at a fit ended, if it printed one.
    fn error(&self, fit: &PlannedFit) -> Option<String> {
        let text = end_of(&self.log(fit.number)).unwrap_or_default();
        let error = text.lines().rev().find_map(|line| line.strip_prefix(ERROR));
        error.map(str::to_owned)
    }

    /// Why a fit has no result.
    fn reason(&self, fit: &PlannedFit) -> String {
        self.error(fit).unwrap_or_else(|| {
            let log = self.log(fit.number);
            let text = end_of(&log).unwrap_or_default();
            let last = text.lines().rev().find(|line| !line.trim().is_empty());
            format!(
                "no result after {} attempts, the last of which ended with \"{}\" ({}); repeat the study to continue it",
                self.settings.attempts,
                last.unwrap_or_default().trim(),
                log.display()
            )
        })
    }
}

/// The first number of an array job, less one, and the index in it.
fn place(number: usize) -> (usize, usize) {
    let first = (number - 1) / FITS_OF_A_JOB * FITS_OF_A_JOB;
    (first, number - first)
}

fn interrupted(fits: &[PlannedFit]) -> Vec<Outcome> {
    fits.iter().map(|_| Outcome::Interrupted).collect()
}

/// What a command prints.
///
/// # Errors
/// [`Error::Command`] if it cannot be started or fails.
fn answer(command: &mut Command, remedy: &'static str) -> Result<String> {
    let program = command.get_program().to_string_lossy().into_owned();
    match command.output() {
        Err(error) => Err(Error::Command {
            program,
            message: error.to_string(),
            remedy: "work on a computer from which jobs are submitted to Slurm",
        }),
        Ok(output) if output.status.success() => {
            Ok(String::from_utf8_lossy(&output.stdout).into_owned())
        }
        Ok(output) => Err(Error::Command {
            program,
            message: String::from_utf8_lossy(&output.stderr)
                .trim()
                .replace('\n', " "),
            remedy,
        }),
    }
}

/// The end of a log.
fn end_of(path: &Path) -> std::io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MAX_LOG_BYTES)))?;
    let mut bytes = Vec::new();
    file.take(MAX_LOG_BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
