//! The times of the nodes of a dense orbit: equal blocks of the age, each in equal intervals (docs/physics.md, section 3).
//!
//! Times are fractions `tau` of the age: -1 at the first release, 0 today.

/// The nodes of one block. Neighbouring blocks have one each at the time where they meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Block {
    /// Number of its first node.
    pub first_node: usize,
    /// Number of its intervals.
    pub intervals: usize,
    /// Number of such intervals in the age.
    pub per_age: f64,
    /// Number of such intervals from the first release to the block.
    before: f64,
}

/// The times of all nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeTimes {
    /// The blocks, the earliest first.
    blocks: Vec<Block>,
}

/// An interval between two nodes, and the fraction of it before a time.
pub(super) struct Place {
    /// The earlier node.
    pub node: usize,
    /// The fraction in [0, 1].
    pub t: f64,
    /// Number of such intervals in the age.
    pub per_age: f64,
}

impl NodeTimes {
    /// One block of equal intervals.
    #[must_use]
    pub fn uniform(intervals: usize) -> Self {
        let mut times = Self::default();
        times.set(&[intervals]);
        times
    }

    /// Sets the number of intervals of each block, the latest first.
    #[inline(always)]
    pub(super) fn set(&mut self, intervals: &[usize]) {
        self.blocks.clear();
        let mut first_node = 0;
        let blocks = intervals.len();
        for block in 0..blocks {
            let intervals = intervals[blocks - 1 - block];
            self.blocks.push(Block {
                first_node,
                intervals,
                per_age: (blocks * intervals) as f64,
                before: (block * intervals) as f64,
            });
            first_node += intervals + 1;
        }
    }

    /// The blocks, the earliest first.
    #[inline(always)]
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The place of `tau`.
    #[inline(always)]
    pub(super) fn locate(&self, tau: f64) -> Place {
        let fraction = (tau + 1.0).clamp(0.0, 1.0);
        let last = self.blocks.len() - 1;
        let block = &self.blocks[whole(fraction * self.blocks.len() as f64, last)];
        let position = fraction * block.per_age - block.before;
        let node = whole(position, block.intervals - 1);
        Place {
            node: block.first_node + node,
            t: position - node as f64,
            per_age: block.per_age,
        }
    }
}

/// The whole part of a number that is not negative, at most `last`.
#[inline(always)]
fn whole(number: f64, last: usize) -> usize {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the number is a fraction of `last + 1`"
    )]
    (number as usize).min(last)
}
