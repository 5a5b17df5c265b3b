//! The result of every sampler: weighted draws, the evidence with its error, the cost and the convergence checks.

mod check;

pub use check::RunFault;

use crate::diagnostics::{
    clustered_bulk_ess, clustered_tail_ess, kish_ess, mean_ess, size_of_mean,
};
use crate::error::{Error, Result};
use crate::surrogate::Surrogate;
use crate::target::{Cause, Outcome, Target};
use crate::valid::{Valid, countable, ensure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which sampler made a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Nested sampling.
    Nested,
    /// Non-reversible parallel tempering with HMC transitions.
    PtHmc,
    /// SMC bridge from a run on a coarse likelihood to a fine one.
    Bridge,
}

impl Method {
    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nested => "nested",
            Self::PtHmc => "pt-hmc",
            Self::Bridge => "bridge",
        }
    }
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The stopping rule was met.
    Complete,
    /// The caller interrupted it; it can be resumed.
    Interrupted,
    /// The budget was spent; it can be resumed.
    BudgetSpent,
}

/// Weighted draws of the posterior, row by row.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Draws {
    /// Parameters per row.
    pub dim: usize,
    /// Derived quantities per row.
    pub derived_dim: usize,
    /// Physical parameters, row-major, `len x dim`.
    pub theta: Vec<f64>,
    /// Derived quantities, row-major, `len x derived_dim`.
    pub derived: Vec<f64>,
    /// Log-likelihood of each row.
    pub ln_likelihood: Vec<f64>,
    /// Log weight of each row; their exponentials add up to 1.
    pub ln_weight: Vec<f64>,
    /// Number of the Markov chain of each row, which is its chain set, rows in the order of the chain. All 0 where
    /// there are no chains.
    pub chain: Vec<u32>,
    /// Cluster of dependent draws that each row belongs to: the chain sets that start from one SMC sampler, the lineage in a nested run.
    /// Clusters are independent of each other, so the error of any estimate follows from their scatter; all 0 where every draw is
    /// independent.
    pub cluster: Vec<u32>,
}

/// Chain and cluster of a row of draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// See [`Draws::chain`].
    pub chain: u32,
    /// See [`Draws::cluster`].
    pub cluster: u32,
}

impl Draws {
    /// No draws yet of this target.
    #[must_use]
    pub fn of(target: &dyn Target) -> Self {
        Self {
            dim: target.dim(),
            derived_dim: target.derived_names().len(),
            ..Self::default()
        }
    }

    /// Adds a row, its derived quantities computed.
    ///
    /// # Errors
    /// [`Error::DerivedCount`] if the target gives another number of derived quantities than it names.
    pub fn push(
        &mut self,
        target: &dyn Target,
        theta: &[f64],
        ln_likelihood: f64,
        ln_weight: f64,
        origin: Origin,
    ) -> Result<()> {
        self.theta.extend_from_slice(theta);
        target.derived(theta, &mut self.derived);
        self.ln_likelihood.push(ln_likelihood);
        self.ln_weight.push(ln_weight);
        self.chain.push(origin.chain);
        self.cluster.push(origin.cluster);
        if self.derived.len() != self.len() * self.derived_dim {
            return Err(Error::DerivedCount {
                named: self.derived_dim,
                given: self.derived.len() - (self.len() - 1) * self.derived_dim,
            });
        }
        Ok(())
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ln_likelihood.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ln_likelihood.is_empty()
    }

    /// The row of the highest likelihood, if there is one.
    #[must_use]
    pub fn best(&self) -> Option<usize> {
        let l = &self.ln_likelihood;
        (0..l.len()).max_by(|&a, &b| l[a].total_cmp(&l[b]))
    }

    /// Physical parameters of one row.
    #[must_use]
    pub fn theta_row(&self, row: usize) -> &[f64] {
        &self.theta[row * self.dim..(row + 1) * self.dim]
    }

    /// Derived quantities of one row.
    #[must_use]
    pub fn derived_row(&self, row: usize) -> &[f64] {
        &self.derived[row * self.derived_dim..(row + 1) * self.derived_dim]
    }

    /// One parameter of all rows.
    #[must_use]
    pub fn column(&self, parameter: usize) -> Vec<f64> {
        self.theta
            .iter()
            .skip(parameter)
            .step_by(self.dim.max(1))
            .copied()
            .collect()
    }

    /// One derived quantity of all rows.
    #[must_use]
    pub fn derived_column(&self, quantity: usize) -> Vec<f64> {
        self.derived
            .iter()
            .skip(quantity)
            .step_by(self.derived_dim.max(1))
            .copied()
            .collect()
    }

