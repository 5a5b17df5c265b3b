//! The release table: release time, tail and release offset of each particle, made once from a random seed. Nothing else between
//! parameters and ln L uses random numbers (docs/physics.md, section 4).

use super::neighbourhood::{Neighbourhood, smearing};
use super::{MAX_NORMALS, Recipe, ReleaseOffset, Tail};
use crate::error::{Error, Result};
use oblate_samplers::limits::{MAX_SEED, in_range};
use oblate_samplers::normal::quantile;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How the random numbers of the releases are spread (docs/physics.md, section 4, "Sampling scheme").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SamplingScheme {
    /// Independent normals, as in Chemaly et al. (2026).
    Random,
    /// For each tail one Sobol set with Owen scrambling over release time and normals.
    Sobol,
    /// The Sobol set, each particle smeared by its neighbours in the space of the normals and by a partner with nearly the same release
    /// offset at the next release time ([`Neighbourhood`]).
    #[default]
    SobolSmeared,
}

impl SamplingScheme {
    /// The mean square error of a bin's mean radius over the Monte-Carlo variance of independent particles, measured by
    /// `cargo bench --bench noise` (docs/physics.md, section 7).
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

/// Settings of a release table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TableSettings {
    /// Number of particles, both tails together.
    pub particles: usize,
    /// Number of release times; 0 chooses 100 for `random`. For the Sobol schemes it chooses as many as give each release time 32, 16 or
    /// 8 particles, the first of these that divides `particles`; `sobol` has 32 only from 2,048 particles on.
    pub release_times: usize,
    /// Sampling scheme.
    pub sampling_scheme: SamplingScheme,
    /// Release recipe.
    pub recipe: Recipe,
    /// Random seed of the table.
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
    /// Checks that every number is in its range of docs/limits.md.
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
            // 32 for any number of particles: with more particles of a tail at one release time, neighbours are nearer.
            (0, SamplingScheme::SobolSmeared) => sobol_release_times(self.particles, 0),
            (given, _) => given,
        }
    }
}

/// Settings key of the number of particles.
const PARTICLES: &str = "model.releases.particles";

/// One particle of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    /// Its tail.
    pub tail: Tail,
    /// Its release offset.
    pub offset: ReleaseOffset,
}

/// All releases by release time, the earliest first. Each release time has equally many particles of both tails, the leading tail first.
#[derive(Clone, Debug, PartialEq)]
pub struct ReleaseTable {
    /// Release times as fractions of the age, in [-1, 0).
    pub taus: Vec<f64>,
    /// The particles, `taus.len() * per_release_time` of them.
    pub releases: Vec<Release>,
    /// Number of particles of a release time.
    pub per_release_time: usize,
    /// The recipe of the release offsets.
    pub recipe: Recipe,
    /// The neighbours of each particle ([`SamplingScheme::SobolSmeared`] with several release times).
    pub neighbourhood: Option<Arc<Neighbourhood>>,
}

