//! The body of a track file: columns by name, each row with its line.

use super::observed::NUMBERS_OF_BINS;
use super::star::MAX_STARS;
use crate::error::{Error, Result, TrackFault};
use std::path::Path;

/// Largest number of rows of a table: those of bins, which have a limit of their own, and of single stars.
const MAX_ROWS: usize = *NUMBERS_OF_BINS.end() + MAX_STARS;

/// The columns that a track may have. Others are refused, because what they say would be ignored.
pub const COLUMNS: [&str; 13] = [
    "phi",
    "PA",
    "r",
    "r_err",
    "r_err_lo",
    "r_err_hi",
    "n",
    "v",
    "v_err",
    "width",
    "width_err",
    "density",
    "density_err",
];

/// The body of a file: columns by name, each row with its line.
pub struct Table {
    names: Vec<String>,
    /// The line of the names, from 1.
    pub names_line: usize,
    /// The rows in the order of the file, each with its line.
    pub rows: Vec<(usize, Vec<String>)>,
}

/// The name among `known` that is nearest to `name`, if it differs in so few letters that it may have been meant.
pub fn nearest(name: &str, known: &[&'static str]) -> Option<&'static str> {
    let name = name.to_lowercase();
    let distance = |other: &str| strsim::osa_distance(&name, &other.to_lowercase());
    let near = known.iter().min_by_key(|other| distance(other))?;
    (distance(near) <= near.len().div_ceil(3)).then_some(*near)
}

impl Table {
    /// Splits the text of a file into the table's rows. Lines that are empty or begin with `#` are skipped.
    pub fn parse(path: &Path, text: &str, delimiter: u8) -> Result<Self> {
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
            } else if rows.len() == MAX_ROWS {
                return Err(Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(line),
                    fault: TrackFault::TooManyRows { max: MAX_ROWS },
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
        let table = Self {
            names,
            names_line,
            rows,
        };
        match table.name_fault() {
            None => Ok(table),
            Some(fault) => Err(table.fail(path, fault)),
        }
    }

    /// What is wrong with the names of the columns.
    fn name_fault(&self) -> Option<TrackFault> {
        let unknown = self.names.iter().find(|n| !COLUMNS.contains(&n.as_str()));
        // One name alone is a line that is not separated.
        let separated = unknown.filter(|_| self.names.len() > 1);
        if let Some((column, name)) = separated.and_then(|column| Some((column, named(column)?))) {
            return Some(TrackFault::UnitInName {
                column: column.clone(),
                name,
            });
        }
        if let Some(line) = unknown.filter(|name| name.contains([';', '\t', ' '])) {
            return Some(TrackFault::Delimiter {
                names: line.clone(),
            });
        }
        if let Some(column) = unknown {
            return Some(TrackFault::UnknownColumn {
                column: column.clone(),
                nearest: nearest(column, &COLUMNS),
                known: &COLUMNS,
            });
        }
        let repeated = |(i, name): &(usize, &String)| self.names[..*i].contains(name);
        let (_, column) = self.names.iter().enumerate().find(repeated)?;
        Some(TrackFault::RepeatedColumn {
            column: column.clone(),
        })
    }

    /// Takes out the rows in which a column is empty, as a table of the same columns.
    pub fn take_rows_without(&mut self, name: &str) -> Self {
        let at = self.names.iter().position(|n| n == name);
        let is_empty = |row: &(usize, Vec<String>)| at.is_some_and(|at| row.1[at].is_empty());
        let (without, with) = self.rows.drain(..).partition(is_empty);
        self.rows = with;
        Self {
            names: self.names.clone(),
            names_line: self.names_line,
            rows: without,
        }
    }

    /// The columns that have something in a row.
    pub fn filled(&self, row: usize) -> Vec<&str> {
        let cells = self.names.iter().zip(&self.rows[row].1);
        cells
            .filter(|(_, cell)| !cell.is_empty())
            .map(|(name, _)| name.as_str())
            .collect()
    }

    /// A fault at the line of the names.
    pub fn fail(&self, path: &Path, fault: TrackFault) -> Error {
        Error::TrackFile {
            path: path.to_path_buf(),
            line: Some(self.names_line),
            fault,
        }
    }

    /// A fault of a row, counted from 0.
    pub fn fail_at(&self, path: &Path, row: usize, fault: TrackFault) -> Error {
        Error::TrackFile {
            path: path.to_path_buf(),
            line: Some(self.rows[row].0),
            fault,
        }
    }

    /// Whether the column is there.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// A column's numbers; it must be there.
    pub fn need(&self, path: &Path, name: &'static str) -> Result<Vec<f64>> {
        let column = || TrackFault::MissingColumn {
            column: name,
            found: self.names.clone(),
        };
        let found = self.find(path, name)?;
        found.ok_or_else(|| self.fail(path, column()))
    }

    /// A column's numbers, if the column is there.
    pub fn find(&self, path: &Path, name: &str) -> Result<Option<Vec<f64>>> {
        let Some(at) = self.names.iter().position(|n| n == name) else {
            return Ok(None);
        };
        self.rows
            .iter()
            .map(|row| number(path, name, row, at))
            .collect::<Result<Vec<f64>>>()
            .map(Some)
    }

    /// A column's numbers, if the column is there; `None` in a row where it is empty.
    pub fn find_sparse(&self, path: &Path, name: &str) -> Result<Option<Vec<Option<f64>>>> {
        let Some(at) = self.names.iter().position(|n| n == name) else {
            return Ok(None);
        };
        self.rows
            .iter()
            .map(|row| {
                let is_empty = row.1[at].is_empty();
                (!is_empty).then(|| number(path, name, row, at)).transpose()
            })
            .collect::<Result<Vec<Option<f64>>>>()
            .map(Some)
    }
}

/// The known name of a column with its unit behind it, such as `r [kpc]` or `r kpc`.
fn named(column: &str) -> Option<&'static str> {
    let end = column.find([' ', '\t', '[', '('])?;
    let (name, unit) = (&column[..end], column[end..].trim());
    let is_unit = unit.starts_with(['[', '('])
        || !(unit.contains([' ', '\t', ';']) || COLUMNS.contains(&unit));
    let known = COLUMNS.into_iter().find(|known| *known == name);
    known.filter(|_| is_unit)
}

/// The number in field `at`, which is that of the column `name`, of a row.
fn number(
    path: &Path,
    name: &str,
    (line, fields): &(usize, Vec<String>),
    at: usize,
) -> Result<f64> {
    fields[at].parse().map_err(|_| Error::TrackFile {
        path: path.to_path_buf(),
        line: Some(*line),
        fault: TrackFault::NotANumber {
            column: name.to_owned(),
            text: fields[at].clone(),
        },
    })
}
