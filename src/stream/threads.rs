//! How many threads one stream may use.

/// Threads that one stream may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// The caller's thread: for many streams at once.
    One,
    /// All of the present rayon pool: for a single stream.
    All,
}
