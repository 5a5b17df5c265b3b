//! The record of the adaptive steps.

/// The size of each adaptive step of each pair of lane groups, in the order of the pairs, as [`length`](crate::orbit::length()) numbers
/// them. Empty if the steps are equal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepSizes {
    steps: Vec<u8>,
    /// Index of the first step of each pair.
    starts: Vec<usize>,
}

impl StepSizes {
    /// Clears the record and reserves memory for this many pairs and steps.
    pub(super) fn reset(&mut self, pairs: usize, steps: usize) {
        self.steps.clear();
        self.steps.reserve(steps);
        self.starts.clear();
        self.starts.reserve(pairs);
    }

    /// Begins the record of the next pair.
    #[inline]
    pub(super) fn begin(&mut self) {
        self.starts.push(self.steps.len());
    }

    /// Records a step of the present pair.
    #[inline]
    pub(super) fn push(&mut self, number: u8) {
        self.steps.push(number);
    }

    /// Appends the record of the pairs that follow.
    pub(super) fn append(&mut self, next: &Self) {
        let before = self.steps.len();
        self.starts.extend(next.starts.iter().map(|s| s + before));
        self.steps.extend_from_slice(&next.steps);
    }

    /// Number of pairs.
    #[must_use]
    pub fn pairs(&self) -> usize {
        self.starts.len()
    }

    /// Number of steps of all pairs.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// The sizes of the steps of one pair; none if the steps are equal.
    pub(super) fn of_pair(&self, pair: usize) -> &[u8] {
        let at = |pair: usize| self.starts.get(pair).copied().unwrap_or(self.steps.len());
        &self.steps[at(pair)..at(pair + 1)]
    }
}
