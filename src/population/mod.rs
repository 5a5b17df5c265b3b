//! Many posteriors of q reweighted into one population of haloes.
//!
//! With samples `q_ni` and normalised weights `w_ni` of stream n, fitted under the prior `pi(q)`, and a population
//! density `pi(q | alpha)`,
//!
//! `ln p(alpha | data) = ln pi(alpha) + sum_n ln sum_i w_ni pi(q_ni | alpha) / pi(q_ni)`
//!
//! (Hogg, Myers and Bovy 2010; Chemaly et al. 2026, section 4). Chemaly et al. multiply their last form once more by
//! `p(q | d)`; on draws of that posterior this would count the data twice, so it is left out here.
//!
//! docs/physics.md, section 10, has the derivation. [`QPosterior`] is one stream, [`Family`] the set of population
//! densities, [`PopulationTarget`] the target of a sampler, [`PopulationDensity`] the density of q from its draws, [`FamilySettings`] the
//! choice among all families, and [`Population`] what the posterior says about each stream: the error of its sum, its q given the population, and its
//! influence.

mod beta;
mod cells;
mod density;
mod exponential;
mod families;
mod family;
mod histogram;
mod hyperprior;
mod kept_cells;
mod leave_one_out;
mod mixture;
mod orientation;
mod predictive;
mod q_posterior;
mod reweighting;
mod selection;
mod target;
mod truncated_gaussian;
mod uniform;

pub use beta::{Beta, BetaPriors};
pub use density::PopulationDensity;
pub use families::{FamilyName, FamilySettings, Population};
pub use family::Family;
pub use histogram::{CELLS, Histogram, HistogramPriors};
pub use mixture::{Mixture, MixturePriors};
pub use orientation::{Alignment, AlignmentEvidence, AxisPosterior, alignments};
pub use predictive::predictive_check;
pub use q_posterior::QPosterior;
pub use reweighting::checks;
pub use selection::selection_check;
pub use target::{PopulationSettings, PopulationTarget};
pub use truncated_gaussian::{TruncatedGaussian, TruncatedGaussianSettings, gauss_legendre};
pub use uniform::{Uniform, UniformPriors};
