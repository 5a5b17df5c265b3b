//! The subset of Zarr version 3 that posterior files use: groups with attributes, and arrays of one uncompressed little-endian
//! chunk on the local file system.
//!
//! The reader accepts what the writer writes and refuses everything else by name, so that no other codec, byte order or chunk grid is
//! misread. Source: the Zarr core specification, version 3.0.

use crate::error::{ArrayFault, Error, Result};
use oblate_samplers::read;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::{Map, Value, json};
use std::cell::RefCell;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file that holds the metadata of a group or an array.
pub const METADATA: &str = "zarr.json";

/// Largest size of a file of metadata, and of the chunk of an array.
const MAX_METADATA_BYTES: u64 = 1 << 20;
const MAX_ARRAY_BYTES: u64 = 4 << 30;

/// An open Zarr hierarchy.
pub struct Store {
    path: PathBuf,
    /// Metadata written so far, by path.
    written: RefCell<Vec<(String, Value)>>,
}

/// A number type that an array may hold.
pub trait Item: Copy {
    /// Zarr's name of the type.
    const DATA_TYPE: &'static str;
    /// Bytes of one number.
    const SIZE: usize;
    /// The value that Zarr gives to a missing chunk.
    fn fill_value() -> Value;
    /// Appends the little-endian bytes.
    fn put(self, bytes: &mut Vec<u8>);
    /// The number of [`SIZE`](Self::SIZE) little-endian bytes.
    fn get(bytes: &[u8]) -> Self;
}

macro_rules! item {
    ($type:ty, $name:literal, $fill:expr) => {
        impl Item for $type {
            const DATA_TYPE: &'static str = $name;
            const SIZE: usize = size_of::<$type>();
            fn fill_value() -> Value {
                json!($fill)
            }
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn get(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$type>()];
                own.copy_from_slice(bytes);
                <$type>::from_le_bytes(own)
            }
        }
    };
}
item!(f64, "float64", "NaN");
item!(u32, "uint32", 0);
item!(u64, "uint64", 0);

/// Metadata of a group.
#[derive(Serialize, Deserialize)]
struct GroupMetadata {
    zarr_format: u8,
    node_type: String,
    #[serde(default)]
    attributes: Map<String, Value>,
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    consolidated_metadata: Option<Consolidated>,
}

/// The metadata of all that is in a group, in the order in which it was written, so that it is read with one file.
#[derive(Serialize)]
struct Consolidated {
    kind: &'static str,
    must_understand: bool,
    #[serde(with = "super::super::json::ordered")]
    metadata: Vec<(String, Value)>,
}

/// Metadata of an array.
#[derive(Serialize, Deserialize)]
struct ArrayMetadata {
    zarr_format: u8,
    node_type: String,
    shape: Vec<u64>,
    data_type: Value,
    chunk_grid: Value,
    chunk_key_encoding: Value,
    fill_value: Value,
    codecs: Value,
    #[serde(default)]
    attributes: Map<String, Value>,
    #[serde(default)]
    dimension_names: Vec<String>,
}

impl ArrayMetadata {
    /// Metadata of an array of one chunk; `dims` are (name, length).
    fn of_one_chunk<T: Item>(dims: &[(&str, usize)], attributes: Map<String, Value>) -> Self {
        let shape: Vec<u64> = dims.iter().map(|d| d.1 as u64).collect();
        // A chunk has no side of length zero, also where the array is empty.
        let chunk: Vec<u64> = shape.iter().map(|n| (*n).max(1)).collect();
        Self {
            zarr_format: 3,
            node_type: "array".to_owned(),
            data_type: json!(T::DATA_TYPE),
            chunk_grid: json!({"name": "regular", "configuration": {"chunk_shape": chunk}}),
            chunk_key_encoding: json!({"name": "default", "configuration": {"separator": "/"}}),
            fill_value: T::fill_value(),
            codecs: json!([{"name": "bytes", "configuration": {"endian": "little"}}]),
            shape,
            attributes,
            dimension_names: dims.iter().map(|d| d.0.to_owned()).collect(),
        }
    }

