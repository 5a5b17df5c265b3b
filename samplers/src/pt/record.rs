//! What is recorded of one round.

use super::evidence::Traces;
use super::posterior_draws::PosteriorDraws;
use super::settings::Settings;
use super::swap::{self, IndexProcess};
use crate::hmc::{End, Moments, Point, Transition, shorten};
use crate::valid::{Valid, countable, ensure, moderate, rows};
use serde::{Deserialize, Serialize};

/// Maximum length of a score that a metric is estimated from, in units of sqrt(d): that of a posterior a thousand times
/// narrower than its prior. Otherwise one chaotic point would outweigh all others.
const MAX_SCORE: f64 = 1_000.0;

/// Maximum number of states of half of the chain sets that are recorded at each temperature, evenly spaced over the
/// scans of a round.
const MAX_VISITS: usize = 256;

/// A part shorter than the longest one by this factor is not used for temperatures and ln Z.
const MIN_PART: usize = 10;

/// The HMC transitions at one temperature in one part, all chain sets together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Local {
    /// HMC transitions.
    pub(super) moves: u64,
    /// Sum of their acceptance probabilities.
    pub(super) acceptance: f64,
    /// Leapfrog steps planned.
    pub(super) leapfrogs: u64,
    /// Transitions cut short by the maximum number of steps.
    pub(super) capped: u64,
    /// Transitions stopped as divergent.
    pub(super) diverged: u64,
    /// Transitions that met a rejected point.
    pub(super) rejected: u64,
    /// Sum of the probabilities with which ln L accepted transitions along a surrogate.
    pub(super) surrogate_acceptance: f64,
}

impl Local {
    pub(super) fn note(&mut self, moved: &Transition) {
        self.moves += 1;
        self.acceptance += moved.acceptance;
        self.leapfrogs += moved.leapfrogs as u64;
        self.capped += u64::from(moved.capped);
        self.diverged += u64::from(moved.end == End::Diverged);
        self.rejected += u64::from(moved.end == End::Rejected);
    }

    /// Checks counts that were read from a file.
    fn check(&self) -> Valid {
        let counts = [
            self.moves,
            self.leapfrogs,
            self.capped,
            self.diverged,
            self.rejected,
        ];
        let sums = [self.acceptance, self.surrogate_acceptance];
        ensure(
            countable(counts) && self.rejected <= self.moves && sums.iter().all(|s| s.is_finite()),
            "a count of moves is too large, or acceptance is not finite",
        )
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.moves += other.moves;
        self.acceptance += other.acceptance;
        self.leapfrogs += other.leapfrogs;
        self.capped += other.capped;
        self.diverged += other.diverged;
        self.rejected += other.rejected;
        self.surrogate_acceptance += other.surrogate_acceptance;
    }

    /// Mean acceptance by the density that the transitions follow; 1 without transitions (at beta = 0 the reference is drawn
    /// independently).
    pub(super) fn mean_acceptance(&self) -> f64 {
        self.mean(self.acceptance)
    }

    /// Mean probability with which ln L accepts transitions along a surrogate; 1 without transitions.
    pub(super) fn mean_surrogate_acceptance(&self) -> f64 {
        self.mean(self.surrogate_acceptance)
    }

    fn mean(&self, sum: f64) -> f64 {
        if self.moves == 0 {
            1.0
        } else {
            sum / self.moves as f64
        }
    }
}

/// Scans with fixed temperatures, metrics and reference: a round, or an extension of the last, or a part of a long one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Part {
    pub(super) beta: Vec<f64>,
    /// Number of the extension that it belongs to; 0 for the round itself.
    pub(super) extension: usize,
    /// Planned number of scans.
    scans: usize,
    /// ln L minus the log ratio of reference to prior, of every chain after every scan's moves.
    pub(super) traces: Traces,
    /// Positions at beta = 1 per chain set, scan by scan.
    pub(super) draws: Vec<Vec<f64>>,
    /// Their ln L.
    pub(super) ln_likelihood: Vec<Vec<f64>>,
    /// One per chain set.
    pub(super) index_processes: Vec<IndexProcess>,
    /// States at each temperature, of the chain sets of each cluster, one after the other: points for later directions.
    pub(super) visits: Vec<Vec<Vec<f64>>>,
    /// Scans between two recorded states.
    visit_every: usize,
    /// One per temperature.
    pub(super) locals: Vec<Local>,
    /// One per temperature.
    pub(super) moments: Vec<Moments>,
    /// Sum of rejection probabilities per pair of temperatures, over chain sets and scans.
    rejection: Vec<f64>,
}

