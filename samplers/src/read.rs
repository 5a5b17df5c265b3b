//! Reading files of bounded size: a file that is longer than any of its kind is refused before memory is taken for it.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// The content of a file of at most `limit` bytes, which may also be a pipe.
///
/// # Errors
/// Those of the operating system; [`ErrorKind::FileTooLarge`] for a longer file.
pub fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = File::open(path)?;
    if file.metadata()?.len() > limit {
        return Err(too_long(limit));
    }
    let mut bytes = Vec::new();
    // The length of a pipe or a device is not known beforehand.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(too_long(limit));
    }
    Ok(bytes)
}

/// What some editors put at the beginning of a text file.
pub const BYTE_ORDER_MARK: &str = "\u{feff}";

/// The content of a file of UTF-8 text of at most `limit` bytes, without a [`BYTE_ORDER_MARK`].
///
/// # Errors
/// As [`bytes`]; [`ErrorKind::InvalidData`] for a file that is not UTF-8.
pub fn text(path: &Path, limit: u64) -> Result<String> {
    let mut text = String::from_utf8(bytes(path, limit)?).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        Error::new(
            ErrorKind::InvalidData,
            format!("not UTF-8 text (at byte {place})"),
        )
    })?;
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(text)
}

fn too_long(limit: u64) -> Error {
    let (size, unit) = match limit {
        0..1_048_576 => (limit >> 10, "KiB"),
        _ => (limit >> 20, "MiB"),
    };
    Error::new(
        ErrorKind::FileTooLarge,
        format!("longer than {size} {unit}, the maximum of such a file"),
    )
}
