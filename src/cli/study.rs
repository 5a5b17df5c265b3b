//! `oblate run`.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::next::{Step, may_grow};
use super::options::{JsonFlag, LimitFlags, WorkFlags};
use super::output::{Output, note, shown};
use super::progress::Progress;
use crate::config::{StudyConfig, read};
use crate::error::{Error, Result};
use crate::inference::Sampler;
use crate::posterior::{Summary, compare};
use crate::report::FigureFormat;
use crate::run::{
    RunFolder, SUMMARY_FILE, StudyResult, StudyRun, render_report, report_path, study,
};
use oblate_samplers::output::Status;
use serde_json::json;
use std::path::{Path, PathBuf};

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
    let result = study(&config, files_from, &command.text(), &mut |label, work| {
        let mut progress = Progress::new(label, args.work.quiet);
        work(&mut progress.monitor(&args.limits))
    })
    .inspect_err(|error| {
        // A fit that the time limit left without draws.
        let stopped = match error {
            Error::Posterior { .. } | Error::Sampler(oblate_samplers::Error::Interrupted) => true,
            Error::Io { path, .. } => path.ends_with(SUMMARY_FILE),
            _ => false,
        };
        if stopped && args.limits.max_minutes.is_some() {
            note("The time limit was reached before the first result of a run.");
            Step::again("continue the study", command).tell();
        }
    })
    .map_err(|error| match error {
        Error::InTable { .. } => Error::InFile {
            path: args.study.clone(),
            line: None,
            source: Box::new(error),
        },
        other => other,
    })?;
    if result.interrupted {
        note("Stopped before the end; all work so far is kept.");
        Step::again("continue it", command).tell();
        return Ok(Exit::Interrupted);
    }
    let page = report_path(&config.out);
    let folders: Vec<PathBuf> = result.runs().map(|p| p.folder.clone()).collect();
    render_report(&config.title, &folders, &[FigureFormat::Svg], &page)?;
    if args.output.json {
        let rows: Vec<_> = result.runs()
            .map(|p| json!({"name": p.name, "sampler": p.sampler, "folder": shown(&p.folder), "summary": p.summary}))
            .collect();
        out.json(&json!({"runs": rows, "acceptance": result.acceptance, "report": shown(&page)}))?;
    } else {
        print(&result, out)?;
        out.line(&format!("report: {}", page.display()))?;
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
    let converged = result.runs().all(|p| p.summary.converged);
    Ok(Exit::from_converged(
        converged || args.allow_unconverged || config.allow_unconverged,
    ))
}

fn print(result: &StudyResult, out: &mut Output<'_>) -> Result<()> {
    out.line("run                               ln Z              median [interval]           ESS   calls  gradients  CPU/s")?;
    for run in result.runs() {
        out.line(&row(run))?;
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
    // Runs of different samplers on one track are compared.
    for group in [&result.tracks, &result.mocks, &result.populations] {
        for (i, a) in group.iter().enumerate() {
            for b in group[i + 1..].iter().filter(|b| b.name == a.name) {
                let (ra, rb) = (
                    RunFolder::open(&a.folder)?.read()?,
                    RunFolder::open(&b.folder)?.read()?,
                );
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
