//! `oblate population`.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::folder::{FolderFlags, interrupted};
use super::next::{Step, after_population};
use super::options::{LimitFlags, sampler};
use super::output::{Output, shown};
use super::set::SetFlags;
use super::several::{print_faults, tell_once};
use crate::config::{PopulationConfig, read};
use crate::error::Result;
use crate::inference::Sampler;
use crate::population::FamilyName;
use crate::posterior::Summary;
use crate::run::{FamilyRun, PopulationFits, population, populations, sampling_of_population};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Flags of `oblate population`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  oblate population runs/mock_* --sampler nested --out runs/population\n  \
oblate population runs/mock_* --family truncated-gaussian,mixture --out runs/families\n\n\
Several families have a run folder each in FOLDER, and a table of their evidences is printed."
)]
pub struct Args {
    /// Finished fits
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// truncated-gaussian (the default), uniform, mixture, beta or histogram; several, with commas or repeated, are compared
    #[arg(long, value_name = "NAME", value_parser = family, value_delimiter = ',')]
    family: Vec<FamilyName>,
    /// nested or pt-hmc
    #[arg(long, value_parser = sampler)]
    sampler: Option<Sampler>,
    /// Settings file (TOML); flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Master seed
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    set: SetFlags,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    folder: FolderFlags,
}

fn family(text: &str) -> std::result::Result<FamilyName, String> {
    text.parse().map_err(|e: crate::Error| e.to_string())
}

/// Samples the population of finished fits by one family of distributions of q, or by several.
pub fn run(args: &Args, command: &CommandLine, out: &mut Output<'_>) -> Result<Exit> {
    let mut config: PopulationConfig = match &args.config {
        Some(path) => read(path)?,
        None => PopulationConfig::default(),
    };
    config.sampling.sampler = args.sampler.unwrap_or(config.sampling.sampler);
    config.seed = args.seed.unwrap_or(config.seed);
    if let [family] = args.family[..] {
        config.family.name = family;
    }
    args.set.apply(&mut config)?;
    let folder = &args.folder;
    let fits = PopulationFits {
        folders: &args.runs,
        missing: &[],
        allow_unconverged: folder.allow_unconverged,
    };
    if let [] | [_] = args.family[..] {
        let label = format!("population {}", config.sampling.sampler.name());
        return folder.fill(
            &label,
            command,
            &args.limits,
            out,
            |destination, monitor| population(&fits, &config, destination, monitor),
            |fit, folder| Ok(steps_after(&fit.summary, &config, folder, command)),
        );
    }
    let runs = folder.fill_several(command, &args.limits, |destination, monitored| {
        populations(&fits, &config, &args.family, destination, monitored)
    })?;
    let Some(runs) = runs else {
        return Ok(interrupted(command, "one of the families"));
    };
    if folder.json() {
        let rows: Vec<_> = runs
            .iter()
            .map(|run| json!({"family": run.family, "folder": shown(&run.folder), "summary": run.summary}))
            .collect();
        out.json(&json!({"families": rows}))?;
    } else {
        print(&runs, out)?;
    }
    let steps = runs.iter().map(|run| {
        let of_family = (command.with_value("--family", run.family.name()))
            .with_value("--out", &run.folder.display().to_string());
        steps_after(&run.summary, &config, &run.folder, &of_family)
    });
    tell_once(steps.flatten());
    let converged = runs.iter().all(|run| run.summary.converged);
    Ok(Exit::from_converged(converged || folder.allow_unconverged))
}

/// What to do after a population, by the settings that its sampler had.
fn steps_after(
    summary: &Summary,
    config: &PopulationConfig,
    folder: &Path,
    command: &CommandLine,
) -> Vec<Step> {
    let sampling = sampling_of_population(config, summary.parameters.len());
    after_population(summary, &sampling, folder, command)
}

/// The families, the best first, with their ln Bayes factors against it; then what is wrong with any of them.
fn print(runs: &[FamilyRun], out: &mut Output<'_>) -> Result<()> {
    let mut order: Vec<&FamilyRun> = runs.iter().collect();
    order.sort_by(|a, b| b.summary.ln_z.value.total_cmp(&a.summary.ln_z.value));
    let best = order[0].summary.ln_z;
    out.line("family              converged  ln Z               ln Bayes factor    ESS    in")?;
    for run in &order {
        let ln_z = run.summary.ln_z;
        let error = if run.family == order[0].family {
            0.0
        } else {
            ln_z.error.hypot(best.error)
        };
        out.line(&format!(
            "{:<18}  {:<9}  {:8.3} +- {:.3}  {:8.3} +- {:.3}  {:5.0}  {}",
            run.family.name(),
            if run.summary.converged { "yes" } else { "NO" },
            ln_z.value,
            ln_z.error,
            ln_z.value - best.value,
            error,
            run.summary.ess,
            run.folder.display()
        ))?;
    }
    for run in &order {
        print_faults(run.family.name(), &run.summary, out)?;
    }
    Ok(())
}
