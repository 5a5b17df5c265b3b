//! ln L of a track as a function of the 13 parameters, and its gradient (docs/physics.md, sections 7 and 8).

mod stream;
mod track;

pub use stream::{Evaluation, StreamLikelihood};
pub use track::{Coverage, DataBin, LikelihoodSettings, TrackLikelihood};
