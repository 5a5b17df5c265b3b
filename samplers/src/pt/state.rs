//! The whole of a run between two scans: what a checkpoint holds and a scan advances.

use super::Settings;
use super::evidence::{Estimate, Traces, estimate};
use super::record::Record;
use super::smc::SmcSamplers;
use crate::control::Event;
use crate::difference_pool::DifferencePool;
use crate::hmc::{Metric, Point, Reference, StepSize};
use crate::output::Cost;
use serde::{Deserialize, Serialize};

/// A round of fewer scans is early: it only has to find the scales, so its trajectories are short, and energies far
/// from equilibrium may vary as they like.
pub(super) const EARLY_SCANS: usize = 32;

/// One temperature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Temperature {
    pub(super) beta: f64,
    pub(super) metric: Metric,
    pub(super) step: StepSize,
    /// Where the round before stood at this temperature: its odd clusters for the even ones, and the other way round.
    pub(super) pools: [DifferencePool; 2],
}

/// One place of one chain set: states stay, replicas travel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Chain {
    pub(super) point: Point,
    pub(super) replica: usize,
}

/// What a finished round came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Finished {
    pub(super) communication_barrier: f64,
    pub(super) ln_z: f64,
}

/// See the module's words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub(super) settings: Settings,
    pub(super) seed: u64,
    /// The SMC samplers that the chain sets start from, until they are cold.
    pub(super) smc_samplers: Option<SmcSamplers>,
    /// Present round, and its scans done.
    pub(super) round: usize,
    pub(super) scan: usize,
    /// Times that the last round has gone on for as long again.
    pub(super) extensions: usize,
    /// Scans done in all rounds: the index of the random streams.
    pub(super) clock: u64,
    /// Where the chain sets begin.
    pub(super) reference: Reference,
    /// The halves of the draws that it was fitted to.
    pub(super) training: [Vec<f64>; 2],
    pub(super) temperatures: Vec<Temperature>,
    /// Chain-set-major.
    pub(super) chains: Vec<Chain>,
    pub(super) record: Record,
    pub(super) history: Vec<Finished>,
    pub(super) cost: Cost,
}

impl State {
    /// Scans of the present round.
    pub(super) fn scans(&self) -> usize {
        self.settings.scans(self.round) * (1 + self.extensions)
    }

    /// Whether the last round is done, as far as it has gone on.
    pub(super) fn finished(&self) -> bool {
        self.is_last_round() && self.scan == self.scans()
    }

    /// The same state, whose last round may go on so many times.
    pub(super) fn allowed(mut self, extensions: usize) -> Self {
        self.settings.extensions = extensions;
        self
    }

    /// Whether the last round may go on once it is done.
    pub(super) fn may_extend(&self) -> bool {
        self.extensions < self.settings.extensions
    }

    /// Whether the first scan is still to come.
    pub(super) fn smc_samplers(&self) -> bool {
        self.smc_samplers.is_some()
    }

    /// Whether the present round has anything to show.
    pub(super) fn scanned(&self) -> bool {
        self.scan > 0
    }

    pub(super) fn is_last_round(&self) -> bool {
        self.round + 1 == self.settings.rounds
    }

    /// Groups of chain sets that are independent of each other.
    pub(super) fn clusters(&self) -> usize {
        self.settings.clusters()
    }

    /// Whether slices explore beside HMC transitions.
    pub(super) fn slices(&self) -> bool {
        self.settings.slice_updates > 0
    }

    /// Whether the chain sets of this round were to begin at a mixture.
    pub(super) fn mixture_due(&self) -> bool {
        self.settings.mixes(self.round)
    }

    /// Whether a mixture is to be fitted to what this round draws. The last but one does without: the last keeps the mixture that it
    /// has, and with it the temperatures that the round before has found on the same path.
    pub(super) fn mixture_next(&self) -> bool {
        if self.is_last_round() {
            return self.settings.mixture_rounds > 0;
        }
        let next = self.round + 1;
        self.settings.mixes(next) && (next + 1 < self.settings.rounds || self.reference.is_prior())
    }

    pub(super) fn is_early_round(&self) -> bool {
        !self.is_last_round() && self.settings.scans(self.round) < EARLY_SCANS
    }

    pub(super) fn beta(&self) -> Vec<f64> {
        self.temperatures
            .iter()
            .map(|temperature| temperature.beta)
            .collect()
    }

    pub(super) fn evidence(&self) -> Estimate {
        let extensions = self.record.telling();
        let extensions: Vec<(&[f64], &Traces)> = extensions
            .map(|extension| (extension.beta.as_slice(), &extension.traces))
            .collect();
        estimate(&extensions, self.settings.clusters())
    }

    /// What an observer is told after a scan; evidence and communication barrier are NaN before a round has finished.
    pub(super) fn progress(&self) -> Event {
        if let Some(smc_samplers) = &self.smc_samplers {
            let (beta, ln_z) = smc_samplers.progress();
            let calls = self.cost.calls;
            return Event::Smc { beta, ln_z, calls };
        }
        let last = self.history.last();
        Event::Tempered {
            round: self.round,
            scan: self.scan.saturating_sub(1),
            scans: self.scans(),
            communication_barrier: last.map_or(f64::NAN, |r| r.communication_barrier),
            round_trips: self.record.round_trips(),
            ln_z: last.map_or(f64::NAN, |r| r.ln_z),
            gradients: self.cost.gradients,
        }
    }

    pub(super) fn next_round(&mut self, dim: usize) {
        self.round += 1;
        self.scan = 0;
        self.record = self.new_record(dim, self.round);
    }

    pub(super) fn new_record(&self, dim: usize, round: usize) -> Record {
        let (chain_sets, clusters) = (self.settings.chain_sets, self.settings.clusters());
        let scans = self.settings.scans(round);
        Record::new(dim, chain_sets, clusters, &self.beta(), scans)
    }
}
