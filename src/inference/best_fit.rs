//! Diagnostics of the model at the best fit of a run.

use super::target::StreamTarget;
use crate::data::ObservedTrack;
use crate::likelihood::DataBin;
use crate::params::StreamParams;
use crate::scalar::Vec3;
use crate::track::{BinQuantity, TrackBin};
use oblate_samplers::Run;
use std::collections::BTreeMap;

/// Numbers about a run and its model, and warnings that follow from them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Diagnostics {
    /// Numbers by name.
    pub numbers: BTreeMap<String, f64>,
    /// Warnings, each with its remedy.
    pub warnings: Vec<String>,
}

/// Diagnostics of a fit:
/// - `bounded_tidal_radius`, `ambiguous_windings`: the approximations in the best fit's stream ([`Tally`](crate::Tally));
/// - `best_fit_chi2`, `best_fit_bins`: chi-square of the best fit, with its jitter, and the number of data bins that it covers;
/// - `best_fit_chi2_velocity` and `best_fit_velocities`, `_width` and `_widths`, `_density` and `_densities`: the same of what is measured beside the radii;
/// - `best_fit_chi2_star_velocity` and `best_fit_star_velocities`: of single stars, whose errors have the scatter of the model's velocities in the bin;
/// - `star_scatter`: if the track has numbers of stars, the variance of a mean over them by the best fit's scatter of radii, over that of the datum, mean
///   over bins. Errors that include the scatter of the stars have at most 1;
/// - `least_density_msun_kpc3`: the host's density at the progenitor's distance from the centre, on the halo's symmetry axis or across it, whichever is smaller.
///
/// All depend on the draws alone: a run that was stopped and resumed has the same. If there are no draws, or if the best fit has no
/// track, nothing is given.
#[must_use]
pub fn diagnose(target: &StreamTarget, track: &ObservedTrack, run: &Run) -> Diagnostics {
    let mut found = Diagnostics::default();
    let Some(best) = run.draws.best() else {
        return found;
    };
    let params = target.params(run.draws.theta_row(best));
    let likelihood = target.likelihood();
    let Ok((modelled, particles)) = likelihood.track_at(&params) else {
        return found;
    };
    let tally = particles.tally;
    found.insert("bounded_tidal_radius", tally.bounded_tidal_radius as f64);
    found.insert("ambiguous_windings", tally.ambiguous_windings as f64);
    let radii = compare_radii(target, track, &modelled.bins, params.jitter);
    let covered = radii.iter().flatten();
    let chi2 = covered.clone().map(|r| r.residual * r.residual).sum();
    found.insert("best_fit_chi2", chi2);
    found.insert("best_fit_bins", covered.count() as f64);
    let mut of_stars = Vec::new();
    for (row, radius) in radii.iter().enumerate() {
        if let (Some(radius), Some(n)) = (radius, &track.n)
            && n[row] > 1.0
        {
            let model = radius.model;
            let variance_of_r = model.effective_n * model.r_err_kpc * model.r_err_kpc;
            of_stars.push(variance_of_r / n[row] / (radius.sigma_kpc * radius.sigma_kpc));
        }
    }
    for (quantity, rows) in &track.measured {
        let [chi2_name, count_name] = match quantity {
            BinQuantity::Velocity => ["best_fit_chi2_velocity", "best_fit_velocities"],
            BinQuantity::Width => ["best_fit_chi2_width", "best_fit_widths"],
            BinQuantity::Density => ["best_fit_chi2_density", "best_fit_densities"],
        };
        let (mut chi2, mut covered) = (0.0, 0_usize);
        for (bin, measured) in track.bins().into_iter().zip(rows) {
            if let Some(datum) = measured
                && let Some(model) = modelled.bins.iter().find(|b| b.bin == bin)
            {
                covered += 1;
                chi2 += ((model.value(*quantity) - datum.value) / datum.error).powi(2);
            }
        }
        found.insert(chi2_name, chi2);
        found.insert(count_name, covered as f64);
    }
    if !track.stars.is_empty() {
        let squares = track.stars.iter().filter_map(|star| {
            let bin = track.bin_at(star.phi_deg);
            let model = modelled.bins.iter().find(|b| b.bin == bin)?;
            let scatter = model.v_err_km_s * model.effective_n.sqrt();
            let residual = (model.v_km_s - star.v_km_s.value) / star.v_km_s.error.hypot(scatter);
            Some(residual * residual)
        });
        let squares: Vec<f64> = squares.collect();
        found.insert("best_fit_chi2_star_velocity", squares.iter().sum());
        found.insert("best_fit_star_velocities", squares.len() as f64);
    }
    if !of_stars.is_empty() {
        found.insert_star_scatter(of_stars.iter().sum::<f64>() / of_stars.len() as f64);
    }
    // Negative on the symmetry axis if the halo is oblate, in the plane across it if it is prolate.
    let r = params.position_kpc().norm2().sqrt();
    let axis = likelihood.q_range().shape(params.dir()).axis;
    let potential = likelihood.potential(&params);
    let density = (potential.density(axis * r)).min(potential.density(across(axis) * r));
    found.insert("least_density_msun_kpc3", density);
    if density < 0.0 {
        found.warnings.push(
            "the best fit's mass density is negative at the progenitor's radius, on the symmetry axis or across it, which can happen because q \
             flattens the potential, not the density: read q as the potential's, or fit with `model.halo = \"nfw_density\"`"
                .to_owned(),
        );
    }
    found
}

