//! Progress of long work on standard error: a line that is renewed on a terminal, otherwise a line for each stage and one a minute.

use super::eta::{Trend, duration};
use super::options::LimitFlags;
use super::output::note;
use super::signals::on_request;
use crate::run::{FitsSoFar, Monitor};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use oblate_samplers::{Event, Observer};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines of plain text.
const LINE_EVERY: Duration = Duration::from_secs(60);

/// Time between two turns of the spinner, which also renews the time so far.
const TICK: Duration = Duration::from_millis(250);

/// Signals so soon after the first are of the same request: `timeout` sends one to the process and one to its group.
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// The interrupt flag of the process. The first request to stop sets it, a second one ends the process at once.
pub fn interrupt() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    Arc::clone(FLAG.get_or_init(|| {
        let flag = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&flag);
        let mut first = None;
        // If there can be no handler, Ctrl-C ends the process, which can be resumed from its last checkpoint.
        let _ = on_request(move || {
            seen.store(true, Ordering::Relaxed);
            let first = first.get_or_insert_with(Instant::now);
            if first.elapsed() > ONE_REQUEST {
                std::process::exit(130);
            }
        });
        flag
    }))
}

/// An observer that shows one run: its stage, how far that is, how fast, and how long it still takes.
pub struct Progress {
    label: String,
    bar: Option<ProgressBar>,
    plain: bool,
    last: Instant,
    /// How many runs share the lines of plain text.
    beside: Arc<AtomicU32>,
    stage: Stage,
    /// The convergence checks that a run had open when it last looked at them.
    open: Option<Open>,
    current: String,
}

/// The progress of several runs, which may work at once: one line for each, below one for all fits.
pub struct Board {
    bars: Option<MultiProgress>,
    all: Option<ProgressBar>,
    plain: bool,
    running: Arc<AtomicU32>,
    /// The numbers of the last line of plain text, and when it was written.
    last: Mutex<Option<([usize; 4], Instant)>>,
}

impl Board {
    /// Without a run yet; a quiet one shows nothing.
    pub fn new(quiet: bool) -> Self {
        let terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
        Self {
            bars: (terminal && !quiet).then(MultiProgress::new),
            all: None,
            plain: !terminal && !quiet,
            running: Arc::new(AtomicU32::new(1)),
            last: Mutex::default(),
        }
    }

    /// With a line for all fits.
    #[must_use]
    pub fn of_fits(quiet: bool) -> Self {
        let mut board = Self::new(quiet);
        board.all = board.bars.as_ref().map(|bars| {
            let bar = bars.add(ProgressBar::new_spinner());
            if let Ok(style) = ProgressStyle::with_template("{msg}") {
                bar.set_style(style);
            }
            bar
        });
        board
    }

    /// The line of one more run.
    pub fn progress(&self, label: &str) -> Progress {
        let bar = self.bars.as_ref().map(|bars| {
            let bar = bars.add(ProgressBar::new_spinner());
            if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix} [{elapsed}] {msg}")
            {
                bar.set_style(style);
            }
            bar.set_prefix(label.to_owned());
            bar.enable_steady_tick(TICK);
            bar
        });
        Progress::with(label, bar, self.plain, Arc::clone(&self.running))
    }

    /// Shows how far all fits are.
    pub fn advanced(&self, fits: &FitsSoFar) {
        let running = u32::try_from(fits.running).unwrap_or(u32::MAX);
        self.running.store(running.max(1), Ordering::Relaxed);
        let text = all_fits(fits);
        if let Some(bar) = &self.all {
            bar.set_message(text);
        } else if self.plain {
            let numbers = [fits.done, fits.failed, fits.running, fits.waiting];
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            let is_new =
                |(told, at): &([usize; 4], Instant)| *told != numbers || at.elapsed() >= LINE_EVERY;
            if last.as_ref().is_none_or(is_new) {
                note(&text);
                *last = Some((numbers, Instant::now()));
            }
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        if let Some(bar) = &self.all {
            bar.finish_and_clear();
        }
    }
}

