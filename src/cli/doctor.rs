//! `oblate doctor`.

use super::eta::duration;
use super::exit::Exit;
use super::options::{JsonFlag, WorkFlags};
use super::output::{Output, note};
use crate::error::Result;
use crate::inference::Speed;
use crate::posterior::SUMMARY_FORMAT;
use crate::scalar::Level;
use oblate_samplers::checkpoint::FORMAT_VERSION;
use oblate_samplers::limits::in_range;
use oblate_samplers::rng::STREAM_VERSION;
use serde_json::json;
use std::time::Duration;

/// Flags of `oblate doctor`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  oblate doctor\n\n\
The predicted time is that of a default fit with all 13 parameters free and the machine to itself; fixed parameters make it shorter.")]
pub struct Args {
    /// Seconds of the benchmark
    #[arg(long, default_value_t = 5, value_name = "SECONDS")]
    seconds: u64,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

/// Describes the machine.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    in_range("--seconds", args.seconds, 1..=10)?;
    let level = match Level::best() {
        Level::Avx512 => "AVX-512",
        Level::Avx2 => "AVX2",
        Level::Baseline if cfg!(target_arch = "aarch64") => "NEON",
        Level::Baseline if cfg!(target_arch = "x86_64") => "SSE2",
        Level::Baseline => "portable",
    };
    let threads = rayon::current_num_threads();
    let cores = std::thread::available_parallelism().map_or(threads, usize::from);
    let version = env!("CARGO_PKG_VERSION");
    if !args.work.quiet {
        note(&format!("measuring for {} s", args.seconds));
    }
    let speed = Speed::measure(Duration::from_secs(args.seconds))?;
    let coarse = speed.first();
    let [shortest, mean, longest] = speed.seconds_of_fit();
    if args.output.json {
        out.json(&json!({
            "version": version,
            "stream_version": STREAM_VERSION,
            "checkpoint_format": FORMAT_VERSION,
            "summary_format": SUMMARY_FORMAT,
            "system": format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            "instruction_set": level,
            "threads": threads,
            "cores": cores,
            "values_per_second": {"model": speed.model, "coarse": coarse},
            "seconds_of_fit": [shortest, mean, longest],
        }))?;
        return Ok(Exit::Done);
    }
    let rows = [
        (
            "oblate",
            format!(
                "{version}; random streams {STREAM_VERSION}, checkpoints {FORMAT_VERSION}, summaries {SUMMARY_FORMAT}"
            ),
        ),
        (
            "system",
            format!("{} on {}", std::env::consts::OS, std::env::consts::ARCH),
        ),
        ("instruction set", level.to_owned()),
        ("threads", format!("{threads} of {cores} cores")),
        (
            "default model",
            format!("{:.0} values of ln L per second", speed.model),
        ),
        (
            "coarse model",
            format!("{coarse:.0} values of ln L per second"),
        ),
        (
            "a default fit",
            format!(
                "{} to {}, {} in the mean, with all 13 parameters free",
                duration(shortest),
                duration(longest),
                duration(mean)
            ),
        ),
    ];
    for (name, value) in rows {
        out.line(&format!("{name:<16} {value}"))?;
    }
    Ok(Exit::Done)
}
