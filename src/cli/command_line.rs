//! The command line as words, and other command lines made from it: those that continue or repeat a run.

use std::ffi::OsString;

/// The words of a command line, without the program's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandLine {
    words: Vec<String>,
}

impl CommandLine {
    /// Of these words.
    pub fn new(words: impl Into<Vec<String>>) -> Self {
        Self {
            words: words.into(),
        }
    }

    /// Of the arguments of the process, the first of which is the program's name; bytes that are not UTF-8 become U+FFFD.
    pub fn of(args: &[OsString]) -> Self {
        let words = args.iter().skip(1);
        Self {
            words: words.map(|a| a.to_string_lossy().into_owned()).collect(),
        }
    }

    /// Without the flags for an existing folder: they change no result, and a resumed run has the summary of one that was never stopped.
    #[must_use]
    pub fn without_folder_flags(&self) -> Self {
        self.without("--force", false).without("--resume", false)
    }

    /// Without a time limit.
    #[must_use]
    pub fn unlimited(&self) -> Self {
        self.without("--max-minutes", true)
    }

    /// The same command, to continue its run without a time limit.
    #[must_use]
    pub fn resumed(&self) -> Self {
        self.without_folder_flags()
            .unlimited()
            .with("--resume", None)
    }

    /// The same command for another run folder, without a time limit.
    #[must_use]
    pub fn for_folder(&self, folder: &str) -> Self {
        self.without_folder_flags()
            .unlimited()
            .with_value("--out", folder)
    }

    /// With a flag of this value in the place of any that it has.
    #[must_use]
    pub fn with_value(&self, flag: &str, value: &str) -> Self {
        self.without(flag, true).with(flag, Some(value))
    }

    /// With a flag at the end of the flags.
    #[must_use]
    pub fn with(mut self, flag: &str, value: Option<&str>) -> Self {
        let end = self.end_of_flags();
        let flag = [Some(flag), value].into_iter().flatten().map(str::to_owned);
        self.words.splice(end..end, flag);
        self
    }

    /// The number of words before `--`, after which there are no flags.
    fn end_of_flags(&self) -> usize {
        let end = self.words.iter().position(|word| word == "--");
        end.unwrap_or(self.words.len())
    }

    /// Without a flag, which has a value or none.
    fn without(&self, flag: &str, has_value: bool) -> Self {
        let mut words = Vec::new();
        let (flags, rest) = self.words.split_at(self.end_of_flags());
        let mut given = flags.iter();
        while let Some(word) = given.next() {
            if word == flag {
                if has_value {
                    given.next();
                }
            } else if !(has_value && word.strip_prefix(flag).is_some_and(|v| v.starts_with('='))) {
                words.push(word.clone());
            }
        }
        words.extend_from_slice(rest);
        Self { words }
    }

    /// The words with spaces between them, as a shell reads them.
    pub fn text(&self) -> String {
        let words: Vec<String> = self.words.iter().map(|word| quoted(word)).collect();
        words.join(" ")
    }
}

/// A word as a shell reads it: in quotes if it has other than plain characters.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,:@%+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