/// How far all fits are, in words.
fn all_fits(fits: &FitsSoFar) -> String {
    let mut text = format!("fits: {} of {} done", fits.done, fits.of);
    if fits.failed > 0 {
        text += &format!(", {} failed", fits.failed);
    }
    if fits.running > 0 {
        text += &format!(", {} at work", fits.running);
    }
    if fits.waiting > 0 {
        text += &format!(", {} in the queue", fits.waiting);
    }
    if let Some(left) = fits.seconds_left.filter(|left| *left > 0.0) {
        text += &format!(", the others end in about {}", duration(left));
    }
    text
}

/// Open convergence checks.
struct Open {
    names: Vec<String>,
    /// Scans or batches that the run needs, if its numbers grow as before.
    needed: f64,
}

impl Open {
    /// Their names, to follow other words.
    fn text(&self) -> String {
        format!(", open checks: {}", self.names.join(", "))
    }
}

/// The present stage.
struct Stage {
    name: String,
    /// What its present numbers belong to: a sampler's phase and round.
    part: String,
    began: Instant,
    done: Trend,
    left: Vec<Trend>,
}

impl Stage {
    fn new(name: String) -> Self {
        Self {
            name,
            part: String::new(),
            began: Instant::now(),
            done: Trend::default(),
            left: Vec::new(),
        }
    }
}

