//! Nested sampling: live points shrinking onto the peak.
