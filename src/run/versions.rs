//! `versions.json`: what made a run, and from which inputs.

use oblate_samplers::checkpoint::hash;
use serde::{Deserialize, Serialize};

/// What made a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// Version of oblate.
    pub oblate: String,
    /// Version of the random streams.
    pub stream_version: u32,
    /// Hash of the settings and of every input, in hexadecimal.
    pub input_hash: String,
}

impl Versions {
    /// The versions of this program for given inputs: the settings, then the bytes of every input. The length of each is hashed with
    /// it, so that different inputs cannot be concatenated to the same bytes.
    #[must_use]
    pub fn new(inputs: &[&[u8]]) -> Self {
        let mut bytes = Vec::new();
        for input in inputs {
            bytes.extend_from_slice(&(input.len() as u64).to_le_bytes());
            bytes.extend_from_slice(&hash(input).to_le_bytes());
        }
        Self {
            oblate: env!("CARGO_PKG_VERSION").to_owned(),
            stream_version: oblate_samplers::rng::STREAM_VERSION,
            input_hash: format!("{:016x}", hash(&bytes)),
        }
    }
}