    /// Refuses an array that [`of_one_chunk`](Self::of_one_chunk) does not describe.
    fn check<T: Item>(&self) -> std::result::Result<(), ArrayFault> {
        let own: Vec<(&str, usize)> = self
            .shape
            .iter()
            .map(|n| ("", usize::try_from(*n).unwrap_or(usize::MAX)))
            .collect();
        let needed = Self::of_one_chunk::<T>(&own, Map::new());
        let pairs = [
            ("zarr_format", json!(self.zarr_format), json!(3)),
            ("node_type", json!(self.node_type), json!("array")),
            ("data_type", self.data_type.clone(), needed.data_type),
            ("chunk_grid", self.chunk_grid.clone(), needed.chunk_grid),
            (
                "chunk_key_encoding",
                self.chunk_key_encoding.clone(),
                needed.chunk_key_encoding,
            ),
            ("codecs", self.codecs.clone(), needed.codecs),
        ];
        for (key, found, needed) in pairs {
            if found != needed {
                return Err(ArrayFault::Unsupported {
                    key,
                    found: found.to_string(),
                    needed: needed.to_string(),
                });
            }
        }
        Ok(())
    }

    /// Refuses an array of another shape.
    fn check_shape(&self, sides: &[Option<usize>]) -> std::result::Result<(), ArrayFault> {
        let fits = |(side, found): (&Option<usize>, &u64)| side.is_none_or(|n| n as u64 == *found);
        if self.shape.len() == sides.len() && sides.iter().zip(&self.shape).all(fits) {
            return Ok(());
        }
        let side = |n: &Option<usize>| n.map_or_else(|| "any".to_owned(), |n| n.to_string());
        Err(ArrayFault::Shape {
            found: format!("{:?}", self.shape),
            needed: format!(
                "[{}]",
                sides.iter().map(side).collect::<Vec<_>>().join(", ")
            ),
        })
    }

    /// Bytes of the chunk, `None` if the shape is beyond any file.
    fn bytes<T: Item>(&self) -> Option<u64> {
        self.shape
            .iter()
            .try_fold(T::SIZE as u64, |product, n| product.checked_mul(*n))
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
    /// A new hierarchy in the folder `path`, which need not exist.
    pub fn create(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
            written: RefCell::default(),
        }
    }

    /// The hierarchy in the folder `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if there is none.
    pub fn open(path: &Path) -> Result<Self> {
        fs::metadata(path.join(METADATA)).map_err(Error::io(
            &path.join(METADATA),
            "give a run folder whose fit has finished",
        ))?;
        Ok(Self::create(path))
    }

    /// The folder of a group or an array.
    fn node(&self, at: &str) -> PathBuf {
        self.path.join(at.trim_start_matches('/'))
    }

    /// The error that something is wrong with a group or an array.
    pub fn fault(&self, at: &str, fault: ArrayFault) -> Error {
        Error::Array {
            path: self.path.clone(),
            array: at.to_owned(),
            fault,
        }
    }

    /// Writes a file, and the folders above it.
    fn write(&self, file: &Path, bytes: &[u8]) -> Result<()> {
        let write = || {
            if let Some(folder) = file.parent() {
                fs::create_dir_all(folder)?;
            }
            fs::File::create(file)?.write_all(bytes)
        };
        write().map_err(Error::io(
            file,
            "check that the run folder exists, is writable and has space left",
        ))
    }

    fn write_metadata(&self, at: &str, metadata: &impl Serialize) -> Result<()> {
        let text = serde_json::to_vec_pretty(metadata).map_err(|e| self.metadata_fault(at, &e))?;
        let value = serde_json::to_value(metadata).map_err(|e| self.metadata_fault(at, &e))?;
        let path = at.trim_start_matches('/').to_owned();
        self.written.borrow_mut().push((path, value));
        self.write(&self.node(at).join(METADATA), &text)
    }

    fn read_metadata<T: DeserializeOwned>(&self, at: &str) -> Result<T> {
        let file = self.node(at).join(METADATA);
        let text = read::bytes(&file, MAX_METADATA_BYTES).map_err(Error::io(
            &file,
            "restore the run folder from a whole copy, or fit again",
        ))?;
        serde_json::from_slice(&text).map_err(|e| self.metadata_fault(at, &e))
    }

    fn metadata_fault(&self, at: &str, error: &serde_json::Error) -> Error {
        let message = error.to_string();
        self.fault(at, ArrayFault::Metadata { message })
    }

    /// Writes a group with attributes; those that are not a JSON object are left out.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written; [`Error::Array`] if the attributes have no JSON form.
    pub fn group(&self, at: &str, attributes: &impl Serialize) -> Result<()> {
        self.group_with(at, attributes, None)
    }

