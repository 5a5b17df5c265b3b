//! The posterior of a stream as a target of the samplers: free parameters in, ln L and its gradient out.

use super::derived::{DERIVED, derived};
use super::settings::FitSettings;
use crate::data::{Measured, ObservedTrack, QuantityColumn, StarVelocity};
use crate::error::{Rejection, Result};
use crate::likelihood::{BinMeasurement, DataBin, Evaluation, StreamLikelihood, TrackLikelihood};
use crate::params::{DIM, FEATURES, StreamParams, StreamPrior, features, features_vjp, symmetry};
use crate::stream::Model;
use crate::track::BinQuantity;
use oblate_samplers::limits::Memory;
use oblate_samplers::{Outcome, Prior, Symmetry, Target};

/// Cost of a value with gradient in units of a value; docs/validation.md, section 6, has the measured range.
const GRADIENT_COST: f64 = 3.5;

/// The posterior of one stream.
pub struct StreamTarget {
    likelihood: StreamLikelihood,
    prior: StreamPrior,
    symmetries: Vec<Symmetry>,
}

impl StreamTarget {
    /// The posterior of a track under given settings.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) or [`Error::Setting`](crate::Error::Setting) for a setting of prior, model or
    /// likelihood; [`Error::TooMuchMemory`](crate::Error::TooMuchMemory) if the model needs too much memory.
    pub fn from_track(track: &ObservedTrack, settings: &FitSettings) -> Result<Self> {
        let prior = StreamPrior::new(&settings.prior)?;
        settings.model.check_distributions(&prior)?;
        check_measured(track, &prior)?;
        let model = Model::new(&settings.model)?;
        let data: Vec<DataBin> = track
            .bins()
            .into_iter()
            .enumerate()
            .map(|(row, bin)| DataBin {
                bin,
                r_kpc: track.r_kpc[row],
                r_err_lo_kpc: track.r_err_lo_kpc[row],
                r_err_hi_kpc: track.r_err_hi_kpc[row],
            })
            .collect();
        let likelihood = TrackLikelihood::new(
            &settings.likelihood,
            track.bin_width_deg,
            &data,
            &model.settings().releases,
        )?
        .with_offset_deg(track.offset_deg())?
        .with_measurements(&measurements(track))?;
        let q_range = prior.q_range();
        Ok(Self::new(
            StreamLikelihood::new(model, likelihood, q_range),
            prior,
        ))
    }

    /// From a likelihood and a prior with the same range of q.
    #[must_use]
    pub fn new(likelihood: StreamLikelihood, prior: StreamPrior) -> Self {
        let velocities = likelihood.track().has(BinQuantity::Velocity);
        let symmetries = symmetry::symmetries(&prior, velocities);
        Self {
            likelihood,
            prior,
            symmetries,
        }
    }

    /// An estimate of the memory of the model and of `threads` values with gradients that are computed at once.
    #[must_use]
    pub fn memory(&self, threads: usize) -> Memory {
        let model = self.likelihood.model().settings().memory(threads);
        model.and(&self.likelihood.track().memory(threads), "")
    }

    /// The likelihood.
    #[must_use]
    pub fn likelihood(&self) -> &StreamLikelihood {
        &self.likelihood
    }

    /// Whether ln L depends on the mass of the halo beside its ratio to other masses: baryons have masses of their own, and velocities a
    /// scale.
    fn has_scale(&self) -> bool {
        let baryons = self.likelihood.model().settings().baryons;
        !baryons.is_none() || self.likelihood.track().has(BinQuantity::Velocity)
    }

    /// The prior with its fixed parameters.
    #[must_use]
    pub fn stream_prior(&self) -> &StreamPrior {
        &self.prior
    }

    /// All parameters from the free ones: `theta` has these in their units, in the order of
    /// [`PARAMETERS`](crate::params::PARAMETERS) without the fixed and the absent ones.
    #[must_use]
    pub fn params(&self, theta: &[f64]) -> StreamParams<f64> {
        self.prior.fill(theta)
    }
}

/// Velocities, widths and densities of a track, and velocities of its stars.
fn measurements(track: &ObservedTrack) -> Vec<BinMeasurement> {
    let bins = track.bins();
    let of_quantity = |(quantity, rows): (&BinQuantity, &Vec<Option<Measured>>)| {
        let of_row = |(bin, measured): (&i64, &Option<Measured>)| {
            measured.map(|Measured { value, error }| BinMeasurement {
                bin: *bin,
                quantity: *quantity,
                value,
                error,
                of_one_star: false,
            })
        };
        bins.iter().zip(rows).filter_map(of_row).collect::<Vec<_>>()
    };
    let of_star = |star: &StarVelocity| BinMeasurement {
        bin: track.bin_at(star.phi_deg),
        quantity: BinQuantity::Velocity,
        value: star.v_km_s.value,
        error: star.v_km_s.error,
        of_one_star: true,
    };
    (track.measured.iter().flat_map(of_quantity))
        .chain(track.stars.iter().map(of_star))
        .collect()
}