impl ReleaseTable {
    /// Makes the table of these settings.
    ///
    /// # Errors
    /// Those of [`TableSettings::check`]; [`Error::Setting`] if the number of particles is not a multiple of twice the number of release
    /// times or too large for the sampling scheme, or if the random seed gives no release offset.
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
        let offsets = |tail| {
            Ok::<_, Error>(match settings.sampling_scheme {
                SamplingScheme::Random => random_offsets(settings, tail, n / 2)?,
                SamplingScheme::Sobol => sobol_offsets(settings, tail, n / 2, 0.0)?,
                SamplingScheme::SobolSmeared => {
                    order_by_partner(sobol_offsets(settings, tail, n / 2, smearing)?, per_tail)
                }
            })
        };
        let offsets = [offsets(tails[0])?, offsets(tails[1])?];
        let mut releases = Vec::with_capacity(n);
        let mut xi = Vec::with_capacity(n);
        for release_time in 0..release_times {
            for (tail, offsets) in tails.iter().zip(&offsets) {
                let these = &offsets[release_time * per_tail..(release_time + 1) * per_tail];
                xi.extend(these.iter().map(|pair| pair.xi));
                releases.extend(these.iter().map(|pair| Release {
                    tail: *tail,
                    offset: pair.offset,
                }));
            }
        }
        let neighbourhood = smeared.then(|| {
            let normals = settings.recipe.normals();
            Arc::new(Neighbourhood::new(&xi, normals, per_tail, smearing))
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

/// Default number of release times of `n` particles of a Sobol scheme, with 32 particles each only from `min_for_32` particles on. More
/// release times do not lower the noise of a track.
fn sobol_release_times(n: usize, min_for_32: usize) -> usize {
    let per_release_time = [32, 16, 8]
        .into_iter()
        .find(|k| n.is_multiple_of(*k) && (*k < 32 || n >= min_for_32));
    (n / per_release_time.unwrap_or(8)).max(1)
}

/// Largest number of tries for one release offset. A try fails with a probability of 2.4e-6 at most.
const MAX_TRIES: u64 = 64;

/// The standard normals of a particle and the release offset that follows from them.
#[derive(Clone, Copy)]
struct NormalsAndOffset {
    xi: [f64; MAX_NORMALS],
    offset: ReleaseOffset,
}

/// The first try that gives a release offset; the argument of `attempt` is the number of the try, from 0.
///
/// # Errors
/// [`Error::Setting`] if none of [`MAX_TRIES`] gives one.
fn first_valid(attempt: impl FnMut(u64) -> Option<NormalsAndOffset>) -> Result<NormalsAndOffset> {
    (0..MAX_TRIES)
        .find_map(attempt)
        .ok_or_else(|| Error::Setting {
            key: "model.releases.seed".to_owned(),
            value: format!("{MAX_TRIES} draws without a release offset"),
            remedy: "give another seed".to_owned(),
        })
}

/// Independent release offsets. A repeated try takes the next normals of the same random stream.
fn random_offsets(
    settings: &TableSettings,
    tail: Tail,
    count: usize,
) -> Result<Vec<NormalsAndOffset>> {
    let mut rng = stream(settings.seed, Domain::Releases, tail_number(tail), 0);
    let mut next = || {
        first_valid(|_| {
            let mut xi = [0.0; MAX_NORMALS];
            for x in xi.iter_mut().take(settings.recipe.normals()) {
                *x = standard_normal(&mut rng);
            }
            let offset = settings.recipe.release_offset(&xi, tail);
            offset.map(|offset| NormalsAndOffset { xi, offset })
        })
    };
    (0..count).map(|_| next()).collect()
}

/// The release offsets of a scrambled Sobol set, sorted by its first coordinate, the release time. The index of a point must not choose the
/// release time or the tail, because its low bits determine the leading bits of the coordinates. The variance of the normals is 1 less
/// that of the smearing.
fn sobol_offsets(
    settings: &TableSettings,
    tail: Tail,
    count: usize,
    smearing: f64,
) -> Result<Vec<NormalsAndOffset>> {
    let narrower = (1.0 - smearing * smearing).sqrt();
    // Each tail and each repeated try has a scramble of its own, given by a seed of 32 bits.
    let scramble = |attempt: u64| {
        let mut rng = stream(
            settings.seed,
            Domain::Releases,
            tail_number(tail),
            1 + attempt,
        );
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
        // The generator gives multiples of 2^-24; the centre of the cell is taken, so that no normal is infinite.
        f64::from(sobol_burley::sample(i as u32, dimension as u32, seed))
            + 0.5 / f64::from(1_u32 << 24)
    };
    let mut rows: Vec<(f64, NormalsAndOffset)> = Vec::with_capacity(count);
    for i in 0..count {
        let pair = first_valid(|attempt| {
            let seed = scramble(attempt);
            let mut xi = [0.0; MAX_NORMALS];
            for (d, x) in xi.iter_mut().enumerate().take(settings.recipe.normals()) {
                *x = narrower * quantile(point(i, d + 1, seed));
            }
            let offset = settings.recipe.release_offset(&xi, tail);
            offset.map(|offset| NormalsAndOffset { xi, offset })
        })?;
        rows.push((point(i, 0, scramble(0)), pair));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(rows.into_iter().map(|(_, pair)| pair).collect())
}

/// Number of particles of one tail and release time that exchange places with each other: the cost grows with its square.
const EXCHANGED_TOGETHER: usize = 64;

/// Reorders the release offsets of one tail, `per_tail` at each release time, so that each is nearly that of its partner at the release time
/// before: among [`EXCHANGED_TOGETHER`] of them no exchange of two lowers the sum of squared distances to the partners.
fn order_by_partner(mut offsets: Vec<NormalsAndOffset>, per_tail: usize) -> Vec<NormalsAndOffset> {
    for first in (per_tail..offsets.len()).step_by(per_tail) {
        let (before, rest) = offsets.split_at_mut(first);
        let (before, now) = (&before[first - per_tail..], &mut rest[..per_tail]);
        let distance2 =
            |i: usize, now: &NormalsAndOffset| before[i].offset.squared_distance(&now.offset);
        let mut moved = true;
        while moved {
            moved = false;
            let earlier = |i| (i - i % EXCHANGED_TOGETHER..i).map(move |j| (i, j));
            for (i, j) in (0..per_tail).flat_map(earlier) {
                let gain = distance2(i, &now[i]) + distance2(j, &now[j])
                    - distance2(i, &now[j])
                    - distance2(j, &now[i]);
                // The tolerance prevents an endless exchange by rounding.
                if gain > 1e-9 {
                    now.swap(i, j);
                    moved = true;
                }
            }
        }
    }
    offsets
}

fn tail_number(tail: Tail) -> u64 {
    match tail {
        Tail::Leading => 0,
        Tail::Trailing => 1,
    }
}
