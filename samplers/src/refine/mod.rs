//! From a run on a coarse likelihood to the posterior of a fine one that costs more: draws of the run are carried along
//! `L_coarse^(1 - s) L_fine^s` from `s = 0` to 1, as a population that is cooled ([`cooling`](crate::cooling)).
//!
//! Where a likelihood can be had cheaper and a little wrong, the long way from the prior to the posterior is walked on the
//! cheap one, by any sampler, and the fine one is called only for what is left. ln Z is the run's and the logarithm of the mean
//! weights of the way: consistent however far the two likelihoods are apart, and soon done if that is a few nats. What the coarse
//! run does not know, it cannot find: a mode that it missed, or points without a coarse likelihood.
//!
//! After each step every member moves by slices. The members of even lineages of the run are led by those of odd ones and the
//! other way round, as relatives would not lead each other by the right law.

mod outcome;
mod settings;

pub use settings::Settings;

use crate::control::{Control, Event};
use crate::cooling::Cooling;
use crate::diagnostics::effective_kinds;
use crate::error::{Error, Result};
use crate::hmc::{Evaluator, Metric, MetricKind, Point, Tally, explore_by_slices};
use crate::neighbours::Neighbours;
use crate::output::Run;
use crate::rng::{Domain, stream, unit_open};
use crate::target::{HalfSpace, Outcome, Prior, Symmetry, Target};
use cpu_time::ProcessTime;
use rayon::prelude::*;
use std::time::Instant;

const WHAT: &str = "the run to refine";

/// Index, within a level, of the stream that takes members anew.
const RESAMPLING: u64 = u64::MAX;

/// Carries draws of `parent`, a run on `coarse`, to the posterior of `target`, which has the same parameters.
///
/// The same parent, settings and seed give the same bits on any number of threads. There are no checkpoints: one that is
/// interrupted or whose budget is spent has to begin again. Calls are of both likelihoods, except that the parent's are not
/// counted again.
///
/// # Errors
/// [`Error::Setting`] for settings out of range; [`Error::Mismatch`] if `parent` is not a run on `coarse`, or `target` has other
/// parameters, or a likelihood at none of its draws; [`Error::Interrupted`]; [`Error::Fatal`] and [`Error::Infinite`] from the
/// targets.
pub fn run(
    target: &dyn Target,
    coarse: &dyn Target,
    parent: &Run,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check(target.dim())?;
    parent.check_belongs(coarse, WHAT)?;
    if target.prior().names() != coarse.prior().names() {
        return Err(Error::Mismatch {
            what: WHAT,
            why: "it has other parameters than the fine target; let both differ in the likelihood alone".to_owned(),
        });
    }
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    let mut way = Way {
        target,
        coarse,
        seed,
        sweeps: settings.sweeps,
        share: 0.0,
        ln_ratio: 0.0,
        levels: Vec::new(),
        tally: Tally::default(),
        members: Vec::new(),
    };
    way.begin(parent, settings.members)?;
    while way.share < 1.0 {
        if stop || control.interrupted() || control.spent(way.tally.calls) {
            return Err(Error::Interrupted);
        }
        way.step()?;
        stop = control.tell(&Event::Refining {
            share: way.share,
            ln_z: parent.evidence.ln_z + way.ln_ratio,
            calls: way.tally.calls,
        });
    }
    let (cpu, wall) = (cpu.elapsed(), wall.elapsed());
    let run = outcome::assemble(&way, parent, cpu.as_secs_f64(), wall.as_secs_f64())?;
    control.tell(&Event::Finished);
    Ok(run)
}

/// A likelihood on the way, at 1 - share of the coarse one and share of the fine one in ln L.
struct Between<'a> {
    coarse: &'a dyn Target,
    fine: &'a dyn Target,
    share: f64,
}

impl Target for Between<'_> {
    fn prior(&self) -> &Prior {
        self.fine.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let coarse = self.coarse.ln_likelihood(theta);
        let Outcome::Value(coarse) = coarse else {
            return coarse;
        };
        match self.fine.ln_likelihood(theta) {
            Outcome::Value(fine) => {
                Outcome::from_ln_likelihood((1.0 - self.share) * coarse + self.share * fine)
            }
            other => other,
        }
    }
    fn walls(&self) -> &[HalfSpace] {
        self.fine.walls()
    }
    fn symmetries(&self) -> &[Symmetry] {
        self.fine.symmetries()
    }
}

/// A draw of the parent run on its way.
#[derive(Clone, Debug)]
struct Member {
    z: Vec<f64>,
    coarse: f64,
    fine: f64,
    /// Row of the parent's draws that it comes from.
    ancestor: usize,
    /// Group of dependent draws that the ancestor is of.
    lineage: u32,
}

/// One step of the way.
#[derive(Clone, Copy, Debug)]
struct Level {
    share: f64,
    /// ln Z here over that of the coarse run.
    ln_ratio: f64,
    /// Ancestors left, in effect.
    ancestors: f64,
    /// Correlation of `ln L_fine - ln L_coarse` before and after the slices.
    echo: f64,
}

/// The population and how far it has come.
struct Way<'a> {
    target: &'a dyn Target,
    coarse: &'a dyn Target,
    seed: u64,
    sweeps: usize,
    share: f64,
    ln_ratio: f64,
    levels: Vec<Level>,
    tally: Tally,
    members: Vec<Member>,
}

