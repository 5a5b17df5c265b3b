//! The checks that columns must pass to be a track, shared by files and tracks made in memory.

use super::measured::{Measured, QuantityColumn};
use super::observed::{
    MAX_DRIFT, NUMBERS_OF_BINS, ObservedTrack, RADII_KPC, RADIUS_ERRORS_KPC, SLACK, STARS, bin_of,
};
use super::star::StarVelocity;
use crate::error::{Error, Result, TrackFault};
use crate::track::{ANGLES_DEG, BIN_WIDTHS_DEG, BinQuantity};
use std::collections::BTreeMap;

/// A fault of a track, and the row, from 0, if one row is at fault.
pub struct Fault {
    /// The row, from 0.
    pub row: Option<usize>,
    /// What is wrong.
    pub fault: TrackFault,
}

impl Fault {
    fn whole(fault: TrackFault) -> Option<Self> {
        Some(Self { row: None, fault })
    }

    fn at(row: usize, fault: TrackFault) -> Option<Self> {
        Some(Self {
            row: Some(row),
            fault,
        })
    }
}

/// The first fault of a track, or `None` if it is sound.
pub fn fault(track: &ObservedTrack) -> Option<Fault> {
    let rows = track.phi_deg.len();
    let same = track.r_kpc.len() == rows
        && track.r_err_lo_kpc.len() == rows
        && track.r_err_hi_kpc.len() == rows
        && track.n.as_ref().is_none_or(|n| n.len() == rows)
        && track.measured.values().all(|values| values.len() == rows);
    if !same {
        return Fault::whole(TrackFault::ColumnLengths);
    }
    let (min, max) = (*NUMBERS_OF_BINS.start(), *NUMBERS_OF_BINS.end());
    if rows < min {
        return Fault::whole(TrackFault::TooFewBins { bins: rows, min });
    }
    if rows > max {
        return Fault::at(max, TrackFault::TooManyBins { bins: rows, max });
    }
    let errors = if track.has_symmetric_errors() {
        ["r_err", "r_err"]
    } else {
        ["r_err_lo", "r_err_hi"]
    };
    (0..rows)
        .find_map(|row| row_fault(track, errors, row))
        .or_else(|| width_fault(track))
        .or_else(|| measured_fault(track))
        .or_else(|| {
            let faults = track.stars.iter().find_map(star_faults(track));
            faults.and_then(Fault::whole)
        })
}

