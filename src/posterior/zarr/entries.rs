//! The files and folders that the writer makes, so that nothing else is checked or removed.

use super::store::METADATA;
use crate::data::QuantityColumn;
use crate::track::BinQuantity;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The group of the track, which has the columns of what is measured and [`OF_STARS`] as well.
const OBSERVED_DATA: &str = "observed_data";

/// Arrays of single stars: angles, velocities and their errors.
pub(super) const OF_STARS: [&str; 3] = ["star_phi", "star_v", "star_v_err"];

/// Groups, and their arrays beside those that the run names.
const GROUPS: [(&str, &[&str]); 7] = [
    ("posterior", &["chain", "draw"]),
    ("sample_stats", &["chain", "draw", "ln_likelihood", "lp"]),
    (
        OBSERVED_DATA,
        &["phi", "r", "r_err", "r_err_lo", "r_err_hi", "n"],
    ),
    ("prior", &["chain", "draw"]),
    (
        "weighted",
        &[
            "theta",
            "derived",
            "ln_likelihood",
            "ln_weight",
            "chain",
            "cluster",
        ],
    ),
    (
        "history",
        &[
            // of a nested run
            "ln_x",
            "ln_likelihood",
            "ln_likelihood_birth",
            "live",
            "insertion_rank",
            // of a tempered one
            "beta",
            "mean_ln_likelihood",
            "variance_ln_likelihood",
            "swap_rejection",
            "acceptance",
            "step_size",
            "mean_leapfrogs",
            "divergences",
            "communication_barrier",
            "round_trips",
            "trace",
            "trace_length",
            // of a bridge
            "fraction",
            "ln_ratio",
            "ancestors",
            "correlation",
        ],
    ),
    ("surrogate", &SURROGATE),
];

/// Arrays of group `surrogate`.
pub(super) const SURROGATE: [&str; 3] = ["features", "outputs", "parameters"];

/// Groups that have an array for each parameter and each derived quantity.
const NAMED_BY_THE_RUN: [&str; 2] = ["posterior", "prior"];

/// Whether the track has an array of this name for what is measured in its bins or of single stars.
fn is_measured(name: &str) -> bool {
    let of_bins = BinQuantity::ALL.iter().any(|quantity| {
        let QuantityColumn { value, error, .. } = quantity.column();
        [value, error].contains(&name)
    });
    of_bins || OF_STARS.contains(&name)
}

/// Most dimensions of an array: its only chunk is a file `0` in this many folders at most, the first called `c`.
const DIMENSIONS: usize = 2;

/// What is in a posterior's folder: paths relative to it, each list in order.
#[derive(Debug, Default)]
pub struct Entries {
    /// Files of the writer's.
    pub files: Vec<PathBuf>,
    /// Folders of the writer's, each before those in it.
    pub folders: Vec<PathBuf>,
    /// Files, folders, links and devices that the writer does not make. What is in such a folder is not looked at.
    pub foreign: Vec<PathBuf>,
}

/// A place in the hierarchy.
enum Place {
    Root,
    Group(&'static str),
    Array,
    /// A folder of a chunk, and how many more there may be in it.
    Chunk(usize),
}

impl Place {
    /// Whether the writer makes a file of this name here.
    fn file(&self, name: &str) -> bool {
        match self {
            Self::Chunk(_) => name == "0",
            _ => name == METADATA,
        }
    }

    /// The place that a folder of this name is, if the writer makes it here.
    fn folder(&self, name: &str, of_the_run: Option<&BTreeSet<String>>) -> Option<Self> {
        match self {
            Self::Root => {
                let (group, _) = GROUPS.iter().find(|(group, _)| *group == name)?;
                Some(Self::Group(group))
            }
            Self::Group(group) => {
                let (_, arrays) = GROUPS.iter().find(|(g, _)| g == group)?;
                // Where the names of the run cannot be read, any may be one of them.
                let named = NAMED_BY_THE_RUN.contains(group)
                    && of_the_run.is_none_or(|names| names.contains(name));
                let measured = *group == OBSERVED_DATA && is_measured(name);
                (arrays.contains(&name) || named || measured).then_some(Self::Array)
            }
            Self::Array => (name == "c").then_some(Self::Chunk(DIMENSIONS - 1)),
            Self::Chunk(more) => (name == "0").then(|| more.checked_sub(1).map(Self::Chunk))?,
        }
    }
}

impl Entries {
    /// Lists the folder `path`; `of_the_run` are the names of its parameters and derived quantities, `None` if they are
    /// not known.
    ///
    /// # Errors
    /// The operating system's, with which the folder cannot be read.
    pub fn of(path: &Path, of_the_run: Option<&BTreeSet<String>>) -> io::Result<Self> {
        let mut entries = Self::default();
        entries.add(path, &PathBuf::new(), &Place::Root, of_the_run)?;
        entries.files.sort();
        entries.folders.sort();
        entries.foreign.sort();
        Ok(entries)
    }

    fn add(
        &mut self,
        root: &Path,
        at: &Path,
        place: &Place,
        of_the_run: Option<&BTreeSet<String>>,
    ) -> io::Result<()> {
        for entry in fs::read_dir(root.join(at))? {
            let entry = entry?;
            let name = entry.file_name();
            let (path, name) = (at.join(&name), name.to_str().unwrap_or_default());
            let kind = entry.file_type()?;
            if kind.is_file() && place.file(name) {
                self.files.push(path);
            } else if kind.is_dir()
                && let Some(inside) = place.folder(name, of_the_run)
            {
                self.add(root, &path, &inside, of_the_run)?;
                self.folders.push(path);
            } else {
                self.foreign.push(path);
            }
        }
        Ok(())
    }
}
