//! Files to tracks: finds the columns, applies the units, and turns each fault into an error with its line.

use super::angles::{Handedness, header_angle_deg, phi_deg, star_phi_deg};
use super::assumed_error::AssumedError;
use super::ecsv::{self, Header, quantity};
use super::header_keys::{Entry, comments, entry, meant_by};
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
use std::str::FromStr;

/// Largest size of a track file.
const MAX_BYTES: u64 = 16 << 20;

/// Kiloparsecs per arcsecond and megaparsec: 1000 / 206264.806...
const KPC_PER_ARCSEC_MPC: f64 = 1000.0 * std::f64::consts::PI / (180.0 * 3600.0);

/// Names of km/s and of one over a degree: as people and as astropy write them.
const KM_S: [&str; 4] = ["km / s", "km/s", "km s-1", "km.s**-1"];
const PER_DEGREE: [&str; 4] = ["1 / deg", "1/deg", "deg-1", "deg**-1"];

/// What a file of a track may leave open.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// The errors of a track that has none; instead of the header's `assume_error`.
    pub assumed_error: Option<AssumedError>,
    /// The sense of phi; instead of the header's `handedness`.
    pub handedness: Option<Handedness>,
}

/// Entries of the header that are not kept with the track: the first ones have been used and would be used twice; the last is astropy's note
/// on how it packed its quantities.
const NOT_KEPT: [&str; 6] = [
    "name",
    "bin_width",
    "assume_error",
    "handedness",
    "progenitor_pa",
    "__serialized_columns__",
];

fn track(path: &Path, options: &ReadOptions) -> Result<ObservedTrack> {
    let mut file = TrackFile::open(path)?;
    let handedness = match options.handedness {
        Some(handedness) => handedness,
        None => file
            .entry("handedness", "`as-given` or `mirrored`")?
            .unwrap_or_default(),
    };
    let mut phi_deg = phi_deg(path, &file.bins, &file.header)?;
    let star_phi_deg = if file.has_stars() {
        star_phi_deg(path, &file.star_rows, &file.header, &phi_deg)?
    } else {
        Vec::new()
    };
    if handedness == Handedness::Mirrored {
        // Reversed, so that phi increases.
        file.bins.rows.reverse();
        phi_deg = phi_deg.iter().rev().map(|phi| -phi).collect();
        let meta = &mut file.header.meta;
        // A track that was mirrored before has its first sense again.
        if meta.remove(MIRRORED).is_none() {
            meta.insert(MIRRORED.to_owned(), Value::from(true));
        }
    }
    let r_kpc = file.in_kpc("r", &file.bins.need(path, "r")?)?;
    let (r_err_lo_kpc, r_err_hi_kpc, assumed_error) =
        file.radius_errors_kpc(&r_kpc, options.assumed_error)?;
    let mut track = ObservedTrack {
        name: file.name(),
        bin_width_deg: file.bin_width_deg(&phi_deg)?,
        r_err_lo_kpc,
        r_err_hi_kpc,
        assumed_error,
        measured: file.measured()?,
        n: file.bins.find(path, "n")?,
        stars: Vec::new(),
        phi_deg,
        r_kpc,
        meta: file.kept_meta(),
    };
    if let Some(found) = check::fault(&track) {
        return Err(match found.row {
            Some(row) => file.bins.fail_at(path, row, found.fault),
            None => file.fail(found.fault),
        });
    }
    track.stars = file.stars(&star_phi_deg, handedness, &track)?;
    Ok(track)
}

/// A file of a track: its header, and the rows of its table.
struct TrackFile<'a> {
    path: &'a Path,
    text: String,
    header: Header,
    bins: Table,
    /// The rows of single stars, those without a radius.
    star_rows: Table,
}

