//! One binary for the crate's integration tests; each module mirrors a room of `src`.

mod hmc;
mod nested;
mod pt;
mod targets;
