//! How many threads one stream may use.

/// Threads that one stream may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// The caller's: where many streams are made side by side.
    One,
    /// All of the present rayon pool: for one stream that somebody waits for.
    All,
}
