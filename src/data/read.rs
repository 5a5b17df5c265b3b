//! Files to tracks: finds the columns, applies the units, and turns each fault into an error with its line.

use super::angles::{Handedness, header_angle_deg, phi_deg, star_phi_deg};
use super::assumed_error::AssumedError;
use super::ecsv::{self, Header, quantity};
use super::header_keys::meant_by;
use super::measured::Measured;
use super::observed::{MIRRORED, ObservedTrack};
use super::star::StarVelocity;
use super::table::Table;
use super::{check, csv_header};
use crate::error::{Error, Result, TrackFault};
use crate::track::BinQuantity;
use oblate_samplers::read;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Largest size of a track file.
const MAX_BYTES: u64 = 16 << 20;

/// Kiloparsecs per arcsecond and megaparsec: 1000 / 206264.806...
const KPC_PER_ARCSEC_MPC: f64 = 1000.0 * std::f64::consts::PI / (180.0 * 3600.0);

/// What a file of a track may leave open.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The errors of a track that has none; instead of the header's `assume_error`.
    pub assumed_error: Option<AssumedError>,
    /// The sense of phi; instead of the header's `handedness`.
    pub handedness: Option<Handedness>,
}

fn track(path: &Path, options: &ReadOptions) -> Result<ObservedTrack> {
    let text = read::text(path, MAX_BYTES).map_err(Error::io(
        path,
        "give the path of a readable ECSV or CSV track (UTF-8 text)",
    ))?;
    let lines: Vec<&str> = text.lines().collect();
    let comments = lines.iter().take_while(|l| l.starts_with('#')).count();
    let is_ecsv = lines.first().is_some_and(|l| l.starts_with("# %ECSV"));
    let mut header = if is_ecsv {
        ecsv::header(path, &lines[..comments])?
    } else {
        csv_header::header(path, &lines[..comments])?
    };
    // ECSV without a delimiter is separated by spaces; that is its default.
    let usual = if is_ecsv { b' ' } else { b',' };
    let mut table = Table::parse(path, &text, header.delimiter.unwrap_or(usual))?;
    let fail = |table: &Table, fault| table.fail(path, fault);
    let in_header = |key: &str, fault| Error::TrackFile {
        path: path.to_path_buf(),
        line: line_of(&lines, key),
        fault,
    };
    if let Some(fault) = header_fault(&header, &table, is_ecsv) {
        let key = match &fault {
            TrackFault::HeaderKey { key, .. } => key.as_str(),
            _ => "units",
        };
        return Err(in_header(key, fault.clone()));
    }

    let star_rows = table.take_rows_without("r");
    let handedness = match options.handedness {
        Some(handedness) => handedness,
        None => entry(&header, "handedness", "`as-given` or `mirrored`")
            .map_err(|fault| in_header("handedness", fault))?
            .unwrap_or_default(),
    };
    let mut phi_deg = phi_deg(path, &table, &header)?;
    let star_angles = if star_rows.rows.is_empty() {
        Vec::new()
    } else {
        star_phi_deg(path, &star_rows, &header, &phi_deg)?
    };
    if handedness == Handedness::Mirrored {
        // Reversed, so that phi increases.
        table.rows.reverse();
        phi_deg = phi_deg.iter().rev().map(|phi| -phi).collect();
        header.meta.insert(MIRRORED.to_owned(), Value::from(true));
    }
    let kpc = |column: &'static str| kpc(path, &table, &header, column);
    let Some(r_kpc) = kpc("r")? else {
        table.need(path, "r")?;
        return Err(fail(&table, TrackFault::NoTable));
    };
    let given = (kpc("r_err")?, kpc("r_err_lo")?, kpc("r_err_hi")?);
    let assumed = match options.assumed_error {
        Some(assumed) => Some(assumed),
        None => entry(&header, "assume_error", "per cent of r, such as `2%`")
            .map_err(|fault| in_header("assume_error", fault))?,
    };
    let (r_err_lo_kpc, r_err_hi_kpc) = match (given, assumed) {
        ((Some(both), None, None), None) => (both.clone(), both),
        ((None, Some(lo), Some(hi)), None) => (lo, hi),
        ((None, None, None), Some(assumed)) => {
            let errors: Vec<f64> = r_kpc.iter().map(|r| assumed.of(*r)).collect();
            (errors.clone(), errors)
        }
        ((None, None, None), None) => return Err(fail(&table, TrackFault::NoErrors)),
        ((Some(_), None, None) | (None, Some(_), Some(_)), Some(_)) => {
            return Err(fail(&table, TrackFault::ErrorsAndAssumption));
        }
        _ => return Err(fail(&table, TrackFault::ErrorColumns)),
    };
    let bin_width_deg = match header_angle_deg(&header, "bin_width") {
        Some(width) => width.map_err(|fault| in_header("bin_width", fault))?,
        None => smallest_step(&phi_deg),
    };
    let name = match header.meta.get("name").and_then(Value::as_str) {
        Some(name) => name.to_owned(),
        None => path
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
    };
    let mut measured = measured(path, &table, &header)?;
    if !star_rows.rows.is_empty() {
        // The columns of velocities may be those of the stars alone.
        measured.retain(|quantity, rows| {
            *quantity != BinQuantity::Velocity || rows.iter().any(Option::is_some)
        });
    }
    // The first ones have been used and would be used twice; the last is astropy's note on how it packed its quantities.
    for key in [
        "name",
        "bin_width",
        "assume_error",
        "handedness",
        "progenitor_pa",
        "__serialized_columns__",
    ] {
        header.meta.remove(key);
    }
    let mut track = ObservedTrack {
        name,
        bin_width_deg,
        r_err_lo_kpc,
        r_err_hi_kpc,
        assumed_error: assumed,
        n: table.find(path, "n")?,
        measured,
        stars: Vec::new(),
        phi_deg,
        r_kpc,
        meta: header.meta,
    };
    match check::fault(&track) {
        None => {
            track.stars = stars(path, &star_rows, &star_angles, handedness, &track)?;
            Ok(track)
        }
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

/// The single stars of a track, of which the rows have these angles in the sense of the file.
fn stars(
    path: &Path,
    rows: &Table,
    phi_deg: &[f64],
    handedness: Handedness,
    track: &ObservedTrack,
) -> Result<Vec<StarVelocity>> {
    let sign = match handedness {
        Handedness::AsGiven => 1.0,
        Handedness::Mirrored => -1.0,
    };
    let numbers = |column: &str| rows.find_sparse(path, column);
    let (values, errors) = (numbers("v")?, numbers("v_err")?);
    let fault = check::star_faults(track);
    let mut stars = Vec::with_capacity(phi_deg.len());
    for (row, phi) in phi_deg.iter().enumerate() {
        let fail = |fault| {
            Err(Error::TrackFile {
                path: path.to_path_buf(),
                line: Some(rows.rows[row].0),
                fault,
            })
        };
        let bad = |what: &str| {
            fail(TrackFault::BadStar {
                what: what.to_owned(),
            })
        };
        let at = |column: &Option<Vec<Option<f64>>>| column.as_ref().and_then(|c| c[row]);
        let (Some(value), Some(error)) = (at(&values), at(&errors)) else {
            return bad("it lacks a velocity or its error");
        };
        let known = ["phi", "PA", "v", "v_err"];
        if let Some(column) = rows.filled(row).iter().find(|name| !known.contains(name)) {
            return bad(&format!("`{column}` is given"));
        }
        let star = StarVelocity {
            phi_deg: sign * phi,
            v_km_s: Measured { value, error },
        };
        if let Some(fault) = fault(&star) {
            return fail(fault);
        }
        stars.push(star);
    }
    Ok(stars)
}

/// An entry of the header that would be ignored: in ECSV a key that is nearly one that is read, in CSV a unit of a column that is not
/// there.
fn header_fault(header: &Header, table: &Table, is_ecsv: bool) -> Option<TrackFault> {
    if is_ecsv {
        // Units of ECSV are those of its columns.
        let meant = |key: &String| meant_by(key).filter(|meant| *meant != "units");
        return header.meta.keys().find_map(|key| {
            Some(TrackFault::HeaderKey {
                key: key.clone(),
                nearest: meant(key)?.to_owned(),
            })
        });
    }
    let column = header.units.keys().find(|column| !table.has(column))?;
    Some(TrackFault::HeaderValue {
        key: "units",
        text: format!("for `{column}`"),
        expected: "units of columns that the table has",
    })
}

/// An entry of the header that is a word with a meaning.
fn entry<T: std::str::FromStr>(
    header: &Header,
    key: &'static str,
    expected: &'static str,
) -> std::result::Result<Option<T>, TrackFault> {
    let Some(value) = header.meta.get(key) else {
        return Ok(None);
    };
    let word = value.as_str().and_then(|word| word.parse().ok());
    word.map(Some).ok_or_else(|| TrackFault::HeaderValue {
        key,
        text: value.to_string(),
        expected,
    })
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

/// A column of radii or of their errors in kpc, if it is there.
fn kpc(
    path: &Path,
    table: &Table,
    header: &Header,
    column: &'static str,
) -> Result<Option<Vec<f64>>> {
    let Some(values) = table.find(path, column)? else {
        return Ok(None);
    };
    let to_kpc = to_kpc(path, table, header, column)?;
    Ok(Some(values.iter().map(|x| x * to_kpc).collect()))
}

/// The unit of a column of lengths in kpc. A column without a unit has that of the radii.
fn to_kpc(path: &Path, table: &Table, header: &Header, column: &'static str) -> Result<f64> {
    let fail = |fault| table.fail(path, fault);
    let unit = header.units.get(column).or_else(|| header.units.get("r"));
    Ok(match unit.map(String::as_str) {
        Some("arcsec") => KPC_PER_ARCSEC_MPC * distance_mpc(header).map_err(fail)?,
        Some("kpc") => 1.0,
        Some(unit) => {
            return Err(fail(TrackFault::UnknownUnit {
                column: column.to_owned(),
                unit: unit.to_owned(),
                known: "kpc, or in arcsec with `distance` [Mpc] in the header",
            }));
        }
        // A distance is of use only where radii are angles.
        None if header.meta.contains_key("distance") => {
            return Err(fail(TrackFault::DistanceWithoutUnit));
        }
        None => 1.0,
    })
}

/// Names of km/s and of one over a degree: as people and as astropy write them.
const KM_S: [&str; 4] = ["km / s", "km/s", "km s-1", "km.s**-1"];
const PER_DEGREE: [&str; 4] = ["1 / deg", "1/deg", "deg-1", "deg**-1"];

/// Checks that a column has no unit or one of `names`.
fn check_unit(
    path: &Path,
    table: &Table,
    header: &Header,
    column: &'static str,
    names: &[&str],
    known: &'static str,
) -> Result<()> {
    match header.units.get(column) {
        Some(unit) if !names.contains(&unit.as_str()) => Err(table.fail(
            path,
            TrackFault::UnknownUnit {
                column: column.to_owned(),
                unit: unit.to_owned(),
                known,
            },
        )),
        _ => Ok(()),
    }
}

/// What is measured beside the radii. A row has both a value and its error, or neither.
fn measured(
    path: &Path,
    table: &Table,
    header: &Header,
) -> Result<BTreeMap<BinQuantity, Vec<Option<Measured>>>> {
    let mut measured = BTreeMap::new();
    for quantity in BinQuantity::ALL {
        let column = quantity.column();
        let names = [column.value, column.error];
        let numbers = (
            table.find_sparse(path, column.value)?,
            table.find_sparse(path, column.error)?,
        );
        let (values, errors) = match numbers {
            (None, None) => continue,
            (Some(values), Some(errors)) => (values, errors),
            (None, Some(_)) => return Err(table.fail(path, half(column.error, column.value))),
            (Some(_), None) => return Err(table.fail(path, half(column.value, column.error))),
        };
        let mut factors = [1.0; 2];
        for (factor, name) in factors.iter_mut().zip(names) {
            match quantity {
                BinQuantity::Velocity => {
                    check_unit(path, table, header, name, &KM_S, "km/s")?;
                }
                BinQuantity::Width => *factor = to_kpc(path, table, header, name)?,
                BinQuantity::Density => {
                    check_unit(path, table, header, name, &PER_DEGREE, "1/deg")?;
                }
            }
        }
        let mut rows = Vec::with_capacity(values.len());
        for (row, pair) in values.into_iter().zip(errors).enumerate() {
            let fault = match pair {
                (Some(value), Some(error)) => {
                    rows.push(Some(Measured {
                        value: value * factors[0],
                        error: error * factors[1],
                    }));
                    continue;
                }
                (None, None) => {
                    rows.push(None);
                    continue;
                }
                (Some(_), None) => half(column.value, column.error),
                (None, Some(_)) => half(column.error, column.value),
            };
            return Err(Error::TrackFile {
                path: path.to_path_buf(),
                line: table.rows.get(row).map(|(line, _)| *line),
                fault,
            });
        }
        measured.insert(quantity, rows);
    }
    Ok(measured)
}

/// A value without its error, or an error without its value.
fn half(given: &'static str, missing: &'static str) -> TrackFault {
    TrackFault::HalfMeasured { given, missing }
}

/// The header's distance, which must be in Mpc.
fn distance_mpc(header: &Header) -> std::result::Result<f64, TrackFault> {
    let value = header.meta.get("distance").ok_or(TrackFault::NoDistance)?;
    match quantity(value) {
        Some((mpc, unit)) if mpc > 0.0 && unit.as_deref().is_none_or(|u| u == "Mpc") => Ok(mpc),
        _ => Err(TrackFault::BadDistance {
            text: value.to_string(),
        }),
    }
}

/// The line, from 1, of the first header line that names `key`.
fn line_of(lines: &[&str], key: &str) -> Option<usize> {
    lines.iter().position(|l| l.contains(key)).map(|i| i + 1)
}

impl ObservedTrack {
    /// As [`read_with`](Self::read_with), for a file that leaves nothing open.
    ///
    /// # Errors
    /// Those of [`read_with`](Self::read_with).
    pub fn read(path: &Path) -> Result<Self> {
        track(path, &ReadOptions::default())
    }

    /// Reads a track from ECSV (a file that starts with `# %ECSV`) or plain CSV; docs/tracks.md explains both.
    ///
    /// Columns: `phi`, or `PA` with `progenitor_pa` in the header (deg, rad, arcmin or arcsec); `r` (kpc, or arcsec with `distance` in
    /// Mpc in the header); `r_err`, or `r_err_lo` and `r_err_hi` (as `r`); optionally `n`, `v` with `v_err` (km/s), `width`
    /// with `width_err` (as `r`), and `density` with `density_err` (stars per degree), which may be empty in some rows. The header may give `bin_width` in degrees;
    /// otherwise it is the smallest step of `phi`. Without units, angles are in degrees and radii in kpc.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::TrackFile`] with line and column if it is not a table, a column is missing or
    /// not known, the radii have neither errors nor an assumed one, a unit is unknown, an entry of the header cannot be understood, a
    /// value is not finite, not positive or out of its range, bins are fewer than three or more than 10,000, not increasing or not
    /// equally wide.
    pub fn read_with(path: &Path, options: &ReadOptions) -> Result<Self> {
        track(path, options)
    }
}
