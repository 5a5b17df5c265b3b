//! `posterior.zarr`: every array of a run, as Zarr v3 that xarray opens (docs/files.md, sections 6 and 8). Chunks are not
//! compressed: a fit is a few megabytes, and so no C library is needed.
//!
//! | group | variables | dimensions |
//! |---|---|---|
//! | `posterior` | each parameter and derived quantity by name | chain, draw |
//! | `sample_stats` | `ln_likelihood` | chain, draw |
//! | `observed_data` | `phi`, `r`, `r_err` (and `n`) of the track | bin |
//! | `prior` | each parameter and derived quantity by name | chain, draw |
//! | `weighted` | `theta`, `derived`, `ln_weight`, `ln_likelihood`, `chain`, `cluster`: the sampler's own draws, to the bit | row, ... |
//! | `history` | how the run went from the prior to the posterior | step, insertion, temperature or chain set |
//!
//! Equal-length chains of equal weight are written to `posterior` as they are; weighted draws are resampled there to equal
//! weight, systematically, to as many rows as their ESS (Kish). Evidence and weights belong to `weighted`. Names and units are
//! attributes of the variables and of the root.

mod layout;
mod store;

use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use layout::Table;
use oblate_samplers::Run;
use oblate_samplers::output::{Draws, History, Method};
use serde::{Deserialize, Serialize};
use std::path::Path;
use store::Store;

/// What goes into the file beside the run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extras<'a> {
    /// The data that was fitted.
    pub track: Option<&'a ObservedTrack>,
    /// Draws of the prior, with the run's parameters and derived quantities.
    pub prior: Option<&'a Draws>,
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

/// Writes a run into the folder `path`. The folder appears whole (written beside it, then renamed); one that was there
/// is replaced.
///
/// # Errors
/// [`Error::Io`] if the folder's parent is missing, not writable or full; [`Error::DrawColumns`] if prior draws have
/// other columns than the run.
pub fn write(path: &Path, run: &Run, beside: Extras<'_>) -> Result<()> {
    if let Some(prior) = beside.prior
        && (prior.dim, prior.derived_dim) != (run.draws.dim, run.draws.derived_dim)
    {
        return Err(Error::DrawColumns {
            found: prior.dim + prior.derived_dim,
            needed: run.draws.dim + run.draws.derived_dim,
        });
    }
    let io = |source| Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "check that the run folder exists, is writable and has space left",
    };
    let parent = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let fresh = tempfile::Builder::new()
        .prefix(".posterior-")
        .tempdir_in(parent)
        .map_err(io)?;
    let inside = fresh.path().join("zarr");
    let store = Store::create(&inside);
    let root = Root {
        inference_library: "oblate".to_owned(),
        inference_library_version: env!("CARGO_PKG_VERSION").to_owned(),
        method: run.method,
        seed: run.seed,
        names: run.names.clone(),
        units: run.units.clone(),
        derived_names: run.derived_names.clone(),
    };
    store.group("/", &root)?;
    layout::write_posterior(&store, run)?;
    if let Some(prior) = beside.prior {
        let rows: Vec<Vec<usize>> = vec![(0..prior.len()).collect()];
        Table {
            draws: prior,
            run,
            rows: &rows,
        }
        .write(&store, "/prior")?;
    }
    if let Some(track) = beside.track {
        layout::write_track(&store, track)?;
    }
    layout::write_weighted(&store, &run.draws)?;
    layout::write_history(&store, &run.history)?;
    store::sync(&inside).map_err(io)?;
    // A folder cannot be renamed onto one with content: the old one is moved into the temporary folder, which is deleted.
    if path.exists() {
        std::fs::rename(path, fresh.path().join("old")).map_err(io)?;
    }
    std::fs::rename(&inside, path).map_err(io)
}

/// Reads a run's arrays.
///
/// # Errors
/// [`Error::Io`] if the folder or an array of it is missing; [`Error::Array`] if an array is damaged.
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
    })
}
