//! Runs and their folders: a fit, a bridge, a merger or a population from its inputs to a run folder, studies of many, and the page
//! that reports them.

mod bridge;
mod fit;
mod folder;
mod log;
mod merge;
mod monitor;
mod population;
mod render;
mod session;
mod stored_fit;
mod study;
mod study_inputs;
mod versions;

pub use bridge::bridge;
pub use fit::fit;
pub use folder::{IfExists, RunFolder, SUMMARY_FILE, StoredRun};
pub use log::Log;
pub use merge::merge;
pub use monitor::Monitor;
pub use population::{population, q_posterior};
pub use render::render_report;
pub use session::Destination;
pub use study::{StudyResult, StudyRun, study};
pub use versions::Versions;
