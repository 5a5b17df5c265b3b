//! What one round remembers.

use super::evidence::Traces;
use super::swap::{self, Journeys};
use crate::hmc::{End, Moments, Moved, Point, shorten};
use serde::{Deserialize, Serialize};

/// Longest score that a metric is estimated from, in units of sqrt(d): the score of a posterior a thousand times narrower
/// than its prior. One chaotic point would otherwise outweigh all others.
const LONGEST_SCORE: f64 = 1_000.0;

/// Most states of half of the ladders that a round remembers at each temperature, spread evenly over its scans.
const MOST_VISITS: usize = 256;

/// What happened at one temperature in one round, all ladders together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Local {
    /// Local moves.
    pub(super) moves: u64,
    /// Sum of their acceptance probabilities.
    pub(super) acceptance: f64,
    /// Leapfrog steps planned.
    pub(super) leapfrogs: u64,
    /// Moves cut short by the largest number of steps.
    pub(super) capped: u64,
    /// Moves given up as divergent.
    pub(super) diverged: u64,
    /// Moves that met a point without likelihood.
    pub(super) rejected: u64,
}

impl Local {
    pub(super) fn note(&mut self, moved: &Moved) {
        self.moves += 1;
        self.acceptance += moved.acceptance;
        self.leapfrogs += moved.leapfrogs as u64;
        self.capped += u64::from(moved.capped);
        self.diverged += u64::from(moved.end == End::Diverged);
        self.rejected += u64::from(moved.end == End::Rejected);
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.moves += other.moves;
        self.acceptance += other.acceptance;
        self.leapfrogs += other.leapfrogs;
        self.capped += other.capped;
        self.diverged += other.diverged;
        self.rejected += other.rejected;
    }

    /// Mean acceptance; 1 where no move was made (the prior's own rung draws afresh).
    pub(super) fn mean_acceptance(&self) -> f64 {
        if self.moves == 0 {
            1.0
        } else {
            self.acceptance / self.moves as f64
        }
    }
}

/// Everything a round leaves behind: for adaptation, evidence, gates and draws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    /// ln L of every slot after every scan's exploration.
    pub(super) traces: Traces,
    /// Positions at beta = 1 per ladder, scan by scan.
    pub(super) draws: Vec<Vec<f64>>,
    /// States at each temperature, of the ladders of each family, one after the other: the next round's pools of directions.
    pub(super) visits: Vec<Vec<Vec<f64>>>,
    /// Where each ladder has been at beta = 1, every move of every scan, in a round that a mixture is fitted to.
    pub(super) trails: Vec<Vec<f64>>,
    /// Scans from one remembered state to the next.
    visit_every: usize,
    /// One per temperature.
    pub(super) locals: Vec<Local>,
    /// One per temperature.
    pub(super) moments: Vec<Moments>,
    /// Sum of rejection probabilities per gap, over ladders and scans.
    rejection: Vec<f64>,
    /// One per ladder.
    pub(super) journeys: Vec<Journeys>,
}

impl Record {
    /// An empty record of a round of `scans`; ladder `k` is of family `k % families`.
    pub(super) fn new(
        dim: usize,
        ladders: usize,
        families: usize,
        rungs: usize,
        scans: usize,
    ) -> Self {
        Self {
            traces: Traces::new(ladders, rungs),
            draws: vec![Vec::new(); ladders],
            trails: vec![Vec::new(); ladders],
            visits: vec![vec![Vec::new(); families]; rungs],
            visit_every: (scans * ladders).div_ceil(2 * MOST_VISITS),
            locals: vec![Local::default(); rungs],
            moments: vec![Moments::new(dim); rungs],
            rejection: vec![0.0; rungs - 1],
            journeys: vec![Journeys::new(rungs); ladders],
        }
    }

    /// Notes one ladder's states, hottest first, after exploration and before swaps.
    pub(super) fn note<'a>(
        &mut self,
        ladder: usize,
        beta: &[f64],
        points: impl Iterator<Item = &'a Point>,
    ) {
        let visited = self.traces.scans().is_multiple_of(self.visit_every);
        let mut hotter: Option<f64> = None;
        let mut score = Vec::new();
        for (rung, point) in points.enumerate() {
            self.traces.push(ladder, rung, point.ln_ratio());
            if let Some(l_hot) = hotter {
                let gap = beta[rung] - beta[rung - 1];
                self.rejection[rung - 1] += 1.0 - swap::acceptance(gap, l_hot, point.ln_ratio());
            }
            if point.has_gradient {
                score.clear();
                score.extend(
                    point
                        .gradient
                        .iter()
                        .zip(&point.z)
                        .map(|(g, z)| beta[rung] * g - z),
                );
                for (score, tilt) in score.iter_mut().zip(&point.tilt_gradient) {
                    *score += (1.0 - beta[rung]) * tilt;
                }
                shorten(&mut score, LONGEST_SCORE);
                self.moments[rung].push(&point.z, &score);
            }
            if visited {
                let family = ladder % self.visits[rung].len();
                self.visits[rung][family].extend_from_slice(&point.z);
            }
            if rung + 1 == beta.len() {
                self.draws[ladder].extend_from_slice(&point.z);
            }
            hotter = Some(point.ln_ratio());
        }
    }

    /// Mean swap rejection per gap.
    pub(super) fn mean_rejection(&self) -> Vec<f64> {
        let count = self.traces.scans() * self.journeys.len();
        self.rejection
            .iter()
            .map(|s| s / count.max(1) as f64)
            .collect()
    }

    /// Round trips of all ladders.
    pub(super) fn round_trips(&self) -> u64 {
        self.journeys.iter().map(|j| j.round_trips).sum()
    }
}
