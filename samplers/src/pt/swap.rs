//! Swaps between neighbouring temperatures, and the index processes of the replicas (Syed et al. 2022).

use crate::valid::{Valid, countable, ensure};
use serde::{Deserialize, Serialize};

/// `min(1, exp{(b_cold - b_hot)(l_hot - l_cold)})`, computed in logarithms; 0 if the state at the smaller beta has no
/// likelihood.
pub(super) fn acceptance(beta_gap: f64, l_hot: f64, l_cold: f64) -> f64 {
    if l_hot == f64::NEG_INFINITY {
        0.0
    } else {
        (beta_gap * (l_hot - l_cold)).exp().min(1.0)
    }
}

/// The index processes of the replicas of one chain set: which temperatures each has visited. A round trip is from the
/// reference to the posterior and back; its first half, the arrival at the posterior from the reference, is a restart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct IndexProcess {
    /// Whether each replica was last at the reference, at the posterior, or at neither yet.
    phase: Vec<Phase>,
    /// Round trips finished.
    pub(super) round_trips: u64,
    /// Restarts of the posterior.
    pub(super) restarts: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Phase {
    Neither,
    FromPrior,
    FromPosterior,
}

impl IndexProcess {
    pub(super) fn new(replicas: usize) -> Self {
        Self {
            phase: vec![Phase::Neither; replicas],
            round_trips: 0,
            restarts: 0,
        }
    }

    /// Checks index processes that were read from a file.
    pub(super) fn check(&self, replicas: usize) -> Valid {
        ensure(
            self.phase.len() == replicas && countable([self.round_trips, self.restarts]),
            "a chain set has another number of replicas, or a count is too large",
        )
    }

    /// The same replicas, with counts at zero.
    pub(super) fn onward(&self) -> Self {
        Self {
            phase: self.phase.clone(),
            round_trips: 0,
            restarts: 0,
        }
    }

    /// Records the replicas at the two ends after the swaps of a scan.
    pub(super) fn note(&mut self, at_prior: usize, at_posterior: usize) {
        let top = &mut self.phase[at_prior];
        if *top == Phase::FromPosterior {
            self.round_trips += 1;
        }
        *top = Phase::FromPrior;
        let bottom = &mut self.phase[at_posterior];
        if *bottom == Phase::FromPrior {
            self.restarts += 1;
            *bottom = Phase::FromPosterior;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_trip_starts_and_ends_at_the_prior() {
        let mut index_processes = IndexProcess::new(2);
        // Replica 1 begins at the posterior: its way to the reference is no round trip.
        for (prior, posterior) in [(1, 0), (0, 1), (1, 0), (1, 0), (0, 1)] {
            index_processes.note(prior, posterior);
        }
        assert_eq!(
            (index_processes.restarts, index_processes.round_trips),
            (3, 2)
        );
    }

    #[test]
    fn swaps_are_decided_in_logarithms() {
        assert!((acceptance(1e-5, -2e6, -1e6) - (-10.0_f64).exp()).abs() < 1e-15);
        assert!((acceptance(0.5, -1.0, -1e6) - 1.0).abs() < 1e-15);
        assert!(acceptance(0.1, f64::NEG_INFINITY, -3.0).abs() < 1e-300);
    }
}
