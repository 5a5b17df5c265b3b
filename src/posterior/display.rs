//! A summary as text: verdict, evidence, a table of parameters, and cost.

use super::summary::Summary;
use std::fmt;

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.verdict())?;
        if let Some(verdict) = self.model_verdict() {
            writeln!(f, "{verdict}")?;
        }
        for check in self.model_checks.iter().filter(|check| !check.pass) {
            writeln!(
                f,
                "    {} = {:.2}, limit {}: {}",
                check.name, check.value, check.limit, check.message
            )?;
        }
        for assumption in &self.assumptions {
            writeln!(f, "Assumed: {assumption}.")?;
        }
        if let Some(verdict) = self.population.as_ref().and_then(|p| p.verdict()) {
            writeln!(f, "{verdict}")?;
        }
        writeln!(f, "ln Z = {:.3} +- {:.3}", self.ln_z.value, self.ln_z.error)?;
        for (name, i) in self.parameters.iter().chain(&self.derived) {
            writeln!(
                f,
                "{name:>16} {:10.4}   68 % [{:.4}, {:.4}]   95 % [{:.4}, {:.4}]",
                i.median, i.lo68, i.hi68, i.lo95, i.hi95
            )?;
        }
        write!(
            f,
            "ESS {:.0}, {} calls, {} gradients, {:.0} CPU seconds",
            self.ess, self.cost.calls, self.cost.gradients, self.cost.cpu_seconds
        )
    }
}
