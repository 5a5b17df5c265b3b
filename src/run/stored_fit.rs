//! A finished fit with its track and settings, read back from its folder.

use super::folder::{RunFolder, StoredRun};
use crate::config::parse;
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::FitSettings;
use std::path::Path;

/// A finished fit, its track and its settings.
pub(super) struct StoredFit {
    pub stored: StoredRun,
    pub track: ObservedTrack,
    pub settings: FitSettings,
}

impl StoredFit {
    /// Reads a run folder.
    ///
    /// # Errors
    /// `Error::Io`, `Error::Syntax`, `Error::Checksum`, `Error::Array` or `Error::InFile` if the folder
    /// cannot be read; `Error::NotAFit` if it has no track; `Error::TrackFile` if its track cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let folder = RunFolder::open(path)?;
        let stored = folder.read()?;
        Ok(Self {
            track: folder.read_track()?,
            settings: parse(&stored.config, &folder.config())?,
            stored,
        })
    }
}
