//! What to do after a run that has not reached its end, has not converged or whose model is not accurate enough: the commands to type.

use super::command_line::CommandLine;
use super::output::note;
use crate::config::read;
use crate::error::Result;
use crate::inference::{FitSettings, PARTICLES_CHECKS, STEPS_CHECKS, Sampler, SamplerSettings};
use crate::posterior::Summary;
use crate::run::RunFolder;
use crate::spray::TableSettings;
use crate::stream::{ModelSettings, StepRule};
use oblate_samplers::bridge::{BRIDGE_ERROR, COARSE_RUN_CHECKS};
use oblate_samplers::nested::{self, Kernel, check_names as nested_checks};
use oblate_samplers::output::{ESS_BULK, ESS_TAIL, MIN_ESS, Method, Status};
use oblate_samplers::pt::{self, check_names as tempered_checks};
use std::path::{Path, PathBuf};

/// A command that can be typed next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    /// What it does, as a phrase that follows "to".
    pub purpose: String,
    /// Its words after `oblate`.
    pub command: String,
}

impl Step {
    fn new(purpose: impl Into<String>, command: &CommandLine) -> Self {
        Self {
            purpose: purpose.into(),
            command: command.text(),
        }
    }

    /// The one that continues a run from its checkpoint.
    pub fn resume(command: &CommandLine) -> Self {
        Self::new("continue it", &command.resumed())
    }

    /// Whether it continues a run.
    fn resumes(&self) -> bool {
        self.command.split(' ').any(|word| word == "--resume")
    }

    /// The same command, without a time limit.
    pub fn again(purpose: &str, command: &CommandLine) -> Self {
        Self::new(purpose, &command.unlimited())
    }

    /// Writes it to standard error.
    pub fn tell(&self) {
        note(&format!(
            "To {}:\n    oblate {}",
            self.purpose, self.command
        ));
    }
}