impl<'a> TrackFile<'a> {
    /// Reads a file, and refuses a header with an entry that would be ignored.
    fn open(path: &'a Path) -> Result<Self> {
        let text = read::text(path, MAX_BYTES).map_err(Error::io(
            path,
            "give the path of a readable ECSV or CSV track (UTF-8 text)",
        ))?;
        let (above, mut outside) = comments(&text);
        let first = above.iter().position(|(_, l)| l.starts_with("# %ECSV"));
        let is_ecsv = first.is_some();
        let header = if let Some(first) = first {
            outside.extend(&above[..first]);
            ecsv::header(path, &above[first..])?
        } else {
            csv_header::header(path, &above)?
        };
        for (line, comment) in outside {
            if let Entry::Value(key, _) | Entry::Nearly(key, _) = entry(comment) {
                let key = key.to_owned();
                return Err(Error::TrackFile {
                    path: path.to_path_buf(),
                    line: Some(line),
                    fault: TrackFault::HeaderPlace { key },
                });
            }
        }
        // ECSV without a delimiter is separated by spaces; that is its default.
        let usual = if is_ecsv { b' ' } else { b',' };
        let mut bins = Table::parse(path, &text, header.delimiter.unwrap_or(usual))?;
        let fault = header_fault(&header, &bins, is_ecsv);
        let file = Self {
            path,
            text,
            header,
            star_rows: bins.take_rows_without("r"),
            bins,
        };
        match fault {
            None => Ok(file),
            Some((key, fault)) => Err(file.fail_in_header(&key, fault)),
        }
    }

    /// A fault at the first line that names a key of the header.
    fn fail_in_header(&self, key: &str, fault: TrackFault) -> Error {
        let index = self.text.lines().position(|l| l.contains(key));
        Error::TrackFile {
            path: self.path.to_path_buf(),
            line: index.map(|i| i + 1),
            fault,
        }
    }

    /// A fault of the columns.
    fn fail(&self, fault: TrackFault) -> Error {
        self.bins.fail(self.path, fault)
    }

    /// An entry of the header that is a word with a meaning.
    fn entry<T: FromStr>(&self, key: &'static str, expected: &'static str) -> Result<Option<T>> {
        let Some(value) = self.header.meta.get(key) else {
            return Ok(None);
        };
        let word = value.as_str().and_then(|word| word.parse().ok());
        word.map(Some).ok_or_else(|| {
            let text = value.to_string();
            let fault = TrackFault::HeaderValue {
                key,
                text,
                expected,
            };
            self.fail_in_header(key, fault)
        })
    }

    /// The header's `name`, or the file's stem.
    fn name(&self) -> String {
        match self.header.meta.get("name") {
            Some(Value::String(name)) => name.clone(),
            // Digits alone are a number to YAML.
            Some(Value::Number(name)) => name.to_string(),
            _ => (self.path.file_stem())
                .map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
        }
    }

    /// The header's `bin_width`, or the smallest step of phi.
    fn bin_width_deg(&self, phi_deg: &[f64]) -> Result<f64> {
        match header_angle_deg(&self.header, "bin_width") {
            Some(width) => width.map_err(|fault| self.fail_in_header("bin_width", fault)),
            None => Ok(smallest_step(phi_deg)),
        }
    }

    /// The entries of the header that are kept with the track.
    fn kept_meta(&self) -> BTreeMap<String, Value> {
        let mut meta = self.header.meta.clone();
        meta.retain(|key, _| !NOT_KEPT.contains(&key.as_str()));
        meta
    }

    /// Errors of the radii towards smaller and larger ones, from their columns or from an assumed relative error, and that error if it is used.
    /// `assumed` takes the place of the header's `assume_error`.
    fn radius_errors_kpc(
        &self,
        r_kpc: &[f64],
        assumed: Option<AssumedError>,
    ) -> Result<(Vec<f64>, Vec<f64>, Option<AssumedError>)> {
        let given = (
            self.find_kpc("r_err")?,
            self.find_kpc("r_err_lo")?,
            self.find_kpc("r_err_hi")?,
        );
        let assumed = match assumed {
            Some(assumed) => Some(assumed),
            None => self.entry("assume_error", "per cent of r, such as `2%`")?,
        };
        match (given, assumed) {
            ((Some(both), None, None), None) => Ok((both.clone(), both, None)),
            ((None, Some(lo), Some(hi)), None) => Ok((lo, hi, None)),
            ((None, None, None), Some(assumed)) => {
                let errors: Vec<f64> = r_kpc.iter().map(|r| assumed.of(*r)).collect();
                Ok((errors.clone(), errors, Some(assumed)))
            }
            ((None, None, None), None) => Err(self.fail(TrackFault::NoErrors)),
            ((Some(_), None, None) | (None, Some(_), Some(_)), Some(_)) => {
                Err(self.fail(TrackFault::ErrorsAndAssumption))
            }
            _ => Err(self.fail(TrackFault::ErrorColumns)),
        }
    }

