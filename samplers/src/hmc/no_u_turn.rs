//! Trajectories that find their own length: they double, forwards or backwards, until they turn back (the no-U-turn sampler of
//! Hoffman & Gelman 2014), and the next state is drawn from all that they passed by its weight (Betancourt 2017).
//!
//! A doubling that turns back within, or that meets a point without a likelihood, is given up, and the states before it stay:
//! whichever of its states a trajectory had begun at, it would have been given up too.

use super::leapfrog::{Step, dot};
use super::{End, LocalSampler, Moved, Plan, Point};
use crate::diagnostics::ln_sum_exp;
use crate::error::Result;
use crate::rng::{Stream, standard_normal, unit_open};

/// A state of a trajectory.
#[derive(Clone)]
struct Place {
    point: Point,
    momentum: Vec<f64>,
}

/// A run of states that follow each other, and one drawn from them by its weight.
struct Stretch {
    /// The first and the last, in the order in which they were made.
    ends: [Place; 2],
    /// Sum of the whitened momenta of all.
    sum: Vec<f64>,
    chosen: Point,
    /// Logarithm of the sum of their weights.
    ln_weight: f64,
}

/// How building a stretch ended.
enum Built {
    Whole(Box<Stretch>),
    /// It turns back within.
    Turned,
    /// It met a point from which there is no going on.
    Ended(End),
}

/// One trajectory in the making.
struct Journey<'e, 't, 'm, 'r> {
    local_sampler: &'e mut LocalSampler<'t, 'm>,
    rng: &'r mut Stream,
    step: f64,
    start: f64,
    max_energy_range: f64,
    /// Of all states made: energies above the start, and the sum of what a Metropolis test would say.
    made: usize,
    acceptance: f64,
    rise: [f64; 2],
}

impl LocalSampler<'_, '_> {
    /// One move whose length is found on the way; at most `plan.max_leapfrogs` steps, `plan.length` and `plan.slack` are not
    /// used. Its acceptance is the mean over all states of what a Metropolis test would say to each.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn no_u_turn(&mut self, at: &mut Point, plan: &Plan, rng: &mut Stream) -> Result<Moved> {
        if !self.has_gradient(at)? {
            return Ok(Moved::NOWHERE);
        }
        for r in &mut self.momentum {
            *r = standard_normal(rng);
        }
        let step = plan.step * (0.9 + 0.2 * unit_open(rng));
        self.stand_at(at);
        let start = self.energy();
        let first = Place {
            point: at.clone(),
            momentum: self.momentum.clone(),
        };
        let mut journey = Journey {
            local_sampler: self,
            rng,
            step,
            start,
            max_energy_range: plan.max_energy_range,
            made: 0,
            acceptance: 0.0,
            rise: [0.0; 2],
        };
        let mut path = Stretch {
            sum: first.momentum.clone(),
            chosen: at.clone(),
            ends: [first.clone(), first],
            ln_weight: 0.0,
        };
        let mut end = None;
        let mut depth = 0;
        let mut moved = false;
        // A whole doubling must fit.
        while (2_usize << depth) - 1 <= plan.max_leapfrogs {
            let forwards = unit_open(journey.rng) < 0.5;
            let mut next =
                match journey.stretch(&path.ends[usize::from(forwards)], forwards, depth)? {
                    Built::Whole(next) => next,
                    Built::Turned => break,
                    Built::Ended(how) => {
                        end = Some(how);
                        break;
                    }
                };
            depth += 1;
            // The newer half is favoured: it is farther away, and the law is kept (Betancourt 2017, A.3.2).
            if unit_open(journey.rng).ln() < next.ln_weight - path.ln_weight {
                moved = true;
            } else {
                next.chosen.copy_from(&path.chosen);
            }
            let turned = turns(&path, &next, forwards);
            path = path.followed_by(*next, forwards);
            if turned {
                break;
            }
        }
        let leapfrogs = journey.made;
        let [low, high] = journey.rise;
        let acceptance = journey.acceptance / leapfrogs.max(1) as f64;
        at.copy_from(&path.chosen);
        Ok(Moved {
            acceptance,
            accepted: moved,
            leapfrogs,
            capped: (2_usize << depth) - 1 > plan.max_leapfrogs,
            end: end.unwrap_or(End::Arrived {
                rise: high,
                fall: -low,
            }),
        })
    }
}

