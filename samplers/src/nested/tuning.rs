//! Adaptation of the length and number of a chain's steps to how chains moved.

use super::bound::Bound;
use super::kernel::{self, Counts, NewPoint, StepCounts, Trajectories};
use super::live::Points;
use super::rank::Ranks;
use super::settings::Kernel;
use crate::rng::{RandomStream, below};
use crate::valid::{Valid, countable, ensure};
use serde::{Deserialize, Serialize};

/// First step length in units of the local ellipsoid; for a walk the longest. A step of the ellipsoid's radius times 1.35 over
/// the root of the dimension leaves a ball of many dimensions half of the time; it leaves the region above a likelihood bound
/// within the ellipsoid more often.
fn first_scale(kernel: Kernel, dim: usize) -> f64 {
    match kernel {
        Kernel::RandomWalk => 2.0 / (dim as f64).sqrt(),
        _ => 1.0,
    }
}

/// First step length along a difference: the distance of two points of a region of any dimension is about `sqrt 2` of
/// its radius.
const FIRST_STRIDE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// First step of the leapfrog along a surrogate, and the bounds of later ones.
const FIRST_LEAP: f64 = 0.2;
const LEAPS: std::ops::RangeInclusive<f64> = 1e-3..=1.0;

/// Mean probability of acceptance by the surrogate's own energy that steps of the leapfrog aim at.
const ENERGY_ACCEPTANCE: f64 = 0.9;

/// Fraction of accepted trajectories and proposals from which on few slice updates are needed beside them.
const TRUSTED: f64 = 0.03;

/// Slice updates that accepted moves along a surrogate replace, but for one.
const SLICES_PER_SET: usize = 16;

/// Largest number of proposals and sets of trajectories of a point for as many slice updates.
const MAX_SETS: usize = 18;

/// Maximum rank correlation of a new point's likelihood with its seed's; docs/targets.md, section 1, has bias and
/// scatter of ln Z for several values of it (`cargo bench -p oblate-samplers --bench seed_correlation`).
pub(super) const MAX_SEED_CORRELATION: f64 = 0.2;

/// Target fraction of straight moves in Galilean Monte Carlo: near it new points depended least on their seeds for the
/// same calls (docs/targets.md, section 1). The fraction of reflected moves cannot serve, because moves
/// at points without a gradient reverse at any length.
const STRAIGHT_FRACTION: f64 = 0.7;

/// Statistics of the chains, and the steps that follow from them. Within an iteration steps are fixed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Tuning {
    /// Step length in units of the local ellipsoid.
    pub scale: f64,
    /// Step length along the difference of two points, in units of their distance.
    pub stride: f64,
    /// Step of the leapfrog along a surrogate, in units of the metric.
    pub leap: f64,
    /// Fraction of the trajectories along a surrogate that were accepted in the last iteration.
    pub acceptance: f64,
    /// Independent proposals that were accepted in the last iteration, per try.
    pub exchange: f64,
    /// Slice updates, Galilean Monte Carlo trajectories or walk steps per point; never lowered in a run.
    pub steps: usize,
    /// Relative jump distance of every iteration.
    pub jump_distances: Vec<f64>,
    /// Mean over every iteration of `12 (v - 1/2) (w - 1/2)`, v and w the fractional ranks of a chain's end and of its
    /// start: their correlation.
    pub seed_correlations: Vec<f64>,
    /// Chains that ended where they began.
    pub stayed: u64,
    /// The rank correlation at the last raise of `steps`.
    seed_correlation_at_raise: Option<f64>,
    /// Numbers of insertions, rank correlations and unmoved chains when the present window began.
    window: (usize, usize, u64),
}

impl Tuning {
    pub fn new(steps: usize, kernel: Kernel, dim: usize) -> Self {
        Self {
            scale: first_scale(kernel, dim),
            stride: FIRST_STRIDE,
            leap: FIRST_LEAP,
            acceptance: 0.0,
            exchange: 0.0,
            steps,
            jump_distances: Vec::new(),
            seed_correlations: Vec::new(),
            stayed: 0,
            seed_correlation_at_raise: None,
            window: (0, 0, 0),
        }
    }

    /// Checks what was read from a file, beside so many insertions: steps are from `first_steps` on and at most `max_steps`.
    pub fn check(&self, insertions: usize, first_steps: usize, max_steps: usize) -> Valid {
        let length = |x: f64| x >= 0.0 && x.is_finite();
        ensure(
            length(self.scale)
                && length(self.stride)
                && LEAPS.contains(&self.leap)
                && (0.0..=1.0).contains(&self.acceptance)
                && (0.0..=1.0).contains(&self.exchange),
            "a step length is not finite, or negative",
        )?;
        ensure(
            (first_steps..=max_steps).contains(&self.steps),
            "the number of steps is not one that the settings allow",
        )?;
        let (inserted, seed_correlations, stayed) = self.window;
        ensure(
            inserted <= insertions
                && seed_correlations <= self.seed_correlations.len()
                && stayed <= self.stayed,
            "the window of the steps begins after the last insertion",
        )?;
        ensure(countable([self.stayed]), "a count is too large")
    }

