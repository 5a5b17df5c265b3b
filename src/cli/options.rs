//! Common flags of subcommands, and how they change settings.

use super::output::note;
use crate::config::read;
use crate::data::{AssumedError, Handedness, ObservedTrack, ReadOptions};
use crate::error::{Error, OutputFault, Result};
use crate::inference::{FitSettings, Profile, Sampler};
use crate::likelihood::LikelihoodSettings;
use crate::potential::HaloKind;
use crate::spray::SamplingScheme;
use crate::stream::ModelSettings;
use clap::{Args, ValueEnum};
use oblate_samplers::files::{create_atomically, write_atomically};
use oblate_samplers::limits::{Memory, in_range};
use std::io::ErrorKind;
use std::ops::RangeInclusive;
use std::path::Path;
use std::str::FromStr;

/// Allowed numbers of threads: more than the cores of any computer only take memory and time to start.
const THREADS: RangeInclusive<usize> = 1..=1024;

/// Seconds between checkpoints.
const CHECKPOINT_EVERY: u64 = 30;

/// The environment variable with the number of threads of rayon.
const THREADS_VARIABLE: &str = "RAYON_NUM_THREADS";

/// Flags of subcommands that compute.
#[derive(Args, Debug)]
pub struct WorkFlags {
    /// Number of threads, all cores by default; results do not depend on it
    #[arg(long)]
    threads: Option<usize>,
    /// Print results only: no progress, and no warning of much memory
    #[arg(short, long)]
    pub quiet: bool,
}

impl WorkFlags {
    /// Starts the given number of threads, for all work of the process.
    pub fn start_threads(&self) -> Result<()> {
        if let Some(threads) = self.threads {
            in_range("--threads", threads, THREADS)?;
            // The global pool: subcommands call the library from the main thread, which is not one of the pool's.
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build_global()
                .map_err(|e| Error::Setting {
                    key: "--threads".to_owned(),
                    value: threads.to_string(),
                    remedy: e.to_string(),
                })?;
        } else if let Some(threads) = std::env::var(THREADS_VARIABLE)
            .ok()
            .and_then(|text| text.parse().ok())
        {
            // For rayon 0 means all cores.
            in_range(THREADS_VARIABLE, threads, 0..=*THREADS.end())?;
        }
        Ok(())
    }

    /// Writes to standard error how much memory will be used, if it is much.
    pub fn tell_memory(&self, memory: &Memory) {
        if let Some(warning) = memory.warning().filter(|_| !self.quiet) {
            note(&format!("warning: {warning}"));
        }
    }
}

/// The flag of subcommands whose result is text or JSON.
#[derive(Args, Clone, Copy, Debug)]
pub struct JsonFlag {
    /// Print JSON instead of text
    #[arg(long)]
    pub json: bool,
}

/// Flags of a run that writes checkpoints.
#[derive(Args, Clone, Copy, Debug)]
pub struct LimitFlags {
    /// Seconds between checkpoints: the maximum of work that is lost if the process is killed
    #[arg(long, default_value_t = CHECKPOINT_EVERY, value_name = "SECONDS")]
    pub checkpoint_every: u64,
    /// Minutes after which a run ends, unconverged, with its result so far; the same command, with --resume for a single run,
    /// continues it
    #[arg(long, value_name = "MINUTES")]
    pub max_minutes: Option<u64>,
}

impl Default for LimitFlags {
    fn default() -> Self {
        Self {
            checkpoint_every: CHECKPOINT_EVERY,
            max_minutes: None,
        }
    }
}

impl LimitFlags {
    /// Checks both: a day between checkpoints, ten years for a run.
    pub fn check(&self) -> Result<()> {
        in_range("--checkpoint-every", self.checkpoint_every, 0..=86_400)?;
        let minutes = self.max_minutes.unwrap_or(0);
        in_range("--max-minutes", minutes, 0..=5_256_000)?;
        Ok(())
    }
}

