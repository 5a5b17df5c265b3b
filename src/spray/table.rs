//! The table of releases: release time, tail and release offset of each particle. Made once from a seed; all later steps up to
//! the likelihood use no random numbers.

use super::neighbourhood::{Neighbourhood, smearing};
use super::{MAX_NORMALS, Recipe, ReleaseOffset, Tail};
use crate::error::{Error, Result};
use oblate_samplers::limits::{MAX_SEED, in_range};
use oblate_samplers::normal::quantile;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How the random numbers of the releases are spread (docs/physics.md, section 4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SamplingScheme {
    /// Independent normals; release times -T + k T / `release_times` (the paper).
    Random,
    /// One Owen-scrambled Sobol set per tail over release time and normals, sorted by time. Release times are the middles of
    /// equal intervals.
    Sobol,
    /// The Sobol set, each particle smeared over the stream around it, whose shape follows from its neighbours in the space of the random
    /// numbers and from a partner with nearly the same ones at the next release time ([`Neighbourhood`]). benches/RESULTS.md, `noise` and
    /// `roughness`, compares the schemes.
    #[default]
    SobolSmeared,
}

impl SamplingScheme {
    /// The mean square error of a bin's mean radius, over the Monte-Carlo variance of independent particles: measured on mocks and posterior draws
    /// (`cargo bench --bench noise`).
    #[must_use]
    pub fn variance_factor(self) -> f64 {
        match self {
            Self::Random => 1.0,
            Self::Sobol => 0.5,
            Self::SobolSmeared => 0.35,
        }
    }

    /// The largest number of particles, both tails together; that of the Sobol schemes is the length of the sequence in use.
    #[must_use]
    pub fn max_particles(self) -> usize {
        match self {
            Self::Random => 10_000_000,
            Self::Sobol | Self::SobolSmeared => 1 << 17,
        }
    }
}

/// What a table is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TableSettings {
    /// Particles, both tails together.
    pub particles: usize,
    /// Release times; 0 chooses 100 for `random`, else as many as leave each 32 particles (from 2,048 on), else 16, else 8:
    /// whichever divides them.
    pub release_times: usize,
    /// Sampling scheme.
    pub sampling_scheme: SamplingScheme,
    /// Release recipe.
    pub recipe: Recipe,
    /// Seed of the table.
    pub seed: u64,
}

impl Default for TableSettings {
    fn default() -> Self {
        Self {
            particles: 2_560,
            release_times: 0,
            sampling_scheme: SamplingScheme::default(),
            recipe: Recipe::default(),
            seed: 1,
        }
    }
}

impl TableSettings {
    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        let most = SamplingScheme::Random.max_particles();
        in_range(PARTICLES, self.particles, 2..=most)?;
        in_range(
            "model.releases.release_times",
            self.release_times,
            0..=5_000_000,
        )?;
        in_range("model.releases.seed", self.seed, 0..=MAX_SEED)?;
        Ok(())
    }

    /// The number of release times: as it is given, or as the sampling scheme chooses it.
    #[must_use]
    pub fn number_of_release_times(&self) -> usize {
        match (self.release_times, self.sampling_scheme) {
            (0, SamplingScheme::Random) => 100,
            (0, SamplingScheme::Sobol) => sobol_release_times(self.particles, 2_048),
            // With more particles of a tail at one release time, neighbours are nearer.
            (0, SamplingScheme::SobolSmeared) => sobol_release_times(self.particles, 0),
            (given, _) => given,
        }
    }
}

/// The key of the number of particles.
const PARTICLES: &str = "model.releases.particles";

/// One particle of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    /// Side.
    pub tail: Tail,
    /// Release in the tidal frame.
    pub offset: ReleaseOffset,
}

/// All releases by release time, oldest first; equal numbers at each time, leading before trailing.
#[derive(Clone, Debug, PartialEq)]
pub struct ReleaseTable {
    /// Release times as fractions of the age, in [-1, 0).
    pub taus: Vec<f64>,
    /// Particles, `taus.len() * per_release_time` of them.
    pub releases: Vec<Release>,
    /// Particles per release time.
    pub per_release_time: usize,
    /// Recipe of the release offsets.
    pub recipe: Recipe,
    /// The neighbours of each particle ([`SamplingScheme::SobolSmeared`] with several release times).
    pub neighbourhood: Option<Arc<Neighbourhood>>,
}

