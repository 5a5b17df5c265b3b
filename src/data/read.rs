//! Files to tracks: finds the columns, applies the units, and turns each fault into an error with its line.

use super::observed::{NUMBERS_OF_BINS, ObservedTrack, default_errors};
use super::{check, ecsv};
use crate::error::{Error, Result, TrackFault};
use oblate_samplers::read;
use serde_json::Value;
use std::path::Path;

/// Largest size of a track file.
const MAX_BYTES: u64 = 4 << 20;

/// Kiloparsecs per arcsecond and megaparsec: 1000 / 206264.806...
const KPC_PER_ARCSEC_MPC: f64 = 1000.0 * std::f64::consts::PI / (180.0 * 3600.0);

/// The body of a file: columns by name, each row with its line.
struct Table {
    names: Vec<String>,
    names_line: usize,
    rows: Vec<(usize, Vec<String>)>,
}

fn track(path: &Path) -> Result<ObservedTrack> {
    let text = read::text(path, MAX_BYTES).map_err(|source| Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "give the path of a readable ECSV or CSV track (UTF-8 text)",
    })?;
    let lines: Vec<&str> = text.lines().collect();
    let comments = lines.iter().take_while(|l| l.starts_with('#')).count();
    let header = if lines.first().is_some_and(|l| l.starts_with("# %ECSV")) {
        Some(ecsv::header(path, &lines[..comments])?)
    } else {
        None
    };
    // ECSV without a delimiter is separated by spaces; that is its default.
    let delimiter = match &header {
        Some(h) => h.delimiter.unwrap_or(b' '),
        None => b',',
    };
    let table = Table::parse(path, &text, delimiter)?;
    let mut header = header.unwrap_or_default();

    let (phi, phi_unit) = (table.need(path, "phi")?, header.units.get("phi"));
    let to_deg = factor(path, &table, "phi", phi_unit, |u| match u {
        "deg" => Some(1.0),
        "rad" => Some(180.0 / std::f64::consts::PI),
        _ => None,
    })?;
    let phi_deg: Vec<f64> = phi.iter().map(|x| x * to_deg).collect();
    let kpc = |column: &str| -> Result<f64> {
        if header.units.get(column).map(String::as_str) == Some("arcsec") {
            return Ok(KPC_PER_ARCSEC_MPC * distance_mpc(path, &table, &header)?);
        }
        let unit = header.units.get(column);
        factor(path, &table, column, unit, |u| (u == "kpc").then_some(1.0))
    };
    let to_kpc = kpc("r")?;
    let r_kpc: Vec<f64> = table.need(path, "r")?.iter().map(|x| x * to_kpc).collect();
    let r_err_kpc = match table.find(path, "r_err")? {
        Some(values) => {
            let to_kpc = kpc("r_err")?;
            Some(values.iter().map(|x| x * to_kpc).collect())
        }
        None => None,
    };
    let bin_width_deg = match header.meta.get("bin_width") {
        Some(width) => number(width).ok_or_else(|| Error::TrackFile {
            path: path.to_path_buf(),
            line: line_of(&lines, "bin_width"),
            fault: TrackFault::BinWidthNotANumber {
                text: width.to_string(),
            },
        })?,
        None => smallest_step(&phi_deg),
    };
    let name = match header.meta.get("name").and_then(Value::as_str) {
        Some(name) => name.to_owned(),
        None => path
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
    };
    // The first two have fields of their own; the last is astropy's note on how it packed its quantities.
    for key in ["name", "bin_width", "__serialized_columns__"] {
        header.meta.remove(key);
    }
    let track = ObservedTrack {
        name,
        bin_width_deg,
        r_err_assumed: r_err_kpc.is_none(),
        r_err_kpc: r_err_kpc.unwrap_or_else(|| default_errors(&r_kpc)),
        n: table.find(path, "n")?,
        phi_deg,
        r_kpc,
        meta: header.meta,
    };
    match check::fault(&track) {
        None => Ok(track),
        Some(found) => Err(Error::TrackFile {
            path: path.to_path_buf(),
            line: found
                .row
                .and_then(|row| table.rows.get(row))
                .map(|(line, _)| *line)
                .or(Some(table.names_line)),
            fault: found.fault,
        }),
    }
}

/// The smallest positive step, or 0 where there is none (the checks then name the row).
fn smallest_step(phi_deg: &[f64]) -> f64 {
    let min = phi_deg
        .windows(2)
        .map(|w| w[1] - w[0])
        .filter(|step| *step > 0.0)
        .fold(f64::INFINITY, f64::min);
    if min.is_finite() { min } else { 0.0 }
}

/// The factor from a column's unit to degrees or kpc.
fn factor(
    path: &Path,
    table: &Table,
    column: &str,
    unit: Option<&String>,
    known: impl Fn(&str) -> Option<f64>,
) -> Result<f64> {
    let Some(unit) = unit else { return Ok(1.0) };
    known(unit).ok_or_else(|| Error::TrackFile {
        path: path.to_path_buf(),
        line: Some(table.names_line),
        fault: TrackFault::UnknownUnit {
            column: column.to_owned(),
            unit: unit.to_owned(),
            known: if column == "phi" {
                "deg or rad"
            } else {
                "kpc, or in arcsec with `distance` [Mpc] in the header"
            },
        },
    })
}

