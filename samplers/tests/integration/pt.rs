//! Parallel tempering against exact evidences and posteriors.