    /// A column of errors of radii in kpc, if it is there.
    fn find_kpc(&self, column: &'static str) -> Result<Option<Vec<f64>>> {
        let values = self.bins.find(self.path, column)?;
        values.map(|x| self.in_kpc(column, &x)).transpose()
    }

    /// The values of a column of lengths in kpc.
    fn in_kpc(&self, column: &'static str, values: &[f64]) -> Result<Vec<f64>> {
        let to_kpc = self.to_kpc(column)?;
        Ok(values.iter().map(|x| x * to_kpc).collect())
    }

    /// The unit of a column of lengths in kpc. A column without a unit has that of the radii.
    fn to_kpc(&self, column: &'static str) -> Result<f64> {
        let header = &self.header;
        let unit = header.units.get(column).or_else(|| header.units.get("r"));
        Ok(match unit.map(String::as_str) {
            Some("arcsec") => {
                let distance = distance_mpc(header, column);
                KPC_PER_ARCSEC_MPC * distance.map_err(|fault| self.fail(fault))?
            }
            Some("kpc") => 1.0,
            Some(unit) => {
                return Err(self.fail(TrackFault::UnknownUnit {
                    column: column.to_owned(),
                    unit: unit.to_owned(),
                    known: "kpc, or in arcsec with `distance` [Mpc] in the header",
                }));
            }
            // A distance is of use only where radii are angles.
            None if header.meta.contains_key("distance") => {
                return Err(self.fail(TrackFault::DistanceWithoutUnit));
            }
            None => 1.0,
        })
    }

    /// Checks that a column has no unit or one of `names`.
    fn check_unit(&self, column: &'static str, names: &[&str], known: &'static str) -> Result<()> {
        match self.header.units.get(column) {
            Some(unit) if !names.contains(&unit.as_str()) => {
                Err(self.fail(TrackFault::UnknownUnit {
                    column: column.to_owned(),
                    unit: unit.to_owned(),
                    known,
                }))
            }
            _ => Ok(()),
        }
    }

    /// What is measured beside the radii.
    fn measured(&self) -> Result<BTreeMap<BinQuantity, Vec<Option<Measured>>>> {
        let mut measured = BTreeMap::new();
        for quantity in BinQuantity::ALL {
            if let Some(rows) = self.rows_of(quantity)? {
                measured.insert(quantity, rows);
            }
        }
        if self.has_stars() {
            // The columns of velocities may be those of the stars alone.
            measured.retain(|quantity, rows| {
                *quantity != BinQuantity::Velocity || rows.iter().any(Option::is_some)
            });
        }
        Ok(measured)
    }

    /// A quantity that is measured beside the radii, if its columns are there. A row has both a value and its error, or neither.
    fn rows_of(&self, quantity: BinQuantity) -> Result<Option<Vec<Option<Measured>>>> {
        let column = quantity.column();
        let no_error = || half(column.value, column.error);
        let no_value = || half(column.error, column.value);
        let numbers = |name| self.bins.find_sparse(self.path, name);
        let (values, errors) = match (numbers(column.value)?, numbers(column.error)?) {
            (None, None) => return Ok(None),
            (Some(values), Some(errors)) => (values, errors),
            (Some(_), None) => return Err(self.fail(no_error())),
            (None, Some(_)) => return Err(self.fail(no_value())),
        };
        let value_unit = self.unit_of(quantity, column.value)?;
        let error_unit = self.unit_of(quantity, column.error)?;
        let row = |(row, pair)| {
            let fault = match pair {
                (Some(value), Some(error)) => {
                    return Ok(Some(Measured {
                        value: value * value_unit,
                        error: error * error_unit,
                    }));
                }
                (None, None) => return Ok(None),
                (Some(_), None) => no_error(),
                (None, Some(_)) => no_value(),
            };
            Err(self.bins.fail_at(self.path, row, fault))
        };
        let pairs = values.into_iter().zip(errors);
        pairs.enumerate().map(row).collect::<Result<_>>().map(Some)
    }