impl Journey<'_, '_, '_, '_> {
    /// `2^depth` states on from a place, or back.
    fn stretch(&mut self, from: &Place, forwards: bool, depth: u32) -> Result<Built> {
        if depth == 0 {
            return self.one(from, forwards);
        }
        let first = match self.stretch(from, forwards, depth - 1)? {
            Built::Whole(first) => first,
            other => return Ok(other),
        };
        // Ends are in the order of making: the newest is the last, whichever way it goes.
        let mut second = match self.stretch(&first.ends[1], forwards, depth - 1)? {
            Built::Whole(second) => second,
            other => return Ok(other),
        };
        let turned = turns(&first, &second, true);
        let ln_weight = ln_sum_exp(&[first.ln_weight, second.ln_weight]);
        if unit_open(self.rng).ln() >= second.ln_weight - ln_weight {
            second.chosen.copy_from(&first.chosen);
        }
        if turned {
            return Ok(Built::Turned);
        }
        let mut both = first.followed_by(*second, true);
        both.ln_weight = ln_weight;
        Ok(Built::Whole(Box::new(both)))
    }

    /// The next state.
    fn one(&mut self, from: &Place, forwards: bool) -> Result<Built> {
        // Back is forwards with the momentum turned round, at mirrors too.
        let sense = if forwards { 1.0 } else { -1.0 };
        let turned = |momentum: &mut [f64]| momentum.iter_mut().for_each(|r| *r *= sense);
        self.local_sampler.momentum.copy_from_slice(&from.momentum);
        turned(&mut self.local_sampler.momentum);
        self.local_sampler.stand_at(&from.point);
        self.made += 1;
        match self.local_sampler.step(self.step)? {
            Step::Made => {}
            Step::Rejected => return Ok(Built::Ended(End::Rejected)),
            Step::Lost => return Ok(Built::Ended(End::Diverged)),
        }
        turned(&mut self.local_sampler.momentum);
        let rise = self.local_sampler.energy() - self.start;
        if !rise.is_finite() {
            return Ok(Built::Ended(End::Diverged));
        }
        self.acceptance += (-rise).exp().min(1.0);
        self.rise = [self.rise[0].min(rise), self.rise[1].max(rise)];
        // Which states are met depends on the first; those beyond such a range have no weight to speak of.
        if self.rise[1] - self.rise[0] > self.max_energy_range {
            return Ok(Built::Ended(End::Diverged));
        }
        let place = Place {
            point: self.local_sampler.end.clone(),
            momentum: self.local_sampler.momentum.clone(),
        };
        Ok(Built::Whole(Box::new(Stretch {
            sum: place.momentum.clone(),
            chosen: place.point.clone(),
            ends: [place.clone(), place],
            ln_weight: -rise,
        })))
    }
}

impl Stretch {
    /// This and another one behind it, or in front of it, with what was drawn from the other.
    fn followed_by(self, next: Self, behind: bool) -> Self {
        let [a, b] = self.ends;
        let [_, newest] = next.ends;
        let ends = if behind { [a, newest] } else { [newest, b] };
        let sum = self.sum.iter().zip(&next.sum).map(|(a, b)| a + b).collect();
        Self {
            ends,
            sum,
            ln_weight: ln_sum_exp(&[self.ln_weight, next.ln_weight]),
            chosen: next.chosen,
        }
    }
}

/// Whether two stretches that join turn back: the momenta at the ends of both together, and across the joint, against the sum
/// of those between. In whitened momenta velocity and momentum are one.
fn turns(first: &Stretch, second: &Stretch, behind: bool) -> bool {
    let far = &first.ends[usize::from(!behind)].momentum;
    let [joint_first, joint_second] = [
        &first.ends[usize::from(behind)].momentum,
        &second.ends[0].momentum,
    ];
    let newest = &second.ends[1].momentum;
    let all = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + b).collect() };
    let against = |sum: &[f64], ends: [&[f64]; 2]| ends.iter().any(|end| dot(end, sum) <= 0.0);
    against(&all(&first.sum, &second.sum), [far, newest])
        || against(&all(&first.sum, joint_second), [far, joint_second])
        || against(&all(&second.sum, joint_first), [joint_first, newest])
}
