//! A run folder: what one fit or one population leaves behind, never overwritten unasked; and the work that fills it.

mod boost;
mod fit;
mod folder;
mod job;
mod log;
mod merge;
mod pages;
mod population;
mod refine;
mod study;
mod watch;

pub use boost::boost;
pub use fit::{Existing, fit, target};
pub use folder::{FINISHED, RunFolder, StoredRun, Versions};
pub use log::Log;
pub use merge::merge;
pub use pages::report;
pub use population::{population, q_posterior};
pub use refine::refine;
pub use study::{Outcome, Piece, study};
pub use watch::Watch;

use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::posterior::{Summary, prior_draws, zarr};
use oblate_samplers::output::Status;
use oblate_samplers::{Run, Target};
use std::path::Path;

/// Draws of the prior that are kept beside the posterior.
const PRIOR_DRAWS: usize = 2_000;

/// Writes what a run leaves behind, with draws of its prior; an interrupted one leaves only its checkpoint.
fn conclude(
    folder: &RunFolder,
    target: &dyn Target,
    run: &Run,
    summary: &Summary,
    track: Option<&ObservedTrack>,
    seed: u64,
) -> Result<()> {
    if run.status == Status::Interrupted {
        return Ok(());
    }
    let prior = prior_draws(target.prior(), PRIOR_DRAWS, seed, |theta| {
        let mut derived = Vec::new();
        target.derived(theta, &mut derived);
        derived
    });
    let beside = zarr::Beside {
        track,
        prior: Some(&prior),
    };
    folder.finish(run, summary, beside)
}

/// A folder made ready for a run.
enum Opened {
    /// It has finished already, by its own rule and with the same inputs.
    Finished(Box<Run>, Box<Summary>),
    /// It waits for work.
    Folder(RunFolder),
}

/// Makes a folder ready: new, replaced, or continued.
fn open_or_create(out: &Path, existing: Existing, versions: &Versions) -> Result<Opened> {
    if existing != Existing::Resume || RunFolder::unbegun(out) {
        return Ok(Opened::Folder(RunFolder::create(
            out,
            existing == Existing::Replace,
        )?));
    }
    let folder = RunFolder::open(out)?;
    if folder.read_versions()?.input_hash != versions.input_hash {
        return Err(Error::Mismatch {
            what: format!(
                "{}: made from another track, other settings or another version",
                out.display()
            ),
            remedy: "resume with what its config.toml says, or start again with --force".to_owned(),
        });
    }
    if folder.finished() {
        let stored = folder.read()?;
        if stored.run.status == Status::Complete {
            return Ok(Opened::Finished(
                Box::new(stored.run),
                Box::new(stored.summary),
            ));
        }
    }
    Ok(Opened::Folder(folder))
}
