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

mod between;
mod outcome;
mod settings;

pub use settings::Settings;

use crate::control::{Control, Event};
use crate::cooling::Cooling;
use crate::diagnostics::effective_kinds;
use crate::error::{Error, Result};
use crate::hmc::{Evaluator, Metric, MetricKind, Point, Tally, involve, slide};
use crate::keeper::{Keeper, Time};
use crate::neighbours::Neighbours;
use crate::output::Run;
use crate::rng::{Domain, stream, unit_open};
use crate::target::{Symmetry, Target};
use between::{Between, Both};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

const WHAT: &str = "the run to refine";

/// Index, within a level, of the stream that takes members anew.
const RESAMPLING: u64 = u64::MAX;

/// Carries draws of `parent`, a run on `coarse`, to the posterior of `target`, which has the same parameters.
///
/// The same parent, settings and seed give the same bits on any number of threads and after any number of interruptions. One
/// that is interrupted or whose budget is spent has no result yet: it leaves a checkpoint, where one is planned. Calls are of both
/// likelihoods, except that the parent's are not counted again.
///
/// # Errors
/// [`Error::Setting`] for settings out of range; [`Error::Mismatch`] if `parent` is not a run on `coarse`, or `target` has other
/// parameters, or a likelihood at none of its draws; [`Error::Interrupted`] after a checkpoint; [`Error::Fatal`] and
/// [`Error::Infinite`] from the targets, after a checkpoint of the last whole sweep; [`Error::Checkpoint`] and [`Error::Io`] from
/// the file.
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
            why: "it has other parameters than the fine target; let both differ in the likelihood alone"
                .to_owned(),
        });
    }
    let origin = (parent.seed, parent.evidence.ln_z, parent.draws.len());
    let mut keeper = Keeper::new(&[target, coarse], &(settings, seed, origin), control)?;
    let mut way = Way {
        target,
        coarse,
        settings,
        seed,
        state: State::default(),
    };
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    match keeper.load(control, |state: &State| state.time)? {
        Some((state, _)) => way.state = state,
        None => way.begin(parent)?,
    }
    while !way.arrived() {
        if stop || control.interrupted() || control.spent(way.state.tally.calls) {
            keeper.save(&way.state, control)?;
            control.tell(&Event::Checkpointed);
            return Err(Error::Interrupted);
        }
        let moved = way.advance();
        way.state.time = keeper.time();
        if let Err(error) = moved {
            return Err(keeper.save_after(error, &way.state, control));
        }
        stop = control.tell(&Event::Bridge {
            share: way.state.share,
            ln_z: parent.evidence.ln_z + way.state.ln_ratio,
            calls: way.state.tally.calls,
        });
        if control.checkpoint_due() {
            keeper.save(&way.state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    }
    let run = outcome::assemble(&way, parent)?;
    control.tell(&Event::Finished);
    Ok(run)
}

/// A draw of the parent run on its way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Member {
    z: Vec<f64>,
    both: Both,
    /// Row of the parent's draws that it comes from.
    ancestor: usize,
    /// Group of dependent draws that the ancestor is of.
    lineage: u32,
}

/// One step of the way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Level {
    share: f64,
    /// ln Z here over that of the coarse run.
    ln_ratio: f64,
    /// Ancestors left, in effect.
    ancestors: f64,
    /// Correlation of `ln L_fine - ln L_coarse` before and after the slices.
    echo: f64,
}

/// The population and how far it has come: what a checkpoint holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct State {
    share: f64,
    ln_ratio: f64,
    members: Vec<Member>,
    /// Sweeps done at this share; none are due at the parent's own.
    sweeps: usize,
    /// ln L of the fine likelihood over the coarse one of every member before these sweeps.
    gaps_before: Vec<f64>,
    /// What members of even and of odd lineages move by.
    metrics: Vec<Metric>,
    pools: Vec<Neighbours>,
    levels: Vec<Level>,
    tally: Tally,
    time: Time,
}

impl State {
    /// ln L of the fine likelihood over the coarse one of every member.
    fn gaps(&self) -> Vec<f64> {
        self.members.iter().map(|m| m.both.gap()).collect()
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

/// A population between its two likelihoods.
struct Way<'a> {
    target: &'a dyn Target,
    coarse: &'a dyn Target,
    settings: &'a Settings,
    seed: u64,
    state: State,
}

impl Way<'_> {
    /// Whether the last sweep at the fine likelihood is done.
    fn arrived(&self) -> bool {
        self.state.share >= 1.0 && self.state.sweeps == self.settings.sweeps
    }

