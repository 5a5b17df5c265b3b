//! Observed tracks: one projected radius per bin of angle from the progenitor, read from files and checked.
//!
//! ```
//! use oblate::data::ObservedTrack;
//! let track = ObservedTrack::new("toy", &[-15.0, -5.0, 5.0, 15.0], 10.0, &[62.0, 60.0, 59.0, 57.5], None)?;
//! assert_eq!(track.bins(), [-2, -1, 0, 1]);
//! assert!(track.r_err_assumed);
//! # Ok::<(), oblate::Error>(())
//! ```

mod check;
mod ecsv;
mod mock;
mod read;

pub use mock::{Mock, MockSettings, Mocks, QPopulation, mocks};

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Relative error of a radius where a file gives none: `sigma_b = 0.02 r_b` (Chemaly et al. 2026).
pub const DEFAULT_RELATIVE_ERROR: f64 = 0.02;

/// Fewest bins that make a track.
pub const LEAST_BINS: usize = 3;

/// A track on the sky: one mean projected radius per bin of angle around the host, counted from the progenitor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservedTrack {
    /// The stream's name: the header's `name`, or the file's stem.
    pub name: String,
    /// Bin centres in degrees, increasing, each at `(k + 1/2) bin_width_deg` for a whole number k. Bins may be missing.
    pub phi_deg: Vec<f64>,
    /// Width of every bin in degrees.
    pub bin_width_deg: f64,
    /// Mean projected radius per bin, in kpc.
    pub r_kpc: Vec<f64>,
    /// Its standard error, in kpc.
    pub r_err_kpc: Vec<f64>,
    /// Whether the errors are [`DEFAULT_RELATIVE_ERROR`] times the radius because the source gave none.
    pub r_err_assumed: bool,
    /// Stars (or particles) per bin, where known.
    pub n: Option<Vec<f64>>,
    /// Everything else that the header says (origin, distance, truth), as it was read.
    pub meta: BTreeMap<String, serde_json::Value>,
}

impl ObservedTrack {
    /// A track from columns of one length: centres in degrees, the bins' width in degrees, radii and their errors in
    /// kpc (2 % of the radius if `None`).
    ///
    /// # Errors
    /// [`Error::Track`] if the columns do not make a track (see [`ObservedTrack::read`]).
    pub fn new(
        name: &str,
        phi_deg: &[f64],
        bin_width_deg: f64,
        r_kpc: &[f64],
        r_err_kpc: Option<&[f64]>,
    ) -> Result<Self> {
        let track = Self {
            name: name.to_owned(),
            phi_deg: phi_deg.to_vec(),
            bin_width_deg,
            r_kpc: r_kpc.to_vec(),
            r_err_kpc: r_err_kpc.map_or_else(|| default_errors(r_kpc), <[f64]>::to_vec),
            r_err_assumed: r_err_kpc.is_none(),
            n: None,
            meta: BTreeMap::new(),
        };
        match check::fault(&track) {
            None => Ok(track),
            Some(found) => Err(Error::Track {
                name: name.to_owned(),
                bin: found.row.map(|row| row + 1),
                fault: found.fault,
            }),
        }
    }

    /// Reads a track from ECSV (a file that starts with `# %ECSV`) or plain CSV.
    ///
    /// Columns: `phi` (deg or rad), `r` (kpc, or arcsec with `distance` in Mpc in the header), optionally `r_err` (as
    /// `r`) and `n`; others are ignored. CSV has no place for units: there `phi` is in degrees, `r` and `r_err` in kpc.
    /// The header may give `bin_width` in degrees; otherwise it is the smallest step of `phi`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::TrackFile`] with line and column if it is not a table, a column
    /// is missing, a unit is unknown, a value is not finite or not positive, bins are fewer than three, not
    /// increasing, not equally wide, or do not have their edges at multiples of the bin width from the progenitor.
    pub fn read(path: &Path) -> Result<Self> {
        read::track(path)
    }

    /// Writes ECSV that astropy and [`ObservedTrack::read`] read back, floats exact to the bit. The file appears whole
    /// or not at all, and replaces an old one.
    ///
    /// # Errors
    /// [`Error::Sampler`] with the file's name if it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        oblate_samplers::checkpoint::write_atomically(path, ecsv::text(self).as_bytes())?;
        Ok(())
    }

    /// Number of bins with data.
    #[must_use]
    pub fn len(&self) -> usize {
        self.phi_deg.len()
    }

    /// Whether there is no bin.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.phi_deg.is_empty()
    }

    /// The whole number k of each bin, which covers `[k, k + 1) bin_width_deg`.
    #[must_use]
    pub fn bins(&self) -> Vec<i64> {
        self.phi_deg
            .iter()
            .map(|phi| check::bin_of(*phi, self.bin_width_deg))
            .collect()
    }
}

/// The errors of a track that came without.
fn default_errors(r_kpc: &[f64]) -> Vec<f64> {
    r_kpc.iter().map(|r| DEFAULT_RELATIVE_ERROR * r).collect()
}
