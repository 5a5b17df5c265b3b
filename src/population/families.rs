//! All families by name: their settings, and what is done with whichever is chosen.

use super::beta::{Beta, BetaPriors};
use super::density::PopulationDensity;
use super::family::Family;
use super::histogram::{Histogram, HistogramPriors};
use super::leave_one_out::leave_one_out;
use super::mixture::{Mixture, MixturePriors};
use super::predictive::predictive;
use super::q_posterior::QPosterior;
use super::reweighting::streams_given_population;
use super::selection::selection_variance;
use super::target::{PopulationSettings, PopulationTarget};
use super::truncated_gaussian::{TruncatedGaussian, TruncatedGaussianSettings};
use super::uniform::{Uniform, UniformPriors};
use crate::data::Selection;
use crate::error::{Error, Result};
use crate::posterior::{PredictiveQuantity, StreamInPopulation, WithoutStream};
use oblate_samplers::output::Draws;
use oblate_samplers::{Marginal, Target};
use serde::{Deserialize, Serialize};

/// Which family.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FamilyName {
    /// [`TruncatedGaussian`]; the default.
    #[default]
    TruncatedGaussian,
    /// [`Uniform`].
    Uniform,
    /// [`Mixture`].
    Mixture,
    /// [`Beta`].
    Beta,
    /// [`Histogram`].
    Histogram,
}

impl FamilyName {
    /// All families.
    pub const ALL: [Self; 5] = [
        Self::TruncatedGaussian,
        Self::Uniform,
        Self::Mixture,
        Self::Beta,
        Self::Histogram,
    ];

    /// Its name in flags, files and folders.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TruncatedGaussian => "truncated-gaussian",
            Self::Uniform => "uniform",
            Self::Mixture => "mixture",
            Self::Beta => "beta",
            Self::Histogram => "histogram",
        }
    }
}

impl std::str::FromStr for FamilyName {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let named = Self::ALL.into_iter().find(|family| family.name() == text);
        named.ok_or_else(|| Error::Setting {
            key: "family".to_owned(),
            value: text.to_owned(),
            remedy: format!("give one of {}", Self::ALL.map(Self::name).join(", ")),
        })
    }
}

/// Which family is fitted, the support of all, and the hyperpriors of each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FamilySettings {
    /// The family.
    pub name: FamilyName,
    /// Lower end of the support; 0.5.
    pub q_min: f64,
    /// Upper end of the support; 1.5.
    pub q_max: f64,
    /// Prior of `mu_pop` of the [truncated Gaussian](TruncatedGaussianSettings).
    pub mu_pop: Marginal,
    /// Prior of its `sigma_pop`.
    pub sigma_pop: Marginal,
    /// Hyperpriors of [`Uniform`].
    pub uniform: UniformPriors,
    /// Hyperpriors of [`Mixture`].
    pub mixture: MixturePriors,
    /// Hyperpriors of [`Beta`].
    pub beta: BetaPriors,
    /// Hyperprior of [`Histogram`].
    pub histogram: HistogramPriors,
}

impl Default for FamilySettings {
    fn default() -> Self {
        let TruncatedGaussianSettings {
            q_min,
            q_max,
            mu_pop,
            sigma_pop,
        } = TruncatedGaussianSettings::default();
        Self {
            name: FamilyName::default(),
            q_min,
            q_max,
            mu_pop,
            sigma_pop,
            uniform: UniformPriors::default(),
            mixture: MixturePriors::default(),
            beta: BetaPriors::default(),
            histogram: HistogramPriors::default(),
        }
    }
}

/// The posterior of a population's hyperparameters, of whichever family. What it says about the streams is taken from draws of it.
pub trait Population: Target {
    /// Every stream along the posterior, in the streams' order.
    fn streams_given_population(&self, draws: &Draws) -> Vec<StreamInPopulation>;

    /// The posterior without each stream, in the streams' order.
    fn leave_one_out(&self, draws: &Draws) -> Vec<WithoutStream>;

    /// The posterior predictive check of the streams' q, with random numbers of `seed`.
    fn predictive(&self, draws: &Draws, seed: u64) -> Vec<PredictiveQuantity>;

    /// Variance of ln L by the errors of the selection, over the posterior; none without a selection.
    fn selection_variance(&self, draws: &Draws) -> Option<f64>;
}

