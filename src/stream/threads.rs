//! The threads that one stream may use.

/// Threads that one stream may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// The caller's thread only, for many streams at once.
    One,
    /// All threads of the present rayon pool, for a single stream.
    All,
}
