//! Particle spray: the tidal radius, the recipes, and the table of releases (docs/physics.md, section 4).
//!
//! A recipe has a length and a velocity scale that depend on the parameters, and for each particle six pure numbers, its
//! [`ReleaseOffset`], that depend on random numbers alone. So the table of release offsets is made once for a whole fit (common random
//! numbers).

mod neighbourhood;
mod recipe;
mod table;
mod tidal;

pub use neighbourhood::Neighbourhood;
pub use recipe::{MAX_NORMALS, Recipe, ReleaseOffset, Tail};
pub use table::{Release, ReleaseTable, SamplingScheme, TableSettings};
pub use tidal::Tidal;
