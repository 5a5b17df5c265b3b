//! A run folder: what one fit or one population leaves behind, never overwritten unasked.

mod folder;
mod log;

pub use folder::{FINISHED, RunFolder, StoredRun, Versions};
pub use log::Log;
