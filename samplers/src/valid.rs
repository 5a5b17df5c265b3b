//! Checks of a state that was read from a file, so that no code that uses it can panic or run without end.

/// What is wrong with a state, if anything is.
pub type Valid = Result<(), &'static str>;

/// Largest magnitude of a coordinate: products and sums of squares of coordinates stay finite.
const MAX_COORDINATE: f64 = 1e100;

/// An error unless a condition holds.
pub fn ensure(holds: bool, fault: &'static str) -> Valid {
    if holds { Ok(()) } else { Err(fault) }
}

/// Whether all numbers are finite and no larger than any coordinate is.
pub fn moderate<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> bool {
    numbers.into_iter().all(|x| x.abs() <= MAX_COORDINATE)
}

/// Whether counts are so small that adding to them does not overflow.
pub fn countable(counts: impl IntoIterator<Item = u64>) -> bool {
    counts.into_iter().all(|count| count < 1 << 62)
}

/// Whether a number of elements is that of rows of `dim`, with no product that overflows.
pub fn rows(elements: usize, rows: usize, dim: usize) -> bool {
    rows.checked_mul(dim) == Some(elements)
}

/// Elements of a lower triangle with its diagonal.
pub fn triangle(dim: usize) -> usize {
    dim * (dim + 1) / 2
}
