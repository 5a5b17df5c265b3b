//! The sizes of the steps of each pair of lane groups.

/// The size of each adaptive step of each pair of lane groups, as [`length`](crate::orbit::length()) numbers them, in the order of the pairs;
/// nothing for equal steps. With it, the integration is a fixed sequence of kicks and drifts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepSizes {
    steps: Vec<u8>,
    /// Index of the first step of each pair.
    starts: Vec<usize>,
}

impl StepSizes {
    /// None, with memory for this many pairs and steps.
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

    /// Adds a step to the present pair.
    #[inline]
    pub(super) fn push(&mut self, number: u8) {
        self.steps.push(number);
    }

    /// Adds the pairs that follow.
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

    /// The steps of one pair; none, if steps are equal.
    pub(super) fn of(&self, pair: usize) -> &[u8] {
        let at = |pair: usize| self.starts.get(pair).copied().unwrap_or(self.steps.len());
        &self.steps[at(pair)..at(pair + 1)]
    }
}