impl Part {
    fn new(dim: usize, chain_sets: usize, clusters: usize, beta: &[f64], scans: usize) -> Self {
        let temperatures = beta.len();
        Self {
            beta: beta.to_vec(),
            extension: 0,
            scans,
            traces: Traces::new(chain_sets, temperatures),
            draws: vec![Vec::new(); chain_sets],
            ln_likelihood: vec![Vec::new(); chain_sets],
            index_processes: vec![IndexProcess::new(temperatures); chain_sets],
            visits: vec![vec![Vec::new(); clusters]; temperatures],
            visit_every: (scans * chain_sets).div_ceil(2 * MAX_VISITS),
            locals: vec![Local::default(); temperatures],
            moments: vec![Moments::new(dim); temperatures],
            rejection: vec![0.0; temperatures - 1],
        }
    }

    /// Checks a part of this extension, with `scans`, that was read from a file.
    fn check(
        &self,
        dim: usize,
        chain_sets: usize,
        clusters: usize,
        (extension, scans): (usize, usize),
    ) -> Valid {
        let temperatures = self.beta.len();
        ensure(
            temperatures >= 2
                && self.extension == extension
                && self.scans == scans
                && self.index_processes.len() == chain_sets
                && self.locals.len() == temperatures
                && self.moments.len() == temperatures
                && self.rejection.len() == temperatures - 1,
            "a part of a round has other chain sets, temperatures or scans",
        )?;
        self.traces.check(chain_sets, temperatures)?;
        let noted = self.traces.scans();
        let draws = (self.draws.iter()).all(|z| rows(z.len(), noted, dim) && moderate(z));
        let values = |l: &Vec<f64>| l.len() == noted && l.iter().all(|l| l.is_finite());
        ensure(
            self.draws.len() == chain_sets
                && draws
                && self.ln_likelihood.len() == chain_sets
                && self.ln_likelihood.iter().all(values),
            "draws and their likelihoods differ in number, or are not finite",
        )?;
        let visited = |z: &Vec<f64>| z.len().is_multiple_of(dim) && moderate(z);
        ensure(
            self.visit_every > 0
                && self.visits.len() == temperatures
                && self
                    .visits
                    .iter()
                    .all(|v| v.len() == clusters && v.iter().all(visited)),
            "recorded states are of other temperatures or clusters",
        )?;
        ensure(
            self.rejection.iter().all(|s| *s >= 0.0 && s.is_finite()),
            "a sum of rejections is negative, or not finite",
        )?;
        (self.index_processes.iter())
            .try_for_each(|index_processes| index_processes.check(temperatures))?;
        self.locals.iter().try_for_each(Local::check)?;
        (self.moments.iter()).try_for_each(|moments| moments.check(dim))
    }

    /// Records the score at a state of one temperature: the gradient of the log density that its trajectories follow.
    pub(super) fn note_score(&mut self, temperature: usize, point: &Point, mut score: Vec<f64>) {
        shorten(&mut score, MAX_SCORE);
        self.moments[temperature].push(&point.z, &score);
    }