    /// The weights, adding up to 1.
    #[must_use]
    pub fn weights(&self) -> Vec<f64> {
        self.ln_weight.iter().map(|w| w.exp()).collect()
    }

    /// Row numbers, chain by chain.
    #[must_use]
    pub fn chains(&self) -> Vec<Vec<usize>> {
        rows_by(&self.chain)
    }

    /// Row numbers, cluster by cluster.
    #[must_use]
    pub fn clusters(&self) -> Vec<Vec<usize>> {
        rows_by(&self.cluster)
    }

    /// The numbers of each row, chain by chain.
    #[must_use]
    pub fn by_chain(&self, values: &[f64]) -> Vec<Vec<f64>> {
        let of = |rows: Vec<usize>| rows.into_iter().map(|row| values[row]).collect();
        self.chains().into_iter().map(of).collect()
    }

    /// Effective size of the draws for the mean of one number per row: of Markov chains by their autocorrelation and agreement; of
    /// other draws by the scatter of their clusters, at most Kish's.
    #[must_use]
    pub fn ess_of_mean(&self, values: &[f64]) -> f64 {
        let chains = self.by_chain(values);
        if chains.len() > 1 {
            let chains: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
            return mean_ess(&chains);
        }
        let kish = kish_ess(&self.ln_weight);
        if self.clusters().len() > 1 {
            size_of_mean(values, &self.weights(), &self.cluster).min(kish)
        } else {
            kish
        }
    }

    /// Bulk and tail ESS of each parameter by the scatter of clusters: never more than there are draws.
    pub(crate) fn clustered_ess(&self) -> (Vec<f64>, Vec<f64>) {
        let (weights, most) = (self.weights(), self.len() as f64);
        // A parameter that is the same in all draws has no variance.
        let of = |size: f64| if size.is_nan() { most } else { size.min(most) };
        (0..self.dim)
            .map(|parameter| {
                let column = self.column(parameter);
                (
                    of(clustered_bulk_ess(&column, &weights, &self.cluster)),
                    of(clustered_tail_ess(&column, &weights, &self.cluster)),
                )
            })
            .unzip()
    }

    /// `count` equal-weight rows by systematic resampling with the one uniform `offset` in [0, 1): row numbers, in
    /// order.
    #[must_use]
    pub fn resample(&self, count: usize, offset: f64) -> Vec<usize> {
        let mut rows = Vec::with_capacity(count);
        let mut cumulative = 0.0;
        for (row, w) in self.weights().into_iter().enumerate() {
            cumulative += w * count as f64;
            while rows.len() < count && (rows.len() as f64 + offset) < cumulative {
                rows.push(row);
            }
        }
        // Rounding can leave the last uniform just above the last sum.
        while rows.len() < count && !self.is_empty() {
            rows.push(self.len() - 1);
        }
        rows
    }
}

/// Row numbers by label.
fn rows_by(labels: &[u32]) -> Vec<Vec<usize>> {
    let mut rows: Vec<Vec<usize>> = Vec::new();
    for (row, label) in labels.iter().enumerate() {
        let label = *label as usize;
        rows.resize_with(rows.len().max(label + 1), Vec::new);
        rows[label].push(row);
    }
    rows
}

/// The evidence and its errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// ln Z.
    pub ln_z: f64,
    /// One standard error of ln Z: the largest of the parts.
    pub error: f64,
    /// Errors, by the name of their estimate.
    pub error_parts: BTreeMap<String, f64>,
    /// Other estimates of ln Z, by name.
    pub estimates: BTreeMap<String, f64>,
    /// Kullback-Leibler divergence of the posterior from the prior, in nats.
    pub information: f64,
}

/// Effective sample sizes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ess {
    /// ESS (Kish), 1 / sum of squared weights.
    pub kish: f64,
    /// Bulk ESS per parameter; for draws that are no Markov chains by the scatter of clusters (design effect).
    pub bulk: Vec<f64>,
    /// Tail ESS per parameter, likewise.
    pub tail: Vec<f64>,
    /// Rank-normalised split R-hat per parameter; empty where there are no chains.
    pub r_hat: Vec<f64>,
    /// The number to quote: the smallest of `bulk` and `tail`, and of `kish` where draws have weights.
    pub quoted: f64,
}

/// Smallest bulk and tail ESS of a parameter with which the draws of a run pass their checks (Vehtari et al. 2021 advise 100 for each of
/// four chains).
pub const MIN_ESS: f64 = 400.0;

