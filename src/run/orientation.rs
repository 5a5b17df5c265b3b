//! The angles between the symmetry axes of finished fits and a direction.

use super::population_fits::read_fits;
use super::stored_fit::StoredFit;
use crate::error::{Error, PosteriorFault, Result};
use crate::params::{QPrior, StreamPrior};
use crate::population::AxisPosterior;
use crate::posterior::column;
use crate::stream::{DiscPlane, DiscSettings};
use std::path::PathBuf;

/// The direction that symmetry axes are compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisDirection {
    /// The line of sight.
    #[default]
    LineOfSight,
    /// The normal of the disc.
    Disc,
}

/// Reads finished fits, and the cosine of the angle between axis and direction of each draw.
///
/// # Errors
/// As of [`population`](super::population()) for fits that cannot be read or do not belong together; [`Error::Posterior`] for a fit in
/// which the prior of the axis is not isotropic; [`Error::NoColumn`] for a run without an axis; [`Error::InFile`] for a fit without a disc
/// whose plane is free, if the direction is that of the disc, or of which the prior cannot be used.
pub fn axis_posteriors(paths: &[PathBuf], direction: AxisDirection) -> Result<Vec<AxisPosterior>> {
    let fits = read_fits(paths)?;
    (fits.iter().zip(paths))
        .map(|(fit, path)| {
            let in_file = |source| Error::InFile {
                path: path.clone(),
                line: None,
                source: Box::new(source),
            };
            let prior = StreamPrior::new(&fit.settings.prior).map_err(in_file)?;
            let angle_is_isotropic = match direction {
                // The prior of q has a closed form only if the shape vector is free under its default marginals, each perhaps the positive half.
                AxisDirection::LineOfSight => prior.q_prior() != QPrior::Unknown,
                AxisDirection::Disc => prior.axis_is_isotropic(),
            };
            if !angle_is_isotropic {
                return Err(Error::Posterior {
                    name: fit.stored.name.clone(),
                    fault: PosteriorFault::AxisPrior,
                });
            }
            let cosines = match direction {
                AxisDirection::LineOfSight => column(&fit.stored.run, "axis_z")?.values,
                AxisDirection::Disc => to_disc(fit, &prior).map_err(in_file)?,
            };
            Ok(AxisPosterior {
                name: fit.stored.name.clone(),
                cosines: cosines.iter().map(|mu| mu.abs().min(1.0)).collect(),
                weights: fit.stored.run.draws.weights(),
                effective_size: fit.stored.summary.ess.max(1.0),
                converged: fit.stored.summary.converged,
            })
        })
        .collect()
}

/// The cosines of the angles between the symmetry axis and the normal of the disc.
fn to_disc(fit: &StoredFit, prior: &StreamPrior) -> Result<Vec<f64>> {
    let model = &fit.settings.model;
    let is_free = |disc: &DiscSettings| disc.plane == DiscPlane::Angles;
    if !model.baryons.disc.as_ref().is_some_and(is_free) {
        return Err(Error::Setting {
            key: "model.baryons.disc".to_owned(),
            value: "no disc with angles of its own".to_owned(),
            remedy: "give fits with a disc whose `plane` is \"angles\", or compare with the line of sight".to_owned(),
        });
    }
    let draws = &fit.stored.run.draws;
    Ok((0..draws.len())
        .map(|i| {
            let params = prior.fill(draws.theta_row(i));
            let axis = prior.shape(&params).axis;
            model.baryons.at(&params, axis).disc.normal.dot(axis)
        })
        .collect())
}
