//! `oblate evaluate`: the likelihood for programs in any language.

use super::exit::Exit;
use super::options::{Common, FitFlags, TrackFlags};
use super::output::{Output, note};
use crate::error::{Error, Result};
use crate::inference::StreamTarget;
use crate::params::{NAMES, ParameterLines};
use serde_json::json;
use std::io::BufRead;
use std::path::PathBuf;
use std::time::Instant;

/// Flags of `oblate evaluate`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate evaluate track.ecsv --gradient < parameters.jsonl\n\n\
Each input line is a JSON object with the 13 parameters; each output line is\n  \
{\"ln_likelihood\": x or null, \"rejected\": cause or null, \"gradient\": {name: ..}, \"seconds\": ..}"
)]
pub struct Args {
    /// The track (ECSV or CSV)
    track: PathBuf,
    /// Print the gradient with respect to the 13 parameters too
    #[arg(long)]
    gradient: bool,
    #[command(flatten)]
    reading: TrackFlags,
    #[command(flatten)]
    settings: FitFlags,
}

/// Answers each line before reading the next, until the reader closes the output.
pub fn run(
    args: &Args,
    common: &Common,
    input: &mut dyn BufRead,
    out: &mut Output<'_>,
) -> Result<Exit> {
    let settings = args.settings.settings()?;
    let track = args.reading.read(&args.track)?;
    for assumption in track.assumptions() {
        note(&format!("assumed: {assumption}"));
    }
    let target = StreamTarget::from_track(&track, &settings)?;
    common.tell_memory(&target.memory(1));
    let stdin = PathBuf::from("standard input");
    for line in ParameterLines::new(input, stdin.clone()) {
        let (number, params) = line?;
        target
            .stream_prior()
            .check_inside(&params)
            .map_err(|e| Error::InFile {
                path: stdin.clone(),
                line: Some(number),
                source: Box::new(e),
            })?;
        let begin = Instant::now();
        let theta = params.to_array();
        let likelihood = target.likelihood();
        let outcome = if args.gradient {
            likelihood
                .gradient_in_parallel(&theta)
                .map(|(e, g)| (e.ln_likelihood, Some(g)))
        } else {
            likelihood
                .ln_likelihood_in_parallel(&theta)
                .map(|e| (e.ln_likelihood, None))
        };
        let seconds = begin.elapsed().as_secs_f64();
        let answer = match outcome {
            Ok((l, None)) => json!({"ln_likelihood": l, "rejected": null, "seconds": seconds}),
            Ok((l, Some(g))) => {
                let gradient: serde_json::Map<String, serde_json::Value> = NAMES
                    .iter()
                    .zip(g)
                    .map(|(n, g)| ((*n).to_owned(), g.into()))
                    .collect();
                json!({"ln_likelihood": l, "rejected": null, "gradient": gradient, "seconds": seconds})
            }
            Err(cause) => {
                json!({"ln_likelihood": null, "rejected": cause.name(), "seconds": seconds})
            }
        };
        out.json(&answer)?;
        if out.closed() {
            break;
        }
    }
    Ok(Exit::Done)
}
