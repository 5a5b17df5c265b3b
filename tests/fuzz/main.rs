//! Damaged input of every reader: no panic, no unbounded memory, and what is accepted can be used.
//!
//! The tests run a few hundred cases of each reader, or as many as `OBLATE_FUZZ_CASES` says. The ignored one runs 100,000 of each, and
//! prints a table.
#![allow(
    clippy::cast_possible_truncation,
    reason = "tests cast small counts of their own"
)]

mod checkpoint;
mod folder;
mod harness;
mod mutate;
#[allow(dead_code, reason = "some runs are for other tests")]
#[path = "../integration/runs.rs"]
mod runs;
mod text;
mod track;

use folder::Part;
use harness::{Counts, Reader};
use oblate::data::ObservedTrack;

const MIB: u64 = 1 << 20;

/// Memory that one case may take: what a reader makes of damaged input of up to 200 kB.
const BOUND: u64 = 64 * MIB;

/// Folders of the cases, in memory where there is a file system for it.
fn temporary() -> tempfile::TempDir {
    let memory = std::path::Path::new("/dev/shm");
    if memory.is_dir() {
        tempfile::tempdir_in(memory)
            .or_else(|_| tempfile::tempdir())
            .unwrap()
    } else {
        tempfile::tempdir().unwrap()
    }
}

/// A number of cases, unless another one is asked for.
fn cases(usual: u64) -> u64 {
    std::env::var("OBLATE_FUZZ_CASES").map_or(usual, |number| number.parse().unwrap())
}

macro_rules! readers {
    ($($test:ident, $task:literal, $name:literal, $short:literal, $fraction:literal, |$cases:ident, $reader:ident, $folder:ident| $run:expr;)*) => {
        $(
            #[test]
            fn $test() {
                $test::counts(cases($short)).assert(BOUND);
            }

            mod $test {
                use super::*;

                pub fn counts($cases: u64) -> Counts {
                    let $reader = Reader { name: $name, task: $task };
                    let $folder = temporary();
                    $run
                }
            }
        )*

        /// Slow readers have a fraction of the cases only.
        #[test]
        #[ignore = "many minutes; prints the table of docs/reliability.md"]
        fn all() {
            let cases = cases(100_000);
            println!("| input | accepted | refused | panics | longest case (s) | most memory (MiB) |\n|---|---|---|---|---|---|");
            let all: Vec<Counts> = vec![$({
                let counts = $test::counts((cases as f64 * $fraction) as u64);
                println!("{counts}");
                counts
            }),*];
            all.iter().for_each(|counts| counts.assert(BOUND));
        }
    };
}

readers! {
    ecsv, 1, "track, ECSV", 500, 1.0, |cases, reader, folder| {
        let (seeds, path) = (track::ecsv_seeds(), folder.path().join("track.ecsv"));
        reader.run(cases, |rng| track::case(rng, &seeds, &path))
    };
    csv, 2, "track, CSV", 500, 1.0, |cases, reader, folder| {
        let (seeds, path) = (track::csv_seeds(), folder.path().join("track.csv"));
        reader.run(cases, |rng| track::case(rng, &seeds, &path))
    };
    settings, 3, "settings", 500, 1.0, |cases, reader, folder| {
        let (seeds, path) = (text::fit_seeds(), folder.path().join("fit.toml"));
        let track = ObservedTrack::new("toy", &[5.0, 15.0, 25.0], 10.0, &[60.0, 61.0, 62.0], &[1.2, 1.22, 1.24]).unwrap();
        reader.run(cases, |rng| text::fit_case(rng, &seeds, &track, &path))
    };
    study, 4, "study", 500, 1.0, |cases, reader, folder| {
        let (seeds, path) = (text::study_seeds(), folder.path().join("study.toml"));
        reader.run(cases, |rng| text::study_case(rng, &seeds, &path))
    };
    parameters, 5, "parameters", 500, 1.0, |cases, reader, folder| {
        let (seeds, path) = (text::parameter_seeds(), folder.path().join("params.toml"));
        reader.run(cases, |rng| text::parameter_case(rng, &seeds, &path))
    };
    lines, 6, "JSON lines", 500, 1.0, |cases, reader, _folder| {
        let seeds = text::line_seeds();
        reader.run(cases, |rng| text::line_case(rng, &seeds))
    };
    nested_checkpoint, 7, "checkpoint, nested", 300, 1.0, |cases, reader, folder| {
        let seeds = checkpoint::nested_seeds();
        reader.run(cases, |rng| checkpoint::case(rng, &seeds, folder.path()))
    };
    pt_checkpoint, 8, "checkpoint, pt-hmc", 300, 1.0, |cases, reader, folder| {
        let seeds = checkpoint::pt_seeds();
        reader.run(cases, |rng| checkpoint::case(rng, &seeds, folder.path()))
    };
    bridge_checkpoint, 9, "checkpoint, bridge", 300, 1.0, |cases, reader, folder| {
        let seeds = checkpoint::bridge_seeds();
        reader.run(cases, |rng| checkpoint::case(rng, &seeds, folder.path()))
    };
    summary, 10, "summary", 300, 1.0, |cases, reader, folder| {
        let seeds = folder::seeds(folder.path(), Part::Summary);
        reader.run(cases, |rng| folder::case(rng, &seeds, Part::Summary))
    };
    versions, 11, "versions", 300, 1.0, |cases, reader, folder| {
        let seeds = folder::seeds(folder.path(), Part::Versions);
        reader.run(cases, |rng| folder::case(rng, &seeds, Part::Versions))
    };
    metadata, 12, "Zarr metadata", 300, 1.0, |cases, reader, folder| {
        let seeds = folder::seeds(folder.path(), Part::Metadata);
        reader.run(cases, |rng| folder::case(rng, &seeds, Part::Metadata))
    };
    chunks, 13, "Zarr chunks", 300, 1.0, |cases, reader, folder| {
        let seeds = folder::seeds(folder.path(), Part::Chunks);
        reader.run(cases, |rng| folder::case(rng, &seeds, Part::Chunks))
    };
    report, 14, "report of Zarr chunks", 20, 0.01, |cases, reader, folder| {
        let seeds = folder::seeds(folder.path(), Part::Chunks);
        reader.run(cases, |rng| folder::report_case(rng, &seeds))
    };
}
