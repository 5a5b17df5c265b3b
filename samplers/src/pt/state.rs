//! The state of a run between two scans: what a checkpoint holds.

use super::Settings;
use super::evidence::{Estimate, Traces, estimate};
use super::record::Record;
use super::smc::SmcSamplers;
use crate::control::Event;
use crate::difference_pool::DifferencePool;
use crate::hmc::{MAX_ENERGY_RANGE, Metric, Plan, Point, Reference, StepSize};
use crate::output::Cost;
use crate::surrogate::{Examples, Surrogate};
use serde::{Deserialize, Serialize};

/// A round of fewer scans is early: it only finds the scales, so its trajectories are short and their energy range has
/// no limit.
pub(super) const EARLY_SCANS: usize = 32;

/// Maximum number of leapfrog steps of a transition in an early round.
const EARLY_LEAPFROGS: usize = 32;

/// Energy error of an early round that is accepted, as a fraction of the depth that a trajectory descended.
const EARLY_SLACK: f64 = 0.05;

/// Largest change of ln Z, in nats, from one part of an extension to the next with which the burn-in ends (docs/decisions.md, section 2).
const SETTLED_LN_Z: f64 = 0.3;

/// One temperature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Temperature {
    pub(super) beta: f64,
    pub(super) metric: Metric,
    pub(super) step: StepSize,
    /// States of the round before at this temperature: of its odd clusters for chains of the even ones, and of its even ones
    /// for the odd.
    pub(super) pools: [DifferencePool; 2],
}

/// One chain of one chain set. Swaps exchange states and the numbers of their replicas between chains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Chain {
    pub(super) point: Point,
    pub(super) replica: usize,
}

/// Results of a finished round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Finished {
    pub(super) communication_barrier: f64,
    pub(super) ln_z: f64,
}

