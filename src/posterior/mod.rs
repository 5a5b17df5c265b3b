//! Weighted draws with names, their summary, and the files that keep both.
//!
//! A finished [`Run`](oblate_samplers::Run) of either sampler is stored in two files of a run folder: `posterior.zarr`
//! ([`zarr`]) holds every array to the bit, `summary.json` ([`Summary`]) every single number. [`assemble_run`] puts the
//! same run together again.

mod assemble;
mod calibration;
mod columns;
mod compare;
mod display;
mod export;
mod information;
mod interval;
pub mod json;
pub mod modes;
mod population_summary;
mod scaling;
mod summary;
mod trends;
pub mod zarr;

pub use assemble::assemble_run;
pub use calibration::{
    Calibration, CalibrationGroup, CalibrationRow, LEVELS, MIN_P_VALUE, RankedFit, rank,
};
pub use columns::{Column, column, columns};
pub use compare::{
    Comparison, CostRow, MarginalRow, ModeRow, SIGMA_LIMIT, compare, compare_models,
    compare_other_data,
};
pub use export::{DrawTable, TableFormat};
pub use information::{
    EQUAL_TO_PRIOR, MIN_ESS_FOR_INFORMATION, equal_to_prior, information, marginal_information,
    not_measured,
};
pub use interval::Interval;
pub use modes::{Mode, ModeWeight, Probability, mode_weights, modes_of_draws, prolate_probability};
pub use population_summary::{
    MAX_PARETO_K, MeanWithoutStream, PopulationSummary, PredictiveQuantity, StreamInPopulation,
    WithoutStream,
};
pub use scaling::{ScalingRow, ScalingWidth, scaling, scaling_csv};
pub use summary::{SUMMARY_FORMAT, Summary, SummaryContext, ValueError, intervals};
pub use trends::{Trend, trends};