impl Way<'_> {
    /// Takes draws of the parent, equally weighted, and asks for their fine likelihood.
    fn begin(&mut self, parent: &Run, count: usize) -> Result<()> {
        let draws = &parent.draws;
        let grouped = draws.group.iter().any(|g| *g != draws.group[0]);
        let offset = unit_open(&mut stream(self.seed, Domain::Refine, 0, RESAMPLING));
        for row in draws.resample(count, offset) {
            let mut z = vec![0.0; draws.dim];
            let prior = self.target.prior();
            prior.z_from_theta(draws.theta_row(row), &mut z);
            // Rounding can put a draw on the wall of a bounded prior, where it has no coordinates.
            if z.iter().all(|z| z.is_finite()) {
                self.members.push(Member {
                    z,
                    coarse: draws.ln_likelihood[row],
                    fine: f64::NEG_INFINITY,
                    ancestor: row,
                    lineage: if grouped {
                        draws.group[row]
                    } else {
                        u32::try_from(row).unwrap_or(u32::MAX)
                    },
                });
            }
        }
        let mut evaluator = Evaluator::new(self.target);
        let places: Vec<&[f64]> = self.members.iter().map(|m| m.z.as_slice()).collect();
        let fine = evaluator.values(&places)?;
        self.tally.add(&evaluator);
        if fine.iter().all(|l| *l == f64::NEG_INFINITY) {
            return Err(Error::Mismatch {
                what: WHAT,
                why:
                    "the fine target has a likelihood at none of its draws; let the two differ less"
                        .to_owned(),
            });
        }
        for (member, fine) in self.members.iter_mut().zip(fine) {
            member.fine = fine;
        }
        Ok(())
    }

    /// One step: weights, members taken anew, slices.
    fn step(&mut self) -> Result<()> {
        let cooling = Cooling::new(self.gaps());
        let left = 1.0 - self.share;
        let step = cooling.longest_step(left);
        // A step of almost all that is left takes it all: what remains weighs nothing.
        self.share = if step >= left * (1.0 - 1e-9) {
            1.0
        } else {
            self.share + step
        };
        self.ln_ratio += cooling.ln_mean_weight(step);
        let level = self.levels.len() as u64 + 1;
        let uniform = unit_open(&mut stream(self.seed, Domain::Refine, level, RESAMPLING));
        let drawn = cooling.resample(step, uniform).into_iter();
        self.members = drawn.map(|i| self.members[i].clone()).collect();
        let before = self.gaps();
        self.sweep(level)?;
        self.levels.push(Level {
            share: self.share,
            ln_ratio: self.ln_ratio,
            ancestors: effective_kinds(self.members.iter().map(|m| m.ancestor)),
            echo: correlation(&before, &self.gaps()),
        });
        Ok(())
    }

    /// ln L of the fine likelihood over the coarse one of every member.
    fn gaps(&self) -> Vec<f64> {
        self.members.iter().map(|m| m.fine - m.coarse).collect()
    }

    /// Moves every member by slices of the present law.
    fn sweep(&mut self, level: u64) -> Result<()> {
        let between = Between {
            coarse: self.coarse,
            fine: self.target,
            share: self.share,
        };
        let dim = self.target.dim();
        let orbit = Symmetry::first_orbit(self.target.symmetries());
        let others = [1, 0].map(|parity| self.rows(parity));
        let metrics = [0, 1].map(|half| Metric::of_rows(MetricKind::Dense, &others[half], dim));
        let pools = [0, 1].map(|half| Neighbours::new(&others[half], dim, orbit));
        let moved: Vec<Result<(Member, Tally)>> = (0..self.members.len())
            .into_par_iter()
            .map(|i| {
                let mut member = self.members[i].clone();
                let mut rng = stream(self.seed, Domain::Refine, level, i as u64);
                let half = (member.lineage % 2) as usize;
                let mut point = Point::new(dim);
                point.z.clone_from(&member.z);
                point.ln_likelihood = (1.0 - self.share) * member.coarse + self.share * member.fine;
                let mut evaluator = Evaluator::new(&between);
                explore_by_slices(
                    &mut evaluator,
                    1.0,
                    &metrics[half],
                    &pools[half],
                    self.sweeps,
                    &mut point,
                    &mut rng,
                    |_| (),
                )?;
                let mut tally = Tally::default();
                // Each value between the two is one of either.
                tally.add(&evaluator);
                tally.calls *= 2;
                let mut own = [Evaluator::new(self.coarse), Evaluator::new(self.target)];
                member.coarse = own[0].value(&point.z)?;
                member.fine = own[1].value(&point.z)?;
                own.iter().for_each(|evaluator| tally.add(evaluator));
                member.z = point.z;
                Ok((member, tally))
            })
            .collect();
        let moved: Vec<(Member, Tally)> = moved.into_iter().collect::<Result<_>>()?;
        self.members.clear();
        for (member, tally) in moved {
            self.members.push(member);
            self.tally.merge(&tally);
        }
        Ok(())
    }

    /// Coordinates of the members of even (0) or odd (1) lineages; of all, where there are none.
    fn rows(&self, parity: u32) -> Vec<f64> {
        let of = |own: &dyn Fn(&Member) -> bool| -> Vec<f64> {
            let members = self.members.iter().filter(|m| own(m));
            members.flat_map(|m| m.z.iter().copied()).collect()
        };
        let half = of(&|m| m.lineage % 2 == parity);
        if half.is_empty() { of(&|_| true) } else { half }
    }
}

/// Pearson's; 0 where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    let scale = (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    if scale > 0.0 {
        sum(&|x, y| x * y) / scale
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_rise_together_are_correlated() {
        assert!((correlation(&[1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]) - 1.0).abs() < 1e-12);
        assert!(correlation(&[1.0, 1.0], &[2.0, 4.0]).abs() < 1e-12);
    }
}