/// A setting's key and its new value.
type Change = (&'static str, String);

/// What to do after a fit: continue it if it was stopped, extend it or fit again if it has not converged, and bridge it to a finer
/// model if its own is not accurate enough.
pub fn after_fit(
    summary: &Summary,
    settings: &FitSettings,
    folder: &RunFolder,
    command: &CommandLine,
) -> Vec<Step> {
    if summary.status == Status::BudgetSpent {
        return vec![Step::resume(command)];
    }
    if !summary.converged {
        let coarse = coarse_summary(folder);
        let sampling = &settings.sampling;
        let mut steps = Vec::new();
        // The checks of the coarse fit are those of the sampler; the bridge has its own.
        let sampled = coarse.as_ref().unwrap_or(summary);
        if sampling.sampler == Sampler::PtHmc
            && names(sampled).iter().any(|name| needs_scans(name))
            && let Some(more) = more_extensions(sampling)
        {
            // As a setting, which goes before flags and settings that the command has.
            let change = format!("sampling.pt_hmc.extensions={more}");
            let longer = command.resumed().with("--set", Some(&change));
            steps.push(Step::new("extend its last round", &longer));
        }
        let batches = more_batches(sampled, sampling, command);
        let mut failed = [names(sampled), names(summary)].concat();
        if batches.is_some() {
            failed.retain(|name| *name != nested_checks::EFFECTIVE_LINEAGES);
        }
        steps.extend(batches);
        let batches = longer_bridge(summary, sampling, command);
        let mut changes = changes(&failed, sampling);
        if batches.is_some() {
            changes.push(more_coarse_draws(sampling));
        }
        steps.extend(batches);
        changes.extend(model_changes(summary, &settings.model));
        steps.extend(again(&changes, folder.path(), command));
        return steps;
    }
    let changes = model_changes(summary, &settings.model);
    finer(&changes, folder.path()).into_iter().collect()
}

/// What to do after a merger of these runs that has not converged: sample with one more seed, and merge again.
///
/// # Errors
/// Those of reading the runs' summaries.
pub fn after_merge(summary: &Summary, parts: &[PathBuf], folder: &Path) -> Result<Vec<Step>> {
    let Some(first) = parts.first().filter(|_| !summary.converged) else {
        return Ok(Vec::new());
    };
    let seeds = (parts.iter())
        .map(|part| Ok(Summary::read(&RunFolder::open(part)?.summary())?.seed))
        .collect::<Result<Vec<u64>>>()?;
    let unused_seed = (1..).find(|seed| !seeds.contains(seed)).unwrap_or(1);
    let first = RunFolder::open(first)?;
    // Named after the merger: a folder beside a part may be in another run, as one beside a coarse run is.
    let one_more = format!("{}_seed{unused_seed}", without_slash(folder));
    let one_more = if Path::new(&one_more).exists() {
        unused(Path::new(&one_more))
    } else {
        one_more
    };
    let fit = CommandLine::new(["fit".to_owned(), first.track().display().to_string()])
        .with_value("--config", &first.config().display().to_string())
        .with_value("--seed", &unused_seed.to_string())
        .with_value("--out", &one_more);
    let mut merger = vec!["merge".to_owned()];
    merger.extend(parts.iter().map(|part| part.display().to_string()));
    merger.push(one_more);
    let merger = CommandLine::new(merger).with_value("--out", &unused(folder));
    Ok(vec![
        Step::new("sample with one more seed", &fit),
        Step::new("merge it with the others", &merger),
    ])
}

/// What to do after a fit that is in this folder, with the track and the settings in it.
pub fn after_stored_fit(summary: &Summary, folder: &RunFolder) -> Result<Vec<Step>> {
    let own = CommandLine::new(["fit".to_owned(), folder.track().display().to_string()])
        .with_value("--config", &folder.config().display().to_string())
        .with_value("--out", &folder.path().display().to_string());
    let settings: FitSettings = read(&folder.config())?;
    Ok(after_fit(summary, &settings, folder, &own))
}

/// What to do after a bridge of the run in `coarse`: continue it, or first what makes the coarse run converge; and bridge its result to a
/// finer model if its own is not accurate enough.
pub fn after_bridge(
    summary: &Summary,
    coarse: &Path,
    folder: &Path,
    command: &CommandLine,
) -> Result<Vec<Step>> {
    if summary.status == Status::BudgetSpent {
        return Ok(vec![Step::resume(command)]);
    }
    let failed = names(summary);
    if failed.contains(&COARSE_RUN_CHECKS) {
        let coarse = RunFolder::open(coarse)?;
        let own = Summary::read(&coarse.summary())?;
        // Others than fits have no command that continues them.
        if !own.command.starts_with("fit ") {
            return Ok(Vec::new());
        }
        let mut steps = after_stored_fit(&own, &coarse)?;
        if steps.iter().any(Step::resumes) {
            let anew = command.without_folder_flags().with("--force", None);
            steps.push(Step::new("bridge it again after that", &anew));
        }
        return Ok(steps);
    }
    let settings: FitSettings = read(&RunFolder::open(folder)?.config())?;
    let of_model = model_changes(summary, &settings.model);
    if summary.converged {
        return Ok(finer(&of_model, folder).into_iter().collect());
    }
    let changes = [changes(&failed, &settings.sampling), of_model].concat();
    let more = longer_bridge(summary, &settings.sampling, command).into_iter();
    Ok(more.chain(again(&changes, folder, command)).collect())
}

/// What to do after a population: it takes seconds, and is sampled again as a whole.
pub fn after_population(
    summary: &Summary,
    sampling: &SamplerSettings,
    folder: &Path,
    command: &CommandLine,
) -> Vec<Step> {
    if summary.status == Status::BudgetSpent {
        return vec![Step::resume(command)];
    }
    let mut failed = names(summary);
    let mut longer = Vec::new();
    if summary.method == Method::Nested
        && let Some(more) = doubled_batches(&failed, sampling)
    {
        longer.push(("sampling.nested.max_batches", more));
        failed.retain(|name| *name != nested_checks::EFFECTIVE_LINEAGES);
    }
    if summary.method == Method::PtHmc
        && failed.iter().any(|name| needs_scans(name))
        && let Some(more) = more_extensions(sampling)
    {
        longer.push(("sampling.pt_hmc.extensions", more));
    }
    let changes = [longer, changes(&failed, sampling)].concat();
    again(&changes, folder, command).into_iter().collect()
}

/// The summary of the coarse fit that came first, if there is one.
pub fn coarse_summary(folder: &RunFolder) -> Option<Summary> {
    let coarse = RunFolder::open(&folder.coarse()).ok()?;
    Summary::read(&coarse.summary()).ok()
}

/// Whether a fit has failed checks that it may pass if it goes on: with more batches, or more extensions.
pub fn may_grow(summary: &Summary, folder: &RunFolder) -> bool {
    let coarse = coarse_summary(folder);
    let sampled = coarse.as_ref().unwrap_or(summary);
    let failed = names(sampled);
    match sampled.method {
        Method::Nested => has_few_draws(&failed),
        Method::PtHmc => failed.iter().any(|name| needs_scans(name)),
        Method::Bridge => false,
    }
}

/// Says what is wrong with the coarse fit, if it is the reason why the fit has not ended or not converged.
pub fn tell_coarse(summary: &Summary, folder: &RunFolder) {
    let Some(coarse) = coarse_summary(folder) else {
        return;
    };
    if !folder.finished() {
        note(
            "The result is that of the coarse model, which is fitted first: the time limit was reached there.",
        );
    } else if !summary.converged && !coarse.converged {
        let path = folder.coarse();
        note(&format!(
            "The coarse fit, {}: {}",
            path.display(),
            coarse.verdict()
        ));
        for failed in coarse.failed_checks() {
            note(&format!("    {failed}"));
        }
    }
}

/// Names of the checks that it failed.
fn names(summary: &Summary) -> Vec<&str> {
    let failed = summary.checks.iter().filter(|check| !check.pass);
    failed.map(|check| check.name.as_str()).collect()
}

/// Two more extensions of the last round, as far as there may be more.
fn more_extensions(sampling: &SamplerSettings) -> Option<String> {
    let (now, most) = (sampling.pt_hmc.extensions, pt::Settings::MAX_EXTENSIONS);
    (now < most).then(|| (now + 2).min(most).to_string())
}

/// Goes on with a nested run that has too few draws or ancestors.
fn more_batches(
    summary: &Summary,
    sampling: &SamplerSettings,
    command: &CommandLine,
) -> Option<Step> {
    if summary.method != Method::Nested {
        return None;
    }
    let change = format!(
        "sampling.nested.max_batches={}",
        doubled_batches(&names(summary), sampling)?
    );
    let longer = command.resumed().with("--set", Some(&change));
    Some(Step::new("add batches of live points", &longer))
}

/// Twice as many batches of live points, as far as there may be more, where that may help.
fn doubled_batches(failed: &[&str], sampling: &SamplerSettings) -> Option<String> {
    let (now, most) = (sampling.nested.max_batches, nested::Settings::MAX_BATCHES);
    let grows = sampling.nested.dynamic() && has_few_draws(failed) && now < most;
    grows.then(|| (2 * now).min(most).to_string())
}

/// Goes on with a bridge that has too few draws, unless it begins anew because its coarse run has not converged.
fn longer_bridge(
    summary: &Summary,
    sampling: &SamplerSettings,
    command: &CommandLine,
) -> Option<Step> {
    let failed = names(summary);
    let few = [ESS_BULK, ESS_TAIL];
    let grows = summary.method == Method::Bridge
        && few.iter().any(|name| failed.contains(name))
        && !failed.contains(&COARSE_RUN_CHECKS);
    let more = 2 * sampling.bridge.max_batches;
    let change = format!("sampling.bridge.max_batches={more}");
    let longer = command.resumed().with("--set", Some(&change));
    grows.then(|| Step::new("add batches to its bridge", &longer))
}

/// The setting with which a coarse run has more effective draws, for a bridge whose batches do not help: they are of too few coarse draws.
fn more_coarse_draws(sampling: &SamplerSettings) -> Change {
    let more = |target: f64| (4.0 * target).to_string();
    match sampling.sampler {
        Sampler::PtHmc => (
            "sampling.pt_hmc.target_ess",
            more(sampling.pt_hmc.target_ess),
        ),
        Sampler::Nested => (
            "sampling.nested.target_ess",
            more(sampling.nested.target_ess.unwrap_or(MIN_ESS)),
        ),
    }
}

/// Whether failed checks of a nested run may pass with more batches.
fn has_few_draws(failed: &[&str]) -> bool {
    let of_draws = [
        ESS_BULK,
        ESS_TAIL,
        nested_checks::TARGET_ESS,
        nested_checks::TARGET_LN_Z_ERROR,
        nested_checks::EFFECTIVE_LINEAGES,
    ];
    failed.iter().any(|name| of_draws.contains(name))
}

/// Whether a check of a tempered run may pass with more scans.
fn needs_scans(check: &str) -> bool {
    [
        tempered_checks::ROUND_TRIPS_WORST_CHAIN_SET,
        tempered_checks::ROUND_TRIPS,
        tempered_checks::RESTARTS_PER_REPLICA,
        tempered_checks::LN_Z_ERROR,
        tempered_checks::LN_Z_AGREEMENT_OF_CHAIN_SETS,
        tempered_checks::NEWEST_LN_Z,
        tempered_checks::NEWEST_ESS,
        tempered_checks::NEWEST_MODE_AGREEMENT,
        tempered_checks::LOOKS_PASSED,
        tempered_checks::R_HAT,
        ESS_BULK,
        ESS_TAIL,
        tempered_checks::MODE_AGREEMENT_OF_CHAIN_SETS,
    ]
    .contains(&check)
}

/// The setting that helps against a failed check, with its new value; none if there is none, or if it is unknown what was used.
fn change(check: &str, sampling: &SamplerSettings) -> Option<Change> {
    let (nested, tempered) = (&sampling.nested, &sampling.pt_hmc);
    let of = |key: &'static str, value: usize| Some((key, value.to_string()));
    match check {
        nested_checks::EFFECTIVE_LINEAGES
        | nested_checks::LINEAGE_HALVES
        | nested_checks::LN_Z_AGREEMENT_OF_SEEDS
        | nested_checks::MEAN_AGREEMENT_OF_SEEDS => of("sampling.nested.n_live", 2 * nested.n_live),
        nested_checks::INSERTION_RANK
        | nested_checks::INSERTION_RANK_WINDOWS
        | nested_checks::BOOTSTRAP_TO_SIMULATED
        | nested_checks::RELATIVE_JUMP_DISTANCE
        | nested_checks::SEED_RANK_CORRELATION
        | nested_checks::NO_MOVE => match nested.steps {
            Some(steps) => of("sampling.nested.steps", 2 * steps),
            None if nested.kernel == Kernel::Differential => None,
            None => Some(("sampling.nested.kernel", "differential".to_owned())),
        },
        nested_checks::BOUND_EFFICIENCY => {
            Some(("sampling.nested.kernel", "differential".to_owned()))
        }
        tempered_checks::ROUND_TRIP_RATE => of(
            "sampling.pt_hmc.slice_updates",
            (2 * tempered.slice_updates).max(1),
        ),
        tempered_checks::SWAP_REJECTION
        | tempered_checks::COMMUNICATION_BARRIER_CHANGE
        | tempered_checks::FORWARD_BACKWARD_DIFFERENCE
        | tempered_checks::LOWEST_ACCEPTANCE
        | tempered_checks::HIGHEST_ACCEPTANCE => of("sampling.pt_hmc.rounds", tempered.rounds + 1),
        tempered_checks::TRUNCATED_TRAJECTORIES => {
            of("sampling.pt_hmc.max_leapfrogs", 2 * tempered.max_leapfrogs)
        }
        tempered_checks::REJECTED_TRANSITIONS => Some((
            "likelihood.coverage",
            "{ penalty = { z_miss = 10.0, lambda = 1000.0 } }".to_owned(),
        )),
        BRIDGE_ERROR => of(
            "sampling.bridge.smc_particles",
            2 * sampling.bridge.smc_particles,
        ),
        _ => None,
    }
}

/// The settings that help against failed checks of a sampler.
fn changes(failed: &[&str], sampling: &SamplerSettings) -> Vec<Change> {
    let names = failed.iter();
    names.filter_map(|name| change(name, sampling)).collect()
}

/// The settings that help against the failed checks of the model.
fn model_changes(summary: &Summary, model: &ModelSettings) -> Vec<Change> {
    let fails = |start: &str| {
        let mut checks = summary.model_checks.iter();
        checks.any(|check| !check.pass && check.name.starts_with(start))
    };
    let mut changes = Vec::new();
    if fails(STEPS_CHECKS) {
        changes.push(match model.step_rule {
            StepRule::Adaptive => ("model.step_phase", format!("{:.3}", 0.7 * model.step_phase)),
            StepRule::Uniform => ("model.steps", (2 * model.steps).to_string()),
        });
    }
    if fails(PARTICLES_CHECKS) {
        let TableSettings {
            particles,
            release_times,
            ..
        } = model.releases;
        changes.push(("model.releases.particles", (4 * particles).to_string()));
        if release_times > 0 {
            let more = (4 * release_times).to_string();
            changes.push(("model.releases.release_times", more));
        }
    }
    changes
}

/// The same command into another folder with some settings changed; none without changes.
fn again(changes: &[Change], folder: &Path, command: &CommandLine) -> Option<Step> {
    let next = command.for_folder(&unused(folder));
    with_changes("sample again with other settings", next, changes)
}

/// The bridge to a finer model; none without changes.
fn finer(changes: &[Change], folder: &Path) -> Option<Step> {
    let bridge = CommandLine::new(["bridge".to_owned(), folder.display().to_string()]);
    let bridge = bridge.with_value("--out", &unused(folder));
    with_changes("continue it to a finer model", bridge, changes)
}

fn with_changes(purpose: &str, mut command: CommandLine, changes: &[Change]) -> Option<Step> {
    let mut seen: Vec<&str> = Vec::new();
    for (key, value) in changes {
        if !seen.contains(key) {
            seen.push(key);
            command = command.with("--set", Some(&format!("{key}={value}")));
        }
    }
    (!changes.is_empty()).then(|| Step::new(purpose, &command))
}

/// A folder beside this one that does not exist.
fn unused(folder: &Path) -> String {
    let name = without_slash(folder);
    let mut numbers = 2..;
    numbers
        .find_map(|k: u32| {
            let other = format!("{name}_{k}");
            (!Path::new(&other).exists()).then_some(other)
        })
        .unwrap_or_default()
}

/// The path of a folder, to which an ending can be added.
fn without_slash(folder: &Path) -> String {
    folder
        .display()
        .to_string()
        .trim_end_matches('/')
        .to_owned()
}
