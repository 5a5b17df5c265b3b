//! The angles between the minor axes of the haloes of finished fits and a direction.

use super::population_fits::read_fits;
use super::stored_fit::StoredFit;
use crate::error::{Error, PosteriorFault, Result};
use crate::params::StreamPrior;
use crate::population::AxisPosterior;
use crate::scalar::Vec3;
use crate::stream::{DiscPlane, DiscSettings, MinorAxis};
use std::path::PathBuf;

/// The direction that minor axes are compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisDirection {
    /// The line of sight.
    #[default]
    LineOfSight,
    /// The normal of the disc.
    Disc,
}

/// Reads finished fits, and the cosines of the angle between minor axis and direction of each draw.
///
/// # Errors
/// As of [`population`](super::population()) for fits that cannot be read or do not belong together; [`Error::Posterior`] for a fit in
/// which the prior of the axis is not isotropic; [`Error::InFile`] for a fit without a disc whose plane is free, if the direction is that of
/// the disc, or of which the prior cannot be used.
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
                AxisDirection::LineOfSight => prior.angle_to_line_of_sight_is_isotropic(),
                AxisDirection::Disc => prior.axis_is_isotropic(),
            };
            if !angle_is_isotropic {
                return Err(Error::Posterior {
                    name: fit.stored.name.clone(),
                    fault: PosteriorFault::AxisPrior,
                });
            }
            Ok(AxisPosterior {
                name: fit.stored.name.clone(),
                cosines: cosines(fit, &prior, direction).map_err(in_file)?,
                weights: fit.stored.run.draws.weights(),
                effective_size: fit.stored.summary.ess.max(1.0),
                converged: fit.stored.summary.converged,
            })
        })
        .collect()
}

/// The cosines of the angle between the minor axis and the direction, of each draw.
fn cosines(
    fit: &StoredFit,
    prior: &StreamPrior,
    direction: AxisDirection,
) -> Result<Vec<Vec<f64>>> {
    let model = &fit.settings.model;
    let is_free = |disc: &DiscSettings| disc.plane == DiscPlane::Angles;
    let has_disc = model.baryons.disc.as_ref().is_some_and(is_free);
    if direction == AxisDirection::Disc && !has_disc {
        return Err(Error::Setting {
            key: "model.baryons.disc".to_owned(),
            value: "no disc with angles of its own".to_owned(),
            remedy: "give fits with a disc whose `plane` is \"angles\", or compare with the line of sight".to_owned(),
        });
    }
    let draws = &fit.stored.run.draws;
    let of_draw = |i| {
        let params = prior.fill(draws.theta_row(i));
        let direction = match direction {
            AxisDirection::LineOfSight => Vec3::new(0.0, 0.0, 1.0),
            AxisDirection::Disc => {
                let axis = prior.shape(&params).axis;
                model.baryons.at(&params, axis).disc.normal
            }
        };
        MinorAxis::new(model.halo, &params, prior.q_range()).cosines(direction)
    };
    Ok((0..draws.len()).map(of_draw).collect())
}
