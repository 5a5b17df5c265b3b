//! The pilot of a study whose user may interrupt it.

use super::super::Study;
use super::super::watch::Watcher;
use super::{Cost, pilot_unless};
use crate::error::Result;

impl Study<'_> {
    /// As [`cost`](Study::cost), until the user interrupts the study.
    ///
    /// # Errors
    /// As of [`cost`](Study::cost); [`Error::Sampler`](crate::Error::Sampler) after an interrupt.
    pub fn watched_cost(&self, watcher: &dyn Watcher) -> Result<Option<Cost>> {
        let unfinished: Vec<_> = self.fits.iter().filter(|fit| !fit.is_settled()).collect();
        pilot_unless(&unfinished, &|| watcher.interrupted())
    }
}