impl<F: Family<N>, const N: usize> Population for PopulationTarget<F, N> {
    fn streams_given_population(&self, draws: &Draws) -> Vec<StreamInPopulation> {
        streams_given_population(self, draws)
    }

    fn leave_one_out(&self, draws: &Draws) -> Vec<WithoutStream> {
        leave_one_out(self, draws)
    }

    fn predictive(&self, draws: &Draws, seed: u64) -> Vec<PredictiveQuantity> {
        predictive(self, draws, seed)
    }

    fn selection_variance(&self, draws: &Draws) -> Option<f64> {
        selection_variance(self, draws)
    }
}

/// Work that is the same for every family.
trait Visitor {
    type Output;

    fn visit<F: Family<N> + 'static, const N: usize>(self, family: F) -> Result<Self::Output>;
}

impl FamilySettings {
    /// Checks every number of every family by itself, whether it is the chosen one or not: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        self.truncated_gaussian().check()?;
        self.uniform.check()?;
        self.mixture.check()?;
        self.beta.check()?;
        self.histogram.check()
    }

    /// The support of every family.
    #[must_use]
    pub fn support(&self) -> (f64, f64) {
        (self.q_min, self.q_max)
    }

    /// Number of hyperparameters of the chosen family.
    ///
    /// # Errors
    /// Those of [`check`](Self::check).
    pub fn dim(&self) -> Result<usize> {
        self.visit(Dim)
    }

    /// The posterior of the hyperparameters of the chosen family.
    ///
    /// # Errors
    /// Those of [`check`](Self::check), of [`PopulationTarget::new`] and of [`PopulationTarget::with_selection`].
    pub fn target(
        &self,
        streams: &[QPosterior],
        settings: PopulationSettings,
        selection: Option<&Selection>,
    ) -> Result<Box<dyn Population>> {
        self.visit(MakeTarget {
            streams,
            settings,
            selection,
        })
    }

    /// The density of the chosen family on `points` values of q from draws of its hyperparameters.
    ///
    /// # Errors
    /// Those of [`check`](Self::check) and of [`PopulationDensity::new`].
    pub fn density(&self, draws: &Draws, points: usize) -> Result<PopulationDensity> {
        self.visit(MakeDensity { draws, points })
    }

    fn truncated_gaussian(&self) -> TruncatedGaussianSettings {
        TruncatedGaussianSettings {
            q_min: self.q_min,
            q_max: self.q_max,
            mu_pop: self.mu_pop,
            sigma_pop: self.sigma_pop,
        }
    }

    fn visit<V: Visitor>(&self, visitor: V) -> Result<V::Output> {
        self.check()?;
        let support = self.support();
        match self.name {
            FamilyName::TruncatedGaussian => {
                visitor.visit(TruncatedGaussian::new(self.truncated_gaussian())?)
            }
            FamilyName::Uniform => visitor.visit(Uniform::new(support, self.uniform)?),
            FamilyName::Mixture => visitor.visit(Mixture::new(support, self.mixture)?),
            FamilyName::Beta => visitor.visit(Beta::new(support, self.beta)?),
            FamilyName::Histogram => visitor.visit(Histogram::new(support, self.histogram)?),
        }
    }
}

struct Dim;

impl Visitor for Dim {
    type Output = usize;

    fn visit<F: Family<N> + 'static, const N: usize>(self, _: F) -> Result<usize> {
        Ok(N)
    }
}

struct MakeTarget<'a> {
    streams: &'a [QPosterior],
    settings: PopulationSettings,
    selection: Option<&'a Selection>,
}

impl Visitor for MakeTarget<'_> {
    type Output = Box<dyn Population>;

    fn visit<F: Family<N> + 'static, const N: usize>(self, family: F) -> Result<Self::Output> {
        let target = PopulationTarget::new(family, self.streams, self.settings)?;
        Ok(match self.selection {
            Some(selection) => Box::new(target.with_selection(selection)?),
            None => Box::new(target),
        })
    }
}

struct MakeDensity<'a> {
    draws: &'a Draws,
    points: usize,
}

impl Visitor for MakeDensity<'_> {
    type Output = PopulationDensity;

    fn visit<F: Family<N> + 'static, const N: usize>(self, family: F) -> Result<Self::Output> {
        PopulationDensity::new(&family, self.draws, self.points)
    }
}
