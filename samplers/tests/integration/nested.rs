//! Nested sampling against exact evidences and posteriors.
