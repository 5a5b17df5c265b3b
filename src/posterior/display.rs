//! A summary as text: verdict, evidence, a table of parameters, and cost.

use super::summary::Summary;
use std::fmt;

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.verdict())?;
        for failed in self.failed_checks() {
            writeln!(f, "    {failed}")?;
        }
        if let Some(verdict) = self.model_verdict() {
            writeln!(f, "{verdict}")?;
        }
        for failed in self.failed_model_checks() {
            writeln!(f, "    {failed}")?;
        }
        for warning in self.warnings.iter().chain(&self.model_warnings) {
            writeln!(f, "Warning: {warning}.")?;
        }
        for assumption in &self.assumptions {
            writeln!(f, "Assumed: {assumption}.")?;
        }
        if let Some(verdict) = self.measured_verdict() {
            writeln!(f, "{verdict}")?;
        }
        if let Some(influence) = self.population.as_ref().and_then(|p| p.influence()) {
            writeln!(f, "{influence}")?;
        }
        writeln!(f, "ln Z = {:.3} +- {:.3}", self.ln_z.value, self.ln_z.error)?;
        if let Some(halo) = self.halo {
            let surfaces = halo.flattened();
            writeln!(f, "q is the axis ratio of the {surfaces} (halo {halo}).")?;
        }
        let header = ["quantity", "median", "68 % interval", "95 % interval"];
        writeln!(
            f,
            "{:>16} {:>10}   {:<22} {:<22} unit",
            header[0], header[1], header[2], header[3]
        )?;
        for (name, i) in self.parameters.iter().chain(&self.derived) {
            let inner = format!("[{:.4}, {:.4}]", i.lo68, i.hi68);
            let outer = format!("[{:.4}, {:.4}]", i.lo95, i.hi95);
            let row = format!(
                "{name:>16} {:10.4}   {inner:<22} {outer:<22} {}",
                i.median, i.unit
            );
            writeln!(f, "{}", row.trim_end())?;
        }
        write!(
            f,
            "ESS {:.0}, {} calls, {} gradients, {:.0} CPU seconds",
            self.ess, self.cost.calls, self.cost.gradients, self.cost.cpu_seconds
        )
    }
}
