//! What makes columns a track, in one place for files and for tracks made in memory.

use super::{LEAST_BINS, ObservedTrack};

/// How far a centre may sit from its place, as a fraction of the bin width: files round their angles.
const SLACK: f64 = 1e-3;

/// The first thing wrong with a track.
pub struct Fault {
    /// The row, from 0, if one row is to blame.
    pub row: Option<usize>,
    /// What is wrong, with the column's name.
    pub what: String,
    /// What to do.
    pub remedy: String,
}

impl Fault {
    fn new(row: Option<usize>, what: impl Into<String>, remedy: &str) -> Option<Self> {
        Some(Self {
            row,
            what: what.into(),
            remedy: remedy.to_owned(),
        })
    }
}

/// The bin of a centre.
#[allow(
    clippy::cast_possible_truncation,
    reason = "checked tracks hold centres of a few turns at most; the cast saturates elsewhere"
)]
pub fn bin_of(phi_deg: f64, width_deg: f64) -> i64 {
    (phi_deg / width_deg - 0.5).round() as i64
}

/// The first fault of a track, or `None` if it is sound.
pub fn fault(track: &ObservedTrack) -> Option<Fault> {
    let rows = track.phi_deg.len();
    let same = track.r_kpc.len() == rows
        && track.r_err_kpc.len() == rows
        && track.n.as_ref().is_none_or(|n| n.len() == rows);
    if !same {
        return Fault::new(
            None,
            "columns of different lengths",
            "give every column one value per bin",
        );
    }
    if rows < LEAST_BINS {
        return Fault::new(
            None,
            format!("a track of {rows} bins"),
            &format!("give at least {LEAST_BINS} bins; a shorter arc does not constrain a halo"),
        );
    }
    for row in 0..rows {
        if let Some(found) = row_fault(track, row) {
            return Some(found);
        }
    }
    width_fault(track)
}

fn row_fault(track: &ObservedTrack, row: usize) -> Option<Fault> {
    let (phi, r, r_err) = (track.phi_deg[row], track.r_kpc[row], track.r_err_kpc[row]);
    for (name, value) in [("phi", phi), ("r", r), ("r_err", r_err)] {
        if !value.is_finite() {
            return Fault::new(
                Some(row),
                format!("column `{name}` is {value}"),
                "give a finite number, or drop the row",
            );
        }
    }
    for (name, value) in [("r", r), ("r_err", r_err)] {
        if value <= 0.0 {
            return Fault::new(
                Some(row),
                format!("column `{name}` is {value}"),
                "give a value above zero, or drop the row",
            );
        }
    }
    if let Some(n) = track.n.as_ref().map(|n| n[row])
        && !(n.is_finite() && n >= 0.0)
    {
        return Fault::new(
            Some(row),
            format!("column `n` is {n}"),
            "give the number of stars in the bin, or leave the column out",
        );
    }
    if row > 0 && phi <= track.phi_deg[row - 1] {
        return Fault::new(
            Some(row),
            format!(
                "column `phi` is {phi} deg after {} deg",
                track.phi_deg[row - 1]
            ),
            "sort the rows by phi and give each bin once; phi runs on past 180 deg where a stream wraps",
        );
    }
    None
}

fn width_fault(track: &ObservedTrack) -> Option<Fault> {
    let width = track.bin_width_deg;
    if !(width.is_finite() && width > 0.0 && width <= 180.0) {
        return Fault::new(
            None,
            format!("a bin width of {width} deg"),
            "give `bin_width` in degrees, above 0 and at most 180",
        );
    }
    for (row, pair) in track.phi_deg.windows(2).enumerate() {
        let steps = (pair[1] - pair[0]) / width;
        if steps.round() < 1.0 || (steps - steps.round()).abs() > SLACK {
            return Fault::new(
                Some(row + 1),
                format!(
                    "column `phi` steps by {} deg where bins are {width} deg wide",
                    pair[1] - pair[0]
                ),
                "give equally wide bins (whole bins may be missing), or set `bin_width` in the header",
            );
        }
    }
    let first = track.phi_deg[0] / width - 0.5;
    if (first - first.round()).abs() > SLACK {
        return Fault::new(
            Some(0),
            format!(
                "column `phi` is {} deg, not the centre of a bin whose edges are multiples of {width} deg",
                track.phi_deg[0]
            ),
            "bin the stars with the progenitor at phi = 0 on an edge, so that centres are (k + 1/2) bin widths",
        );
    }
    None
}
