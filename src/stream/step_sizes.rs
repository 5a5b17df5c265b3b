//! The record of the adaptive steps.

use std::ops::Range;

/// The size of each adaptive step of each pair of lane groups, in the order of the pairs, as [`length`](crate::orbit::length()) numbers
/// them. Empty if the steps are equal.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepSizes {
    steps: Vec<u8>,
    /// Indices of the steps of each pair. Pairs that were integrated together share theirs.
    pairs: Vec<Range<usize>>,
}

impl StepSizes {
    /// Clears the record and reserves memory for this many pairs and steps.
    pub(super) fn reset(&mut self, pairs: usize, steps: usize) {
        self.steps.clear();
        self.steps.reserve(steps);
        self.pairs.clear();
        self.pairs.reserve(pairs);
    }

    /// Records a step of the next pairs.
    #[inline]
    pub(super) fn push(&mut self, number: u8) {
        self.steps.push(number);
    }

    /// The steps that have been recorded since the last call are those of each of the next `pairs` pairs.
    #[inline]
    pub(super) fn finish(&mut self, pairs: usize) {
        let first = self.pairs.last().map_or(0, |last| last.end);
        for _ in 0..pairs {
            self.pairs.push(first..self.steps.len());
        }
    }

    /// Appends the record of the pairs that follow.
    pub(super) fn append(&mut self, next: &Self) {
        let before = self.steps.len();
        let later = |range: &Range<usize>| before + range.start..before + range.end;
        self.pairs.extend(next.pairs.iter().map(later));
        self.steps.extend_from_slice(&next.steps);
    }

    /// Number of pairs.
    #[must_use]
    pub fn pairs(&self) -> usize {
        self.pairs.len()
    }

    /// Number of steps of all pairs.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.pairs.iter().map(ExactSizeIterator::len).sum()
    }

    /// The sizes of the steps of one pair; none if the steps are equal.
    pub(super) fn of_pair(&self, pair: usize) -> &[u8] {
        self.pairs
            .get(pair)
            .map_or(&[], |range| &self.steps[range.clone()])
    }
}