/// Checks that a prior has what the data of a track need, and no parameter that these do not have.
fn check_measured(track: &ObservedTrack, prior: &StreamPrior) -> Result<()> {
    let has = |quantity| track.measured.contains_key(&quantity);
    let columns = |quantity: BinQuantity| {
        let QuantityColumn { value, error, .. } = quantity.column();
        format!("a track with the columns `{value}` and `{error}`")
    };
    let example = Some("{ kind = \"uniform\", lo = 2, hi = 5 }");
    let of_densities = columns(BinQuantity::Density);
    prior.check_belongs(
        "log10_n_stars",
        has(BinQuantity::Density),
        &of_densities,
        example,
    )?;
    if track.has_velocities() {
        // They need not have the velocity of the host.
        prior.check_both_sides("velocities tell")
    } else {
        prior.check_belongs("v_host_km_s", false, &columns(BinQuantity::Velocity), None)
    }
}

/// The result of an evaluation, for a sampler.
fn outcome(evaluated: std::result::Result<Evaluation, Rejection>) -> Outcome {
    match evaluated {
        Ok(evaluation) => Outcome::from_ln_likelihood(evaluation.ln_likelihood),
        Err(cause) => Outcome::Reject(cause.name()),
    }
}

impl Target for StreamTarget {
    fn prior(&self) -> &Prior {
        self.prior.prior()
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let all = self.params(theta).to_array();
        outcome(self.likelihood.ln_likelihood(&all))
    }

    fn ln_likelihood_bound(&self) -> Option<f64> {
        Some(self.likelihood.track().ln_likelihood_bound())
    }

    fn ln_likelihoods(&self, thetas: &[Vec<f64>]) -> Vec<Outcome> {
        let all: Vec<[f64; DIM]> = thetas.iter().map(|t| self.params(t).to_array()).collect();
        let evaluated = self.likelihood.ln_likelihoods(&all);
        evaluated.into_iter().map(outcome).collect()
    }

    /// ln L and the truncated gradient: see [`StreamLikelihood::truncated_gradient`].
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let all = self.params(theta).to_array();
        let evaluated = self.likelihood.truncated_gradient(&all);
        outcome(evaluated.map(|(evaluation, all)| {
            for (slot, place) in gradient.iter_mut().zip(self.prior.free()) {
                *slot = all[*place];
            }
            evaluation
        }))
    }

    fn ln_likelihood_and_residuals(&self, theta: &[f64], residuals: &mut Vec<f64>) -> Outcome {
        let all = self.params(theta).to_array();
        outcome(self.likelihood.ln_likelihood_and_residuals(&all, residuals))
    }

    fn gradient_cost(&self) -> Option<f64> {
        Some(GRADIENT_COST)
    }

    fn feature_count(&self) -> usize {
        FEATURES + usize::from(self.has_scale()) + self.prior.free_optional().len()
    }

    /// Those of the stream, the mass of the halo where ln L depends on it, and the free optional parameters as they are.
    fn features(&self, _z: &[f64], theta: &[f64], all: &mut [f64]) {
        let params = self.params(theta);
        let (of_stream, others) = all.split_at_mut(FEATURES);
        of_stream.copy_from_slice(&features(&params, self.prior.q_range()));
        let (mass, optional) = others.split_at_mut(usize::from(self.has_scale()));
        mass.fill(params.log10_m_halo);
        optional.copy_from_slice(&theta[theta.len() - optional.len()..]);
    }

    fn features_vjp(&self, z: &[f64], theta: &[f64], features_bar: &[f64], z_bar: &mut [f64]) {
        let (of_stream, others) = features_bar.split_at(FEATURES);
        let (mass, optional) = others.split_at(usize::from(self.has_scale()));
        let mut bar = [0.0; FEATURES];
        bar.copy_from_slice(of_stream);
        let mut bar = features_vjp(&self.params(theta), self.prior.q_range(), &bar);
        bar.log10_m_halo += mass.iter().sum::<f64>();
        let bar = bar.to_array();
        for (slot, place) in z_bar.iter_mut().zip(self.prior.free()) {
            *slot = bar[*place];
        }
        let first = z_bar.len() - optional.len();
        for (slot, bar) in z_bar[first..].iter_mut().zip(optional) {
            *slot += bar;
        }
        self.prior().gradient_to_z(z, z_bar);
    }

    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }

    fn derived_names(&self) -> Vec<(String, String)> {
        DERIVED
            .map(|(name, unit)| (name.to_owned(), unit.to_owned()))
            .to_vec()
    }

    fn derived(&self, theta: &[f64], out: &mut Vec<f64>) {
        out.extend(derived(
            &self.prior,
            (
                self.likelihood.host(),
                self.likelihood.model().settings().halo,
            ),
            &self.params(theta),
        ));
    }
}