/// A number as astropy writes it: plain, or a quantity.
fn number(value: &Value) -> Option<f64> {
    value
        .as_f64()
        .or_else(|| value.get("value").and_then(Value::as_f64))
        .filter(|x| x.is_finite())
}

/// The header's distance, which must be in Mpc.
fn distance_mpc(path: &Path, table: &Table, header: &ecsv::Header) -> Result<f64> {
    let fail = |fault| Error::TrackFile {
        path: path.to_path_buf(),
        line: Some(table.names_line),
        fault,
    };
    let Some(value) = header.meta.get("distance") else {
        return Err(fail(TrackFault::NoDistance));
    };
    let unit = value.get("unit").map(|u| {
        u.get("unit")
            .unwrap_or(u)
            .as_str()
            .unwrap_or("unknown")
            .to_owned()
    });
    match (number(value), unit.as_deref()) {
        (Some(mpc), None | Some("Mpc")) if mpc > 0.0 => Ok(mpc),
        _ => Err(fail(TrackFault::BadDistance {
            text: value.to_string(),
        })),
    }
}

/// The line, from 1, of the first header line that names `key`.
fn line_of(lines: &[&str], key: &str) -> Option<usize> {
    lines.iter().position(|l| l.contains(key)).map(|i| i + 1)
}

impl Table {
    fn parse(path: &Path, text: &str, delimiter: u8) -> Result<Self> {
        let mut names = Vec::new();
        let mut names_line = 0;
        let mut rows = Vec::new();
        // Line by line, so that every error has its line; quoted fields with line breaks are not supported.
        for (line, content) in text.lines().enumerate().map(|(i, l)| (i + 1, l)) {
            if content.trim().is_empty() || content.starts_with('#') {
                continue;
            }
            let mut record = csv::StringRecord::new();
            csv::ReaderBuilder::new()
                .has_headers(false)
                .delimiter(delimiter)
                .trim(csv::Trim::All)
                .from_reader(content.trim().as_bytes())
                .read_record(&mut record)
                .map_err(|e| Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(line),
                    fault: TrackFault::BadRow {
                        message: e.to_string(),
                    },
                })?;
            let fields: Vec<String> = record.iter().map(str::to_owned).collect();
            if names_line == 0 {
                names_line = line;
                names = fields;
            } else if rows.len() == *NUMBERS_OF_BINS.end() {
                return Err(Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(line),
                    fault: TrackFault::TooManyBins {
                        bins: rows.len() + 1,
                        max: rows.len(),
                    },
                });
            } else if fields.len() == names.len() {
                rows.push((line, fields));
            } else {
                return Err(Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(line),
                    fault: TrackFault::RowLength {
                        values: fields.len(),
                        columns: names.len(),
                    },
                });
            }
        }
        if names.is_empty() {
            return Err(Error::TrackFile {
                path: path.to_path_buf(),
                line: None,
                fault: TrackFault::NoTable,
            });
        }
        Ok(Self {
            names,
            names_line,
            rows,
        })
    }

    /// A column that must be there.
    fn need(&self, path: &Path, name: &str) -> Result<Vec<f64>> {
        self.find(path, name)?.ok_or_else(|| Error::TrackFile {
            path: path.to_path_buf(),
            line: Some(self.names_line),
            fault: TrackFault::MissingColumn {
                column: name.to_owned(),
                found: self.names.clone(),
            },
        })
    }

    /// A column's numbers, if the column is there.
    fn find(&self, path: &Path, name: &str) -> Result<Option<Vec<f64>>> {
        let Some(at) = self.names.iter().position(|n| n == name) else {
            return Ok(None);
        };
        self.rows
            .iter()
            .map(|(line, fields)| {
                fields[at].parse::<f64>().map_err(|_| Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(*line),
                    fault: TrackFault::NotANumber {
                        column: name.to_owned(),
                        text: fields[at].clone(),
                    },
                })
            })
            .collect::<Result<Vec<f64>>>()
            .map(Some)
    }
}

impl ObservedTrack {
    /// Reads a track from ECSV (a file that starts with `# %ECSV`) or plain CSV.
    ///
    /// Columns: `phi` (deg or rad), `r` (kpc, or arcsec with `distance` in Mpc in the header), optionally `r_err` (as
    /// `r`) and `n`; others are ignored. CSV has no place for units: there `phi` is in degrees, `r` and `r_err` in kpc.
    /// The header may give `bin_width` in degrees; otherwise it is the smallest step of `phi`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::TrackFile`] with line and column if it is not a table, a column
    /// is missing, a unit is unknown, a value is not finite, not positive or out of its range, bins are fewer than three or more
    /// than 10,000, not increasing, not equally wide, or do not have their edges at multiples of the bin width from the progenitor.
    pub fn read(path: &Path) -> Result<Self> {
        track(path)
    }
}
