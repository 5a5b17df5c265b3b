//! Weighted draws with names, their summary, and the files that keep both.
//!
//! A finished [`Run`](oblate_samplers::Run) of either sampler is stored in two files of a run folder: `posterior.zarr`
//! ([`zarr`]) holds every array to the bit, `summary.json` ([`Summary`]) every single number. [`run_from_parts`] puts the
//! same run together again.

mod columns;
mod compare;
mod display;
pub mod json;
pub mod modes;
mod parts;
mod summary;
pub mod zarr;

pub use columns::{Column, column, columns};
pub use compare::{Comparison, CostRow, MarginalRow, ModeRow, SIGMA_LIMIT, compare};
pub use modes::{Mode, ModeWeight, Probability, mode_weights, prolate_probability};
pub use parts::run_from_parts;
pub use summary::{Interval, SUMMARY_FORMAT, Summary, SummaryContext, ValueError, intervals};
