//! The line of a file that an error points at, as it is there, with the place in it.

use crate::error::Error;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Largest part of a file that is read again for an error.
const MAX_BYTES: u64 = 1 << 24;

/// Largest part of a line that is shown.
const MAX_COLUMNS: usize = 160;

/// The line that an error points at, with carets below the word that its message names; none if it points at none.
pub fn excerpt(error: &Error) -> Option<String> {
    let (path, line) = place(error)?;
    let text = line_of(path, line)?;
    let gutter = line.to_string();
    let margin = " ".repeat(gutter.len());
    let mut shown = format!("{margin} |\n{gutter} | {text}");
    if let Some((before, word)) = named(&error.to_string(), &text) {
        shown += &format!("\n{margin} | {}{}", " ".repeat(before), "^".repeat(word));
    }
    Some(shown)
}

fn place(error: &Error) -> Option<(&Path, usize)> {
    match error {
        Error::Syntax { path, line, .. }
        | Error::TrackFile { path, line, .. }
        | Error::InFile { path, line, .. } => Some((path, (*line)?)),
        _ => None,
    }
}

/// Line `number` of a file, from 1, without its control characters; none if it is not there.
fn line_of(path: &Path, number: usize) -> Option<String> {
    // Only a regular file can be read twice.
    let file = File::open(path).ok().filter(|_| path.is_file())?;
    let lines = BufReader::new(file.take(MAX_BYTES)).split(b'\n');
    let line = lines.map_while(Result::ok).nth(number.checked_sub(1)?)?;
    let text = String::from_utf8_lossy(&line).replace('\t', " ");
    let text: String = text
        .chars()
        .filter(|c| !c.is_control())
        .take(MAX_COLUMNS)
        .collect();
    (!text.trim().is_empty()).then_some(text)
}

/// The first word in backquotes or quotes of a message that is in a line, or the last part of one that has dots: characters before it,
/// and its own.
fn named(message: &str, line: &str) -> Option<(usize, usize)> {
    let quoted = |quote: char| message.split(quote).skip(1).step_by(2);
    let words = quoted('`').chain(quoted('"'));
    words
        .map(|word| word.rsplit('.').next().unwrap_or(word))
        .filter(|word| !word.is_empty())
        .find_map(|word| {
            let part_of_a_word =
                |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
            let mut places = line.match_indices(word);
            let (at, _) = places.find(|(at, _)| {
                !part_of_a_word(line[..*at].chars().next_back())
                    && !part_of_a_word(line[at + word.len()..].chars().next())
            })?;
            Some((line[..at].chars().count(), word.chars().count()))
        })
}
