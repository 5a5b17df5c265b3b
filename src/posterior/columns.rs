//! Named columns of a run: its parameters and derived quantities.

use crate::error::{Error, Result};
use oblate_samplers::Run;

/// One named column of draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name, of a parameter or of a derived quantity.
    pub name: String,
    /// Its unit, empty where it has none.
    pub unit: String,
    /// One value per draw.
    pub values: Vec<f64>,
}

impl Column {
    /// Whether the values differ at all: a derived quantity of fixed parameters alone has the same value in all draws.
    #[must_use]
    pub fn varies(&self) -> bool {
        self.values
            .windows(2)
            .any(|pair| pair[0].to_bits() != pair[1].to_bits())
    }
}

/// All columns of a run, parameters first, then derived quantities.
#[must_use]
pub fn columns(run: &Run) -> Vec<Column> {
    let parameters = run
        .names
        .iter()
        .zip(&run.units)
        .enumerate()
        .map(|(i, (name, unit))| Column {
            name: name.clone(),
            unit: unit.clone(),
            values: run.draws.column(i),
        });
    let derived = run
        .derived_names
        .iter()
        .enumerate()
        .map(|(i, (name, unit))| Column {
            name: name.clone(),
            unit: unit.clone(),
            values: run.draws.derived_column(i),
        });
    parameters.chain(derived).collect()
}

/// One column of a run by name.
///
/// # Errors
/// [`Error::NoColumn`], which lists the columns of the run.
pub fn column(run: &Run, name: &str) -> Result<Column> {
    columns(run)
        .into_iter()
        .find(|c| c.name == name)
        .ok_or_else(|| Error::NoColumn {
            column: name.to_owned(),
            found: run
                .names
                .iter()
                .chain(run.derived_names.iter().map(|d| &d.0))
                .cloned()
                .collect(),
        })
}
