//! The step schedule of the leapfrog: where the progenitor is at each force evaluation, and the lengths of drifts and kicks.

use super::HermiteWeights;
use super::dense_orbit::vector;
use crate::scalar::{Isa, Lanes, Scalar, Vec3};

/// A step schedule.
pub trait Schedule<S> {
    /// Number of steps.
    fn steps(&self) -> usize;
    /// The progenitor's position at force evaluation `j`, 0 to `steps`.
    fn progenitor_at(&self, j: usize) -> Vec3<S>;
    /// Length of drift `j` in Gyr, 0 to `steps - 1`.
    fn drift_gyr(&self, j: usize) -> S;
    /// Length of kick `j` in Gyr, 0 to `steps`: half of both neighbouring drifts.
    fn kick_gyr(&self, j: usize) -> S;
}

/// The step schedule of all particles of one release time, in buffers that are reused.
#[derive(Clone, Debug)]
pub struct StepSchedule<S> {
    /// The progenitor's positions, kpc, in rows as those of a [`Node`](super::Node).
    pub path: Vec<[S; 4]>,
    /// Lengths of the drifts, Gyr.
    pub drift_gyr: Vec<S>,
    /// Lengths of the kicks, Gyr.
    pub kick_gyr: Vec<S>,
    /// Interpolation weights of the positions on the orbit, if the steps are adaptive.
    pub places: Vec<HermiteWeights>,
}

impl<S> Default for StepSchedule<S> {
    fn default() -> Self {
        Self {
            path: Vec::new(),
            drift_gyr: Vec::new(),
            kick_gyr: Vec::new(),
            places: Vec::new(),
        }
    }
}

impl<S: Scalar> StepSchedule<S> {
    /// Sets the kicks that belong to the drifts.
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
    fn steps(&self) -> usize {
        self.drift_gyr.len()
    }
    #[inline(always)]
    fn progenitor_at(&self, j: usize) -> Vec3<S> {
        vector(&self.path[j])
    }
    #[inline(always)]
    fn drift_gyr(&self, j: usize) -> S {
        self.drift_gyr[j]
    }
    #[inline(always)]
    fn kick_gyr(&self, j: usize) -> S {
        self.kick_gyr[j]
    }
}

/// One schedule for the first half of the lanes and another for the second: two lane groups are integrated together, so that one's
/// arithmetic runs while the other waits for its results.
#[derive(Clone, Copy, Debug)]
pub struct InterleavedSchedules<'a>(pub &'a StepSchedule<f64>, pub &'a StepSchedule<f64>);

impl<I: Isa> Schedule<Lanes<I, 2>> for InterleavedSchedules<'_> {
    #[inline(always)]
    fn steps(&self) -> usize {
        self.0.drift_gyr.len()
    }
    #[inline(always)]
    fn progenitor_at(&self, j: usize) -> Vec3<Lanes<I, 2>> {
        Lanes::vectors(vector(&self.0.path[j]), vector(&self.1.path[j]))
    }
    #[inline(always)]
    fn drift_gyr(&self, j: usize) -> Lanes<I, 2> {
        Lanes::halves(self.0.drift_gyr[j], self.1.drift_gyr[j])
    }
    #[inline(always)]
    fn kick_gyr(&self, j: usize) -> Lanes<I, 2> {
        Lanes::halves(self.0.kick_gyr[j], self.1.kick_gyr[j])
    }
}
