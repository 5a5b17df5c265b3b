//! Run folders: the summary, the versions, and the metadata and chunks of the arrays.

use crate::harness::Verdict;
use crate::mutate;
use crate::runs;
use oblate::FitSettings;
use oblate::config::to_toml;
use oblate::data::ObservedTrack;
use oblate::params::QPrior;
use oblate::population::{
    PopulationSettings, PopulationTarget, TruncatedGaussian, TruncatedGaussianSettings,
};
use oblate::posterior::{Summary, SummaryContext, column, columns, compare, zarr};
use oblate::report::{
    CornerColumn, Figure, FigureFormat, Group, PageRun, QCurve, corner, diagnostics, page,
};
use oblate::run::{
    Beginning, LockedFolder, RunFolder, StoredRun, Versions, q_posterior, render_report,
};
use oblate_samplers::Run;
use oblate_samplers::rng::{RandomStream, below};
use rand::Rng;
use std::path::{Path, PathBuf};

/// Which files are damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Summary,
    Versions,
    Metadata,
    Chunks,
}

/// A complete run folder.
pub struct Seed {
    folder: RunFolder,
    run: Run,
    /// Files of each part, with their content.
    files: Vec<(PathBuf, Vec<u8>)>,
}

/// Folders of finished runs of each kind, below `parent`.
pub fn seeds(parent: &Path, part: Part) -> Vec<Seed> {
    [
        ("nested", runs::nested(120, 1)),
        ("tempered", runs::tempered(120, 2)),
        ("refined", runs::bridged(120, 3)),
    ]
    .map(|(name, run)| seed(&parent.join(name), run, part))
    .into()
}

fn seed(path: &Path, run: Run, part: Part) -> Seed {
    let mut settings = FitSettings::default();
    settings.model.releases.particles = 64;
    let config = to_toml(&settings).unwrap();
    let context = SummaryContext {
        q_prior: Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }),
        ..SummaryContext::default()
    };
    let track = ObservedTrack::new(
        "toy",
        &[5.0, 15.0, 25.0],
        10.0,
        &[60.0, 61.0, 62.0],
        &[1.2, 1.22, 1.24],
    )
    .unwrap();
    let beginning = Beginning {
        versions: Versions::new(&[config.as_bytes()]),
        config_toml: config,
        track: Some(&track),
    };
    let locked = LockedFolder::create(path, false).unwrap();
    locked.begin(&beginning).unwrap();
    let beside = zarr::Extras {
        track: Some(&track),
        ..zarr::Extras::default()
    };
    locked
        .finish(&run, Summary::new(&run, &context), beside, &beginning)
        .unwrap();
    let folder = locked.folder().clone();
    let arrays = || {
        let mut files = Vec::new();
        collect(&folder.posterior().join("weighted"), &mut files);
        collect(&folder.posterior().join("history"), &mut files);
        files
    };
    let is_metadata = |file: &PathBuf| file.ends_with("zarr.json");
    let files: Vec<PathBuf> = match part {
        Part::Summary => vec![folder.summary()],
        Part::Versions => vec![folder.versions()],
        Part::Metadata => {
            let mut files: Vec<PathBuf> = arrays().into_iter().filter(is_metadata).collect();
            files.push(folder.posterior().join("zarr.json"));
            files
        }
        Part::Chunks => arrays()
            .into_iter()
            .filter(|file| !is_metadata(file))
            .collect(),
    };
    let files = files
        .into_iter()
        .map(|file| (file.clone(), std::fs::read(&file).unwrap()))
        .collect();
    Seed { folder, run, files }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
    files.sort();
}

