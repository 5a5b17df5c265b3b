//! `oblate fit`.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::folder::FolderFlags;
use super::next::{after_fit, tell_coarse};
use super::options::{LimitFlags, ModelFlags, TrackFlags, sampler};
use super::output::Output;
use super::senses::fit_both;
use super::set::SetFlags;
use crate::data::Handedness;
use crate::error::{Error, Result};
use crate::inference::{FitSettings, Sampler};
use crate::run::{RunFolder, fit};
use std::path::PathBuf;

/// Flags of `oblate fit`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  oblate fit track.ecsv --seed 3 --out runs/track\n  oblate fit track.ecsv --sampler nested --out runs/track_nested\n  \
oblate fit track.ecsv --handedness both --out runs/track\n\n\
Both senses have a run folder each in FOLDER, and a table of their evidences and probabilities is printed.",
    mut_arg("out", |out| out.required(false).required_unless_present("print_config"))
)]
pub struct Args {
    /// The track (ECSV or CSV)
    #[arg(required_unless_present = "print_config")]
    track: Option<PathBuf>,
    /// nested or pt-hmc
    #[arg(long, value_parser = sampler)]
    sampler: Option<Sampler>,
    /// Print all settings as TOML and stop
    #[arg(long)]
    print_config: bool,
    /// Number of particles of the coarse model that is fitted first; 0: none
    #[arg(long)]
    coarse_particles: Option<usize>,
    /// Number of live points of the nested sampler
    #[arg(long)]
    live: Option<usize>,
    /// Number of rounds of the tempered sampler, each twice as long as the one before
    #[arg(long)]
    rounds: Option<usize>,
    /// Maximum number of extensions of the tempered sampler's last round while it fails its convergence checks; with --resume, more
    /// than before extends a finished fit
    #[arg(long)]
    extensions: Option<usize>,
    #[command(flatten)]
    reading: TrackFlags,
    /// Settings file (TOML); flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    model: ModelFlags,
    /// Master seed of the sampler
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    set: SetFlags,
    #[command(flatten)]
    limits: LimitFlags,
    #[command(flatten)]
    folder: FolderFlags,
}

/// Fits one track.
pub fn run(args: &Args, command: &CommandLine, out: &mut Output<'_>) -> Result<Exit> {
    let settings = settings(args)?;
    if args.print_config {
        out.bytes(commented(&crate::config::to_toml(&settings)?).as_bytes())?;
        return Ok(Exit::Done);
    }
    let Some(path) = &args.track else {
        return Err(Error::Setting {
            key: "TRACK".to_owned(),
            value: "missing".to_owned(),
            remedy: "name the track to fit".to_owned(),
        });
    };
    if args.reading.both_senses() {
        let read = |sense| args.reading.read_in(path, Some(sense));
        let tracks = (read(Handedness::AsGiven)?, read(Handedness::Mirrored)?);
        return fit_both(
            [&tracks.0, &tracks.1],
            &settings,
            &args.folder,
            &args.limits,
            command,
            out,
        );
    }
    let track = args.reading.read(path)?;
    let label = format!("{} {}", track.name, settings.sampling.sampler.name());
    args.folder.fill(
        &label,
        command,
        &args.limits,
        out,
        |destination, monitor| fit(&track, &settings, destination, monitor),
        |fit, folder| {
            let folder = RunFolder::open(folder)?;
            tell_coarse(&fit.summary, &folder);
            Ok(after_fit(&fit.summary, &settings, &folder, command))
        },
    )
}

/// Comments of the printed settings, each above its table; the first is above all.
const COMMENTS: [(&str, &str); 5] = [
    (
        "",
        "Settings of a fit; docs/limits.md has the smallest and the largest value of each.",
    ),
    (
        "[model]",
        "The model of the stream: docs/physics.md, sections 3 to 5",
    ),
    (
        "[likelihood]",
        "Its comparison with the data: docs/physics.md, sections 6 and 7",
    ),
    (
        "[prior]",
        "Range of q, distributions and fixed values: docs/files.md, section 3",
    ),
    ("[sampling]", "The samplers: docs/samplers.md, section 6"),
];

/// Settings as TOML with the comments.
fn commented(toml: &str) -> String {
    let mut text = format!("# {}\n", COMMENTS[0].1);
    for line in toml.lines() {
        if let Some((_, comment)) = COMMENTS[1..].iter().find(|(table, _)| *table == line) {
            text += &format!("# {comment}\n");
        }
        text += &format!("{line}\n");
    }
    text
}

/// The file's settings with the flags applied.
fn settings(args: &Args) -> Result<FitSettings> {
    let mut settings = args.model.settings(args.config.as_deref())?;
    settings.seed = args.seed.unwrap_or(settings.seed);
    let sampling = &mut settings.sampling;
    sampling.sampler = args.sampler.unwrap_or(sampling.sampler);
    sampling.nested.n_live = args.live.unwrap_or(sampling.nested.n_live);
    sampling.pt_hmc.rounds = args.rounds.unwrap_or(sampling.pt_hmc.rounds);
    sampling.pt_hmc.extensions = args.extensions.unwrap_or(sampling.pt_hmc.extensions);
    settings.coarse_particles = args.coarse_particles.unwrap_or(settings.coarse_particles);
    args.set.apply(&mut settings)?;
    Ok(settings)
}
