//! The rule by which names that users give become names of files.

use crate::error::{Error, NameFault, Result};

/// Maximum number of bytes in the name of a file, on the usual file systems.
const MAX_BYTES: usize = 255;

/// Names that Windows keeps for devices, also with an extension.
const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];

/// Names that Windows keeps for numbered devices.
const NUMBERED_DEVICES: [&str; 2] = ["com", "lpt"];

/// `name` followed by `suffix` as the name of one file: never a path, never hidden, and another one for every other name.
///
/// Letters and digits of every script stay, and so do `-`, `_`, `+`, `,`, `(` and `)`, and spaces and points inside the name. Of any other
/// character each byte in UTF-8 becomes `%` and its two hexadecimal digits; also of the first letter of a name that Windows keeps for a
/// device.
///
/// # Errors
/// [`Error::Name`] if the name is empty, or too long for a file.
pub fn file_name(name: &str, suffix: &str) -> Result<String> {
    let fail = |fault| Error::Name {
        name: name.to_owned(),
        fault,
    };
    if name.is_empty() {
        return Err(fail(NameFault::Empty));
    }
    let last = name.chars().count() - 1;
    let device = is_device(&format!("{name}{suffix}"));
    let mut file = String::new();
    for (i, c) in name.chars().enumerate() {
        let stays =
            c.is_alphanumeric() || "-_+,()".contains(c) || " .".contains(c) && i > 0 && i < last;
        if stays && !(device && i == 0) {
            file.push(c);
        } else {
            let mut bytes = [0; 4];
            for byte in c.encode_utf8(&mut bytes).bytes() {
                file.push_str(&format!("%{byte:02X}"));
            }
        }
    }
    file.push_str(suffix);
    if file.len() > MAX_BYTES {
        return Err(fail(NameFault::TooLong {
            bytes: file.len(),
            max: MAX_BYTES,
        }));
    }
    Ok(file)
}

/// Whether Windows takes a file of this name for a device.
fn is_device(file: &str) -> bool {
    let stem = file.split('.').next().unwrap_or_default();
    let stem = stem.trim().to_lowercase();
    let mut before = stem.clone();
    let number = before.pop();
    DEVICES.contains(&stem.as_str())
        || NUMBERED_DEVICES.contains(&before.as_str())
            && number.is_some_and(|n| n.is_ascii_digit() || "¹²³".contains(n))
}