    /// Whether moves along a surrogate were accepted in the last iteration.
    fn trusts(&self) -> bool {
        self.acceptance + self.exchange >= TRUSTED
    }

    /// How often a proposal and a set of trajectories are made for a point: so often that, for every [`SLICES_PER_SET`] steps, a proposal or
    /// as many trajectories as a set has are expected to be accepted.
    pub fn sets(&self) -> usize {
        let wanted = self.steps as f64 / SLICES_PER_SET as f64;
        let accepted = |sets: &usize| *sets as f64 * (self.acceptance + self.exchange) >= wanted;
        let most = MAX_SETS * self.steps.div_ceil(SLICES_PER_SET);
        (1..most).find(accepted).unwrap_or(most)
    }

    /// Slice updates, trajectories or walk steps of a point before trajectories along a surrogate: few where these are accepted.
    pub fn steps_beside_trajectories(&self) -> usize {
        if self.trusts() {
            self.steps.div_ceil(SLICES_PER_SET)
        } else {
            self.steps
        }
    }

    /// Resets the step lengths, for another likelihood bound.
    pub fn forget_lengths(&mut self, kernel: Kernel, dim: usize) {
        self.scale = first_scale(kernel, dim);
        self.stride = FIRST_STRIDE;
        self.leap = FIRST_LEAP;
    }

    /// Rescales the step length so that new ellipsoids, its unit, leave steps as long as they were.
    pub fn keep_step_length(&mut self, old: &[Bound], new: &[Bound], kept: &Points) {
        let mean_unit = |bounds: &[Bound]| -> Option<f64> {
            let units: Option<Vec<f64>> = (0..kept.len())
                .map(|i| {
                    Some(kernel::bound_of(bounds, kept.genealogy[i].lineage)?.ln_unit(kept.row(i)))
                })
                .collect();
            units.map(|units| mean(&units))
        };
        if let (Some(old), Some(new)) = (mean_unit(old), mean_unit(new)) {
            self.scale *= (old - new).exp();
        }
    }

    /// Records the chains of an iteration, from `seeds` to `born`, and sets the step length of the next one.
    pub fn learn(
        &mut self,
        kernel: Kernel,
        bounds: &[Bound],
        kept: &Points,
        seeds: &[usize],
        born: &[NewPoint],
        rng: &mut RandomStream,
    ) {
        self.jump_distances
            .extend(relative_jump(rng, bounds, kept, seeds, born));
        self.seed_correlations
            .push(seed_correlation(kept, seeds, born));
        self.stayed += born.iter().filter(|b| !b.motion.moved).count() as u64;
        let (mut local, mut differences) = (StepCounts::default(), StepCounts::default());
        let mut trajectories = Trajectories::default();
        let mut proposals = Counts::default();
        for b in born {
            trajectories.add(b.motion.trajectories);
            proposals.add(b.motion.proposals);
            local.add(b.motion.local);
            differences.add(b.motion.differences);
        }
        if trajectories.made > 0 {
            let made = trajectories.made as f64;
            let factor = (trajectories.energy / made - ENERGY_ACCEPTANCE).exp();
            self.leap = (self.leap * factor).clamp(*LEAPS.start(), *LEAPS.end());
            self.acceptance = trajectories.accepted as f64 / made;
            self.exchange = proposals.accepted as f64 / proposals.tried.max(1) as f64;
        }
        match kernel {
            Kernel::RandomSlice | Kernel::Differential | Kernel::Surrogate => {
                self.scale *= balance(local);
                self.stride *= balance(differences);
            }
            // Half of the steps accepted.
            Kernel::RandomWalk => {
                let fraction = local.fraction().unwrap_or(0.5);
                self.scale *= ((fraction - 0.5) / (0.5 * kept.dim() as f64)).exp();
            }
            Kernel::Galilean => {
                let fraction = local.fraction().unwrap_or(STRAIGHT_FRACTION);
                self.scale *= (fraction - STRAIGHT_FRACTION).exp();
            }
            Kernel::Auto | Kernel::Uniform => {}
        }
    }