/// Name of the check of the bulk ESS.
pub const ESS_BULK: &str = "ess-bulk";

/// Name of the check of the tail ESS.
pub const ESS_TAIL: &str = "ess-tail";

impl Ess {
    /// The smallest of these sizes.
    pub(crate) fn smallest(bulk: &[f64], tail: &[f64]) -> f64 {
        bulk.iter()
            .chain(tail)
            .copied()
            .fold(f64::INFINITY, f64::min)
    }

    /// The checks of the draws of any sampler: at least `min` of them; `remedy` says what makes more.
    pub(crate) fn checks(&self, min: f64, remedy: &str) -> [Check; 2] {
        [
            (ESS_BULK, "bulk", &self.bulk),
            (ESS_TAIL, "tail", &self.tail),
        ]
        .map(|(name, of, sizes)| {
            Check::at_least(
                name,
                Self::smallest(sizes, &[]),
                min,
                format!("smallest {of} ESS over parameters; if too small, {remedy}"),
            )
        })
    }
}

/// What a run cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Likelihood values without a gradient.
    pub calls: u64,
    /// Likelihood values with a gradient.
    pub gradients: u64,
    /// CPU time of the process while it ran.
    pub cpu_seconds: f64,
    /// Wall time.
    pub wall_seconds: f64,
    /// Rejected points by cause.
    pub rejected: BTreeMap<String, u64>,
}

/// Likelihood calls of one task, with rejections by cause: what is added to a [`Cost`] when the task is done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Calls {
    /// Values without a gradient.
    pub values: u64,
    /// Values with a gradient.
    pub gradients: u64,
    /// Rejected points by cause.
    pub rejected: Vec<(Cause, u64)>,
}

impl Calls {
    /// Counts a rejection, if the outcome is one.
    pub fn note(&mut self, outcome: &Outcome) {
        if let Some(cause) = outcome.cause() {
            self.reject(cause, 1);
        }
    }

    /// Counts rejections of one cause.
    pub fn reject(&mut self, cause: Cause, count: u64) {
        match self.rejected.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, sum)) => *sum += count,
            None => self.rejected.push((cause, count)),
        }
    }

    /// Adds the calls of another task.
    pub fn add(&mut self, other: &Self) {
        self.values += other.values;
        self.gradients += other.gradients;
        for (cause, count) in &other.rejected {
            self.reject(cause, *count);
        }
    }
}

impl Cost {
    /// Likelihood calls, with and without a gradient.
    #[must_use]
    pub fn all_calls(&self) -> u64 {
        self.calls + self.gradients
    }

    /// Checks a cost that was read from a file.
    pub(crate) fn check(&self) -> Valid {
        let counts = [self.calls, self.gradients].into_iter();
        ensure(
            countable(counts.chain(self.rejected.values().copied())),
            "a count is too large",
        )?;
        let time = |x: f64| x >= 0.0 && x.is_finite();
        ensure(
            time(self.wall_seconds) && time(self.cpu_seconds),
            "a time is not finite, or negative",
        )
    }

    /// Adds the calls of a task.
    pub fn count(&mut self, calls: &Calls) {
        self.calls += calls.values;
        self.gradients += calls.gradients;
        for (cause, count) in &calls.rejected {
            *self.rejected.entry((*cause).to_owned()).or_default() += count;
        }
    }

    /// The most frequent cause of rejection; "none" without rejections.
    #[must_use]
    pub fn main_cause(&self) -> String {
        let most = self.rejected.iter().max_by_key(|(_, count)| **count);
        most.map_or_else(|| "none".to_owned(), |(cause, _)| cause.clone())
    }

    /// Adds what another part of the work cost.
    pub fn add(&mut self, other: &Self) {
        self.calls = self.calls.saturating_add(other.calls);
        self.gradients = self.gradients.saturating_add(other.gradients);
        self.cpu_seconds += other.cpu_seconds;
        self.wall_seconds += other.wall_seconds;
        for (cause, count) in &other.rejected {
            let sum = self.rejected.entry(cause.clone()).or_default();
            *sum = sum.saturating_add(*count);
        }
    }
}