    /// Takes draws of the parent, equally weighted, and asks for their fine likelihood.
    fn begin(&mut self, parent: &Run) -> Result<()> {
        let draws = &parent.draws;
        let grouped = draws.cluster.iter().any(|g| *g != draws.cluster[0]);
        let offset = unit_open(&mut stream(self.seed, Domain::Bridge, 0, RESAMPLING));
        let mut members = Vec::new();
        for row in draws.resample(self.settings.members, offset) {
            let mut z = vec![0.0; draws.dim];
            let prior = self.target.prior();
            prior.z_from_theta(draws.theta_row(row), &mut z);
            // Rounding can put a draw on the wall of a bounded prior, where it has no coordinates.
            if z.iter().all(|z| z.is_finite()) {
                members.push(Member {
                    z,
                    both: Both {
                        coarse: draws.ln_likelihood[row],
                        fine: f64::NEG_INFINITY,
                    },
                    ancestor: row,
                    lineage: if grouped {
                        draws.cluster[row]
                    } else {
                        u32::try_from(row).unwrap_or(u32::MAX)
                    },
                });
            }
        }
        let mut evaluator = Evaluator::new(self.target);
        let places: Vec<&[f64]> = members.iter().map(|m| m.z.as_slice()).collect();
        let fine = evaluator.values(&places)?;
        if fine.iter().all(|l| *l == f64::NEG_INFINITY) {
            return Err(Error::Mismatch {
                what: WHAT,
                why:
                    "the fine target has a likelihood at none of its draws; let the two differ less"
                        .to_owned(),
            });
        }
        for (member, fine) in members.iter_mut().zip(fine) {
            member.both.fine = fine;
        }
        self.state.tally.add(&evaluator);
        self.state.members = members;
        self.state.sweeps = self.settings.sweeps;
        Ok(())
    }

    /// One sweep, with a step towards the fine likelihood before it where it is due. On an error no member has moved, and the
    /// same sweep can be tried again.
    fn advance(&mut self) -> Result<()> {
        if self.state.sweeps == self.settings.sweeps {
            self.step();
        }
        self.sweep()?;
        let state = &mut self.state;
        state.sweeps += 1;
        if state.sweeps == self.settings.sweeps {
            let level = Level {
                share: state.share,
                ln_ratio: state.ln_ratio,
                ancestors: effective_kinds(state.members.iter().map(|m| m.ancestor)),
                echo: correlation(&state.gaps_before, &state.gaps()),
            };
            state.levels.push(level);
        }
        Ok(())
    }

    /// Number of the present step, from 1 on.
    fn level(&self) -> u64 {
        self.state.levels.len() as u64 + 1
    }

    /// Weights, and members taken anew by them.
    fn step(&mut self) {
        let level = self.level();
        let state = &mut self.state;
        let cooling = Cooling::new(state.gaps());
        let left = 1.0 - state.share;
        let step = cooling.longest_step(left);
        // A step of almost all that is left takes it all: what remains weighs nothing.
        state.share = if step >= left * (1.0 - 1e-9) {
            1.0
        } else {
            state.share + step
        };
        state.ln_ratio += cooling.ln_mean_weight(step);
        let uniform = unit_open(&mut stream(self.seed, Domain::Bridge, level, RESAMPLING));
        let drawn = cooling.resample(step, uniform).into_iter();
        state.members = drawn.map(|i| state.members[i].clone()).collect();
        state.sweeps = 0;
        state.gaps_before = state.gaps();
        let dim = self.target.dim();
        let orbit = Symmetry::first_orbit(self.target.symmetries());
        let others = [1, 0].map(|parity| state.rows(parity));
        state.metrics = others
            .iter()
            .map(|rows| Metric::of_rows(MetricKind::Dense, rows, dim))
            .collect();
        state.pools = others
            .iter()
            .map(|rows| Neighbours::new(rows, dim, orbit))
            .collect();
    }

    /// Moves every member by a slice of the present law, and by the target's involutions in the first sweep at it.
    fn sweep(&mut self) -> Result<()> {
        let state = &self.state;
        let share = state.share;
        let (level, sweep) = (self.level(), state.sweeps as u64);
        let moved: Vec<Result<(Member, Tally)>> = (0..state.members.len())
            .into_par_iter()
            .map(|i| {
                let mut member = state.members[i].clone();
                let task = level << 32 | sweep;
                let mut rng = stream(self.seed, Domain::Bridge, task, i as u64);
                let half = (member.lineage % 2) as usize;
                let mut point = Point::new(self.target.dim());
                point.z.clone_from(&member.z);
                let between = Between::new(self.coarse, self.target, share);
                let (metric, pool) = (&state.metrics[half], &state.pools[half]);
                let tally = between.explore(&mut point, &mut member.both, |evaluator, point| {
                    if sweep == 0 {
                        involve(evaluator, 1.0, point, &mut rng)?;
                    }
                    slide(evaluator, 1.0, metric, pool, 1, point, &mut rng, |_| ())
                })?;
                member.z = point.z;
                Ok((member, tally))
            })
            .collect();
        let moved: Vec<(Member, Tally)> = moved.into_iter().collect::<Result<_>>()?;
        let (members, tallies): (Vec<Member>, Vec<Tally>) = moved.into_iter().unzip();
        self.state.members = members;
        tallies
            .iter()
            .for_each(|tally| self.state.tally.merge(tally));
        Ok(())
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
