//! Draws a new point above the likelihood bound: directly from the ellipsoids, or by a chain of steps from a live
//! point.

mod along;
pub(super) mod chain;
mod difference;
mod galilean;
mod independent;
mod involution;
mod slice;
mod trajectory;
mod uniform;
mod walk;

pub(super) use along::{Along, Proposals};
pub(super) use chain::{ChainContext, Counts, NewPoint, StepCounts, Trajectories};

use super::bound::Bound;
use super::live::Points;
use super::settings::Kernel;
use crate::difference_pool::DifferencePool;
use crate::error::Result;
use crate::mixture::Rows;
use crate::rng::{RandomStream, below};
use crate::target::{Symmetry, Target};
use chain::{Chain, normals};
use nalgebra::DMatrix;
use trajectory::WIDTHS;

/// The ellipsoids of chains that start from a point of this lineage.
pub(super) fn bound_of(bounds: &[Bound], lineage: u32) -> Option<&Bound> {
    let index = (lineage as usize).checked_rem(bounds.len())?;
    bounds.get(index)
}

/// Draws a point above the likelihood bound. Chains start at row `seed` of the surviving points.
pub(super) fn draw(
    context: &ChainContext<'_>,
    kept: &Points,
    seed: usize,
    mut rng: RandomStream,
) -> Result<NewPoint> {
    let rng = &mut rng;
    let bound = bound_of(context.bounds, kept.genealogy[seed].lineage);
    let Some(bound) = bound.filter(|_| context.kernel != Kernel::Uniform) else {
        return uniform::draw(context, bound, rng);
    };
    let mut chain = Chain::new(context, bound, kept, seed);
    for step in 0..context.steps {
        match context.kernel {
            Kernel::RandomWalk => walk::step(&mut chain, rng)?,
            Kernel::Differential | Kernel::Surrogate => difference::step(&mut chain, rng)?,
            Kernel::Galilean => galilean::step(&mut chain, rng)?,
            _ => slice::step(&mut chain, rng)?,
        }
        if step == 0 {
            involution::try_all(&mut chain, rng)?;
        }
    }
    if let Some(along) = context.along {
        let even = kept.genealogy[seed].lineage.is_multiple_of(2);
        let first = below(rng, WIDTHS.len());
        for set in 0..along.sets {
            let other = along.other_half(even, WIDTHS[(first + set) % WIDTHS.len()]);
            independent::step(&mut chain, &other, rng)?;
            trajectory::steps(&mut chain, &other, rng)?;
        }
    }
    chain.refresh_orbits(rng)?;
    chain.motion.moved = chain.x != kept.row(seed);
    Ok(NewPoint {
        u: chain.x,
        ln_l: chain.ln_l,
        calls: chain.likelihood.calls,
        examples: chain.likelihood.examples.unwrap_or_default(),
        motion: chain.motion,
    })
}

/// Some points in standard-normal coordinates.
pub(super) fn normal_rows(kept: &Points, rows: &[usize]) -> Rows {
    Rows {
        dim: kept.dim(),
        values: rows.iter().flat_map(|&i| normals(kept.row(i))).collect(),
    }
}

/// Lower Cholesky factor of the covariance of some points in standard-normal coordinates; none if it has none.
pub(super) fn factor_of_covariance(kept: &Points, rows: &[usize]) -> Option<DMatrix<f64>> {
    let (dim, count) = (kept.dim(), rows.len() as f64);
    let z: Vec<Vec<f64>> = rows.iter().map(|&i| normals(kept.row(i))).collect();
    let mean: Vec<f64> = (0..dim)
        .map(|k| z.iter().map(|z| z[k]).sum::<f64>() / count)
        .collect();
    let covariance = DMatrix::from_fn(dim, dim, |i, j| {
        let products = z.iter().map(|z| (z[i] - mean[i]) * (z[j] - mean[j]));
        products.sum::<f64>() / (count - 1.0)
    });
    Some(covariance.cholesky()?.l())
}

/// The surviving points of even and of odd lineages, for chains of the other half.
pub(super) fn halves(target: &dyn Target, kept: &Points) -> [DifferencePool; 2] {
    let orbit = Symmetry::first_orbit(target.symmetries());
    kept.halves().map(|rows| {
        let z: Vec<f64> = rows.iter().flat_map(|&i| normals(kept.row(i))).collect();
        DifferencePool::new(&z, kept.dim(), orbit)
    })
}

#[cfg(test)]
mod tests;
