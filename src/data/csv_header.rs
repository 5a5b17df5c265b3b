//! The header of a CSV track: comment lines `# key: value` above the table. Other comments are free text.

use super::ecsv::Header;
use super::header_keys::{KEYS, meant_by};
use crate::error::{Error, Result, TrackFault};
use serde_json::{Value, json};
use std::path::Path;

/// Reads the comment lines above the table.
pub fn header(path: &Path, comments: &[&str]) -> Result<Header> {
    let mut header = Header::default();
    for (row, comment) in comments.iter().enumerate() {
        let fail = |fault| Error::TrackFile {
            path: path.to_path_buf(),
            line: Some(row + 1),
            fault,
        };
        let text = comment.trim_start_matches('#').trim();
        let Some((key, value)) = text.split_once([':', '=']) else {
            // A key without its colon would be taken for free text.
            let word = text.split_whitespace().next().unwrap_or_default();
            if word != "name" && KEYS.contains(&word) {
                return Err(fail(TrackFault::HeaderKey {
                    key: word.to_owned(),
                    nearest: word.to_owned(),
                }));
            }
            continue;
        };
        let (key, value) = (key.trim(), value.trim());
        match KEYS.iter().find(|known| **known == key) {
            Some(&"units") => {
                for entry in value.split(',') {
                    let mut words = entry.split_whitespace();
                    let (Some(column), Some(unit), None) =
                        (words.next(), words.next(), words.next())
                    else {
                        return Err(fail(TrackFault::HeaderValue {
                            key: "units",
                            text: value.to_owned(),
                            expected: "columns with their units, such as `phi deg, r arcsec`",
                        }));
                    };
                    header.units.insert(column.to_owned(), unit.to_owned());
                }
            }
            Some(known) => {
                // A name may be or begin with a number, such as that of a catalogue.
                let value = match *known {
                    "name" => json!(value),
                    _ => typed(value),
                };
                header.meta.insert((*known).to_owned(), value);
            }
            None => {
                if let Some(meant) = meant_by(key) {
                    return Err(fail(TrackFault::HeaderKey {
                        key: key.to_owned(),
                        nearest: meant.to_owned(),
                    }));
                }
            }
        }
    }
    Ok(header)
}

/// A number, a number with a unit as astropy writes it, or a text.
fn typed(text: &str) -> Value {
    let number = |word: &str| word.parse::<f64>().ok().filter(|x| x.is_finite());
    if let Some(x) = number(text) {
        return json!(x);
    }
    match text.split_once(' ') {
        Some((value, unit)) if number(value).is_some() && !unit.contains('%') => {
            json!({"value": number(value), "unit": unit.trim()})
        }
        _ => json!(text),
    }
}
