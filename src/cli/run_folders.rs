//! Paths of runs, as a pattern such as `runs/*` gives them.

use super::output::note;
use crate::run::RunFolder;
use std::path::{Path, PathBuf};

/// The paths that are run folders; others are skipped with a note. A path where nothing is stays, and is an error; so do all where none is a
/// run.
pub fn run_folders(given: &[PathBuf]) -> Vec<PathBuf> {
    let is_other = |path: &Path| path.exists() && RunFolder::open(path).is_err();
    let (others, runs): (Vec<PathBuf>, Vec<PathBuf>) =
        given.iter().cloned().partition(|path| is_other(path));
    if runs.is_empty() {
        return given.to_vec();
    }
    for path in others {
        note(&format!("skipped: {} is no run folder", path.display()));
    }
    runs
}