impl ReleaseTable {
    /// Makes the table.
    ///
    /// # Errors
    /// Those of [`TableSettings::check`]; [`Error::Setting`] if the number of particles is not a multiple of what the sampling scheme
    /// needs, or too large for it.
    pub fn new(settings: &TableSettings) -> Result<Self> {
        let n = settings.particles;
        let fail = |remedy: &str| Error::Setting {
            key: PARTICLES.to_owned(),
            value: n.to_string(),
            remedy: remedy.to_owned(),
        };
        settings.check()?;
        let release_times = settings.number_of_release_times();
        if !n.is_multiple_of(2 * release_times) {
            return Err(fail(&format!(
                "with {release_times} release times give a multiple of {}, or set `release_times` to a divisor of half of it",
                2 * release_times
            )));
        }
        if n > settings.sampling_scheme.max_particles() {
            return Err(fail(
                "this sampling scheme has at most 131072 particles; set `model.releases.sampling_scheme = \"random\"` for more",
            ));
        }
        let per_tail = n / (2 * release_times);
        let tails = [Tail::Leading, Tail::Trailing];
        let smeared = settings.sampling_scheme == SamplingScheme::SobolSmeared && release_times > 1;
        let smearing = if smeared { smearing(n) } else { 0.0 };
        let draws = |tail| {
            Ok::<_, Error>(match settings.sampling_scheme {
                SamplingScheme::Random => random_draws(settings, tail, n / 2)?,
                SamplingScheme::Sobol => sobol_draws(settings, tail, n / 2, 0.0)?,
                SamplingScheme::SobolSmeared => {
                    linked(sobol_draws(settings, tail, n / 2, smearing)?, per_tail)
                }
            })
        };
        let draws = [draws(tails[0])?, draws(tails[1])?];
        let mut releases = Vec::with_capacity(n);
        let mut xi = Vec::with_capacity(n);
        for release_time in 0..release_times {
            for (tail, draws) in tails.iter().zip(&draws) {
                let these = &draws[release_time * per_tail..(release_time + 1) * per_tail];
                xi.extend(these.iter().map(|draw| draw.xi));
                releases.extend(these.iter().map(|draw| Release {
                    tail: *tail,
                    offset: draw.offset,
                }));
            }
        }
        let neighbourhood = smeared.then(|| {
            let numbers = settings.recipe.normals();
            Arc::new(Neighbourhood::new(&xi, numbers, per_tail, smearing))
        });
        let middle = match settings.sampling_scheme {
            SamplingScheme::Random => 0.0,
            SamplingScheme::Sobol | SamplingScheme::SobolSmeared => 0.5,
        };
        let taus = (0..release_times)
            .map(|k| (k as f64 + middle) / release_times as f64 - 1.0)
            .collect();
        Ok(Self {
            taus,
            releases,
            per_release_time: 2 * per_tail,
            recipe: settings.recipe,
            neighbourhood,
        })
    }

    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.releases.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.releases.is_empty()
    }
}

/// Default number of release times of `n` particles of a Sobol scheme. More do not lower the noise of a track, and 16 particles
/// of one time fill the lanes.
fn sobol_release_times(n: usize, least_for_32: usize) -> usize {
    let per_release_time = [32, 16, 8]
        .into_iter()
        .find(|k| n.is_multiple_of(*k) && (*k < 32 || n >= least_for_32));
    (n / per_release_time.unwrap_or(8)).max(1)
}

/// Largest number of tries for one release offset. A try fails with a probability of 2.4e-6 at most.
const MAX_DRAWS: u64 = 64;

/// The random numbers of a particle and what follows from them.
#[derive(Clone, Copy)]
struct Draw {
    xi: [f64; MAX_NORMALS],
    offset: ReleaseOffset,
}

/// The first try that gives a release offset; `draw` is given the number of the try, from 0.
fn first_valid(draw: impl FnMut(u64) -> Option<Draw>) -> Result<Draw> {
    (0..MAX_DRAWS).find_map(draw).ok_or_else(|| Error::Setting {
        key: "model.releases.seed".to_owned(),
        value: format!("{MAX_DRAWS} draws without a release offset"),
        remedy: "give another seed".to_owned(),
    })
}

