//! `posterior.zarr`: every array of a run, as Zarr v3 that xarray opens (docs/files.md, sections 6 and 8). Chunks are
//! not compressed, because a fit is a few megabytes, and no C library is needed then.
//!
//! | group | variables | dimensions |
//! |---|---|---|
//! | `posterior` | each parameter and derived quantity by name | chain, draw |
//! | `sample_stats` | `ln_likelihood`, `lp` (ln of likelihood times prior density) | chain, draw |
//! | `observed_data` | `phi`, `r`, `r_err` (or `r_err_lo` and `r_err_hi`) of the track, and its other columns | bin |
//! | | `star_phi`, `star_v`, `star_v_err` of velocities of single stars | star |
//! | `prior` | each parameter and derived quantity by name | chain, draw |
//! | `weighted` | `theta`, `derived`, `ln_weight`, `ln_likelihood`, `chain`, `cluster`: the sampler's own draws, to the bit | row, ... |
//! | `history` | the path of the run from the prior to the posterior | step, insertion, temperature or chain set |
//! | `surrogate` | `features`, `outputs` (mean and standard deviation of each) and `parameters` of the network along which chains moved | one |
//!
//! Equal-length chains of equal weight are written to `posterior` as they are; weighted draws are resampled there to equal
//! weight, systematically, to as many rows as their ESS (Kish). Evidence and weights belong to `weighted`. Names and units are
//! attributes of the variables and of the root.

mod checksum;
mod entries;
mod layout;
mod store;

pub use checksum::Checksum;
pub use entries::Entries;

use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use layout::Table;
pub use layout::equal_weight_rows;
use oblate_samplers::files::{folder_of, sync_folder};
use oblate_samplers::output::{Draws, History, Method};
use oblate_samplers::surrogate::Surrogate;
use oblate_samplers::{Prior, Run};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::Path;
use store::Store;

/// Further contents of the file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extras<'a> {
    /// The data that was fitted.
    pub track: Option<&'a ObservedTrack>,
    /// Draws of the prior, with the run's parameters and derived quantities.
    pub prior: Option<&'a Draws>,
    /// The prior of the run's parameters, for the density of its draws.
    pub density: Option<&'a Prior>,
}

/// The arrays of a run, read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// Parameter names.
    pub names: Vec<String>,
    /// Parameter units.
    pub units: Vec<String>,
    /// Names and units of derived quantities.
    pub derived_names: Vec<(String, String)>,
    /// The run's seed.
    pub seed: u64,
    /// The draws, equal to the sampler's in every bit.
    pub draws: Draws,
    /// The history, equal to the sampler's in every bit.
    pub history: History,
    /// The surrogate, equal to the sampler's in every bit.
    pub surrogate: Option<Surrogate>,
}

/// The root's attributes.
#[derive(Serialize, Deserialize)]
struct Root {
    inference_library: String,
    inference_library_version: String,
    method: Method,
    seed: u64,
    names: Vec<String>,
    units: Vec<String>,
    derived_names: Vec<(String, String)>,
}

/// Writes a run into the new folder `path`, and syncs it. If the writing fails, the incomplete folder stays, and the
/// caller must remove it.
///
/// # Errors
/// [`Error::Exists`] if there is something at `path`; [`Error::Io`] if the folder's parent is missing, not writable or full;
/// [`Error::DrawColumns`] if prior draws have other columns than the run; [`Error::ArrayName`] if two parameters or derived quantities have
/// one name, or one of them a name that no array can have.
pub fn write(path: &Path, run: &Run, extras: Extras<'_>) -> Result<()> {
    if let Some(prior) = extras.prior
        && (prior.dim, prior.derived_dim) != (run.draws.dim, run.draws.derived_dim)
    {
        return Err(Error::DrawColumns {
            found: prior.dim + prior.derived_dim,
            needed: run.draws.dim + run.draws.derived_dim,
        });
    }
    check_names(run)?;
    let failed = |source| Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "check that the run folder exists, is writable and has space left",
    };
    std::fs::create_dir(path).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => Error::Exists {
            path: path.to_path_buf(),
        },
        _ => failed(source),
    })?;
    let store = Store::create(path);
    let root = Root {
        inference_library: "oblate".to_owned(),
        inference_library_version: env!("CARGO_PKG_VERSION").to_owned(),
        method: run.method,
        seed: run.seed,
        names: run.names.clone(),
        units: run.units.clone(),
        derived_names: run.derived_names.clone(),
    };
    layout::write_posterior(&store, run, extras.density)?;
    if let Some(prior) = extras.prior {
        let rows: Vec<Vec<usize>> = vec![(0..prior.len()).collect()];
        Table {
            draws: prior,
            run,
            rows: &rows,
        }
        .write(&store, "/prior")?;
    }
    if let Some(track) = extras.track {
        layout::write_track(&store, track)?;
    }
    layout::write_weighted(&store, &run.draws)?;
    layout::write_history(&store, &run.history)?;
    if let Some(surrogate) = &run.surrogate {
        layout::write_surrogate(&store, surrogate)?;
    }
    store.root(&root)?;
    sync(path).map_err(failed)
}

/// Checks that the arrays of a run have names of their own, and lie in their groups.
fn check_names(run: &Run) -> Result<()> {
    let mut taken = BTreeSet::from(["", ".", "..", "chain", "draw"]);
    let derived = run.derived_names.iter().map(|(name, _)| name);
    for name in run.names.iter().chain(derived) {
        if name.contains(['/', '\\', '\0']) || !taken.insert(name) {
            return Err(Error::ArrayName { name: name.clone() });
        }
    }
    Ok(())
}

/// Syncs every file and every folder of a posterior, and the folder that it is in.
fn sync(path: &Path) -> io::Result<()> {
    let entries = entries(path)?;
    for file in &entries.files {
        File::open(path.join(file))?.sync_all()?;
    }
    for folder in &entries.folders {
        sync_folder(&path.join(folder))?;
    }
    sync_folder(path)?;
    sync_folder(folder_of(path))
}

/// What is in the folder of a posterior: the files and folders that [`write()`] makes, and others.
///
/// # Errors
/// The operating system's, with which the folder cannot be read.
pub fn entries(path: &Path) -> io::Result<Entries> {
    let root: Option<Root> = Store::open(path).and_then(|s| s.attributes("/")).ok();
    let names = root.map(|root| {
        let derived = root.derived_names.into_iter().map(|(name, _)| name);
        root.names.into_iter().chain(derived).collect()
    });
    Entries::of(path, names.as_ref())
}

/// Reads a run's arrays. Their shapes agree with each other; their numbers are checked by
/// [`assemble_run`](super::assemble_run).
///
/// # Errors
/// [`Error::Io`] if the folder or an array of it is missing; [`Error::Array`] if an array is damaged or has another shape.
pub fn read(path: &Path) -> Result<Stored> {
    let store = Store::open(path)?;
    let root: Root = store.attributes("/")?;
    let draws = layout::read_weighted(&store, root.names.len(), root.derived_names.len())?;
    let history = layout::read_history(&store, root.method)?;
    Ok(Stored {
        names: root.names,
        units: root.units,
        derived_names: root.derived_names,
        seed: root.seed,
        draws,
        history,
        surrogate: layout::read_surrogate(&store)?,
    })
}