    /// Records the states of one chain set, from beta = 0 on, after the local moves and before swaps.
    pub(super) fn note<'a>(&mut self, chain_set: usize, points: impl Iterator<Item = &'a Point>) {
        // What follows the planned scans, extensions on a path from the prior, adapts nothing.
        let visited = !self.whole() && self.traces.scans().is_multiple_of(self.visit_every);
        let mut hotter: Option<f64> = None;
        for (temperature, point) in points.enumerate() {
            let beta = self.beta[temperature];
            self.traces.push(chain_set, temperature, point.ln_ratio());
            if let Some(l_hot) = hotter {
                let gap = beta - self.beta[temperature - 1];
                self.rejection[temperature - 1] +=
                    1.0 - swap::acceptance(gap, l_hot, point.ln_ratio());
            }
            if visited {
                let cluster = chain_set % self.visits[temperature].len();
                self.visits[temperature][cluster].extend_from_slice(&point.z);
            }
            if temperature + 1 == self.beta.len() {
                self.draws[chain_set].extend_from_slice(&point.z);
                self.ln_likelihood[chain_set].push(point.ln_likelihood);
            }
            hotter = Some(point.ln_ratio());
        }
    }

    /// Whether all planned scans are done.
    pub(super) fn whole(&self) -> bool {
        self.traces.scans() >= self.scans
    }

    /// Mean swap rejection per pair of temperatures.
    pub(super) fn mean_rejection(&self) -> Vec<f64> {
        let count = self.traces.scans() * self.traces.chain_sets();
        self.rejection
            .iter()
            .map(|s| s / count.max(1) as f64)
            .collect()
    }
}

/// The record of a round: for adaptation, evidence, checks and draws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    /// The round, and the parts of the extensions of the last.
    parts: Vec<Part>,
    /// Number of extensions that are the burn-in of a path from a mixture, with the round itself.
    burn_in: usize,
    /// Positions of each chain set at beta = 1 after every move of every scan, in a round that a mixture is fitted to.
    pub(super) trails: Vec<Vec<f64>>,
    clusters: usize,
}

impl Record {
    /// An empty record of a round of `scans` at these inverse temperatures; chain set `k` belongs to cluster `k %
    /// clusters`.
    pub(super) fn new(
        dim: usize,
        chain_sets: usize,
        clusters: usize,
        beta: &[f64],
        scans: usize,
    ) -> Self {
        Self {
            parts: vec![Part::new(dim, chain_sets, clusters, beta, scans)],
            burn_in: 0,
            trails: vec![Vec::new(); chain_sets],
            clusters,
        }
    }

    /// Checks a record that was read from a file: `planned` has the scans of all parts with the numbers of their extensions, of which `done` are done in
    /// all.
    pub(super) fn check(
        &self,
        dim: usize,
        settings: &Settings,
        beta: &[f64],
        planned: &[(usize, usize)],
        done: usize,
    ) -> Valid {
        let (chain_sets, clusters) = (settings.chain_sets, settings.clusters());
        ensure(
            (1..=planned.len()).contains(&self.parts.len())
                && self.burn_in <= self.part().extension
                && self.trails.len() == chain_sets
                && self.clusters == clusters,
            "a record has other parts, chain sets or clusters",
        )?;
        let whole = |z: &Vec<f64>| z.len().is_multiple_of(dim) && moderate(z);
        ensure(
            self.trails.iter().all(whole),
            "a list of positions has another dimension, or is not finite",
        )?;
        (self.parts.iter().zip(planned))
            .try_for_each(|(part, planned)| part.check(dim, chain_sets, clusters, *planned))?;
        let noted: usize = self.parts.iter().map(|part| part.traces.scans()).sum();
        let before = &self.parts[..self.parts.len() - 1];
        ensure(
            noted == done && before.iter().all(|part| part.traces.scans() == part.scans),
            "a record has other scans than the round",
        )?;
        let same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
        let last = &self.part().beta;
        ensure(
            last.len() == beta.len() && last.iter().zip(beta).all(same),
            "the present part is at other temperatures",
        )
    }

    /// Begins another part, of `scans` and of this extension; replicas keep their numbers.
    pub(super) fn begin_part(&mut self, dim: usize, beta: &[f64], extension: usize, scans: usize) {
        let mut part = Part::new(dim, self.trails.len(), self.clusters, beta, scans);
        part.index_processes = self
            .part()
            .index_processes
            .iter()
            .map(IndexProcess::onward)
            .collect();
        part.extension = extension;
        self.parts.push(part);
    }

    /// The present part.
    pub(super) fn part(&self) -> &Part {
        &self.parts[self.parts.len() - 1]
    }

    /// The present part, to be added to.
    pub(super) fn part_mut(&mut self) -> &mut Part {
        let last = self.parts.len() - 1;
        &mut self.parts[last]
    }

