//! Parameter sets as JSON lines: per line one object with parameters by name, or a list of such objects.

use super::layout::StreamParams;
use crate::error::{Error, Result};
use oblate_samplers::read;
use std::io::{BufRead, Read};
use std::path::PathBuf;

/// Largest length of a line in bytes, its end included: a list of some ten thousand parameter sets.
const MAX_BYTES: u64 = 4 << 20;

/// The parameter sets of one line. Parameters may be missing.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterLine {
    /// Its number, from 1.
    pub number: usize,
    /// One set, or those of the list.
    pub points: Vec<StreamParams<Option<f64>>>,
    /// Whether it is a list, also one of a single set.
    pub is_list: bool,
}

/// Reads parameter sets with the numbers of their lines. Each line is read when it is asked for; empty ones are left out.
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
            remedy: "give one JSON object with parameters by name per line, or a list of them",
        }
    }

    /// The sets of a line that is not empty.
    fn parse(&self, json: &[u8]) -> serde_json::Result<ParameterLine> {
        let is_list = json.trim_ascii_start().starts_with(b"[");
        let points = if is_list {
            serde_json::from_slice(json)?
        } else {
            vec![serde_json::from_slice(json)?]
        };
        Ok(ParameterLine {
            number: self.line,
            points,
            is_list,
        })
    }
}

impl Iterator for ParameterLines<'_> {
    type Item = Result<ParameterLine>;

    /// The next line; [`Error::Syntax`] for one without parameter sets or longer than 4 MiB, [`Error::Io`] if the input cannot be read.
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
                let message = format!("longer than {} MiB", MAX_BYTES >> 20);
                return Some(Err(self.fail(message)));
            }
            let mark = read::BYTE_ORDER_MARK.as_bytes();
            let first = self.line == 1;
            let json = bytes.strip_prefix(mark).filter(|_| first).unwrap_or(&bytes);
            if std::str::from_utf8(json).is_err() {
                return Some(Err(self.fail("not UTF-8 text".to_owned())));
            }
            if !json.trim_ascii().is_empty() {
                return Some(self.parse(json).map_err(|e| self.fail(e.to_string())));
            }
        }
    }
}
