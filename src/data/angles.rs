//! The angle phi of the bins, from a column of phi or of position angles, and its sense.

use super::ecsv::{Header, quantity};
use super::table::Table;
use crate::error::{Error, Result, TrackFault};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::str::FromStr;

/// The sense of phi in a file. The model needs phi to increase from the trailing tail to the leading one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Handedness {
    /// The leading tail is at positive phi.
    #[default]
    AsGiven,
    /// The leading tail is at negative phi: the sign of phi is changed on reading.
    Mirrored,
}

impl Handedness {
    /// Both senses.
    pub const BOTH: [Self; 2] = [Self::AsGiven, Self::Mirrored];

    /// Its name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AsGiven => "as-given",
            Self::Mirrored => "mirrored",
        }
    }
}

impl FromStr for Handedness {
    type Err = Error;

    /// # Errors
    /// [`Error::Setting`] for anything but `as-given` and `mirrored`.
    fn from_str(text: &str) -> Result<Self> {
        let known = Self::BOTH.into_iter().find(|sense| sense.name() == text);
        known.ok_or_else(|| Error::Setting {
            key: "handedness".to_owned(),
            value: text.to_owned(),
            remedy: "give `as-given` where the leading tail is at positive phi, else `mirrored`"
                .to_owned(),
        })
    }
}

/// Units of angles.
const UNITS: &str = "deg, rad, arcmin or arcsec";

/// Degrees in a unit of angle.
fn degrees_per(unit: &str) -> Option<f64> {
    match unit {
        "deg" => Some(1.0),
        "rad" => Some(180.0 / std::f64::consts::PI),
        "arcmin" => Some(1.0 / 60.0),
        "arcsec" => Some(1.0 / 3600.0),
        _ => None,
    }
}

/// An angle of the header in degrees: a number, or a quantity with its unit.
pub fn header_angle_deg(
    header: &Header,
    key: &'static str,
) -> Option<std::result::Result<f64, TrackFault>> {
    let value = header.meta.get(key)?;
    let angle = quantity(value).and_then(|(x, unit)| {
        let per = degrees_per(unit.as_deref().unwrap_or("deg"))?;
        Some(x * per)
    });
    Some(angle.ok_or_else(|| TrackFault::HeaderValue {
        key,
        text: value.to_string(),
        expected: "an angle in degrees as a plain number",
    }))
}

/// phi of the rows in degrees, counted from the progenitor, in the sense of the file.
pub fn phi_deg(path: &Path, table: &Table, header: &Header) -> Result<Vec<f64>> {
    let (angles, is_phi) = angles_deg(path, table, header)?;
    if is_phi {
        return Ok(angles);
    }
    let progenitor = progenitor_pa_deg(path, table, header)?;
    from_progenitor(&angles, progenitor).map_err(|(row, fault)| match row {
        Some(row) => table.fail_at(path, row, fault),
        None => table.fail(path, fault),
    })
}

/// The position angle of the progenitor by the header, degrees.
fn progenitor_pa_deg(path: &Path, table: &Table, header: &Header) -> Result<f64> {
    header_angle_deg(header, "progenitor_pa")
        .unwrap_or(Err(TrackFault::NoProgenitorPa))
        .map_err(|fault| table.fail(path, fault))
}

/// The angles of the rows in degrees, and whether they are phi and not position angles.
fn angles_deg(path: &Path, table: &Table, header: &Header) -> Result<(Vec<f64>, bool)> {
    let fail = |fault| table.fail(path, fault);
    let column = match (table.has("phi"), table.has("PA")) {
        (true, true) => return Err(fail(TrackFault::PhiAndPa)),
        (false, true) => "PA",
        _ => "phi",
    };
    let unit = header.units.get(column).map_or("deg", String::as_str);
    let per = degrees_per(unit).ok_or_else(|| {
        fail(TrackFault::UnknownUnit {
            column: column.to_owned(),
            unit: unit.to_owned(),
            known: UNITS,
        })
    })?;
    let angles = table.need(path, column)?.iter().map(|x| x * per).collect();
    Ok((angles, column == "phi"))
}

