//! What runs ask, and of which data: by this two runs are compared as one posterior, as two models, or not at all.

use super::folder::{RunFolder, StoredRun};
use crate::config::{PopulationConfig, parse};
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::FitSettings;

/// What a run asks.
#[derive(Clone, Debug)]
pub enum Asked {
    /// The parameters of a stream.
    Fit {
        /// Its track.
        track: Box<ObservedTrack>,
        /// The settings.
        settings: Box<FitSettings>,
    },
    /// The hyperparameters of a population.
    Population {
        /// The names of its streams.
        streams: Vec<String>,
        /// The settings.
        settings: Box<PopulationConfig>,
    },
}

/// How what a run asks differs from what another one asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difference {
    /// One is a fit, the other a population.
    Kind,
    /// The fits are of other tracks, or of other senses of phi of one track.
    Track,
    /// The fits are in other hosts.
    Host,
    /// The fits have other priors, or other errors of the data.
    Prior,
    /// The populations are of other streams.
    Streams,
    /// The populations have other selections: what is normalised are the streams that are kept.
    Selection,
    /// The populations have other families, supports or hyperpriors.
    Family,
}

impl Difference {
    /// Whether the data are the same, so that the difference of ln Z is the evidence for one run's model over the other's.
    #[must_use]
    pub fn has_odds(self) -> bool {
        matches!(self, Self::Host | Self::Prior | Self::Family)
    }
}

impl Asked {
    /// What the run in this folder asks.
    ///
    /// # Errors
    /// [`Error::Syntax`](crate::Error::Syntax) if its settings cannot be read; as of [`RunFolder::read_track`].
    pub fn of(stored: &StoredRun, folder: &RunFolder) -> Result<Self> {
        if let Some(settings) = stored.fit_settings(folder)? {
            return Ok(Self::Fit {
                track: Box::new(folder.read_track()?),
                settings: Box::new(settings),
            });
        }
        let population = stored.summary.population.iter();
        Ok(Self::Population {
            streams: population
                .flat_map(|p| p.streams.iter().map(|stream| stream.name.clone()))
                .collect(),
            settings: Box::new(parse(&stored.config, &folder.config())?),
        })
    }

    /// Whether another run has the same data: fits the same track in the same sense, populations streams of the same names.
    #[must_use]
    pub fn has_data_of(&self, other: &Self) -> bool {
        use Difference::{Kind, Streams, Track};
        !matches!(self.difference(other), Some(Kind | Track | Streams))
    }

    /// The track of a fit.
    #[must_use]
    pub fn track(&self) -> Option<&ObservedTrack> {
        match self {
            Self::Fit { track, .. } => Some(track),
            Self::Population { .. } => None,
        }
    }

    /// How it differs from what another run asks; none if both ask for one posterior.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<Difference> {
        match (self, other) {
            (
                Self::Fit { track, settings },
                Self::Fit {
                    track: other_track,
                    settings: other,
                },
            ) => {
                if !track.has_data_of(other_track) {
                    Some(Difference::Track)
                } else if !settings.model.has_host_of(&other.model) {
                    Some(Difference::Host)
                } else {
                    (!settings.has_posterior_of(other)).then_some(Difference::Prior)
                }
            }
            (
                Self::Population { streams, settings },
                Self::Population {
                    streams: other_streams,
                    settings: other,
                },
            ) => {
                if streams != other_streams {
                    Some(Difference::Streams)
                } else if settings.selection != other.selection {
                    Some(Difference::Selection)
                } else {
                    (settings.family != other.family).then_some(Difference::Family)
                }
            }
            _ => Some(Difference::Kind),
        }
    }
}
