//! `oblate run`.

use super::command_line::CommandLine;
use super::eta::duration;
use super::exit::Exit;
use super::next::{Step, may_grow};
use super::options::{JsonFlag, LimitFlags, WorkFlags};
use super::output::{Output, note, shown};
use super::progress::{Board, interrupt};
use super::report::tell_without_figures;
use crate::config::{StudyConfig, read};
use crate::error::{Error, Result};
use crate::inference::Sampler;
use crate::posterior::{ScalingRow, Summary, compare, scaling_csv};
use crate::report::{self, Figure, FigureFormat};
use crate::run::{
    Cost, Executor, FitsSoFar, Monitor, RunFolder, Study, StudyResult, StudyRun, Watcher,
    render_report, report_path,
};
use clap::ValueEnum;
use oblate_samplers::Error as SamplerError;
use oblate_samplers::files::write_atomically;
use oblate_samplers::output::Status;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Flags of `oblate run`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  oblate run examples/quickstart.toml\n\n\
Run it again to continue after an interrupt, or to read the results back.")]
pub struct Args {
    /// The study (TOML)
    study: PathBuf,
    /// Folder of all results; overrides the study's `out`
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Who does the fits
    #[arg(long, value_enum, default_value_t = ExecutorName::Local)]
    executor: ExecutorName,
    /// Do only the fit of this number, from 1, and no population and no report: for other queues than Slurm's
    #[arg(long, value_name = "NUMBER", conflicts_with = "executor")]
    fit: Option<usize>,
    /// Exit with 0 even if a run has not converged
    #[arg(long)]
    allow_unconverged: bool,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

/// What is said of a study that was stopped.
const STOPPED: &str = "Stopped before the end; all work so far is kept.";

/// Who does the fits of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ExecutorName {
    /// This process, as many at once as it has threads
    Local,
    /// Slurm, as array jobs
    Slurm,
}

/// Shows the progress of a study.
struct Shown<'a> {
    board: Board,
    limits: &'a LimitFlags,
}

impl Watcher for Shown<'_> {
    fn monitored(
        &self,
        label: &str,
        work: &mut dyn FnMut(&mut Monitor<'_>) -> Result<()>,
    ) -> Result<()> {
        let mut progress = self.board.progress(label);
        work(&mut progress.monitor(self.limits))
    }

    fn advanced(&self, fits: &FitsSoFar) {
        self.board.advanced(fits);
    }

    fn interrupted(&self) -> bool {
        interrupt().load(Ordering::Relaxed)
    }
}

/// Runs a study and writes its report.
pub fn run(args: &Args, command: &CommandLine, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    args.limits.check()?;
    let mut config: StudyConfig = read(&args.study)?;
    if let Some(folder) = &args.out {
        config.out.clone_from(folder);
    }
    if config.tracks.is_none() && config.mocks.is_none() {
        return Err(Error::Syntax {
            path: args.study.clone(),
            line: None,
            message: "the study has neither tracks nor mocks".to_owned(),
            remedy: "give [tracks], [mocks] or both",
        });
    }
    let files_from = args.study.parent().unwrap_or(Path::new("."));
    let shown_fits = Shown {
        board: Board::of_fits(args.work.quiet),
        limits: &args.limits,
    };
    let result = done(args, &config, files_from, command, &shown_fits);
    drop(shown_fits);
    if let Err(Error::Sampler(SamplerError::Interrupted)) = result {
        // Before the first fit, and before any job of Slurm.
        return Ok(stopped(STOPPED, command));
    }
    let result = result.map_err(|error| match error {
        Error::InTable { .. } => Error::InFile {
            path: args.study.clone(),
            line: None,
            source: Box::new(error),
        },
        other => other,
    })?;
    if result.interrupted {
        let told = match args.executor {
            ExecutorName::Slurm => "Stopped watching; the jobs in Slurm's queue go on.",
            ExecutorName::Local => STOPPED,
        };
        return Ok(stopped(told, command));
    }
    let page = report_path(&config.out);
    let folders: Vec<PathBuf> = result.runs().map(|p| p.folder.clone()).collect();
    let reported = args.fit.is_none() && !folders.is_empty();
    let scaling = result.scaling();
    if reported {
        let figures = scaling_figures(&scaling, &config.out)?;
        let formats = [FigureFormat::Svg];
        let rendered = render_report(&config.title, &folders, &formats, &figures)?;
        write_atomically(&page, rendered.page.as_bytes())?;
        tell_without_figures(&rendered);
    }
    if args.fit.is_some() {
        // Slurm's log of the fit is searched for it.
        for failed in &result.failed {
            note(&format!("error: {}", failed.reason));
        }
    }
    if args.output.json {
        let rows: Vec<_> = result.runs()
            .map(|p| json!({"name": p.name, "sampler": p.sampler, "folder": shown(&p.folder), "summary": p.summary}))
            .collect();
        let failed: Vec<_> = (result.failed.iter())
            .map(|p| json!({"name": p.name, "sampler": p.sampler, "reason": p.reason}))
            .collect();
        let subsets: Vec<_> = (result.subsets.iter())
            .map(|p| json!({"streams": p.streams, "folder": shown(&p.run.folder), "converged": p.run.summary.converged}))
            .collect();
        out.json(&json!({
            "runs": rows,
            "subsets": subsets,
            "failed": failed,
            "acceptance": result.acceptance,
            "scaling": scaling,
            "report": reported.then(|| shown(&page)),
        }))?;
    } else {
        print(&result, &scaling, out)?;
        if reported {
            out.line(&format!("report: {}", page.display()))?;
        }
    }
    tell_next(args, command, &result);
    let converged = result.converged();
    Ok(Exit::from_converged(
        result.failed.is_empty()
            && (converged || args.allow_unconverged || config.allow_unconverged),
    ))
}