/// phi of single stars in degrees, as [`phi_deg`]. Position angles do not tell the turn: it is that of the nearest bin.
pub fn star_phi_deg(
    path: &Path,
    stars: &Table,
    header: &Header,
    bins_deg: &[f64],
) -> Result<Vec<f64>> {
    let (angles, is_phi) = angles_deg(path, stars, header)?;
    if is_phi {
        return Ok(angles);
    }
    let progenitor = progenitor_pa_deg(path, stars, header)?;
    let distance = |phi: f64, bin: f64| (phi - bin + 180.0).rem_euclid(360.0) - 180.0;
    let nearest = |pa: &f64| {
        let phi = pa - progenitor;
        let from_bins = bins_deg.iter().map(|bin| (distance(phi, *bin), *bin));
        let least = from_bins.min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        least.map_or(phi, |(distance, bin)| bin + distance)
    };
    Ok(angles.iter().map(nearest).collect())
}

/// How much wider than the gap between the last and the first row another may be: files round their angles.
const ROUNDING: f64 = 1.01;

/// Position angles counted from that of the progenitor, without jumps by a turn. A fault, and its row if it has one, for rows that are not in
/// order along the stream, and for a track of a turn or more, whose position angles do not tell on which turn a bin is.
fn from_progenitor(
    pa_deg: &[f64],
    progenitor_deg: f64,
) -> std::result::Result<Vec<f64>, (Option<usize>, TrackFault)> {
    let turn = 360.0;
    if let Some(row) = pa_deg.iter().position(|pa| !pa.is_finite()) {
        let (column, value) = ("PA", pa_deg[row]);
        return Err((Some(row), TrackFault::NotFinite { column, value }));
    }
    let mut phi = Vec::with_capacity(pa_deg.len());
    let mut turns = 0.0;
    for (i, pa) in pa_deg.iter().enumerate() {
        if i > 0 {
            // Only a step over north changes a position angle by more than half of a turn.
            let step: f64 = pa - pa_deg[i - 1];
            if step.abs() > 0.5 * turn {
                turns -= step.signum();
            }
        }
        phi.push(pa - progenitor_deg + turns * turn);
    }
    let step = |row: usize| phi[row] - phi[row - 1];
    if let Some(row) = (1..phi.len()).find(|row| step(*row) <= 0.0) {
        let fault = TrackFault::PaNotIncreasing {
            pa_deg: pa_deg[row],
            previous_deg: pa_deg[row - 1],
        };
        return Err((Some(row), fault));
    }
    let (Some(lo), Some(hi)) = (phi.first(), phi.last()) else {
        return Ok(phi);
    };
    let outside = turn - (hi - lo);
    if outside <= 0.0 {
        return Err((None, TrackFault::PaOverATurn));
    }
    // Rows that are sorted by position angle increase too, from the middle of a stream over north on; its ends are then neighbours.
    let widest = (1..phi.len()).max_by(|a, b| step(*a).total_cmp(&step(*b)));
    if let Some(row) = widest.filter(|row| step(*row) > ROUNDING * outside) {
        let fault = TrackFault::PaGap {
            from_deg: pa_deg[row - 1],
            to_deg: pa_deg[row],
        };
        return Err((Some(row), fault));
    }
    // The whole turn by which the bin nearest to the progenitor is within half of a turn of it.
    let nearest = |k: f64| {
        let distances = phi.iter().map(|x| (x + k * turn).abs());
        distances.fold(f64::INFINITY, f64::min)
    };
    let middle = -(0.5 * (lo + hi) / turn).round();
    let k = [middle, middle - 1.0, middle + 1.0]
        .into_iter()
        .min_by(|a, b| nearest(*a).total_cmp(&nearest(*b)))
        .unwrap_or(middle);
    Ok(phi.iter().map(|x| x + k * turn).collect())
}
