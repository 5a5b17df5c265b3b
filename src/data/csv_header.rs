//! The header of a CSV track: comment lines `# key: value` above the table. Other comments are free text.

use super::ecsv::Header;
use super::header_keys::{Comment, Entry, entry};
use crate::error::{Error, Result, TrackFault};
use serde_json::{Value, json};
use std::path::Path;

/// Reads the comment lines above the table.
pub fn header(path: &Path, comments: &[Comment]) -> Result<Header> {
    let mut header = Header::default();
    for (line, comment) in comments {
        let fail = |fault| Error::TrackFile {
            path: path.to_path_buf(),
            line: Some(*line),
            fault,
        };
        let repeated = |what: String| fail(TrackFault::RepeatedKey { what });
        match entry(comment) {
            Entry::Value("units", value) => {
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
                    let old = header.units.insert(column.to_owned(), unit.to_owned());
                    if old.is_some() {
                        return Err(repeated(format!("the unit of `{column}`")));
                    }
                }
            }
            Entry::Value(key, value) => {
                // A name may be or begin with a number, such as that of a catalogue.
                let value = match key {
                    "name" => json!(value),
                    _ => typed(value),
                };
                if header.meta.insert(key.to_owned(), value).is_some() {
                    return Err(repeated(format!("`{key}`")));
                }
            }
            Entry::Nearly(key, meant) => {
                return Err(fail(TrackFault::HeaderKey {
                    key: key.to_owned(),
                    nearest: meant.to_owned(),
                }));
            }
            Entry::Text => {}
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