    /// Writes the root with its attributes and with the metadata of all that was written before. It is written last.
    ///
    /// # Errors
    /// As of [`group`](Self::group).
    pub fn root(&self, attributes: &impl Serialize) -> Result<()> {
        let consolidated = Consolidated {
            kind: "inline",
            must_understand: false,
            metadata: self.written.take(),
        };
        self.group_with("/", attributes, Some(consolidated))
    }

    fn group_with(
        &self,
        at: &str,
        attributes: &impl Serialize,
        consolidated_metadata: Option<Consolidated>,
    ) -> Result<()> {
        let attributes = match serde_json::to_value(attributes) {
            Ok(Value::Object(map)) => map,
            Ok(_) => Map::new(),
            Err(e) => return Err(self.metadata_fault(at, &e)),
        };
        let metadata = GroupMetadata {
            zarr_format: 3,
            node_type: "group".to_owned(),
            attributes,
            consolidated_metadata,
        };
        self.write_metadata(at, &metadata)
    }

    /// Whether there is a group or an array.
    pub fn has(&self, at: &str) -> bool {
        self.node(at).join(METADATA).is_file()
    }

    /// A group's attributes.
    ///
    /// # Errors
    /// [`Error::Io`] if it is missing; [`Error::Array`] if it is not a group or has other attributes.
    pub fn attributes<T: DeserializeOwned>(&self, at: &str) -> Result<T> {
        let group: GroupMetadata = self.read_metadata(at)?;
        for (key, found, needed) in [
            ("zarr_format", json!(group.zarr_format), json!(3)),
            ("node_type", json!(group.node_type), json!("group")),
        ] {
            if found != needed {
                let (found, needed) = (found.to_string(), needed.to_string());
                return Err(self.fault(at, ArrayFault::Unsupported { key, found, needed }));
            }
        }
        serde_json::from_value(Value::Object(group.attributes))
            .map_err(|e| self.metadata_fault(at, &e))
    }

    /// The file of the only chunk of an array of `dimensions` dimensions.
    fn chunk(&self, at: &str, dimensions: usize) -> PathBuf {
        let mut file = self.node(at).join("c");
        for _ in 0..dimensions {
            file.push("0");
        }
        file
    }

    /// Writes an array, row-major, in one chunk; `dims` are (name, length).
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn array<T: Item>(
        &self,
        at: &str,
        dims: &[(&str, usize)],
        data: &[T],
        attributes: Map<String, Value>,
    ) -> Result<()> {
        self.write_metadata(at, &ArrayMetadata::of_one_chunk::<T>(dims, attributes))?;
        if data.is_empty() {
            return Ok(());
        }
        let mut bytes = Vec::with_capacity(data.len() * T::SIZE);
        data.iter().for_each(|number| number.put(&mut bytes));
        self.write(&self.chunk(at, dims.len()), &bytes)
    }

    /// Reads a whole array, row-major. `sides` are its dimensions; `None`: of any length.
    ///
    /// # Errors
    /// [`Error::Io`] if it is missing or cannot be read; [`Error::Array`] if it is not an array of this type and shape in one
    /// uncompressed chunk of the size that its shape says. The size is compared with the file before memory is taken for it.
    pub fn read<T: Item>(&self, at: &str, sides: &[Option<usize>]) -> Result<Vec<T>> {
        let metadata: ArrayMetadata = self.read_metadata(at)?;
        metadata
            .check_shape(sides)
            .and_then(|()| metadata.check::<T>())
            .map_err(|e| self.fault(at, e))?;
        let needed = metadata.bytes::<T>();
        if needed == Some(0) {
            return Ok(Vec::new());
        }
        let file = self.chunk(at, metadata.shape.len());
        let Ok(found) = fs::metadata(&file).map(|m| m.len()) else {
            return Err(self.fault(at, ArrayFault::MissingChunk));
        };
        if needed != Some(found) {
            let needed = needed.map_or_else(|| "more than any file".to_owned(), |n| n.to_string());
            return Err(self.fault(at, ArrayFault::ChunkSize { found, needed }));
        }
        let bytes = read::bytes(&file, MAX_ARRAY_BYTES).map_err(Error::io(
            &file,
            "restore the run folder from a whole copy, or fit again",
        ))?;
        Ok(bytes.chunks_exact(T::SIZE).map(T::get).collect())
    }
}