/// What an event says about its stage.
struct Report {
    /// The part of the stage in which numbers can be compared.
    part: String,
    /// How far it is.
    text: String,
    /// What counts its work, and how many so far.
    done: Option<(&'static str, f64)>,
    /// What may end the stage, whichever comes first: work that is left, in any unit, and the words before the time that it takes.
    left: Vec<(f64, &'static str)>,
}

impl Progress {
    /// For a run called `label`; a quiet one shows nothing.
    #[must_use]
    pub fn new(label: &str, quiet: bool) -> Self {
        Board::new(quiet).progress(label)
    }

    fn with(label: &str, bar: Option<ProgressBar>, plain: bool, beside: Arc<AtomicU32>) -> Self {
        Self {
            label: label.to_owned(),
            bar,
            plain,
            last: Instant::now(),
            beside,
            stage: Stage::new(String::new()),
            open: None,
            current: "the beginning".to_owned(),
        }
    }

    /// A monitor with this observer and the interrupt flag of the process.
    pub fn monitor(&mut self, limits: &LimitFlags) -> Monitor<'_> {
        Monitor {
            interrupt: interrupt(),
            checkpoint_every: Duration::from_secs(limits.checkpoint_every),
            max_wall: limits.max_minutes.map_or(Duration::MAX, |minutes| {
                Duration::from_secs(minutes.saturating_mul(60))
            }),
            observer: self,
        }
    }

    /// What was shown last: the stage and how far it was.
    #[must_use]
    pub fn current(&self) -> &str {
        &self.current
    }

    fn begin(&mut self, name: String) {
        self.stage = Stage::new(name);
        self.open = None;
        self.current.clone_from(&self.stage.name);
        if let Some(bar) = &self.bar {
            bar.set_message(self.current.clone());
        } else if self.plain {
            self.last = Instant::now();
            note(&format!("{}: {}", self.label, self.current));
        }
    }

    fn advance(&mut self, report: Report) {
        let stage = &mut self.stage;
        if stage.part != report.part {
            *stage = Stage {
                part: report.part,
                ..Stage::new(std::mem::take(&mut stage.name))
            };
        }
        let seconds = stage.began.elapsed().as_secs_f64();
        let mut parts = Vec::new();
        // What matters most comes first: a terminal cuts the line off at its width.
        stage.left.resize_with(report.left.len(), Trend::default);
        let ends = stage.left.iter_mut().zip(report.left);
        let ends = ends.filter_map(|(trend, (left, what))| {
            trend.note(seconds, left);
            Some((trend.seconds_to_zero()?, what))
        });
        if let Some((left, what)) = ends.min_by(|a, b| a.0.total_cmp(&b.0)) {
            parts.push(format!("{what} {}", duration(left)));
        }
        if let Some((what, done)) = report.done {
            stage.done.note(seconds, done);
            let rate = stage.done.rate().map(|rate| {
                let digits = if rate < 10.0 { 2 } else { 0 };
                format!("{rate:.digits$} {what}/s")
            });
            parts.extend(rate);
        }
        parts.push(report.text);
        let mut text = parts.join(", ");
        if !stage.name.is_empty() {
            text = format!("{}: {text}", stage.name);
        }
        self.current = text;
        if let Some(bar) = &self.bar {
            bar.set_message(self.current.clone());
        } else if self.plain && self.last.elapsed() >= self.line_every() {
            self.last = Instant::now();
            note(&format!("{}: {}", self.label, self.current));
        }
    }

    fn line_every(&self) -> Duration {
        LINE_EVERY * self.beside.load(Ordering::Relaxed)
    }

    fn warn(&self, message: &str) {
        let line = format!("{}: warning: {message}", self.label);
        if let Some(bar) = &self.bar {
            bar.println(line);
        } else if self.plain {
            note(&line);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Progress {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Stage { number, of, name } => {
                self.begin(format!("stage {number} of {of}, {name}"));
            }
            Event::Warning { message } => self.warn(message),
            Event::Look {
                scans,
                open,
                needed,
            } => {
                self.open = Some(Open {
                    names: open.clone(),
                    needed: *scans as f64 * needed,
                });
            }
            Event::Batch {
                number,
                of,
                open,
                needed,
                ..
            } => {
                // At least one more, and no more than there may be.
                let batches = *number as f64;
                self.open = Some(Open {
                    names: open.clone(),
                    needed: (batches * needed)
                        .clamp(batches + 1.0, (batches + 1.0).max(*of as f64)),
                });
            }
            other => {
                if let Some(report) = report(other, self.open.as_ref()) {
                    self.advance(report);
                }
            }
        }
        ControlFlow::Continue(())
    }
}

/// What an event of a sampler says; none if it says nothing about how far the work is.
fn report(event: &Event, open: Option<&Open>) -> Option<Report> {
    match event {
        Event::Advanced { done, of } => Some(Report {
            part: "count".to_owned(),
            text: format!("{done} of {of}"),
            done: None,
            left: vec![((of - done) as f64, "ends in")],
        }),
        Event::Smc { beta, ln_z, calls } => Some(Report {
            part: "SMC".to_owned(),
            text: format!("SMC, beta {beta:.2e} of 1, ln Z {ln_z:.2}, {calls} calls"),
            done: Some(("calls", *calls as f64)),
            // The steps of SMC are about equal in ln beta.
            left: vec![(-beta.ln(), "SMC ends in")],
        }),
        _ => nested_iteration(event, open)
            .or_else(|| tempered_scan(event, open))
            .or_else(|| further_step(event))
            .or_else(|| bridge_step(event)),
    }
}

/// What an iteration of a nested run says, in its first batch or in a later one; none for other events.
fn nested_iteration(event: &Event, open: Option<&Open>) -> Option<Report> {
    match event {
        Event::Nested {
            ln_x,
            ln_z,
            ln_z_error,
            delta_ln_z,
            dlnz,
            calls,
            batches,
            ..
        } if *batches < 1.0 => Some(Report {
            part: "nested".to_owned(),
            text: format!(
                "ln X {ln_x:.1}, ln Z {ln_z:.2} +- {ln_z_error:.2}, delta ln Z {delta_ln_z:.3} of {dlnz}, {calls} calls"
            ),
            done: Some(("calls", *calls as f64)),
            left: vec![nested_left(*delta_ln_z, *dlnz)],
        }),
        Event::Nested {
            ln_z,
            calls,
            batches,
            ..
        } => {
            let mut text = format!(
                "batch {:.0}, ln Z {ln_z:.2}, {calls} calls",
                batches.floor() + 1.0
            );
            let mut left = (batches.floor() + 1.0 - batches, "the batch ends in");
            if let Some(open) = open {
                text += &open.text();
                left = (open.needed - batches, "ends in about");
            }
            Some(Report {
                part: "batches".to_owned(),
                text,
                done: Some(("calls", *calls as f64)),
                left: vec![left],
            })
        }
        _ => None,
    }
}

/// What a scan of a tempered run says; none for other events.
fn tempered_scan(event: &Event, open: Option<&Open>) -> Option<Report> {
    let Event::Tempered {
        round,
        scan,
        scans,
        communication_barrier,
        round_trips,
        ln_z,
        ..
    } = event
    else {
        return None;
    };
    let mut text = format!("round {round}, scan {} of {scans}", scan + 1);
    // Neither is known in the first round.
    if communication_barrier.is_finite() {
        text += &format!(", ln Z {ln_z:.2}, communication barrier {communication_barrier:.1}");
    }
    text += &format!(", {round_trips} round trips");
    let mut left = ((scans - scan - 1) as f64, "the round ends in");
    if let Some(open) = open {
        text += &open.text();
        // Without an end where the number of an open check is still zero.
        left = (
            left.0.max(open.needed - *scan as f64 - 1.0),
            "ends in at least",
        );
    }
    Some(Report {
        part: format!("round {round}"),
        text,
        done: Some(("scans", *scan as f64)),
        left: vec![left],
    })
}

/// What a further MCMC step of an SMC bridge at the fine likelihood says; none for other events.
fn further_step(event: &Event) -> Option<Report> {
    let Event::Bridge {
        further,
        of,
        batches,
        of_batches,
        ess: Some(ess),
        target_ess,
        ln_z,
        calls,
        ..
    } = event
    else {
        return None;
    };
    let mut left = vec![(target_ess - ess, "ends in about")];
    // Before the last batch nobody knows what those to come will take.
    if batches == of_batches {
        left.push(((of - further) as f64, "ends in at most"));
    }
    Some(Report {
        part: "further MCMC steps".to_owned(),
        text: format!(
            "batch {batches} of at most {of_batches}, further MCMC step {further} of at most {of}, ESS {ess:.0} of {target_ess}, ln Z {ln_z:.2}, {calls} calls"
        ),
        done: Some(("calls", *calls as f64)),
        left,
    })
}

/// What a step of an SMC bridge towards the fine likelihood says; none for other events.
fn bridge_step(event: &Event) -> Option<Report> {
    let Event::Bridge {
        fraction,
        batches,
        of_batches,
        ess: None,
        ln_z,
        calls,
        ..
    } = event
    else {
        return None;
    };
    Some(Report {
        part: "bridge".to_owned(),
        text: format!(
            "batch {batches} of at most {of_batches}, {:.0} % of the way, ln Z {ln_z:.2}, {calls} calls",
            100.0 * fraction
        ),
        done: Some(("calls", *calls as f64)),
        left: vec![(1.0 - fraction, "reaches the finer model in")],
    })
}

/// What is left of a nested run: at the end the remaining evidence falls by the same factor in equal times; before, while it is more than
/// one nat, it falls faster than in proportion to the time, so that the estimate is a lower bound.
fn nested_left(delta_ln_z: f64, dlnz: f64) -> (f64, &'static str) {
    if delta_ln_z > 1.0 {
        (delta_ln_z - 1.0 - dlnz.ln(), "ends in more than")
    } else {
        ((delta_ln_z / dlnz).ln().max(0.0), "ends in")
    }
}