/// (data - model) / error of the radius in each row of the data, with the errors that ln L has: at least the error floor, and with jitter. NaN where the model has no
/// mean radius, everywhere if it has no track.
#[must_use]
pub fn residuals(
    target: &StreamTarget,
    track: &ObservedTrack,
    params: &StreamParams<f64>,
) -> Vec<f64> {
    let Ok((modelled, _)) = target.likelihood().track_at(params) else {
        return vec![f64::NAN; track.len()];
    };
    let radii = compare_radii(target, track, &modelled.bins, params.jitter);
    let residual = |r: &Option<Radius<'_>>| r.as_ref().map_or(f64::NAN, |r| r.residual);
    radii.iter().map(residual).collect()
}

/// A bin of the data beside that of the model.
struct Radius<'a> {
    model: &'a TrackBin,
    sigma_kpc: f64,
    /// (data - model) / sigma.
    residual: f64,
}

/// For each row of the data; none where the model has no bin.
fn compare_radii<'a>(
    target: &StreamTarget,
    track: &ObservedTrack,
    model: &'a [TrackBin],
    jitter: f64,
) -> Vec<Option<Radius<'a>>> {
    let data = target.likelihood().track().data();
    let data: BTreeMap<i64, &DataBin> = data.map(|d| (d.bin, d)).collect();
    let radius = |bin: i64| {
        let (model, datum) = (model.iter().find(|b| b.bin == bin)?, data.get(&bin)?);
        let sigma_kpc = datum.r_err_towards_kpc(model.r_kpc, jitter);
        Some(Radius {
            model,
            sigma_kpc,
            residual: (datum.r_kpc - model.r_kpc) / sigma_kpc,
        })
    };
    track.bins().into_iter().map(radius).collect()
}

/// A direction at right angles to this one.
fn across(axis: Vec3<f64>) -> Vec3<f64> {
    let sky = if axis.z.abs() < 0.6 {
        Vec3::new(0.0, 0.0, 1.0)
    } else {
        Vec3::new(1.0, 0.0, 0.0)
    };
    let other = axis.cross(sky);
    other * (1.0 / other.norm2().sqrt())
}

/// Mean variance of means over the stars of bins, over that of the data, above which the data's errors cannot include it. By the best fit it is up to 1
/// with the right errors, give or take a fifth: the scatter of some hundred stars.
const MAX_STAR_SCATTER: f64 = 1.2;

impl Diagnostics {
    fn insert_star_scatter(&mut self, star_scatter: f64) {
        self.insert("star_scatter", star_scatter);
        if star_scatter > MAX_STAR_SCATTER {
            let times = star_scatter.sqrt();
            self.warnings.push(format!(
                "the radii of the stars scatter so much that the mean over those of a bin errs by {times:.1} times `r_err`, by the best fit and the column `n`: \
                 add the standard deviation of r over the root of n to `r_err` in quadrature, or leave `n` out if it is no number of stars"
            ));
        }
    }

    pub(super) fn insert(&mut self, name: &str, value: f64) {
        self.numbers.insert(name.to_owned(), value);
    }
}