    /// The unit of a column of a quantity in km/s, kpc or one over a degree.
    fn unit_of(&self, quantity: BinQuantity, column: &'static str) -> Result<f64> {
        match quantity {
            BinQuantity::Velocity => self.check_unit(column, &KM_S, "km/s").map(|()| 1.0),
            BinQuantity::Width => self.to_kpc(column),
            BinQuantity::Density => (self.check_unit(column, &PER_DEGREE, "1/deg")).map(|()| 1.0),
        }
    }

    /// Whether it has single stars.
    fn has_stars(&self) -> bool {
        !self.star_rows.rows.is_empty()
    }

    /// The single stars of a track, of which the rows have these angles in the sense of the file.
    fn stars(
        &self,
        phi_deg: &[f64],
        handedness: Handedness,
        track: &ObservedTrack,
    ) -> Result<Vec<StarVelocity>> {
        let sign = match handedness {
            Handedness::AsGiven => 1.0,
            Handedness::Mirrored => -1.0,
        };
        let numbers = |column: &str| self.star_rows.find_sparse(self.path, column);
        let (values, errors) = (numbers("v")?, numbers("v_err")?);
        let fault = check::star_faults(track);
        let mut stars = Vec::with_capacity(phi_deg.len());
        for (row, phi) in phi_deg.iter().enumerate() {
            let fail = |fault| Err(self.star_rows.fail_at(self.path, row, fault));
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
            let filled = self.star_rows.filled(row);
            if let Some(column) = filled.iter().find(|name| !known.contains(name)) {
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
}

/// An entry of the header that would be ignored, with its key: the progenitor's position angle beside `phi`, in ECSV a key that is nearly one
/// that is read, in CSV a unit of a column that is not there.
fn header_fault(header: &Header, table: &Table, is_ecsv: bool) -> Option<(String, TrackFault)> {
    let key = "progenitor_pa";
    if header.meta.contains_key(key) && !table.has("PA") {
        return Some((key.to_owned(), TrackFault::ProgenitorPaWithoutPa));
    }
    if is_ecsv {
        let number = |key: &str| header.meta.get(key).and_then(Value::as_f64);
        // Units of ECSV are those of its columns. Tracks of fits made by earlier versions have the same width as `bin_width_deg` too.
        let is_said = |key: &str, meant: &str| {
            meant == "bin_width" && number(key).is_some_and(|width| number(meant) == Some(width))
        };
        let meant =
            |key: &String| meant_by(key).filter(|meant| *meant != "units" && !is_said(key, meant));
        return header.meta.keys().find_map(|key| {
            let fault = TrackFault::HeaderKey {
                key: key.clone(),
                nearest: meant(key)?.to_owned(),
            };
            Some((key.clone(), fault))
        });
    }
    let key = "units";
    let column = header.units.keys().find(|column| !table.has(column))?;
    let fault = TrackFault::HeaderValue {
        key,
        text: format!("for `{column}`"),
        expected: "units of columns that the table has",
    };
    Some((key.to_owned(), fault))
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

/// A value without its error, or an error without its value.
fn half(given: &'static str, missing: &'static str) -> TrackFault {
    TrackFault::HalfMeasured { given, missing }
}

/// The header's distance, which must be in Mpc, for a column in arcsec.
fn distance_mpc(header: &Header, column: &'static str) -> std::result::Result<f64, TrackFault> {
    let value = header.meta.get("distance");
    let value = value.ok_or(TrackFault::NoDistance { column })?;
    match quantity(value) {
        Some((mpc, unit)) if mpc > 0.0 && unit.as_deref().is_none_or(|u| u == "Mpc") => Ok(mpc),
        _ => Err(TrackFault::BadDistance {
            text: value.to_string(),
        }),
    }
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
    /// not known, the radii have neither errors nor an assumed one, a unit is unknown, an entry of the header cannot be understood or would
    /// be ignored, rows with position angles are not in order along the stream, a
    /// value is not finite, not positive or out of its range, bins are fewer than three or more than 10,000, not increasing or not
    /// equally wide.
    pub fn read_with(path: &Path, options: &ReadOptions) -> Result<Self> {
        track(path, options)
    }
}
