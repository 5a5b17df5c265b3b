//! What is wrong with an array of a posterior file.

/// Why an array or group of a Zarr folder cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArrayFault {
    /// Its `zarr.json` is not Zarr version 3 metadata of the expected kind.
    #[error("its zarr.json cannot be read ({message})")]
    Metadata {
        /// The parser's message.
        message: String,
    },
    /// Its metadata asks for a feature that posterior files do not use.
    #[error("its {key} is {found}, and only {needed} is supported")]
    Unsupported {
        /// The key of the metadata.
        key: &'static str,
        /// Its value.
        found: String,
        /// What posterior files have.
        needed: String,
    },
    /// It has another shape than the other arrays of the file ask for.
    #[error("its shape is {found} where {needed} is needed")]
    Shape {
        /// Its shape.
        found: String,
        /// The shape that follows from the other arrays; `any` for a side that does not.
        needed: String,
    },
    /// Lengths of traces do not add up to their number of values.
    #[error("its lengths add up to {sum}, and the traces have {needed} values")]
    TraceLengths {
        /// The sum.
        sum: u128,
        /// The number of values.
        needed: usize,
    },
    /// Numbers of a surrogate that do not make one.
    #[error("its numbers do not make a surrogate")]
    Surrogate,
    /// Its chunk is not there.
    #[error("its chunk is missing")]
    MissingChunk,
    /// Its chunk has another size than its shape says.
    #[error("its chunk has {found} bytes, and its shape needs {needed}")]
    ChunkSize {
        /// Bytes in the file.
        found: u64,
        /// Bytes by the shape; `None` if there is no such number.
        needed: String,
    },
}