/// Damages one or two files of a run folder, reads it, and makes all output of the command from it; then restores the
/// files.
pub fn case(rng: &mut RandomStream, seeds: &[Seed], part: Part) -> Verdict {
    let seed = &seeds[below(rng, seeds.len())];
    let mut damaged = Vec::new();
    for _ in 0..mutate::places(rng) {
        let (file, bytes) = &seed.files[below(rng, seed.files.len())];
        let other = &seed.files[below(rng, seed.files.len())].1;
        let new = match part {
            Part::Chunks => numbers(rng, bytes, other),
            _ => json(rng, bytes, other),
        };
        match new {
            Some(new) => std::fs::write(file, new).unwrap(),
            None => drop(std::fs::remove_file(file)),
        }
        damaged.push((file, bytes));
    }
    let summary = std::fs::read(seed.folder.summary()).unwrap_or_default();
    if matches!(part, Part::Metadata | Part::Chunks) {
        seal(&seed.folder, &summary);
    }
    let verdict = std::panic::catch_unwind(|| outcome(seed, part));
    for (file, bytes) in damaged {
        // Also where the same file was damaged twice.
        std::fs::write(file, bytes).unwrap();
    }
    if matches!(part, Part::Metadata | Part::Chunks) {
        std::fs::write(seed.folder.summary(), summary).unwrap();
    }
    verdict.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// Writes the checksum of the damaged arrays into the summary, so that they are read.
fn seal(folder: &RunFolder, summary: &[u8]) {
    let path = folder.posterior();
    let entries = zarr::entries(&path).unwrap();
    // As a summary: the order of its parameters counts.
    let mut sealed: Summary = serde_json::from_slice(summary).unwrap();
    sealed.posterior = Some(zarr::Checksum::of(&path, &entries).unwrap());
    std::fs::write(folder.summary(), serde_json::to_vec(&sealed).unwrap()).unwrap();
}

fn outcome(seed: &Seed, part: Part) -> Verdict {
    if part == Part::Versions {
        return match seed.folder.read_versions() {
            Ok(_) => Verdict::Accepted,
            Err(_) => Verdict::Refused,
        };
    }
    match seed.folder.read() {
        Ok(stored) => {
            used(seed, &stored);
            Verdict::Accepted
        }
        Err(_) => Verdict::Refused,
    }
}

/// All output that is made from a run that was read.
fn used(seed: &Seed, stored: &StoredRun) {
    let (run, summary) = (&stored.run, &stored.summary);
    assert!(!summary.to_string().is_empty());
    assert!(serde_json::to_string(&Summary::new(run, &SummaryContext::default())).is_ok());
    let comparison = compare("a", run, "b", &seed.run).unwrap();
    assert!(!comparison.verdict().is_empty());
    if let Ok(posterior) = q_posterior(stored) {
        let family = TruncatedGaussian::new(TruncatedGaussianSettings::default()).unwrap();
        if let Ok(target) =
            PopulationTarget::new(family, &[posterior], PopulationSettings::default())
        {
            assert_eq!(target.effective_draws([0.8, 0.1]).len(), 1);
        }
    }
    let weights = run.draws.weights();
    let shown: Vec<CornerColumn> = columns(run)
        .into_iter()
        .take(4)
        .map(|column| CornerColumn {
            ess: run.draws.ess_of_mean(&column.values),
            column,
            truth: Some(1.0),
        })
        .collect();
    let figure = |svg| Figure {
        caption: "a figure".to_owned(),
        svg,
    };
    let mut figures = vec![
        figure(diagnostics(run)),
        figure(corner(&shown, &weights, "corner")),
    ];
    if let Ok(q) = column(run, "q") {
        let curve = QCurve {
            name: stored.name.clone(),
            ess: run.draws.ess_of_mean(&q.values),
            q: q.values,
            weights,
        };
        let svg = oblate::report::q_posterior(&[curve], summary.q_prior, Some(1.0));
        figures.push(figure(svg));
    }
    let shown = PageRun {
        name: &stored.name,
        summary,
        comparison: Some(&comparison),
        config: &stored.config,
        figures: &figures,
    };
    let group = Group {
        name: stored.name.clone(),
        runs: vec![shown, shown],
        figures: &[],
    };
    let html = page("fuzz", &[group]);
    // Numbers that are not finite cannot be drawn.
    assert!(
        !html.contains("=\"NaN") && !html.contains("=\"inf"),
        "{}",
        &html[..1000]
    );
}

/// The whole report of a folder whose files are damaged, from its tracks on; slow.
pub fn report_case(rng: &mut RandomStream, seeds: &[Seed]) -> Verdict {
    let seed = &seeds[below(rng, seeds.len())];
    let (file, bytes) = &seed.files[below(rng, seed.files.len())];
    let damaged = numbers(rng, bytes, bytes).unwrap_or_default();
    std::fs::write(file, damaged).unwrap();
    let folders = [seed.folder.path().to_path_buf()];
    let done = std::panic::catch_unwind(|| {
        render_report("fuzz", &folders, &[FigureFormat::Svg], &[]).is_ok()
    });
    std::fs::write(file, bytes).unwrap();
    match done {
        Ok(true) => Verdict::Accepted,
        Ok(false) => Verdict::Refused,
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

fn json(rng: &mut RandomStream, bytes: &[u8], other: &[u8]) -> Option<Vec<u8>> {
    if below(rng, 50) == 0 {
        return None;
    }
    if below(rng, 3) == 0 {
        return Some(mutate::bytes(rng, bytes, other));
    }
    let value = serde_json::from_slice(bytes).unwrap();
    Some(serde_json::to_vec(&mutate::tree(rng, &value)).unwrap())
}

/// Damages an array of numbers; none: the file is gone.
fn numbers(rng: &mut RandomStream, bytes: &[u8], other: &[u8]) -> Option<Vec<u8>> {
    let mut out = bytes.to_vec();
    for _ in 0..mutate::places(rng) {
        let at = below(rng, out.len().max(1));
        match below(rng, 10) {
            0 => return None,
            1 => out.truncate(at),
            2 => out.extend_from_slice(&other[..other.len().min(8 * (1 + below(rng, 4)))]),
            3 => {
                let end = (at + 4).min(out.len());
                out[at..end].fill(0xff);
            }
            4 if !out.is_empty() => out[at] = out[at].wrapping_add(1),
            5 => out = other.to_vec(),
            6 => {
                let byte = [0, 0xff, 0x7f, 0x3f][below(rng, 4)];
                out.fill(byte);
            }
            7 => {
                // Whole numbers of all sizes.
                let at = at / 4 * 4;
                let number = (rng.next_u32() >> below(rng, 32)).to_le_bytes();
                let end = (at + 4).min(out.len());
                out[at..end].copy_from_slice(&number[..end - at]);
            }
            _ => {
                let at = at / 8 * 8;
                let number = mutate::nasty_float(rng).to_le_bytes();
                let end = (at + 8).min(out.len());
                out[at..end].copy_from_slice(&number[..end - at]);
            }
        }
    }
    Some(out)
}
