//! ln L of a track as a function of the parameters, and its gradient (docs/physics.md, sections 7 and 8).

mod correlation;
mod coverage;
mod measurement;
mod observation;
mod stream;
mod track;

pub use correlation::ErrorCorrelation;
pub use coverage::Coverage;
pub use measurement::BinMeasurement;
pub use observation::Observation;
pub use stream::{Evaluation, StreamLikelihood};
pub use track::{DataBin, LikelihoodSettings, TrackLikelihood};
