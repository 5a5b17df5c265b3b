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
mod observed;
mod read;

pub use mock::{Mock, MockSettings, Mocks, NUMBERS_OF_MOCKS, QPopulation, mocks};
pub use observed::{
    DEFAULT_RELATIVE_ERROR, NUMBERS_OF_BINS, ObservedTrack, RADII_KPC, RADIUS_ERRORS_KPC, STARS,
};
