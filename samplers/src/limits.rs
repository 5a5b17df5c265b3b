//! Limits of inputs: ranges of numbers, and memory.

use std::fmt::Debug;
use std::ops::RangeInclusive;

/// A number outside its allowed range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {value}: allowed {lo} to {hi}")]
pub struct OutOfRange {
    /// The setting, flag or column as the user writes it.
    pub key: String,
    /// What was given.
    pub value: String,
    /// The smallest number that is allowed.
    pub lo: String,
    /// The largest number that is allowed.
    pub hi: String,
}

impl OutOfRange {
    /// The same, with the name of the table that the key belongs to.
    #[must_use]
    pub fn within(mut self, table: &str) -> Self {
        self.key = format!("{table}.{}", self.key);
        self
    }
}

/// Checks that a number lies in a range, both ends included. NaN lies in none.
///
/// # Errors
/// [`OutOfRange`] with the key, the value and the range.
#[allow(
    clippy::needless_pass_by_value,
    reason = "numbers are given as they are, most of them literals"
)]
pub fn in_range<T: PartialOrd + Debug>(
    key: &str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), OutOfRange> {
    if range.contains(&value) {
        return Ok(());
    }
    // Debug, because Display writes 1e300 with all its zeros.
    let text = |number: &T| format!("{number:?}");
    Err(OutOfRange {
        key: key.to_owned(),
        value: text(&value),
        lo: text(range.start()),
        hi: text(range.end()),
    })
}

/// The largest seed, because files store signed 64-bit numbers.
pub const MAX_SEED: u64 = i64::MAX.cast_unsigned();

/// The memory that one task may take: 16 GB. It is below the memory of one node of a cluster, and a hundred times what a fit with the
/// default settings takes.
pub const MAX_BYTES: f64 = 16e9;

/// From this much memory on, 1 GB, a task warns of it.
pub const TOLD_BYTES: f64 = 1e9;

/// More memory than one task may take.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("these settings need about {needed} of memory, and {allowed} are allowed: lower `{key}`")]
pub struct TooMuchMemory {
    /// The estimate.
    pub needed: String,
    /// The limit.
    pub allowed: String,
    /// The setting that needs most of it.
    pub key: String,
}

/// An estimate of the memory that a task takes, in parts that grow with one setting each.
///
/// ```
/// use oblate_samplers::limits::Memory;
///
/// let memory = Memory::default().with("n_live", 3e9).with("steps", 1e6);
/// assert!(memory.check().is_ok());
/// assert!(memory.warning().unwrap().contains("3.0 GB"));
/// let error = memory.with("steps", 20e9).check().unwrap_err();
/// assert_eq!(error.key, "steps");
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Memory {
    parts: Vec<(String, f64)>,
}

impl Memory {
    /// With `bytes` more that grow with the setting `key`.
    #[must_use]
    pub fn with(mut self, key: &str, bytes: f64) -> Self {
        match self.parts.iter_mut().find(|(known, _)| known == key) {
            Some((_, sum)) => *sum += bytes,
            None => self.parts.push((key.to_owned(), bytes)),
        }
        self
    }

    /// Together with another task's, whose keys are in `table`; empty: they keep their names.
    #[must_use]
    pub fn and(self, other: &Self, table: &str) -> Self {
        other.parts.iter().fold(self, |sum, (key, bytes)| {
            if table.is_empty() {
                sum.with(key, *bytes)
            } else {
                sum.with(&format!("{table}.{key}"), *bytes)
            }
        })
    }

    /// The sum, in bytes.
    #[must_use]
    pub fn bytes(&self) -> f64 {
        self.parts.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Checks that it is at most [`MAX_BYTES`].
    ///
    /// # Errors
    /// [`TooMuchMemory`] with the estimate, and the setting that needs most of it.
    pub fn check(&self) -> Result<(), TooMuchMemory> {
        if self.bytes() <= MAX_BYTES {
            return Ok(());
        }
        let most = self.parts.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        Err(TooMuchMemory {
            needed: gigabytes(self.bytes()),
            allowed: gigabytes(MAX_BYTES),
            key: most.map_or_else(String::new, |(key, _)| key.clone()),
        })
    }

    /// The warning for the user, from [`TOLD_BYTES`] on.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let most = self.parts.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        most.filter(|_| self.bytes() >= TOLD_BYTES).map(|(key, _)| {
            format!(
                "about {} of memory will be used; lower `{key}` if that is too much",
                gigabytes(self.bytes())
            )
        })
    }
}

fn gigabytes(bytes: f64) -> String {
    format!("{:.1} GB", bytes / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_are_in_a_range_and_nan_and_infinity_are_in_none() {
        for value in [0.5, 1.0, 2.0] {
            assert!(in_range("x", value, 0.5..=2.0).is_ok());
        }
        let wrong = [
            0.5_f64.next_down(),
            2.0_f64.next_up(),
            f64::NAN,
            f64::INFINITY,
        ];
        for value in wrong {
            assert!(in_range("x", value, 0.5..=2.0).is_err(), "{value}");
        }
        let error = in_range("steps", 0, 1..=9).unwrap_err().within("nested");
        assert_eq!(error.to_string(), "nested.steps = 0: allowed 1 to 9");
        let error = in_range("x", 1e300, 0.5..=2.0).unwrap_err();
        assert_eq!(error.to_string(), "x = 1e300: allowed 0.5 to 2.0");
    }

    #[test]
    fn the_largest_part_of_a_sum_is_named() {
        let memory = Memory::default().with("a", 9e9).with("b", 5e9);
        assert!(memory.check().is_ok());
        let more = Memory::default().with("b", 5e9);
        let error = memory.clone().and(&more, "").check().unwrap_err();
        assert_eq!(
            error.to_string(),
            "these settings need about 19.0 GB of memory, and 16.0 GB are allowed: lower `b`"
        );
        assert_eq!(
            memory.and(&more, "c").check().unwrap_err().key,
            "a".to_owned()
        );
    }

    #[test]
    fn much_memory_is_told_and_little_is_not() {
        assert_eq!(Memory::default().with("a", 0.9e9).warning(), None);
        let told = Memory::default().with("a", 1.25e9).warning().unwrap();
        assert!(told.contains("1.2 GB") && told.contains("`a`"), "{told}");
    }
}
