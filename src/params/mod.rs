//! The numbers of a stream: their names and units ([`StreamParams`]), their prior ([`PriorSettings`],
//! [`StreamPrior`]), the flattening and axis that the shape vector encodes ([`Shape`]), and the symmetries of the
//! posterior that samplers use ([`symmetry`]).

mod features;
mod layout;
mod lines;
mod prior;
mod shape;
pub mod symmetry;

pub use features::{FEATURES, features, features_vjp};
pub use layout::{
    DIM, NAMES, PARAMETERS, Parameter, REQUIRED, StreamParams, index_of, without_optional,
};
pub use lines::{ParameterLine, ParameterLines};
pub use prior::{PriorSettings, StreamPrior};
pub use shape::{AXIS_RATIOS, QPrior, QRange, Shape, length_cdf, length_quantile, length_sf};