/// The state of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub(super) settings: Settings,
    pub(super) seed: u64,
    /// The SMC samplers, until they have reached the posterior.
    pub(super) smc_samplers: Option<SmcSamplers>,
    /// Present round, and its scans done.
    pub(super) round: usize,
    pub(super) scan: usize,
    /// Extensions of the last round so far.
    pub(super) extensions: usize,
    /// Whether the checks passed at the end of the extension before.
    pub(super) passed_before: bool,
    /// Scans done in all rounds: the index of the random streams.
    pub(super) clock: u64,
    /// The distributions at beta = 0: of the chain sets of even clusters, and of those of odd ones.
    pub(super) references: [Reference; 2],
    /// The draws of all clusters that the references of the rounds before the last were fitted to.
    pub(super) training: Vec<f64>,
    /// The surrogate of ln L that HMC transitions follow, where the settings ask for one.
    pub(super) surrogate: Option<Surrogate>,
    /// What it was fitted to.
    pub(super) examples: Examples,
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
        if self.is_last_round() {
            self.settings.scans_with(self.extensions)
        } else {
            self.settings.scans(self.round)
        }
    }

    /// Whether the last round and its extensions are done.
    pub(super) fn finished(&self) -> bool {
        self.is_last_round() && self.scan == self.scans()
    }

    /// Whether a part of an extension has ended, but not the extension, and another is to begin.
    pub(super) fn part_ended(&self) -> bool {
        let goes_on = self.is_last_round() && self.scan < self.scans();
        goes_on && self.mixture_next() && self.record.part().whole()
    }

    /// Scans of the next part of the present extension.
    pub(super) fn scans_of_next_part(&self) -> usize {
        let left = self.scans() - self.scan;
        let longest = self.settings.parts_of_extension(self.extensions).next();
        longest.map_or(left, |longest| longest.min(left))
    }

    /// Scans of the present extension of the last round, or of the round itself.
    pub(super) fn newest_scans(&self) -> usize {
        self.settings.scans_of_extension(self.extensions)
    }

    /// Whether the present scans belong to the burn-in of a path from a mixture: the rounds, and extensions until ln Z is settled.
    pub(super) fn burns_in(&self) -> bool {
        self.settings.mixture_rounds > 0
            && (!self.is_last_round() || self.record.burns_in(self.extensions))
    }

    /// Whether ln Z of the part that has just ended is that of the one, or the round, before it. While references still approach the
    /// posterior it is not.
    pub(super) fn settled_at(&self, ln_z: f64) -> bool {
        let before = self.history.last().map_or(f64::NAN, |round| round.ln_z);
        (ln_z - before).abs() <= SETTLED_LN_Z
    }

    /// Number of looks in succession at which all checks passed, at most 2: the present one if `passed`, and the one
    /// before. Draws of the burn-in of a path from a mixture do not count, and a look at them neither.
    pub(super) fn looks_passed(&self, passed: bool) -> usize {
        if passed && !self.burns_in() {
            1 + usize::from(self.passed_before)
        } else {
            0
        }
    }

    /// A state that was read from a file, with another maximum number of extensions.
    pub(super) fn resumed(mut self, extensions: usize) -> Self {
        self.settings.extensions = extensions;
        if let Some(surrogate) = &mut self.surrogate {
            surrogate.prepare();
        }
        self
    }

    /// Whether the last round may be extended again.
    pub(super) fn may_extend(&self) -> bool {
        self.extensions < self.settings.extensions
    }

    /// Whether the first scan is still to come.
    pub(super) fn smc_samplers(&self) -> bool {
        self.smc_samplers.is_some()
    }

    /// Whether the present round has a scan.
    pub(super) fn scanned(&self) -> bool {
        self.scan > 0
    }

    pub(super) fn is_last_round(&self) -> bool {
        self.round + 1 == self.settings.rounds
    }

    /// Number of independent clusters of chain sets.
    pub(super) fn clusters(&self) -> usize {
        self.settings.clusters()
    }

    /// The half of the clusters that a chain belongs to: 0 for even clusters, 1 for odd ones. Each half has a reference and
    /// pools from the draws of the other.
    pub(super) fn half(&self, chain: usize) -> usize {
        chain / self.temperatures.len() % self.clusters() % 2
    }

    /// The distribution at beta = 0 on the annealing path of a chain.
    pub(super) fn reference(&self, chain: usize) -> &Reference {
        &self.references[self.half(chain)]
    }

    /// Whether the references are the prior.
    pub(super) fn path_from_prior(&self) -> bool {
        self.references[0].is_prior()
    }

    /// Whether slice updates are made besides HMC transitions.
    pub(super) fn slices(&self) -> bool {
        self.settings.slice_updates > 0
    }

    /// Whether the settings ask for a mixture as the reference of this round.
    pub(super) fn mixture_due(&self) -> bool {
        self.settings.mixes(self.round)
    }

    /// Whether a mixture is to be fitted to the draws of this round. Not to those of the last but one: the last round keeps
    /// the mixture of the round before, and with it temperatures that were found on the same annealing path.
    pub(super) fn mixture_next(&self) -> bool {
        if self.is_last_round() {
            return self.settings.mixture_rounds > 0;
        }
        let next = self.round + 1;
        self.settings.mixes(next) && (next + 1 < self.settings.rounds || self.path_from_prior())
    }

    pub(super) fn is_early_round(&self) -> bool {
        !self.is_last_round() && self.settings.scans(self.round) < EARLY_SCANS
    }

    /// The plan of a transition of one temperature in the present round.
    pub(super) fn plan(&self, temperature: &Temperature) -> Plan {
        let early = self.is_early_round();
        let most = self.settings.max_leapfrogs;
        Plan {
            step: temperature.step.step(),
            length: self.settings.trajectory,
            max_leapfrogs: if early {
                most.min(EARLY_LEAPFROGS)
            } else {
                most
            },
            max_energy_range: if early {
                f64::INFINITY
            } else {
                MAX_ENERGY_RANGE
            },
            slack: if early { EARLY_SLACK } else { 0.0 },
        }
    }

    pub(super) fn beta(&self) -> Vec<f64> {
        self.temperatures
            .iter()
            .map(|temperature| temperature.beta)
            .collect()
    }

    pub(super) fn evidence(&self) -> Estimate {
        let parts: Vec<(&[f64], &Traces)> = self.parts(|_| true).collect();
        self.evidence_of(&parts)
    }

    /// The evidence of the scans before the newest extension, and of that extension alone; none if there is none before.
    pub(super) fn evidence_of_earlier_and_newest(&self) -> Option<[Estimate; 2]> {
        let of = |newest: bool| -> Option<Estimate> {
            let parts = self.parts(|extension| (extension == self.extensions) == newest);
            let parts: Vec<(&[f64], &Traces)> = parts.collect();
            (!parts.is_empty()).then(|| self.evidence_of(&parts))
        };
        if let (Some(earlier), Some(newest)) = (of(false), of(true)) {
            return Some([earlier, newest]);
        }
        // Without a mixture all extensions are one part.
        let (beta, all) = self.parts(|_| true).next()?;
        let before = all.scans().checked_sub(self.newest_scans())?;
        (before > 0 && self.path_from_prior()).then(|| {
            let both = all.split_at(before);
            both.map(|part| self.evidence_of(&[(beta, &part)]))
        })
    }

    /// The parts of these extensions that are long enough for ln Z: inverse temperatures, and the traces at them.
    fn parts(&self, of: impl Fn(usize) -> bool) -> impl Iterator<Item = (&[f64], &Traces)> {
        let parts = self
            .record
            .long_enough()
            .filter(move |part| of(part.extension));
        parts.map(|part| (part.beta.as_slice(), &part.traces))
    }

    fn evidence_of(&self, parts: &[(&[f64], &Traces)]) -> Estimate {
        let paths = if self.path_from_prior() {
            1
        } else {
            self.references.len()
        };
        estimate(parts, self.settings.clusters(), paths)
    }

    /// The event of a scan; evidence and communication barrier are NaN before a round has finished.
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
