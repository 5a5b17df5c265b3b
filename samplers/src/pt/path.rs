//! The annealing path from the reference to the posterior, in one part or two.
//!
//! A place from 0 to 1 is an inverse temperature. Chains that follow a surrogate are on its posterior at 1; the second part, from 1 to 2, puts
//! ln L in its place: at `1 + f` the density is that of the prior with the likelihood `S^(1 - f) L^f`.

use crate::hmc::Point;

/// Where the two parts meet: the posterior, or that of the surrogate.
pub(super) const CORNER: f64 = 1.0;

/// The inverse temperature of a place.
pub(super) fn beta(place: f64) -> f64 {
    place.min(CORNER)
}

/// The exponent `f` of ln L of a place, 0 on the first part.
pub(super) fn fraction(place: f64) -> f64 {
    (place - CORNER).max(0.0)
}

/// The derivative of the log density along the part of the path that ends at `place`, or is on both sides of it.
pub(super) fn slope(point: &Point, place: f64) -> f64 {
    if place > CORNER {
        point.gap
    } else {
        point.ln_ratio()
    }
}

/// The places at which the two parts have a slope of their own: where they meet there are two.
pub(super) fn knots(places: &[f64]) -> Vec<f64> {
    let mut knots = Vec::with_capacity(places.len() + 1);
    for (k, place) in places.iter().enumerate() {
        knots.push(*place);
        if meets(places, k) {
            knots.push(*place);
        }
    }
    knots
}

/// Whether place number `k` is where the parts of a path of two meet.
pub(super) fn meets(places: &[f64], k: usize) -> bool {
    places[k].to_bits() == CORNER.to_bits() && k + 1 < places.len()
}

/// The column of traces that has the slope at place number `k`: of the part that ends there, where two meet.
pub(super) fn column(places: &[f64], k: usize) -> usize {
    k + usize::from(places[k] > CORNER)
}

/// The number of places of the first part.
pub(super) fn first_part(places: &[f64]) -> usize {
    places.partition_point(|place| *place <= CORNER)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_of_two_parts_has_one_knot_more_than_places() {
        let one = [0.0, 0.4, 1.0];
        assert_eq!(knots(&one), one);
        assert_eq!(first_part(&one), 3);
        assert!((0..3).all(|k| !meets(&one, k) && column(&one, k) == k));
        let two = [0.0, 0.4, 1.0, 1.5, 2.0];
        assert_eq!(knots(&two), [0.0, 0.4, 1.0, 1.0, 1.5, 2.0]);
        assert_eq!(first_part(&two), 3);
        assert!(meets(&two, 2));
        assert_eq!([0, 1, 2, 3, 4].map(|k| column(&two, k)), [0, 1, 2, 4, 5]);
        assert_eq!(two.map(beta).to_vec(), [0.0, 0.4, 1.0, 1.0, 1.0]);
        assert_eq!(two.map(fraction).to_vec(), [0.0, 0.0, 0.0, 0.5, 1.0]);
    }

    #[test]
    fn the_slope_is_that_of_the_part_that_ends_at_a_place() {
        let mut point = Point::new(1);
        (point.ln_likelihood, point.ln_over_prior, point.gap) = (-5.0, -2.0, 0.5);
        let slopes = [0.7, 1.0, 1.2].map(|place| slope(&point, place));
        assert_eq!(slopes.to_vec(), [-3.0, -3.0, 0.5]);
    }
}