/// Says that the study was stopped, and how it is continued.
fn stopped(told: &str, command: &CommandLine) -> Exit {
    note(told);
    Step::again("continue it", command).tell();
    Exit::Interrupted
}

/// Writes the table of how widths fall with the number of streams, and draws its figure; nothing without rows.
fn scaling_figures(rows: &[ScalingRow], out: &Path) -> Result<Vec<(&'static str, Figure)>> {
    let Some(svg) = report::scaling(rows) else {
        return Ok(Vec::new());
    };
    write_atomically(&out.join("scaling.csv"), scaling_csv(rows).as_bytes())?;
    let caption = "Mean width of the central 68 % interval of each hyperparameter over random subsets of the streams, and its standard deviation; \
        dashed: in proportion to one over the root of the number of streams"
        .to_owned();
    Ok(vec![("Number of streams", Figure { caption, svg })])
}

/// What the fits will cost, in words.
fn predicted(cost: &Cost) -> String {
    let [least, most] = cost.range.map(duration);
    let threads = rayon::current_num_threads().min(cost.fits);
    format!(
        "{} fits will take about {} of CPU, {least} to {most} each, by a pilot of {}; {} with {threads} at once",
        cost.fits,
        duration(cost.cpu_seconds),
        cost.timed,
        duration(cost.cpu_seconds / threads as f64),
    )
}

/// Does the study, or one fit of it.
fn done(
    args: &Args,
    config: &StudyConfig,
    files_from: &Path,
    command: &CommandLine,
    watcher: &Shown<'_>,
) -> Result<StudyResult> {
    let study = Study::new(config, files_from, watcher)?;
    let text = command.text();
    if let Some(number) = args.fit {
        return study.run_fit(number, &text, watcher);
    }
    if !args.work.quiet
        && let Some(cost) = study.cost(watcher)?
    {
        note(&predicted(&cost));
    }
    match args.executor {
        ExecutorName::Local => study.run(Executor::Local, &text, watcher),
        ExecutorName::Slurm => {
            let task = task(args, config)?;
            study.run(Executor::Slurm { task: &task }, &text, watcher)
        }
    }
}

/// The shell command of one fit, whose number is in the variable `FIT`, for any computer that shares this one's files.
fn task(args: &Args, config: &StudyConfig) -> Result<String> {
    let here = |source| Error::Io {
        path: args.study.clone(),
        source,
        remedy: "work in a folder that exists",
    };
    let folder = std::env::current_dir().map_err(here)?;
    let program = std::env::current_exe().map_err(here)?;
    let every = args.limits.checkpoint_every.to_string();
    let words = [
        program.display().to_string(),
        "run".to_owned(),
        args.study.display().to_string(),
        "--out".to_owned(),
        config.out.display().to_string(),
        "--checkpoint-every".to_owned(),
        every,
    ];
    let mut line = CommandLine::new(words);
    if let Some(minutes) = args.limits.max_minutes {
        line = line.with("--max-minutes", Some(&minutes.to_string()));
    }
    let folder = CommandLine::new([folder.display().to_string()]);
    Ok(format!(
        "cd {} && {} --quiet --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" --fit \"$FIT\"",
        folder.text(),
        line.text()
    ))
}

