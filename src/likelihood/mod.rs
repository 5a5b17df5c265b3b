//! One number per point: from parameters through a stream and its track to ln L, and its exact gradient.

mod stream;
mod track;

pub use stream::{Evaluation, StreamLikelihood};
pub use track::{Coverage, DataBin, LikelihoodSettings, TrackLikelihood};
