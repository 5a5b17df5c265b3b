//! Parameter sets as JSON lines: one object with the thirteen parameters per line.

use super::layout::StreamParams;
use crate::error::{Error, Result};
use oblate_samplers::read;
use std::io::{BufRead, Read};
use std::path::PathBuf;

/// Largest length of a line in bytes, its end included.
const MAX_BYTES: u64 = 64 << 10;

/// Reads parameter sets with the numbers of their lines, from 1. Each line is read when it is asked for; empty ones are left out.
pub struct ParameterLines<'a> {
    input: &'a mut dyn BufRead,
    name: PathBuf,
    line: usize,
}

impl<'a> ParameterLines<'a> {
    /// Of `input`, which is called `name` in messages.
    pub fn new(input: &'a mut dyn BufRead, name: PathBuf) -> Self {
        Self {
            input,
            name,
            line: 0,
        }
    }

    fn fail(&self, message: String) -> Error {
        Error::Syntax {
            path: self.name.clone(),
            line: Some(self.line),
            message,
            remedy: "give one JSON object with the 13 parameters per line",
        }
    }
}

impl Iterator for ParameterLines<'_> {
    type Item = Result<(usize, StreamParams<f64>)>;

    /// The next parameter set; [`Error::Syntax`] for a line that is none or is longer than 64 KiB, [`Error::Io`] if the input cannot be
    /// read.
    fn next(&mut self) -> Option<Self::Item> {
        loop {
            self.line += 1;
            let mut bytes = Vec::new();
            let mut limited = self.input.take(MAX_BYTES + 1);
            if let Err(source) = limited.read_until(b'\n', &mut bytes) {
                return Some(Err(Error::Io {
                    path: self.name.clone(),
                    source,
                    remedy: "check what writes it",
                }));
            }
            if bytes.is_empty() {
                return None;
            }
            if bytes.len() as u64 > MAX_BYTES {
                let message = format!("longer than {} KiB", MAX_BYTES >> 10);
                return Some(Err(self.fail(message)));
            }
            let mark = read::BYTE_ORDER_MARK.as_bytes();
            let first = self.line == 1;
            let json = bytes.strip_prefix(mark).filter(|_| first).unwrap_or(&bytes);
            if std::str::from_utf8(json).is_err() {
                return Some(Err(self.fail("not UTF-8 text".to_owned())));
            }
            if !json.trim_ascii().is_empty() {
                let params = serde_json::from_slice(json);
                return Some(match params {
                    Ok(params) => Ok((self.line, params)),
                    Err(e) => Err(self.fail(e.to_string())),
                });
            }
        }
    }
}
