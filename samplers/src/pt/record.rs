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

/// A leg of less than this part of the longest says nothing yet.
const SHORTEST_LEG: usize = 10;

/// What happened at one temperature in one leg, all ladders together.
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

/// What happens while temperatures, metrics and reference stay what they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Leg {
    pub(super) beta: Vec<f64>,
    /// Scans that it is to have.
    scans: usize,
    /// ln L of every slot, over the reference's tilt, after every scan's exploration.
    pub(super) traces: Traces,
    /// Positions at beta = 1 per ladder, scan by scan.
    pub(super) draws: Vec<Vec<f64>>,
    /// Their ln L.
    pub(super) ln_likelihood: Vec<Vec<f64>>,
    /// One per ladder.
    pub(super) journeys: Vec<Journeys>,
    /// States at each temperature, of the ladders of each family, one after the other: the pools of directions to come.
    pub(super) visits: Vec<Vec<Vec<f64>>>,
    /// Scans from one remembered state to the next.
    visit_every: usize,
    /// One per temperature.
    pub(super) locals: Vec<Local>,
    /// One per temperature.
    pub(super) moments: Vec<Moments>,
    /// Sum of rejection probabilities per gap, over ladders and scans.
    rejection: Vec<f64>,
}

impl Leg {
    fn new(dim: usize, ladders: usize, families: usize, beta: &[f64], scans: usize) -> Self {
        let rungs = beta.len();
        Self {
            beta: beta.to_vec(),
            scans,
            traces: Traces::new(ladders, rungs),
            draws: vec![Vec::new(); ladders],
            ln_likelihood: vec![Vec::new(); ladders],
            journeys: vec![Journeys::new(rungs); ladders],
            visits: vec![vec![Vec::new(); families]; rungs],
            visit_every: (scans * ladders).div_ceil(2 * MOST_VISITS),
            locals: vec![Local::default(); rungs],
            moments: vec![Moments::new(dim); rungs],
            rejection: vec![0.0; rungs - 1],
        }
    }

    /// Notes one ladder's states, hottest first, after exploration and before swaps.
    pub(super) fn note<'a>(&mut self, ladder: usize, points: impl Iterator<Item = &'a Point>) {
        let visited = self.traces.scans().is_multiple_of(self.visit_every);
        let mut hotter: Option<f64> = None;
        let mut score = Vec::new();
        for (rung, point) in points.enumerate() {
            let beta = self.beta[rung];
            self.traces.push(ladder, rung, point.ln_ratio());
            if let Some(l_hot) = hotter {
                let gap = beta - self.beta[rung - 1];
                self.rejection[rung - 1] += 1.0 - swap::acceptance(gap, l_hot, point.ln_ratio());
            }
            if point.has_gradient {
                score.clear();
                let gradient = point.gradient.iter().zip(&point.z);
                score.extend(gradient.map(|(g, z)| beta * g - z));
                for (score, tilt) in score.iter_mut().zip(&point.tilt_gradient) {
                    *score += (1.0 - beta) * tilt;
                }
                shorten(&mut score, LONGEST_SCORE);
                self.moments[rung].push(&point.z, &score);
            }
            if visited {
                let family = ladder % self.visits[rung].len();
                self.visits[rung][family].extend_from_slice(&point.z);
            }
            if rung + 1 == self.beta.len() {
                self.draws[ladder].extend_from_slice(&point.z);
                self.ln_likelihood[ladder].push(point.ln_likelihood);
            }
            hotter = Some(point.ln_ratio());
        }
    }

    fn whole(&self) -> bool {
        self.traces.scans() >= self.scans
    }

    /// Mean swap rejection per gap.
    pub(super) fn mean_rejection(&self) -> Vec<f64> {
        let count = self.traces.scans() * self.traces.ladders();
        self.rejection
            .iter()
            .map(|s| s / count.max(1) as f64)
            .collect()
    }
}

/// Draws at beta = 1, ladder by ladder.
pub(super) struct Cold {
    /// Scan by scan.
    pub(super) positions: Vec<Vec<f64>>,
    pub(super) ln_likelihood: Vec<Vec<f64>>,
}

