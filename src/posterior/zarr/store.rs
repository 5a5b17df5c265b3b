//! A thin hand on `zarrs`: groups with attributes, arrays of one uncompressed chunk, errors with the folder's name.

use crate::error::{Error, Result};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zarrs::array::{Array, ArrayBuilder, DataType, Element, ElementOwned, FillValue, data_type};
use zarrs::filesystem::FilesystemStore;
use zarrs::group::{Group, GroupBuilder};

/// An open Zarr hierarchy.
pub struct Store {
    path: PathBuf,
    inner: Arc<FilesystemStore>,
}

/// A type that an array may hold.
pub trait Item: Element + ElementOwned + Copy {
    /// Zarr's name for it.
    fn data_type() -> DataType;
    /// What a missing chunk stands for.
    fn fill() -> FillValue;
}

impl Item for f64 {
    fn data_type() -> DataType {
        data_type::float64()
    }
    fn fill() -> FillValue {
        FillValue::from(f64::NAN)
    }
}

impl Item for u32 {
    fn data_type() -> DataType {
        data_type::uint32()
    }
    fn fill() -> FillValue {
        FillValue::from(0_u32)
    }
}

impl Item for u64 {
    fn data_type() -> DataType {
        data_type::uint64()
    }
    fn fill() -> FillValue {
        FillValue::from(0_u64)
    }
}

/// Attributes that are only text.
pub fn text(pairs: &[(&str, &str)]) -> Map<String, Value> {
    pairs
        .iter()
        .filter(|(_, v)| !v.is_empty())
        .map(|(k, v)| ((*k).to_owned(), Value::from(*v)))
        .collect()
}

impl Store {
    fn fail(&self, at: &str, why: impl std::fmt::Display) -> Error {
        Error::Io {
            path: self.path.clone(),
            source: std::io::Error::other(format!("{at}: {why}")),
            remedy: "check that the folder is whole, or fit again into a new one",
        }
    }

    fn at(path: &Path) -> Result<Self> {
        let inner = FilesystemStore::new(path).map_err(|e| Error::Io {
            path: path.to_path_buf(),
            source: std::io::Error::other(e.to_string()),
            remedy: "check that the folder is there and readable",
        })?;
        Ok(Self {
            path: path.to_path_buf(),
            inner: Arc::new(inner),
        })
    }

    /// A new hierarchy.
    pub fn create(path: &Path) -> Result<Self> {
        Self::at(path)
    }

    /// One that must be there.
    pub fn open(path: &Path) -> Result<Self> {
        std::fs::metadata(path.join("zarr.json")).map_err(|source| Error::Io {
            path: path.join("zarr.json"),
            source,
            remedy: "give a run folder whose fit has finished",
        })?;
        Self::at(path)
    }

    /// Writes a group with attributes.
    pub fn group(&self, at: &str, attributes: &impl Serialize) -> Result<()> {
        let attributes = match serde_json::to_value(attributes) {
            Ok(Value::Object(map)) => map,
            Ok(_) => Map::new(),
            Err(e) => return Err(self.fail(at, e)),
        };
        let group = GroupBuilder::new()
            .attributes(attributes)
            .build(self.inner.clone(), at)
            .map_err(|e| self.fail(at, e))?;
        group.store_metadata().map_err(|e| self.fail(at, e))
    }

    /// A group's attributes.
    pub fn attributes<T: DeserializeOwned>(&self, at: &str) -> Result<T> {
        let group = Group::open(self.inner.clone(), at).map_err(|e| self.fail(at, e))?;
        serde_json::from_value(Value::Object(group.attributes().clone()))
            .map_err(|e| self.fail(at, e))
    }

    /// Writes an array, row-major, in one chunk; `dims` are (name, length).
    pub fn array<T: Item>(
        &self,
        at: &str,
        dims: &[(&str, usize)],
        data: &[T],
        attributes: Map<String, Value>,
    ) -> Result<()> {
        let shape: Vec<u64> = dims.iter().map(|d| d.1 as u64).collect();
        let chunk: Vec<u64> = shape.iter().map(|n| (*n).max(1)).collect();
        let array = ArrayBuilder::new(shape, chunk, T::data_type(), T::fill())
            .dimension_names(Some(dims.iter().map(|d| d.0)))
            .attributes(attributes)
            .build(self.inner.clone(), at)
            .map_err(|e| self.fail(at, e))?;
        array.store_metadata().map_err(|e| self.fail(at, e))?;
        if data.is_empty() {
            return Ok(());
        }
        array
            .store_chunk(&vec![0; dims.len()], data)
            .map_err(|e| self.fail(at, e))
    }

    /// Reads a whole array, row-major.
    pub fn read<T: Item>(&self, at: &str) -> Result<Vec<T>> {
        let array = Array::open(self.inner.clone(), at).map_err(|e| self.fail(at, e))?;
        array
            .retrieve_array_subset(&array.subset_all())
            .map_err(|e| self.fail(at, e))
    }
}

/// Syncs every file below a folder.
pub fn sync(folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            sync(&path)?;
        } else {
            std::fs::File::open(&path)?.sync_all()?;
        }
    }
    Ok(())
}