fn row_fault(
    track: &ObservedTrack,
    [lo_name, hi_name]: [&'static str; 2],
    row: usize,
) -> Option<Fault> {
    let (phi, r) = (track.phi_deg[row], track.r_kpc[row]);
    let (lo, hi) = (track.r_err_lo_kpc[row], track.r_err_hi_kpc[row]);
    let errors = [(lo_name, lo), (hi_name, hi)];
    for (column, value) in [("phi", phi), ("r", r)].into_iter().chain(errors) {
        if !value.is_finite() {
            return Fault::at(row, TrackFault::NotFinite { column, value });
        }
    }
    for (column, value) in [("r", r)].into_iter().chain(errors) {
        if value <= 0.0 {
            return Fault::at(row, TrackFault::NotPositive { column, value });
        }
    }
    let columns = [
        ("phi", phi, ANGLES_DEG, "deg"),
        ("r", r, RADII_KPC, "kpc"),
        (lo_name, lo, RADIUS_ERRORS_KPC, "kpc"),
        (hi_name, hi, RADIUS_ERRORS_KPC, "kpc"),
    ];
    for (column, value, range, unit) in columns {
        if !range.contains(&value) {
            let (lo, hi) = range.into_inner();
            let fault = TrackFault::OutOfRange {
                column,
                value,
                lo,
                hi,
                unit,
            };
            return Fault::at(row, fault);
        }
    }
    if let Some(value) = track.n.as_ref().map(|n| n[row])
        && !STARS.contains(&value)
    {
        return Fault::at(row, TrackFault::BadCount { value });
    }
    if row > 0 && phi <= track.phi_deg[row - 1] {
        return Fault::at(
            row,
            TrackFault::NotIncreasing {
                phi_deg: phi,
                previous_deg: track.phi_deg[row - 1],
            },
        );
    }
    None
}

/// Tells what is wrong with a star of this track: it is in no bin of it, or a number is out of its range.
pub fn star_faults(track: &ObservedTrack) -> impl Fn(&StarVelocity) -> Option<TrackFault> {
    let (bins, offset_deg, width_deg) = (track.bins(), track.offset_deg(), track.bin_width_deg);
    move |star| {
        let (column, value) = ("phi", star.phi_deg);
        if !value.is_finite() {
            return Some(TrackFault::NotFinite { column, value });
        }
        value_fault(&BinQuantity::Velocity.column(), star.v_km_s).or_else(|| {
            let is_in_bin = bins.contains(&bin_of(value - offset_deg, width_deg));
            (!is_in_bin).then_some(TrackFault::StarOutside { phi_deg: value })
        })
    }
}

/// What is wrong with a value or its error.
fn value_fault(column: &QuantityColumn, measured: Measured) -> Option<TrackFault> {
    let Measured { value, error } = measured;
    for (name, value, range) in [
        (column.value, value, &column.values),
        (column.error, error, &column.errors),
    ] {
        if !value.is_finite() {
            let column = name;
            return Some(TrackFault::NotFinite { column, value });
        }
        if !range.contains(&value) {
            return Some(TrackFault::OutOfRange {
                column: name,
                value,
                lo: *range.start(),
                hi: *range.end(),
                unit: column.unit,
            });
        }
    }
    None
}

fn measured_fault(track: &ObservedTrack) -> Option<Fault> {
    for (quantity, rows) in &track.measured {
        let column = quantity.column();
        if rows.iter().all(Option::is_none) {
            let column = column.value;
            return Fault::whole(TrackFault::NeverMeasured { column });
        }
        let of_row = |(row, measured): (usize, &Option<Measured>)| {
            Fault::at(row, value_fault(&column, (*measured)?)?)
        };
        if let Some(fault) = rows.iter().enumerate().find_map(of_row) {
            return Some(fault);
        }
    }
    None
}

fn width_fault(track: &ObservedTrack) -> Option<Fault> {
    let width_deg = track.bin_width_deg;
    if !BIN_WIDTHS_DEG.contains(&width_deg) {
        return Fault::whole(TrackFault::BinWidth {
            width_deg,
            lo: *BIN_WIDTHS_DEG.start(),
            hi: *BIN_WIDTHS_DEG.end(),
        });
    }
    let mut drift = 0.0_f64;
    for (row, pair) in track.phi_deg.windows(2).enumerate() {
        let step_deg = pair[1] - pair[0];
        let steps = step_deg / width_deg;
        let difference = steps - steps.round();
        drift += difference;
        if steps.round() < 1.0 || difference.abs() > SLACK || drift.abs() > MAX_DRIFT {
            return Fault::at(
                row + 1,
                TrackFault::UnequalBins {
                    step_deg,
                    width_deg,
                },
            );
        }
    }
    None
}

impl ObservedTrack {
    /// A track from columns of one length: centres in degrees, the bins' width in degrees, radii and their errors in
    /// kpc. Errors that differ to both sides can be set afterwards.
    ///
    /// # Errors
    /// [`Error::Track`] if the columns do not make a track (see [`ObservedTrack::read`]).
    pub fn new(
        name: &str,
        phi_deg: &[f64],
        bin_width_deg: f64,
        r_kpc: &[f64],
        r_err_kpc: &[f64],
    ) -> Result<Self> {
        let track = Self {
            name: name.to_owned(),
            phi_deg: phi_deg.to_vec(),
            bin_width_deg,
            r_kpc: r_kpc.to_vec(),
            r_err_lo_kpc: r_err_kpc.to_vec(),
            r_err_hi_kpc: r_err_kpc.to_vec(),
            assumed_error: None,
            n: None,
            measured: BTreeMap::new(),
            stars: Vec::new(),
            meta: BTreeMap::new(),
        };
        track.checked()
    }

    /// The same track with a quantity that is measured beside the radii, one value for each bin.
    ///
    /// # Errors
    /// [`Error::Track`] if there are not as many values as bins, none is measured, or one is not finite or out of its range.
    pub fn with_measured(
        mut self,
        quantity: BinQuantity,
        values: Vec<Option<Measured>>,
    ) -> Result<Self> {
        self.measured.insert(quantity, values);
        self.checked()
    }

    /// The same track with velocities of single stars.
    ///
    /// # Errors
    /// [`Error::Track`] if one is in no bin of the track, not finite or out of its range.
    pub fn with_stars(mut self, stars: Vec<StarVelocity>) -> Result<Self> {
        self.stars = stars;
        self.checked()
    }

    fn checked(self) -> Result<Self> {
        match fault(&self) {
            None => Ok(self),
            Some(found) => Err(Error::Track {
                name: self.name,
                bin: found.row.map(|row| row + 1),
                fault: found.fault,
            }),
        }
    }
}