/// Says which commands go on with runs that have ended too soon.
fn tell_next(args: &Args, command: &CommandLine, result: &StudyResult) {
    if !result.failed.is_empty() && args.limits.max_minutes.is_some() {
        Step::again("continue the study", command).tell();
    }
    let stopped = |run: &StudyRun| run.summary.status == Status::BudgetSpent;
    if result.runs().any(stopped) {
        Step::again("continue the runs that reached the time limit", command).tell();
    }
    for (sampler, key) in [
        (Sampler::PtHmc, "sampling.pt_hmc.extensions"),
        (Sampler::Nested, "sampling.nested.max_batches"),
    ] {
        let extended = |run: &&StudyRun| {
            run.sampler == sampler
                && !stopped(run)
                && RunFolder::open(&run.folder).is_ok_and(|folder| may_grow(&run.summary, &folder))
        };
        if let Some(run) = result.tracks.iter().chain(&result.mocks).find(extended) {
            let purpose = format!(
                "extend {} and others like it, raise its `{key}` in {} and repeat the study",
                run.name,
                args.study.display()
            );
            Step::again(&purpose, command).tell();
        }
    }
}

fn print(result: &StudyResult, scaling: &[ScalingRow], out: &mut Output<'_>) -> Result<()> {
    out.line("run                               ln Z              median [interval]           ESS   calls  gradients  CPU/s")?;
    for run in result.runs() {
        out.line(&row(run))?;
    }
    for failed in &result.failed {
        out.line(&format!("FAILED  {failed}"))?;
    }
    for ScalingRow {
        streams,
        populations,
        widths,
    } in scaling
    {
        let widths = widths.iter().map(|width| {
            let sd = width.sd.map(|sd| format!(" +- {sd:.3}"));
            format!("{} {:.3}{}", width.name, width.mean, sd.unwrap_or_default())
        });
        out.line(&format!(
            "streams {streams}, populations {populations}, 68 % widths: {}",
            widths.collect::<Vec<_>>().join(", ")
        ))?;
    }
    let unconverged = result.subsets.iter().filter(|s| !s.run.summary.converged);
    let unconverged = unconverged.count();
    if unconverged > 0 {
        out.line(&format!(
            "{unconverged} of {} populations of subsets have not converged",
            result.subsets.len()
        ))?;
    }
    for run in result.runs() {
        for assumption in &run.summary.assumptions {
            let sampler = run.sampler.name();
            out.line(&format!("{} {sampler}: assumed: {assumption}", run.name))?;
        }
    }
    if let Some(acceptance) = result.acceptance {
        out.line(&format!(
            "{:.1} % of prior draws met the criteria of a mock",
            100.0 * acceptance
        ))?;
    }
    // Runs of different samplers on one track are compared, unless one was stopped before its first draw.
    for group in [&result.tracks, &result.mocks, &result.populations] {
        for (i, a) in group.iter().enumerate() {
            for b in group[i + 1..].iter().filter(|b| b.name == a.name) {
                let (ra, rb) = (
                    RunFolder::open(&a.folder)?.read()?,
                    RunFolder::open(&b.folder)?.read()?,
                );
                if ra.run.draws.is_empty() || rb.run.draws.is_empty() {
                    continue;
                }
                let c = compare(&ra.name, &ra.run, &rb.name, &rb.run)?;
                out.line(&format!("{}: {}", a.name, c.verdict()))?;
            }
        }
    }
    for run in result.runs() {
        let (summary, name) = (&run.summary, format!("{} {}", run.name, run.sampler.name()));
        if !summary.converged {
            out.line(&format!("{name}: {}", summary.verdict()))?;
        }
        for failed in summary.failed_checks() {
            out.line(&format!("    {failed}"))?;
        }
        let inaccurate = summary.model_checks.iter().any(|check| !check.pass);
        if let Some(verdict) = summary.model_verdict().filter(|_| inaccurate) {
            out.line(&format!("{name}: {verdict}"))?;
        }
        for failed in summary.failed_model_checks() {
            out.line(&format!("    {failed}"))?;
        }
        for warning in &summary.model_warnings {
            out.line(&format!("{name}: warning: {warning}"))?;
        }
        if let Some(verdict) = summary.measured_verdict() {
            out.line(&format!("{name}: {verdict}"))?;
        }
    }
    Ok(())
}

fn row(run: &StudyRun) -> String {
    let Summary {
        ln_z, cost, ess, ..
    } = &run.summary;
    let numbers = match &run.summary.q {
        Some(q) => format!("q {:.3} [{:.3}, {:.3}] 95 %", q.median, q.lo95, q.hi95),
        None => run
            .summary
            .parameters
            .iter()
            .map(|(name, i)| format!("{name} {:.3} [{:.3}, {:.3}] 68 %", i.median, i.lo68, i.hi68))
            .collect::<Vec<_>>()
            .join(", "),
    };
    format!(
        "{:<24} {:<7} {:8.2} +- {:.2}  {numbers}  {:.0} {} {} {:.0}",
        run.name,
        run.sampler.name(),
        ln_z.value,
        ln_z.error,
        ess,
        cost.calls,
        cost.gradients,
        cost.cpu_seconds
    )
}
