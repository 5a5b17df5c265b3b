//! Paths of runs, as a pattern such as `runs/*` gives them.

use super::output::note;
use crate::run::RunFolder;
use std::path::{Path, PathBuf};

/// The paths that are run folders; others are skipped with a note. A path where nothing is stays, and is an error; so do all where none is a
/// run.
pub fn run_folders(given: &[PathBuf]) -> Vec<PathBuf> {
    let is_run = |path: &Path| !path.exists() || RunFolder::open(path).is_ok();
    kept(given, is_run, "is no run folder")
}

/// Of run folders those of fits, which have a track; populations are skipped with a note.
pub fn with_track(runs: &[PathBuf]) -> Vec<PathBuf> {
    let has_track = |path: &Path| RunFolder::open(path).is_ok_and(|run| run.track().is_file());
    kept(
        runs,
        |path| !path.exists() || has_track(path),
        "is no fit of a track",
    )
}

/// Of run folders those of finished runs; others are skipped with a note, unless there are no others.
pub fn finished(runs: &[PathBuf]) -> Vec<PathBuf> {
    let is_finished = |path: &Path| RunFolder::open(path).is_ok_and(|run| run.finished());
    kept(
        runs,
        |path| !path.exists() || is_finished(path),
        "has not finished",
    )
}

/// The paths for which `keeps` holds; the others are skipped, and the note says `why`. All if it holds for none.
fn kept(given: &[PathBuf], keeps: impl Fn(&Path) -> bool, why: &str) -> Vec<PathBuf> {
    let (kept, others): (Vec<PathBuf>, Vec<PathBuf>) =
        given.iter().cloned().partition(|path| keeps(path));
    if kept.is_empty() {
        return given.to_vec();
    }
    for path in others {
        note(&format!("skipped: {} {why}", path.display()));
    }
    kept
}