/// Independent release offsets; where a recipe has no offset, the next normals of the same random stream are used.
fn random_draws(settings: &TableSettings, tail: Tail, count: usize) -> Result<Vec<Draw>> {
    let mut rng = stream(settings.seed, Domain::Design, tail_number(tail), 0);
    let mut draw = || {
        first_valid(|_| {
            let mut xi = [0.0; MAX_NORMALS];
            for x in xi.iter_mut().take(settings.recipe.normals()) {
                *x = standard_normal(&mut rng);
            }
            let offset = settings.recipe.kick(&xi, tail);
            offset.map(|offset| Draw { xi, offset })
        })
    };
    (0..count).map(|_| draw()).collect()
}

/// A scrambled Sobol set, sorted by its first coordinate, the release time: its index must not choose the time, nor the
/// tail, because its low bits are the first coordinates of the points. Random numbers that particles are smeared over have their variance less
/// that of the smearing.
fn sobol_draws(
    settings: &TableSettings,
    tail: Tail,
    count: usize,
    smearing: f64,
) -> Result<Vec<Draw>> {
    let narrower = (1.0 - smearing * smearing).sqrt();
    // Scrambles are 32-bit seeds; the two tails and the repetitions have sets of their own.
    let scramble = |round: u64| {
        let mut rng = stream(settings.seed, Domain::Design, tail_number(tail), 1 + round);
        #[allow(
            clippy::cast_possible_truncation,
            reason = "the low half of a random word is a random half-word"
        )]
        let seed = rand::Rng::next_u64(&mut rng) as u32;
        seed
    };
    #[allow(
        clippy::cast_possible_truncation,
        reason = "count is below 2^16, dimensions below 6"
    )]
    let point = |i: usize, dimension: usize, seed: u32| {
        // The generator gives multiples of 2^-24: take the middle of the cell, so that no normal is infinite.
        f64::from(sobol_burley::sample(i as u32, dimension as u32, seed))
            + 0.5 / f64::from(1_u32 << 24)
    };
    let mut rows: Vec<(f64, Draw)> = Vec::with_capacity(count);
    for i in 0..count {
        let draw = first_valid(|round| {
            let seed = scramble(round);
            let mut xi = [0.0; MAX_NORMALS];
            for (d, x) in xi.iter_mut().enumerate().take(settings.recipe.normals()) {
                *x = narrower * quantile(point(i, d + 1, seed));
            }
            let offset = settings.recipe.kick(&xi, tail);
            offset.map(|offset| Draw { xi, offset })
        })?;
        rows.push((point(i, 0, scramble(0)), draw));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(rows.into_iter().map(|(_, draw)| draw).collect())
}

/// Number of release offsets of one release time that are compared with each other to find neighbours: the cost grows with its square.
const LINKED_TOGETHER: usize = 64;

/// Reorders the draws of each release time, `per_release_time` of them, so that the release offset of each is nearly that of the one
/// before: within [`LINKED_TOGETHER`] of them no exchange of two lowers the sum of squared differences to those before.
fn linked(mut kicks: Vec<Draw>, per_release_time: usize) -> Vec<Draw> {
    for first in (per_release_time..kicks.len()).step_by(per_release_time) {
        let (before, rest) = kicks.split_at_mut(first);
        let (before, now) = (
            &before[first - per_release_time..],
            &mut rest[..per_release_time],
        );
        let apart = |i: usize, draw: &Draw| before[i].offset.squared_distance(&draw.offset);
        let mut moved = true;
        while moved {
            moved = false;
            let earlier = |i| (i - i % LINKED_TOGETHER..i).map(move |j| (i, j));
            for (i, j) in (0..per_release_time).flat_map(earlier) {
                let gain =
                    apart(i, &now[i]) + apart(j, &now[j]) - apart(i, &now[j]) - apart(j, &now[i]);
                // A tolerance, so that rounding does not exchange two of them forever.
                if gain > 1e-9 {
                    now.swap(i, j);
                    moved = true;
                }
            }
        }
    }
    kicks
}

fn tail_number(tail: Tail) -> u64 {
    match tail {
        Tail::Leading => 0,
        Tail::Trailing => 1,
    }
}
