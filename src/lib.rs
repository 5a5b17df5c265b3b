//! The shapes of dark-matter haloes from the projected tracks of stellar streams.
