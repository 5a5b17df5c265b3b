//! Figures as SVG and one self-contained page per set of runs.
//!
//! Nothing here runs physics: model tracks and particles come in as plain numbers. Each figure is a function from data
//! to the text of an SVG file.

mod axes;
mod calibration;
mod canvas;
mod corner;
mod curve;
mod density;
mod diagnostics;
mod fit;
mod format;
mod influence;
mod label;
mod measured;
mod modes;
mod page;
mod population_density;
mod q_posterior;
mod scaling;
mod streams_of_population;
mod strips;
mod text;
mod trends;

pub use calibration::calibration;
pub use corner::{CornerColumn, corner};
pub use curve::Curve;
pub use diagnostics::diagnostics;
pub use fit::FitPicture;
pub use format::{FigureFormat, FigureWriter};
pub use influence::influence;
pub use measured::MeasuredPicture;
pub use modes::{ModePicture, modes, outline};
pub use page::{Figure, Group, PageRun, is_page, page};
pub use population_density::population_density;
pub use q_posterior::{QCurve, q_posterior};
pub use scaling::scaling;
pub use streams_of_population::streams_of_population;
pub use trends::q_errors;
