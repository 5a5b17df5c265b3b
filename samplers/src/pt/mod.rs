//! Non-reversible parallel tempering: a ladder from prior to posterior.