    /// Whether an extension belongs to the burn-in.
    pub(super) fn burns_in(&self, extension: usize) -> bool {
        extension <= self.burn_in
    }

    /// Makes one more extension the burn-in too.
    pub(super) fn lengthen_burn_in(&mut self) {
        self.burn_in += 1;
    }

    /// Number of parts of the burn-in.
    fn parts_of_burn_in(&self) -> usize {
        (self.parts).partition_point(|part| self.burns_in(part.extension))
    }

    /// The parts that count: all after the burn-in. The last whole one of the burn-in counts until one after it is whole.
    pub(super) fn counted(&self) -> &[Part] {
        let whole = self.parts.iter().take_while(|e| e.whole()).count();
        &self.parts[self.parts_of_burn_in().min(whole.saturating_sub(1))..]
    }

    /// Those of them that are long enough for temperatures and ln Z: at least a tenth of the longest.
    pub(super) fn long_enough(&self) -> impl DoubleEndedIterator<Item = &Part> {
        let scans = |part: &Part| part.traces.scans();
        let longest = self.counted().iter().map(scans).max().unwrap_or(0);
        let least = longest.div_ceil(MIN_PART);
        let parts = self.counted().iter();
        parts.filter(move |part| scans(part) >= least)
    }

    /// The last part that is long enough.
    pub(super) fn last_long_enough(&self) -> &Part {
        self.long_enough().next_back().unwrap_or(self.part())
    }

    /// What counts at beta = 1.
    pub(super) fn cold(&self) -> PosteriorDraws {
        PosteriorDraws {
            positions: by_chain_set(self.counted(), |part| &part.draws),
            ln_likelihood: by_chain_set(self.counted(), |part| &part.ln_likelihood),
        }
    }

    /// Positions at beta = 1 of the parts that count and of the last of the burn-in.
    pub(super) fn draws_since_burn_in(&self) -> Vec<Vec<f64>> {
        by_chain_set(&self.parts[self.parts_of_burn_in() - 1..], |part| {
            &part.draws
        })
    }

    /// Scans that count.
    pub(super) fn scans(&self) -> usize {
        self.counted().iter().map(|part| part.traces.scans()).sum()
    }

    /// Round trips and restarts of each chain set that count.
    pub(super) fn index_processes(&self) -> Vec<(u64, u64)> {
        let chain_sets = 0..self.trails.len();
        let of = |chain_set: usize, count: fn(&IndexProcess) -> u64| {
            let parts = self.counted().iter();
            parts
                .map(|part| count(&part.index_processes[chain_set]))
                .sum()
        };
        chain_sets
            .map(|chain_set| {
                (
                    of(chain_set, |j| j.round_trips),
                    of(chain_set, |j| j.restarts),
                )
            })
            .collect()
    }

    /// Round trips of all chain sets.
    pub(super) fn round_trips(&self) -> u64 {
        self.index_processes().iter().map(|(trips, _)| trips).sum()
    }
}

fn by_chain_set(parts: &[Part], of: fn(&Part) -> &Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let chain_sets = parts.first().map_or(0, |part| of(part).len());
    (0..chain_sets)
        .map(|chain_set| {
            parts
                .iter()
                .flat_map(|part| &of(part)[chain_set])
                .copied()
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_count_from_the_end_of_the_burn_in_on() {
        let beta = [0.0, 1.0];
        // Parts without scans are whole from the start.
        let mut record = Record::new(1, 2, 2, &beta, 0);
        assert!(record.burns_in(0) && !record.burns_in(1));
        record.lengthen_burn_in();
        assert!(record.burns_in(1) && !record.burns_in(2));
        for _ in 0..2 {
            record.begin_part(1, &beta, 1, 0);
            assert_eq!(record.counted().len(), 1, "the last one of the burn-in");
        }
        assert_eq!(record.parts_of_burn_in(), 3);
        for counted in 1..4 {
            record.begin_part(1, &beta, 2, 0);
            assert_eq!(record.counted().len(), counted);
        }
        // One that has only begun does not count alone.
        let mut begun = Record::new(1, 2, 2, &beta, 0);
        begun.begin_part(1, &beta, 1, 8);
        assert_eq!(begun.counted().len(), 2);
    }
}
