//! Where and how stars leave their progenitor: the tidal radius, the published recipes, and the table of releases.
//!
//! A recipe is two things: a pair of scales (a length and a velocity) that depend on the parameters, and six pure
//! numbers per particle, its [`ReleaseOffset`], that depend on random numbers alone. A release is then linear in the offset, so the
//! table is made once for a whole fit (common random numbers).

mod neighbourhood;
mod recipe;
mod table;
mod tidal;

pub use neighbourhood::Neighbourhood;
pub use recipe::{MAX_NORMALS, Recipe, ReleaseOffset, Tail};
pub use table::{Release, ReleaseTable, SamplingScheme, TableSettings};
pub use tidal::Tidal;
