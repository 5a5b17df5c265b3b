//! The step schedule of an integration: the progenitor's position at each force evaluation, and the lengths of drifts and kicks
//! (docs/physics.md, section 5).

use super::HermiteWeights;
use super::blanes_moan::{KICKS, STAGES};
use super::dense_orbit::vector;
use crate::potential::{Host, MassFraction};
use crate::scalar::{Lanes, Scalar, Vec3, Vectors};
use std::marker::PhantomData;

/// A step schedule: drifts with a kick before the first and after each.
pub trait Schedule<S> {
    /// Number of drifts.
    fn drifts(&self) -> usize;
    /// Number of drifts of a step: positions are on the path after every so many, and between them they need not be.
    fn drifts_of_step(&self) -> usize;
    /// Length of the first and of the last kick of a step over that of the step.
    fn kick_of_step(&self) -> f64;
    /// The progenitor's position in kpc at force evaluation `j`, 0 to `drifts`.
    fn progenitor_at(&self, j: usize) -> Vec3<S>;
    /// Length of drift `j` in Gyr, 0 to `drifts - 1`.
    fn drift_gyr(&self, j: usize) -> S;
    /// Length of kick `j` in Gyr, 0 to `drifts`.
    fn kick_gyr(&self, j: usize) -> S;
    /// The fraction of its mass that the progenitor has at force evaluation `j`, 0 to `drifts`.
    fn mass_fraction(&self, j: usize) -> MassFraction<S>;
}

/// How a step is made of kicks and drifts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepMethod {
    /// Half a kick, a drift, half a kick.
    Leapfrog,
    /// The six drifts of [`advance_adaptively`](super::advance_adaptively).
    FourthOrder,
}

impl StepMethod {
    /// Number of drifts of a step.
    #[inline(always)]
    fn drifts(self) -> usize {
        match self {
            Self::Leapfrog => 1,
            Self::FourthOrder => STAGES,
        }
    }

    /// Length of the first and of the last kick over that of the step.
    #[inline(always)]
    fn kick(self) -> f64 {
        match self {
            Self::Leapfrog => 0.5,
            Self::FourthOrder => KICKS[0],
        }
    }
}

/// The step schedule of all particles of one release time; its buffers are reused.
#[derive(Clone, Debug)]
pub struct StepSchedule<S> {
    /// The progenitor's positions at the force evaluations, kpc, in rows as those of a [`Node`](super::Node).
    pub progenitor_positions: Vec<[S; 4]>,
    /// Method of the steps.
    pub method: StepMethod,
    /// Lengths of the drifts, Gyr.
    pub drift_gyr: Vec<S>,
    /// Lengths of the kicks, Gyr.
    pub kick_gyr: Vec<S>,
    /// Fractions of the progenitor's mass at the force evaluations; empty if it keeps its mass.
    pub mass_fractions: Vec<MassFraction<S>>,
    /// Hermite weights of the positions; empty if the steps are equal, because [`Model`](crate::stream::Model) has them then.
    pub hermite_weights: Vec<HermiteWeights>,
}

impl<S> Default for StepSchedule<S> {
    fn default() -> Self {
        Self {
            progenitor_positions: Vec::new(),
            method: StepMethod::Leapfrog,
            drift_gyr: Vec::new(),
            kick_gyr: Vec::new(),
            mass_fractions: Vec::new(),
            hermite_weights: Vec::new(),
        }
    }
}

impl<S: Scalar> StepSchedule<S> {
    /// Sets the kicks of the leapfrog: each is half of the drifts before and after it.
    #[inline(always)]
    pub fn set_kicks(&mut self) {
        self.kick_gyr.clear();
        let mut before = S::zero();
        for &drift in &self.drift_gyr {
            self.kick_gyr.push((before + drift) * 0.5);
            before = drift;
        }
        self.kick_gyr.push(before * 0.5);
    }
}

impl<S: Scalar> Schedule<S> for StepSchedule<S> {
    #[inline(always)]
    fn drifts(&self) -> usize {
        self.drift_gyr.len()
    }
    #[inline(always)]
    fn drifts_of_step(&self) -> usize {
        self.method.drifts()
    }
    #[inline(always)]
    fn kick_of_step(&self) -> f64 {
        self.method.kick()
    }
    #[inline(always)]
    fn progenitor_at(&self, j: usize) -> Vec3<S> {
        vector(&self.progenitor_positions[j])
    }
    #[inline(always)]
    fn drift_gyr(&self, j: usize) -> S {
        self.drift_gyr[j]
    }
    #[inline(always)]
    fn kick_gyr(&self, j: usize) -> S {
        self.kick_gyr[j]
    }
    #[inline(always)]
    fn mass_fraction(&self, j: usize) -> MassFraction<S> {
        if self.mass_fractions.is_empty() {
            MassFraction::whole()
        } else {
            self.mass_fractions[j]
        }
    }
}

/// Largest number of lane groups that are integrated together.
pub const MAX_TOGETHER: usize = 4;

/// The step schedules of the lane groups that are integrated together in the host `H`, with equally many steps; the last ones may be unused.
#[derive(Clone, Copy, Debug)]
pub struct InterleavedSchedules<'a, H>(
    pub [&'a StepSchedule<f64>; MAX_TOGETHER],
    pub PhantomData<H>,
);

impl<V: Vectors, H: Host, const K: usize> Schedule<Lanes<V, K>> for InterleavedSchedules<'_, H> {
    #[inline(always)]
    fn drifts(&self) -> usize {
        self.0[0].drift_gyr.len()
    }
    #[inline(always)]
    fn drifts_of_step(&self) -> usize {
        self.0[0].method.drifts()
    }
    #[inline(always)]
    fn kick_of_step(&self) -> f64 {
        self.0[0].method.kick()
    }
    #[inline(always)]
    fn progenitor_at(&self, j: usize) -> Vec3<Lanes<V, K>> {
        let mut positions = [Vec3::zero(); MAX_TOGETHER];
        for group in 0..Lanes::<V, K>::GROUPS {
            positions[group] = vector(&self.0[group].progenitor_positions[j]);
        }
        Lanes::splat_vectors(&positions)
    }
    #[inline(always)]
    fn drift_gyr(&self, j: usize) -> Lanes<V, K> {
        let mut drifts = [0.0; MAX_TOGETHER];
        for group in 0..Lanes::<V, K>::GROUPS {
            drifts[group] = self.0[group].drift_gyr[j];
        }
        Lanes::splat_groups(&drifts)
    }
    #[inline(always)]
    fn kick_gyr(&self, j: usize) -> Lanes<V, K> {
        let mut kicks = [0.0; MAX_TOGETHER];
        for group in 0..Lanes::<V, K>::GROUPS {
            kicks[group] = self.0[group].kick_gyr[j];
        }
        Lanes::splat_groups(&kicks)
    }
    #[inline(always)]
    fn mass_fraction(&self, j: usize) -> MassFraction<Lanes<V, K>> {
        if !H::IS_GALAXY {
            return MassFraction::whole();
        }
        let (mut values, mut slopes) = ([0.0; MAX_TOGETHER], [0.0; MAX_TOGETHER]);
        for group in 0..Lanes::<V, K>::GROUPS {
            let fraction = self.0[group].mass_fraction(j);
            (values[group], slopes[group]) = (fraction.value, fraction.slope);
        }
        MassFraction {
            value: Lanes::splat_groups(&values),
            slope: Lanes::splat_groups(&slopes),
        }
    }
}
