//! Where and how stars leave their progenitor: the tidal radius, the published recipes, and the table of draws.
//!
//! A recipe is two things: a pair of scales (a length and a velocity) that depend on the parameters, and six pure
//! numbers per particle, its [`Kick`], that depend on the draws alone. A release is then linear in the kick, so the
//! table is made once for a whole fit (common random numbers).

mod kick;
mod lagrange;
mod table;

pub use kick::{Arm, Kick, Recipe};
pub use lagrange::Tidal;
pub use table::{Design, Particle, ReleaseTable, TableSettings};
