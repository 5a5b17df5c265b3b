//! Runs and their folders: a fit, a bridge, a merger or a population from its inputs to a run folder, studies of many, and the page
//! that reports them.

mod asked;
mod bridge;
mod calibration;
mod contents;
mod fit;
mod folder;
mod locked;
mod log;
mod merge;
mod monitor;
mod names;
mod orientation;
mod population;
mod population_fits;
mod populations;
mod render;
mod senses;
mod session;
mod stored_fit;
mod study;
mod versions;

pub use asked::{Asked, Difference};
pub use bridge::bridge;
pub use calibration::ranked_fits;
pub use contents::SUMMARY_FILE;
pub use fit::fit;
pub use folder::{RunFolder, StoredRun, distinct_names};
pub use locked::{Beginning, IfExists, LockedFolder};
pub use log::Log;
pub use merge::merge;
pub use monitor::{Monitor, Monitored};
pub use names::file_name;
pub use orientation::{AxisDirection, axis_posteriors};
pub use population::{PopulationFits, population, sampling_of_population};
pub use population_fits::q_posterior;
pub use populations::{FamilyRun, populations};
pub use render::{Rendered, render_report};
pub use senses::{SenseRun, senses};
pub use session::Destination;
pub use study::{
    Cost, Executor, FailedRun, FitsSoFar, Study, StudyResult, StudyRun, StudySubset, Watcher,
    report_path,
};
pub use versions::{FolderKind, Versions};