/// Flags of the model, shared by `stream`, `evaluate`, `mock` and `fit`.
#[derive(Args, Debug, Default)]
pub struct ModelFlags {
    /// Named settings: `fast` (smeared Sobol particles, soft bin edges, a penalty) or `paper` (10,000 random particles, hard edges, rejection)
    #[arg(long, value_enum)]
    profile: Option<ProfileName>,
    /// Kind of halo: `nfw` flattened in its potential, as in the paper, `nfw-density` flattened in its density, `nfw-triaxial` with a second axis, or `logarithmic`
    #[arg(long, value_enum)]
    halo: Option<HaloName>,
    /// Number of particles, both tails together
    #[arg(long)]
    particles: Option<usize>,
    /// Number of steps; the fewest, where steps are adaptive
    #[arg(long)]
    steps: Option<usize>,
    /// Sampling scheme of the releases
    #[arg(long, value_enum)]
    sampling_scheme: Option<SchemeName>,
    /// Seed of the table of releases
    #[arg(long)]
    model_seed: Option<u64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ProfileName {
    Fast,
    Paper,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum HaloName {
    Nfw,
    NfwDensity,
    NfwTriaxial,
    Logarithmic,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SchemeName {
    Random,
    Sobol,
    SobolSmeared,
}

impl ModelFlags {
    /// Settings of a fit: the file's or the defaults, with these flags applied.
    pub fn settings(&self, config: Option<&Path>) -> Result<FitSettings> {
        let mut settings = fit_settings(config)?;
        self.apply_to_fit(&mut settings);
        Ok(settings)
    }

    /// Applies the profile, then the other flags, to a fit's settings. The host belongs to the physics, not to the profile.
    pub fn apply_to_fit(&self, settings: &mut FitSettings) {
        if let Some(profile) = self.profile() {
            settings.model = profile.model().with_host_of(&settings.model);
            settings.likelihood = LikelihoodSettings {
                // These belong to the data, not to the profile.
                error_floor_percent: settings.likelihood.error_floor_percent,
                error_correlation: settings.likelihood.error_correlation,
                ..profile.likelihood()
            };
        }
        self.apply(&mut settings.model);
    }

    /// Applies all of them to the model of mocks, whose table of releases keeps a seed of its own.
    pub fn apply_to_mocks(&self, model: &mut ModelSettings) {
        if let Some(profile) = self.profile() {
            let seed = model.releases.seed;
            *model = profile.model().with_host_of(model);
            model.releases.seed = seed;
        }
        self.apply(model);
    }

    /// The profile, if one is named.
    pub fn profile(&self) -> Option<Profile> {
        self.profile.map(|p| match p {
            ProfileName::Fast => Profile::Fast,
            ProfileName::Paper => Profile::Paper,
        })
    }

    /// Applies the flags other than the profile to a model's settings.
    pub fn apply(&self, model: &mut ModelSettings) {
        if let Some(halo) = self.halo {
            model.halo = match halo {
                HaloName::Nfw => HaloKind::Nfw,
                HaloName::NfwDensity => HaloKind::NfwDensity,
                HaloName::NfwTriaxial => HaloKind::NfwTriaxial,
                HaloName::Logarithmic => HaloKind::Logarithmic,
            };
        }
        if let Some(scheme) = self.sampling_scheme {
            model.releases.sampling_scheme = match scheme {
                SchemeName::Random => SamplingScheme::Random,
                SchemeName::Sobol => SamplingScheme::Sobol,
                SchemeName::SobolSmeared => SamplingScheme::SobolSmeared,
            };
            model.releases.release_times = 0;
        }
        if let Some(particles) = self.particles {
            model.releases.particles = particles;
            model.releases.release_times = 0;
        }
        if let Some(steps) = self.steps {
            model.steps = steps;
        }
        if let Some(seed) = self.model_seed {
            model.releases.seed = seed;
        }
    }
}

/// Settings of a fit: the file's or the defaults.
pub fn fit_settings(config: Option<&Path>) -> Result<FitSettings> {
    config.map_or_else(|| Ok(FitSettings::default()), read)
}

/// Flags of subcommands that read a track.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct TrackFlags {
    /// Standard error of all radii, in per cent of the radius, for a track without errors; it is named with the result
    #[arg(long, value_name = "PERCENT", value_parser = parsed::<AssumedError>)]
    assume_error: Option<AssumedError>,
    /// `as-given` where the leading tail is at positive phi; `mirrored` changes the sign of phi; a fit takes `both`, and compares the two
    #[arg(long, value_name = "SENSE", value_parser = Senses::parse)]
    handedness: Option<Senses>,
}

/// The sense or the senses of phi in which a track is read.
#[derive(Clone, Copy, Debug)]
enum Senses {
    One(Handedness),
    Both,
}

impl Senses {
    fn parse(text: &str) -> std::result::Result<Self, String> {
        if text == "both" {
            return Ok(Self::Both);
        }
        parsed(text).map(Self::One)
    }
}

impl TrackFlags {
    /// Whether the track is to be read in both senses.
    pub fn both_senses(&self) -> bool {
        matches!(self.handedness, Some(Senses::Both))
    }

    /// Reads a track; these flags come before its header.
    pub fn read(&self, path: &Path) -> Result<ObservedTrack> {
        match self.handedness {
            Some(Senses::Both) => Err(Error::Setting {
                key: "--handedness".to_owned(),
                value: "both".to_owned(),
                remedy: "give one sense, `as-given` or `mirrored`: only a fit compares both"
                    .to_owned(),
            }),
            Some(Senses::One(sense)) => self.read_in(path, Some(sense)),
            None => self.read_in(path, None),
        }
    }

    /// Reads a track in this sense, or else in that of its header.
    pub fn read_in(&self, path: &Path, sense: Option<Handedness>) -> Result<ObservedTrack> {
        let options = ReadOptions {
            assumed_error: self.assume_error,
            handedness: sense,
        };
        ObservedTrack::read_with(path, &options)
    }
}

/// A value of the library on the command line, with the library's own remedy where it is wrong.
pub fn parsed<T: FromStr<Err = Error>>(text: &str) -> std::result::Result<T, String> {
    text.parse::<T>().map_err(|error| match error {
        Error::Setting { remedy, .. } => remedy,
        other => other.to_string(),
    })
}

/// A sampler's name on the command line.
pub fn sampler(text: &str) -> std::result::Result<Sampler, String> {
    parsed(text)
}

/// A finite number on the command line.
pub fn finite(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err("give a finite number".to_owned()),
    }
}

/// Fails if a file cannot be written to a path: without `force` if there is one, and always if there is anything but a regular file.
pub fn refuse_existing(path: &Path, force: bool) -> Result<()> {
    let kind = match std::fs::symlink_metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        Err(source) => {
            return Err(Error::Io {
                path: path.to_path_buf(),
                source,
                remedy: "choose a path in a folder that is there and readable",
            });
        }
        Ok(found) => found.file_type(),
    };
    if kind.is_file() && force {
        return Ok(());
    }
    let path = path.to_path_buf();
    let kind = match () {
        () if kind.is_file() => return Err(Error::Exists { path }),
        () if kind.is_dir() => "a folder",
        () if kind.is_symlink() => "a symbolic link",
        () => "a device or a pipe",
    };
    Err(Error::OutputPath {
        path,
        fault: OutputFault::NotAFile { kind },
    })
}

/// Writes a file completely or not at all; without `force` only where there is none, and never in the place of anything
/// but a regular file.
pub fn write_file(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    refuse_existing(path, force)?;
    if force {
        write_atomically(path, bytes)?;
        return Ok(());
    }
    create_atomically(path, bytes).map_err(|e| match e {
        oblate_samplers::Error::Io { source, .. } if source.kind() == ErrorKind::AlreadyExists => {
            Error::Exists {
                path: path.to_path_buf(),
            }
        }
        other => other.into(),
    })
}
