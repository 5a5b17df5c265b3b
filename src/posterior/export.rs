//! The posterior as one table for other programs: draws of equal weight with names and units, as ECSV or FITS.

use super::columns::{Column, columns};
use super::summary::Summary;
use super::zarr::equal_weight_rows;
use crate::error::{Error, Result};
use fitskit::{BinColumnType, BinTableBuilder, FitsFile, Hdu, HeaderValue};
use oblate_samplers::Run;
use std::fmt::Write;
use std::path::Path;
use std::str::FromStr;

/// The format of an exported table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableFormat {
    /// Enhanced CSV: text, every number to the bit.
    Ecsv,
    /// A binary table in the first extension of a FITS file.
    Fits,
}

impl TableFormat {
    /// The format that the name of a file ends in.
    ///
    /// # Errors
    /// [`Error::Setting`] for any other end than `.ecsv`, `.fits` and `.fit`.
    pub fn of(path: &Path) -> Result<Self> {
        let end = path.extension().and_then(|end| end.to_str());
        end.unwrap_or_default().parse()
    }
}

impl FromStr for TableFormat {
    type Err = Error;

    fn from_str(end: &str) -> Result<Self> {
        match end.to_ascii_lowercase().as_str() {
            "ecsv" => Ok(Self::Ecsv),
            "fits" | "fit" => Ok(Self::Fits),
            _ => Err(Error::Setting {
                key: "format".to_owned(),
                value: format!("{end:?}"),
                remedy: "give a file whose name ends in .ecsv or .fits".to_owned(),
            }),
        }
    }
}

/// Draws of equal weight, the same as in the group `posterior` of `posterior.zarr`: each parameter and derived quantity, and
/// `ln_likelihood`. They are in the order of the chains.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawTable {
    /// The columns, all of one length.
    pub columns: Vec<Column>,
    converged: bool,
    ln_z: f64,
    ln_z_error: f64,
    ess: f64,
    seed: u64,
    method: &'static str,
}

impl DrawTable {
    /// Of a run.
    #[must_use]
    pub fn new(run: &Run, summary: &Summary) -> Self {
        let rows: Vec<usize> = equal_weight_rows(run).into_iter().flatten().collect();
        let mut columns = columns(run);
        columns.push(Column {
            name: "ln_likelihood".to_owned(),
            unit: String::new(),
            values: run.draws.ln_likelihood.clone(),
        });
        for column in &mut columns {
            column.values = rows.iter().map(|row| column.values[*row]).collect();
        }
        Self {
            columns,
            converged: summary.converged,
            ln_z: summary.ln_z.value,
            ln_z_error: summary.ln_z.error,
            ess: summary.ess,
            seed: summary.seed,
            method: summary.method.name(),
        }
    }

    /// Number of draws.
    #[must_use]
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }

    /// Whether there are no draws.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::Setting`] for a table that FITS cannot hold.
    pub fn bytes(&self, format: TableFormat) -> Result<Vec<u8>> {
        match format {
            TableFormat::Ecsv => Ok(self.ecsv().into_bytes()),
            TableFormat::Fits => self.fits(),
        }
    }

    fn ecsv(&self) -> String {
        let mut out = String::from("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n");
        // Writing to a string cannot fail.
        for Column { name, unit, .. } in &self.columns {
            let unit = if unit.is_empty() {
                String::new()
            } else {
                format!("unit: {unit}, ")
            };
            let _ = writeln!(out, "# - {{name: {name}, {unit}datatype: float64}}");
        }
        let _ = write!(
            out,
            "# meta:\n#   made_by: oblate {}\n#   method: {}\n#   converged: {}\n#   ln_z: {}\n#   ln_z_error: {}\n#   ess: {}\n#   seed: {}\n# schema: astropy-2.0\n",
            env!("CARGO_PKG_VERSION"),
            self.method,
            self.converged,
            yaml(self.ln_z),
            yaml(self.ln_z_error),
            yaml(self.ess),
            self.seed
        );
        let names: Vec<&str> = self.columns.iter().map(|c| c.name.as_str()).collect();
        let _ = writeln!(out, "{}", names.join(","));
        for row in 0..self.len() {
            let values: Vec<String> = self
                .columns
                .iter()
                .map(|c| format!("{:?}", c.values[row]))
                .collect();
            let _ = writeln!(out, "{}", values.join(","));
        }
        out
    }

    fn fits(&self) -> Result<Vec<u8>> {
        let mut table = BinTableBuilder::new();
        for Column { name, unit, .. } in &self.columns {
            // FITS has no decades; the name of such a column begins with log10.
            let known = |unit: &&str| !unit.is_empty() && !unit.starts_with("dex");
            let unit = Some(unit.as_str()).filter(known);
            table = table.add_column_full(name, BinColumnType::D64(1), 1.0, 0.0, unit);
        }
        for row in 0..self.len() {
            table = table.push_row(|cells| {
                let values = self.columns.iter().map(|column| column.values[row]);
                values.for_each(|value| cells.write_f64(value));
            });
        }
        let mut extension = Hdu::bintable_extension(table.build());
        let made_by = format!("oblate {}", env!("CARGO_PKG_VERSION"));
        let seed = i64::try_from(self.seed).unwrap_or(i64::MAX);
        let text = |text: &str| Some(HeaderValue::String(text.to_owned()));
        // FITS has no card of a number that is not finite.
        let number = |x: f64| Some(HeaderValue::Float(x)).filter(|_| x.is_finite());
        for (key, value, comment) in [
            ("EXTNAME", text("POSTERIOR"), "draws of equal weight"),
            ("CREATOR", text(&made_by), ""),
            ("METHOD", text(self.method), "sampler"),
            (
                "CONVERGE",
                Some(HeaderValue::Logical(self.converged)),
                "all checks passed",
            ),
            ("LNZ", number(self.ln_z), "log evidence"),
            ("LNZ_ERR", number(self.ln_z_error), "its standard error"),
            ("ESS", number(self.ess), "effective sample size"),
            ("SEED", Some(HeaderValue::Integer(seed)), ""),
        ] {
            let comment = Some(comment).filter(|comment| !comment.is_empty());
            if let Some(value) = value {
                extension.header.set(key, value, comment);
            }
        }
        let mut file = FitsFile::with_empty_primary();
        file.push_extension(extension);
        // Without checksums: those of this library are not what astropy computes.
        file.to_bytes().map_err(|e| Error::Setting {
            key: "format".to_owned(),
            value: "fits".to_owned(),
            remedy: format!("{e}; export it as ECSV"),
        })
    }
}

/// A number in the YAML of a header.
fn yaml(x: f64) -> String {
    match x {
        x if x.is_finite() => format!("{x:?}"),
        x if x.is_nan() => ".nan".to_owned(),
        x if x > 0.0 => ".inf".to_owned(),
        _ => "-.inf".to_owned(),
    }
}
