//! The thirteen numbers of a stream: their names and units ([`StreamParams`]), their prior ([`PriorSettings`],
//! [`StreamPrior`]), the coordinates that samplers and gradients use ([`Coordinates`]), what the shape vector means
//! ([`Shape`]) and the moves that the author of the problem knows ([`symmetry`]).

mod coords;
mod layout;
mod prior;
mod shape;
pub mod symmetry;

pub use coords::Coordinates;
pub use layout::{DIM, NAMES, PARAMETERS, Parameter, StreamParams, index_of};
pub use prior::{PriorSettings, StreamPrior};
pub use shape::{QPrior, QRange, Shape};
