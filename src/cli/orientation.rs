//! `oblate orientation`.

use super::exit::Exit;
use super::options::JsonFlag;
use super::output::{Output, note};
use super::run_folders::{finished, run_folders, with_track};
use crate::error::Result;
use crate::population::{Alignment, AlignmentEvidence, AxisPosterior, alignments};
use crate::posterior::Interval;
use crate::run::{AxisDirection, axis_posteriors};
use serde_json::json;
use std::path::PathBuf;

/// Flags of `oblate orientation`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate orientation runs/mock_*\n  oblate orientation runs/galaxy_* --to disc\n\n\
The minor axis of a halo is its symmetry axis where q < 1, and any direction perpendicular to it where q > 1; that of a triaxial halo is \
its shortest one. ln odds are ln Z less that of isotropic axes."
)]
pub struct Args {
    /// Finished fits, each of another stream; others are skipped with a note
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The direction that minor axes are compared with
    #[arg(long, value_enum, default_value_t)]
    to: Direction,
    #[command(flatten)]
    output: JsonFlag,
}

/// The direction that minor axes are compared with.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum Direction {
    /// The line of sight
    #[default]
    LineOfSight,
    /// The normal of the disc, of fits with a disc of free or known angles
    Disc,
}

/// Prints the angle of each stream, and how the axes of all of them lie.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    let direction = match args.to {
        Direction::LineOfSight => AxisDirection::LineOfSight,
        Direction::Disc => AxisDirection::Disc,
    };
    let streams = axis_posteriors(&finished(&with_track(&run_folders(&args.runs))), direction)?;
    for stream in streams.iter().filter(|stream| !stream.converged) {
        note(&format!(
            "the fit {} has not converged: fit it longer",
            stream.name
        ));
    }
    let found = alignments(&streams)?;
    if args.output.json {
        let of_stream =
            |stream: &AxisPosterior| json!({"name": stream.name, "angle_deg": stream.angle_deg()});
        let streams: Vec<_> = streams.iter().map(of_stream).collect();
        out.json(&json!({"streams": streams, "alignments": found}))?;
        return Ok(Exit::Done);
    }
    out.line("angle, degrees: median, 68 %, 95 % (isotropic: 60, 33 to 81, 13 to 89)")?;
    for stream in &streams {
        out.line(&format!(
            "{:>24} {}",
            stream.name,
            numbers(&stream.angle_deg())
        ))?;
    }
    out.line(&format!(
        "\nof {} streams: ln odds, and what follows",
        streams.len()
    ))?;
    for population in &found {
        out.line(&line(population))?;
    }
    Ok(Exit::Done)
}

fn numbers(interval: &Interval) -> String {
    let Interval {
        median,
        lo68,
        hi68,
        lo95,
        hi95,
        ..
    } = interval;
    format!("{median:6.2}  [{lo68:.2}, {hi68:.2}]  [{lo95:.2}, {hi95:.2}]")
}

fn line(population: &AlignmentEvidence) -> String {
    let AlignmentEvidence {
        alignment,
        ln_odds,
        error,
        scale_deg,
        fraction,
    } = population;
    let name = match alignment {
        Alignment::Isotropic => "isotropic",
        Alignment::Aligned => "aligned",
        Alignment::Mixture => "mixture",
    };
    let mut text = format!("{name:>12} {ln_odds:8.2} +- {error:.2}");
    for (what, interval) in [
        ("scale, degrees", scale_deg),
        ("fraction aligned", fraction),
    ] {
        if let Some(interval) = interval {
            text.push_str(&format!("   {what}: {}", numbers(interval)));
        }
    }
    text
}