    /// Raises the number of steps by half, up to `max_steps`, if the last `window` insertions show that the likelihoods of
    /// new points depend on their seeds.
    ///
    /// Small jump distances alone do not raise it, they are only checked: on a thin shell points stay close to their
    /// seeds for long after their likelihoods are independent, and ln Z is as good. A rank correlation that the last
    /// raise has not lowered by a quarter is not due to too few steps: chains that stay in their own mode, each with
    /// likelihoods of its own, remain correlated. It is left to the check, unless it grows.
    pub fn raise_steps_if_needed(&mut self, ranks: &Ranks, window: usize, max_steps: usize) {
        let (insertions, seed_correlations, stayed) = self.window;
        let made = ranks.len() - insertions;
        if made < window {
            return;
        }
        let seed_correlations = &self.seed_correlations[seed_correlations..];
        if !seed_correlations.is_empty() {
            let seed_correlation = mean(seed_correlations);
            let helps = self.seed_correlation_at_raise.is_none_or(|before| {
                seed_correlation < 0.75 * before || seed_correlation > 1.5 * before
            });
            let correlated = seed_correlation > MAX_SEED_CORRELATION && helps;
            let still = (self.stayed - stayed) as f64 > 0.01 * made as f64;
            let uneven = ranks.z_score(insertions).abs() > 3.0;
            if (correlated || still || uneven) && self.steps < max_steps {
                self.steps += self.steps.div_ceil(2);
                self.seed_correlation_at_raise = Some(seed_correlation);
            }
        }
        self.window = (ranks.len(), self.seed_correlations.len(), self.stayed);
    }
}

/// Factor of a width so that slice updates step outwards as often as inwards.
fn balance(slices: StepCounts) -> f64 {
    slices
        .fraction()
        .map_or(1.0, |fraction| (2.0 * fraction).clamp(0.5, 2.0))
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Median distance between chains' ends, over the median distance between their starts and other live points of the
/// same metric region, in that region's metric. `None` if no start has such a neighbour.
fn relative_jump(
    rng: &mut RandomStream,
    bounds: &[Bound],
    kept: &Points,
    seeds: &[usize],
    born: &[NewPoint],
) -> Option<f64> {
    const TRIES: usize = 8;
    let mut jump_distances = Vec::with_capacity(seeds.len());
    let mut pairs = Vec::with_capacity(seeds.len());
    for (&s, b) in seeds.iter().zip(born) {
        let start = kept.row(s);
        let bound = kernel::bound_of(bounds, kept.genealogy[s].lineage)?;
        let label = bound.label(start);
        let metric = bound.metric(label);
        let neighbour = (0..TRIES)
            .map(|_| below(rng, kept.len()))
            .find(|&i| i != s && bound.has_label(kept.row(i), label));
        if let Some(i) = neighbour {
            jump_distances.push(metric.distance_between(&b.u, start));
            pairs.push(metric.distance_between(kept.row(i), start));
        }
    }
    let typical = median(pairs);
    (typical > 0.0).then(|| median(jump_distances) / typical)
}

/// Correlation of the likelihood ranks of chains' ends with those of their starts, among the surviving points.
fn seed_correlation(kept: &Points, seeds: &[usize], born: &[NewPoint]) -> f64 {
    let mut sorted = kept.ln_l.clone();
    sorted.sort_by(f64::total_cmp);
    let centred = |ln_l: f64| {
        let below = sorted.partition_point(|l| *l < ln_l);
        let up_to = sorted.partition_point(|l| *l <= ln_l);
        0.5 * (below + up_to) as f64 / sorted.len() as f64 - 0.5
    };
    let products: Vec<f64> = seeds
        .iter()
        .zip(born)
        .map(|(&s, b)| 12.0 * centred(kept.ln_l[s]) * centred(b.ln_l))
        .collect();
    mean(&products)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_rise_while_that_lowers_the_seed_correlation_and_no_longer() {
        let (mut tuning, mut ranks) = (Tuning::new(10, Kernel::RandomSlice, 2), Ranks::default());
        let mut after_a_window_of = |seed_correlation: f64| {
            // Even ranks, and chains that move.
            for i in 0..110 {
                ranks.push(i % 11, 10);
            }
            tuning.seed_correlations.push(seed_correlation);
            tuning.raise_steps_if_needed(&ranks, 110, 100);
            tuning.steps
        };
        assert_eq!(after_a_window_of(0.20), 10, "nothing to mend");
        assert_eq!(after_a_window_of(0.60), 15);
        assert_eq!(
            after_a_window_of(0.40),
            23,
            "it helped, and rank correlations still"
        );
        assert_eq!(after_a_window_of(0.38), 23, "it did not help");
        assert_eq!(after_a_window_of(0.44), 23);
        assert_eq!(after_a_window_of(0.70), 35, "another regime");
    }
}
