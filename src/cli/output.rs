//! The standard streams: a subcommand fails if its results cannot be written to standard output; a message that cannot
//! be written to standard error does not end the work.

use crate::error::{Error, Result};
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Standard output of a subcommand.
///
/// A reader such as `head` may close it early: further output is then dropped, and the exit code is that of the work.
pub struct Output<'a> {
    to: &'a mut dyn Write,
    closed: bool,
}

impl<'a> Output<'a> {
    /// That goes to a writer.
    pub fn new(to: &'a mut dyn Write) -> Self {
        Self { to, closed: false }
    }

    /// Whether the reader has closed it.
    pub fn closed(&self) -> bool {
        self.closed
    }

    /// Writes bytes as they are.
    ///
    /// # Errors
    /// [`Error::Output`] if they cannot be written, unless the reader has closed it.
    pub fn bytes(&mut self, bytes: &[u8]) -> Result<()> {
        if self.closed {
            return Ok(());
        }
        let written = self.to.write_all(bytes).and_then(|()| self.to.flush());
        self.settle(written)
    }

    /// Writes one line.
    ///
    /// # Errors
    /// As of [`bytes`](Self::bytes).
    pub fn line(&mut self, line: &str) -> Result<()> {
        self.bytes(format!("{line}\n").as_bytes())
    }

    /// Writes a value as JSON on one line.
    ///
    /// # Errors
    /// As of [`bytes`](Self::bytes).
    pub fn json(&mut self, value: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string(value).map_err(|e| Error::Output {
            source: std::io::Error::other(e),
        })?;
        self.line(&text)
    }

    /// The result of a write to standard output.
    ///
    /// # Errors
    /// As of [`bytes`](Self::bytes).
    pub fn settle(&mut self, written: std::io::Result<()>) -> Result<()> {
        match written {
            Err(source) if source.kind() == ErrorKind::BrokenPipe => {
                self.closed = true;
                Ok(())
            }
            Err(source) => Err(Error::Output { source }),
            Ok(()) => Ok(()),
        }
    }
}

/// Writes a line to standard error, if it can be written; the work continues otherwise as well.
pub fn note(line: &str) {
    let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// A path in JSON; bytes that are not UTF-8 become U+FFFD.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}
