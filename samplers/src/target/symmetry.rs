//! Known symmetries of a target, by which a sampler moves in one step where local moves would take many.

use crate::rng::RandomStream;

/// A self-inverse map of the standard-normal coordinates, proposed and accepted by Metropolis with its Jacobian: the
/// posterior need not be invariant under it.
pub trait Involution: Sync + Send {
    /// A short name for reports.
    fn name(&self) -> &str;
    /// Maps `z` in place and returns `ln |det J|`; `None` where the map is not defined (then also not at its image).
    fn apply(&self, z: &mut [f64]) -> Option<f64>;
}

/// A continuous group that leaves the likelihood exactly unchanged: the position along its orbit can be redrawn from the prior's
/// conditional distribution, without a likelihood call, at any temperature.
pub trait Orbit: Sync + Send {
    /// A short name for reports.
    fn name(&self) -> &str;
    /// Redraws the position along the orbit through `z`, in place.
    fn refresh(&self, z: &mut [f64], rng: &mut RandomStream);
    /// Whether points can be moved along their orbits to one level, where the prior allows: whether [`align`](Self::align) is more than its
    /// default.
    fn has_levels(&self) -> bool {
        false
    }
    /// Moves `z` along its orbit until it has the level of `to`, and returns whether that is possible. The level is one
    /// of the coordinates, constant on the line between two points of equal level, in `z` as in the unit cube; where an
    /// orbit offers it, samplers step across orbits along such lines and redraw the position along them by
    /// [`refresh`](Self::refresh).
    fn align(&self, z: &mut [f64], to: &[f64]) -> bool {
        let _ = (z, to);
        false
    }
    /// Writes as many numbers as there are coordinates that are constant along an orbit and differ between orbits, in any units:
    /// a measure of how close two orbits are. `z` itself where an orbit offers none.
    fn invariants(&self, z: &[f64], out: &mut [f64]) {
        out.copy_from_slice(z);
    }
}

/// A symmetry move.
pub enum Symmetry {
    /// A map with a Metropolis test.
    Involution(Box<dyn Involution>),
    /// An exact redraw that costs no likelihood call.
    Orbit(Box<dyn Orbit>),
}

impl Symmetry {
    /// The involutions among `symmetries`.
    pub fn involutions(symmetries: &[Self]) -> impl Iterator<Item = &dyn Involution> {
        symmetries.iter().filter_map(|symmetry| match symmetry {
            Self::Involution(involution) => Some(involution.as_ref()),
            Self::Orbit(_) => None,
        })
    }

    /// The first orbit among `symmetries`: the one that differences of points are aligned along.
    #[must_use]
    pub fn first_orbit(symmetries: &[Self]) -> Option<&dyn Orbit> {
        symmetries.iter().find_map(|symmetry| match symmetry {
            Self::Orbit(orbit) => Some(orbit.as_ref()),
            Self::Involution(_) => None,
        })
    }
}
