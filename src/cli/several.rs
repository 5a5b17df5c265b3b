//! Several runs of one command, each in a folder of its own: what is wrong with any of them, and what to do next.

use super::next::Step;
use super::output::Output;
use crate::error::Result;
use crate::posterior::Summary;

/// Prints what is wrong with a run called `name`, and nothing of one that has converged, is accurate enough and says something about its
/// parameters.
pub fn print_faults(name: &str, summary: &Summary, out: &mut Output<'_>) -> Result<()> {
    let verdict = (!summary.converged).then(|| summary.verdict());
    let inaccurate = summary.model_checks.iter().any(|check| !check.pass);
    let model = summary.model_verdict().filter(|_| inaccurate);
    let prior = summary.measured_verdict();
    for words in [verdict, model, prior].into_iter().flatten() {
        out.line(&format!("{name}: {words}"))?;
    }
    for failed in summary.failed_checks().chain(summary.failed_model_checks()) {
        out.line(&format!("    {failed}"))?;
    }
    Ok(())
}

/// Tells each step once.
pub fn tell_once(steps: impl IntoIterator<Item = Step>) {
    let mut told = Vec::new();
    for step in steps {
        if !told.contains(&step) {
            step.tell();
            told.push(step);
        }
    }
}
