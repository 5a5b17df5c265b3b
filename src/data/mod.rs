//! Observed tracks: one projected radius per bin of angle from the progenitor, read from files and checked.
//!
//! ```
//! use oblate::data::ObservedTrack;
//! let (phi_deg, r_kpc) = ([-15.0, -5.0, 5.0, 15.0], [62.0, 60.0, 59.0, 57.5]);
//! let track = ObservedTrack::new("toy", &phi_deg, 10.0, &r_kpc, &[1.2; 4])?;
//! assert_eq!(track.bins(), [-2, -1, 0, 1]);
//! # Ok::<(), oblate::Error>(())
//! ```

mod angles;
mod assumed_error;
mod check;
mod csv_header;
mod ecsv;
mod extent;
mod header_keys;
mod measured;
mod mock;
mod mock_settings;
mod mock_stars;
mod observed;
mod q_population;
mod read;
mod selection;
mod star;
mod table;

pub use angles::Handedness;
pub use assumed_error::AssumedError;
pub use extent::TrackExtent;
pub use measured::{Measured, QuantityColumn};
pub use mock::{Mock, Mocks, NUMBERS_OF_MOCKS, mocks, mocks_with};
pub use mock_settings::MockSettings;
pub use mock_stars::MockStars;
pub use observed::{NUMBERS_OF_BINS, ObservedTrack, RADII_KPC, RADIUS_ERRORS_KPC, STARS};
pub use q_population::QPopulation;
pub use read::ReadOptions;
pub use selection::{SELECTION_DRAWS, SELECTION_POINTS, Selection, selection};
pub use star::StarVelocity;
