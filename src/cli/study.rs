//! `oblate run`.

use super::Exit;
use super::options::{Common, say, say_json};
use super::progress::Progress;
use crate::config::{StudyConfig, read};
use crate::error::{Error, Result};
use crate::posterior::{Summary, compare};
use crate::run::{Outcome, Piece, RunFolder, report, study};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Flags of `oblate run`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  oblate run examples/quickstart.toml\n\n\
Run it again to continue after an interrupt, or to read the results back.")]
pub struct Args {
    /// The study (TOML)
    study: PathBuf,
    /// Folder of all results, instead of the study's own
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Exit with 0 even if a run has not converged
    #[arg(long)]
    allow_unconverged: bool,
}

/// Runs a study and draws its report.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut dyn Write) -> Result<Exit> {
    let mut config: StudyConfig = read(&args.study)?;
    if let Some(folder) = &args.out {
        config.out.clone_from(folder);
    }
    if config.tracks.is_none() && config.mocks.is_none() {
        return Err(Error::Input {
            path: args.study.clone(),
            line: None,
            what: "a study of nothing".to_owned(),
            remedy: "give [tracks], [mocks] or both".to_owned(),
        });
    }
    let files_from = args.study.parent().unwrap_or(Path::new("."));
    let outcome = study(&config, files_from, command, &mut |label, work| {
        let mut progress = Progress::new(label, common);
        work(&mut progress.watch())
    })?;
    if outcome.interrupted {
        eprintln!("interrupted; continue with the same command");
        return Ok(Exit::Interrupted);
    }
    let page = config.out.join("report.html");
    let folders: Vec<PathBuf> = pieces(&outcome).map(|p| p.folder.clone()).collect();
    report(&config.title, &folders, &page)?;
    if common.json {
        let rows: Vec<_> = pieces(&outcome)
            .map(|p| json!({"name": p.name, "sampler": p.sampler, "folder": p.folder, "summary": p.summary}))
            .collect();
        say_json(
            out,
            &json!({"runs": rows, "acceptance": outcome.acceptance, "report": page}),
        )?;
    } else {
        print(&outcome, out)?;
        say(out, &format!("report: {}", page.display()))?;
    }
    let converged = pieces(&outcome).all(|p| p.summary.converged);
    Ok(
        if converged || args.allow_unconverged || config.allow_unconverged {
            Exit::Done
        } else {
            Exit::Failed
        },
    )
}

fn pieces(outcome: &Outcome) -> impl Iterator<Item = &Piece> {
    outcome
        .tracks
        .iter()
        .chain(&outcome.mocks)
        .chain(&outcome.populations)
}

fn print(outcome: &Outcome, out: &mut dyn Write) -> Result<()> {
    say(
        out,
        "run                               ln Z              result                      ESS   calls  gradients  CPU/s",
    )?;
    for piece in pieces(outcome) {
        say(out, &row(piece))?;
    }
    if let Some(acceptance) = outcome.acceptance {
        say(
            out,
            &format!(
                "{:.1} % of prior draws met the mocks' criteria",
                100.0 * acceptance
            ),
        )?;
    }
    // Both samplers on one track: do they agree?
    for group in [&outcome.tracks, &outcome.mocks, &outcome.populations] {
        for (i, a) in group.iter().enumerate() {
            for b in group[i + 1..].iter().filter(|b| b.name == a.name) {
                let (ra, rb) = (
                    RunFolder::open(&a.folder)?.read()?,
                    RunFolder::open(&b.folder)?.read()?,
                );
                let c = compare(&ra.name, &ra.run, &rb.name, &rb.run)?;
                say(out, &format!("{}: {}", a.name, c.verdict()))?;
            }
        }
    }
    for piece in pieces(outcome).filter(|p| !p.summary.converged) {
        say(
            out,
            &format!(
                "{} {}: {}",
                piece.name,
                piece.sampler.name(),
                piece.summary.verdict()
            ),
        )?;
    }
    Ok(())
}

fn row(piece: &Piece) -> String {
    let Summary {
        ln_z, cost, ess, ..
    } = &piece.summary;
    let result = match &piece.summary.q {
        Some(q) => format!("q {:.3} [{:.3}, {:.3}] 95 %", q.median, q.lo95, q.hi95),
        None => piece
            .summary
            .parameters
            .iter()
            .map(|(name, i)| format!("{name} {:.3} [{:.3}, {:.3}]", i.median, i.lo68, i.hi68))
            .collect::<Vec<_>>()
            .join(", "),
    };
    format!(
        "{:<24} {:<7} {:8.2} +- {:.2}  {result}  {:.0} {} {} {:.0}",
        piece.name,
        piece.sampler.name(),
        ln_z.value,
        ln_z.error,
        ess,
        cost.calls,
        cost.gradients,
        cost.cpu_seconds
    )
}