/// Everything a round leaves behind: for adaptation, evidence, checks and draws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    /// One, and as many more as the last round goes on for.
    legs: Vec<Leg>,
    /// Where each ladder has been at beta = 1, every move of every scan, in a round that a mixture is fitted to.
    pub(super) trails: Vec<Vec<f64>>,
    families: usize,
}

impl Record {
    /// An empty record of a round of `scans` at these inverse temperatures; ladder `k` is of family `k % families`.
    pub(super) fn new(
        dim: usize,
        ladders: usize,
        families: usize,
        beta: &[f64],
        scans: usize,
    ) -> Self {
        Self {
            legs: vec![Leg::new(dim, ladders, families, beta, scans)],
            trails: vec![Vec::new(); ladders],
            families,
        }
    }

    /// Begins another leg of `scans`, with the same machines.
    pub(super) fn begin_leg(&mut self, dim: usize, beta: &[f64], scans: usize) {
        let mut leg = Leg::new(dim, self.trails.len(), self.families, beta, scans);
        leg.journeys = self.leg().journeys.iter().map(Journeys::onward).collect();
        self.legs.push(leg);
    }

    /// The present leg.
    pub(super) fn leg(&self) -> &Leg {
        &self.legs[self.legs.len() - 1]
    }

    /// The present leg, to be added to.
    pub(super) fn leg_mut(&mut self) -> &mut Leg {
        let last = self.legs.len() - 1;
        &mut self.legs[last]
    }

    /// The legs that count: the later half of those that are whole, since the earlier ones had still to learn where modes are, and
    /// the one in progress.
    pub(super) fn counted(&self) -> &[Leg] {
        let whole = self.legs.iter().filter(|leg| leg.whole()).count();
        &self.legs[whole / 2..]
    }

    /// Those of them that are long enough to tell of temperatures and of ln Z: one that has only begun, beside others, is not.
    pub(super) fn telling(&self) -> impl DoubleEndedIterator<Item = &Leg> {
        let scans = |leg: &Leg| leg.traces.scans();
        let longest = self.counted().iter().map(scans).max().unwrap_or(0);
        let least = longest.div_ceil(SHORTEST_LEG);
        let legs = self.counted().iter();
        legs.filter(move |leg| scans(leg) >= least)
    }

    /// The last leg that is long enough.
    pub(super) fn telling_leg(&self) -> &Leg {
        self.telling().next_back().unwrap_or(self.leg())
    }

    /// What counts at beta = 1.
    pub(super) fn cold(&self) -> Cold {
        Cold {
            positions: by_ladder(self.counted(), |leg| &leg.draws),
            ln_likelihood: by_ladder(self.counted(), |leg| &leg.ln_likelihood),
        }
    }

    /// Positions at beta = 1 of all legs, also of those that do not count.
    pub(super) fn all_draws(&self) -> Vec<Vec<f64>> {
        by_ladder(&self.legs, |leg| &leg.draws)
    }

    /// Scans that count.
    pub(super) fn scans(&self) -> usize {
        self.counted().iter().map(|leg| leg.traces.scans()).sum()
    }

    /// Round trips and restarts of each ladder that count.
    pub(super) fn journeys(&self) -> Vec<(u64, u64)> {
        let ladders = 0..self.trails.len();
        let of = |ladder: usize, count: fn(&Journeys) -> u64| {
            let legs = self.counted().iter();
            legs.map(|leg| count(&leg.journeys[ladder])).sum()
        };
        ladders
            .map(|ladder| (of(ladder, |j| j.round_trips), of(ladder, |j| j.restarts)))
            .collect()
    }

    /// Round trips of all ladders.
    pub(super) fn round_trips(&self) -> u64 {
        self.journeys().iter().map(|(trips, _)| trips).sum()
    }
}

fn by_ladder(legs: &[Leg], of: fn(&Leg) -> &Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let ladders = legs.first().map_or(0, |leg| of(leg).len());
    (0..ladders)
        .map(|ladder| {
            legs.iter()
                .flat_map(|leg| &of(leg)[ladder])
                .copied()
                .collect()
        })
        .collect()
}