/// The path of the run from the prior to the posterior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum History {
    /// One entry per dead point, outermost first.
    Nested {
        /// Expected log prior volume.
        ln_x: Vec<f64>,
        /// Log-likelihood at death; minus infinity for rejected points.
        ln_likelihood: Vec<f64>,
        /// Likelihood bound above which the point was born: minus infinity for draws of the prior, the smallest number above
        /// rejected points.
        ln_likelihood_birth: Vec<f64>,
        /// Number of live points.
        live: Vec<u32>,
        /// Insertion rank as a fraction in (0, 1), in order of insertion.
        insertion_rank: Vec<f64>,
    },
    /// One entry per temperature, from beta = 0 to 1.
    Tempered {
        /// Inverse temperatures.
        beta: Vec<f64>,
        /// Mean log-likelihood over valid draws; on a path from a mixture, less the logarithm of mixture over prior.
        mean_ln_likelihood: Vec<f64>,
        /// Its variance.
        variance_ln_likelihood: Vec<f64>,
        /// Mean swap rejection between each temperature and the next one (one fewer than temperatures).
        swap_rejection: Vec<f64>,
        /// Mean acceptance of the HMC transitions; along a surrogate by ln L.
        acceptance: Vec<f64>,
        /// Step size of the HMC transitions, in metric units.
        step_size: Vec<f64>,
        /// Mean number of leapfrog steps of an HMC transition.
        mean_leapfrogs: Vec<f64>,
        /// HMC transitions stopped as divergent, all chain sets.
        divergences: Vec<u64>,
        /// Communication barrier from beta = 0 to each temperature.
        communication_barrier: Vec<f64>,
        /// Round trips per chain set, of the scans that count.
        round_trips: Vec<u64>,
        /// Log-likelihood at beta = 1, every scan that counts, one list per chain set.
        trace: Vec<Vec<f64>>,
    },
    /// One entry per step from the coarse likelihood to the fine one.
    Bridge {
        /// The exponent `s` of the fine likelihood.
        fraction: Vec<f64>,
        /// ln Z minus that of the coarse run.
        ln_ratio: Vec<f64>,
        /// Effective number of draws of the coarse run that are ancestors.
        ancestors: Vec<f64>,
        /// Correlation of the difference in ln L before and after the MCMC steps of the step.
        correlation: Vec<f64>,
    },
}

/// One convergence check of a run, with its remedy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Short name.
    pub name: String,
    /// What was measured.
    pub value: f64,
    /// Its limit.
    pub limit: f64,
    /// Whether it passed.
    pub pass: bool,
    /// Its meaning, and what to do if it failed.
    pub message: String,
}

impl Check {
    /// A check that passes if `value <= limit`; a NaN fails.
    #[must_use]
    pub fn at_most(name: &str, value: f64, limit: f64, message: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            value,
            limit,
            pass: value <= limit,
            message: message.into(),
        }
    }

    /// A check that passes if `value >= limit`; a NaN fails.
    #[must_use]
    pub fn at_least(name: &str, value: f64, limit: f64, message: impl Into<String>) -> Self {
        Self {
            name: name.to_owned(),
            value,
            limit,
            pass: value >= limit,
            message: message.into(),
        }
    }
}

/// The result of a sampler.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Which sampler.
    pub method: Method,
    /// Why it ended.
    pub status: Status,
    /// Master seed.
    pub seed: u64,
    /// Version of the random streams.
    pub stream_version: u32,
    /// Parameter names.
    pub names: Vec<String>,
    /// Parameter units.
    pub units: Vec<String>,
    /// Names and units of derived quantities.
    pub derived_names: Vec<(String, String)>,
    /// The draws.
    pub draws: Draws,
    /// The evidence.
    pub evidence: Evidence,
    /// Effective sample sizes.
    pub ess: Ess,
    /// Cost.
    pub cost: Cost,
    /// From prior to posterior.
    pub history: History,
    /// Checks.
    pub checks: Vec<Check>,
    /// Warnings, each with its remedy.
    pub warnings: Vec<String>,
    /// The surrogate of ln L along which its chains moved, as it was at the end; none without one.
    pub surrogate: Option<Surrogate>,
}

impl Run {
    /// Whether the run ended by its stopping rule and every check passed.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.status == Status::Complete && self.checks.iter().all(|g| g.pass)
    }

    /// A hash of everything but times: equal for runs with the same bits.
    ///
    /// # Panics
    /// Never: a `Run` can always be encoded.
    #[must_use]
    pub fn bits(&self) -> u64 {
        let mut copy = self.clone();
        copy.cost.cpu_seconds = 0.0;
        copy.cost.wall_seconds = 0.0;
        postcard::to_stdvec(&copy).map_or(0, |bytes| crate::checkpoint::hash(&bytes))
    }
}
