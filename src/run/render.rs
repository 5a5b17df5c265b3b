//! From run folders to figures and one page: reads the runs, computes the model tracks again, and passes the numbers to the report.

use super::folder::{RunFolder, StoredRun};
use super::population::DENSITY_POINTS;
use crate::config::PopulationConfig;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::{FitSettings, StreamTarget};
use crate::params::QPrior;
use crate::posterior::{Column, Comparison, column, columns, compare};
use crate::report::{
    CornerColumn, FitPicture, ModelTrack, PageRun, QCurve, Section, corner, diagnostics, influence,
    page, population_density, q_posterior, streams_of_population,
};
use oblate_samplers::files::write_atomically;
use oblate_samplers::rng::{Domain, stream, unit_open};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Number of posterior draws whose tracks are shown.
const TRACKS: usize = 100;

/// Number of the best fit's particles that are shown.
const DOTS: usize = 1_500;

/// Substream within [`Domain::Post`] of the choice of posterior draws.
const CHOICE_TASK: u64 = 0x7061_6765;

/// A run with its figures: name, caption and SVG.
struct RunFigures {
    stored: StoredRun,
    folder: RunFolder,
    track: Option<ObservedTrack>,
    figures: Vec<(&'static str, String, String)>,
}

/// Writes every figure of finished runs into their folders, and one self-contained HTML page of all of them.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`], [`Error::TrackFile`] or [`Error::InFile`]
/// if a folder cannot be read; [`Error::Setting`] if its settings cannot be used; [`Error::Io`] or [`Error::Sampler`]
/// if a file cannot be written.
pub fn render_report(title: &str, folders: &[PathBuf], out: &Path) -> Result<()> {
    let rendered: Vec<RunFigures> = folders
        .iter()
        .map(|f| figures_of(f))
        .collect::<Result<_>>()?;
    for d in &rendered {
        for (name, _, svg) in &d.figures {
            write_figure(&d.folder.figure(name), svg)?;
        }
    }
    let names = unique_names(&rendered, folders);
    let captioned: Vec<Vec<(String, String)>> = rendered
        .iter()
        .map(|d| {
            d.figures
                .iter()
                .map(|(_, caption, svg)| (caption.clone(), svg.clone()))
                .collect()
        })
        .collect();
    let comparisons: Vec<Option<Comparison>> = rendered
        .iter()
        .zip(&names)
        .enumerate()
        .map(|(i, (d, name))| {
            let first = &rendered[0].stored.run;
            let same = i > 0 && first.names == d.stored.run.names;
            same.then(|| compare(&names[0], first, name, &d.stored.run))
                .transpose()
        })
        .collect::<Result<_>>()?;
    let runs: Vec<PageRun<'_>> = rendered
        .iter()
        .zip(&names)
        .zip(&captioned)
        .zip(&comparisons)
        .map(|(((d, name), figures), comparison)| PageRun {
            name,
            summary: &d.stored.summary,
            comparison: comparison.as_ref(),
            config: &d.stored.config,
            figures,
        })
        .collect();
    write_atomically(out, page(title, &runs, &together(&rendered)?).as_bytes())?;
    Ok(())
}

/// Writes a figure into a run folder.
fn write_figure(path: &Path, svg: &str) -> Result<()> {
    use oblate_samplers::Error::Io;
    match write_atomically(path, svg.as_bytes()) {
        // A run that begins in the folder at this moment may remove the temporary file as a left-over; then it is
        // written once more.
        Err(Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            Ok(write_atomically(path, svg.as_bytes())?)
        }
        written => Ok(written?),
    }
}

/// Names of the runs on the page: that of the folder, or its whole path where two folders have the same name.
fn unique_names(rendered: &[RunFigures], folders: &[PathBuf]) -> Vec<String> {
    rendered
        .iter()
        .zip(folders)
        .map(|(d, path)| {
            let twins = rendered
                .iter()
                .filter(|o| o.stored.name == d.stored.name)
                .count();
            if twins > 1 {
                path.display().to_string()
            } else {
                d.stored.name.clone()
            }
        })
        .collect()
}

fn figures_of(path: &Path) -> Result<RunFigures> {
    let folder = RunFolder::open(path)?;
    let stored = folder.read()?;
    let file = folder.track();
    let track = if file.is_file() {
        Some(ObservedTrack::read(&file)?)
    } else {
        None
    };
    let truth = track.as_ref().map(ObservedTrack::truth).unwrap_or_default();
    let mut figures = Vec::new();
    if let Some(track) = &track {
        let settings: FitSettings = crate::config::parse(&stored.config, &folder.config())?;
        let target = StreamTarget::from_track(track, &settings)?;
        if let Some(svg) = overlay(&target, track, &stored) {
            let caption = "Data (black), tracks of posterior draws, and the best fit; residuals in units of the data's errors; \
                           the best fit's particles on the sky";
            figures.push(("fit", caption.to_owned(), svg));
        }
    }
    // A run without a track is a population.
    if track.is_none() {
        let config: PopulationConfig = crate::config::read(&folder.config())?;
        let density = config.family.density(&stored.run.draws, DENSITY_POINTS)?;
        figures.push((
            "density",
            "Density of q in the population: posterior mean (solid) and median (dashed), pointwise 68 and 95 % (shaded)".to_owned(),
            population_density(&density),
        ));
    }
    if let Some(population) = &stored.summary.population {
        figures.push((
            "streams",
            "q of each stream: median, 68 and 95 % in its own fit (grey) and given the population (blue)".to_owned(),
            streams_of_population(&population.streams),
        ));
        if let Some(svg) = influence(population) {
            let caption = "Move of each hyperparameter's mean without each stream; faint: not reliable (Pareto k)";
            figures.push(("influence", caption.to_owned(), svg));
        }
    }
    let weights = stored.run.draws.weights();
    if let Ok(q) = column(&stored.run, "q") {
        let curve = QCurve {
            name: stored.name.clone(),
            q: q.values,
            weights: weights.clone(),
        };
        let svg = q_posterior(&[curve], stored.summary.q_prior, truth.get("q").copied());
        figures.push((
            "q",
            "Posterior of the flattening q; dashed: its prior".to_owned(),
            svg,
        ));
    }
    let shown: Vec<CornerColumn> = corner_columns(&stored)
        .into_iter()
        .map(|column| CornerColumn {
            truth: truth.get(&column.name).copied(),
            column,
        })
        .collect();
    let svg = corner(&shown, &weights, &stored.name);
    figures.push((
        "corner",
        "Marginals: 68 and 95 % regions; lines: the truth, where it is known".to_owned(),
        svg,
    ));
    figures.push((
        "diagnostics",
        "Diagnostics of the sampler".to_owned(),
        diagnostics(&stored.run),
    ));
    if let Ok(coarse) = RunFolder::open(&folder.coarse()) {
        figures.push((
            "coarse-diagnostics",
            "Diagnostics of the sampler in the coarse fit that came first".to_owned(),
            diagnostics(&coarse.read()?.run),
        ));
    }
    Ok(RunFigures {
        stored,
        folder,
        track,
        figures,
    })
}

/// The parameters, and q where there is one.
fn corner_columns(stored: &StoredRun) -> Vec<Column> {
    columns(&stored.run)
        .into_iter()
        .filter(|c| stored.run.names.contains(&c.name) || c.name == "q")
        .collect()
}

/// Data, tracks of posterior draws and the best fit in one figure; `None` if the best fit has no track.
fn overlay(target: &StreamTarget, track: &ObservedTrack, stored: &StoredRun) -> Option<String> {
    let draws = &stored.run.draws;
    let model_track = |row: usize| {
        let (t, particles) = target
            .likelihood()
            .track_at(&target.params(draws.theta_row(row)))
            .ok()?;
        let model = ModelTrack {
            phi_deg: t.bins.iter().map(|b| b.phi_deg).collect(),
            r_kpc: t.bins.iter().map(|b| b.r_kpc).collect(),
        };
        Some((model, particles))
    };
    let row = draws.best()?;
    let (best, particles) = model_track(row)?;
    let params = target.params(draws.theta_row(row));
    let offset = unit_open(&mut stream(stored.run.seed, Domain::Post, CHOICE_TASK, 0));
    let tracks: Vec<ModelTrack> = draws
        .resample(TRACKS, offset)
        .into_iter()
        .filter_map(|row| Some(model_track(row)?.0))
        .collect();
    let every = (particles.len() / DOTS).max(1);
    let particles: Vec<(f64, f64)> = particles
        .x
        .iter()
        .zip(&particles.y)
        .step_by(every)
        // At the distance of the data.
        .map(|(x, y)| (x / params.distance_factor, y / params.distance_factor))
        .collect();
    let picture = FitPicture {
        track,
        draws: &tracks,
        best: &best,
        particles: &particles,
        phi_zero_deg: -params.phi0_deg,
    };
    Some(picture.svg())
}

/// Figures of several runs at once: posteriors of q of one track side by side.
fn together(rendered: &[RunFigures]) -> Result<Vec<Section>> {
    let mut by_track: BTreeMap<String, Vec<&RunFigures>> = BTreeMap::new();
    for d in rendered {
        if let Some(track) = &d.track {
            by_track.entry(track.name.clone()).or_default().push(d);
        }
    }
    let mut figures = Vec::new();
    for (name, runs) in by_track.iter().filter(|(_, runs)| runs.len() > 1) {
        let curves: Vec<QCurve> = runs
            .iter()
            .map(|d| {
                let q = column(&d.stored.run, "q")?.values;
                Ok::<_, Error>(QCurve {
                    name: d.stored.name.clone(),
                    q,
                    weights: d.stored.run.draws.weights(),
                })
            })
            .collect::<Result<_>>()?;
        let prior: Option<QPrior> = runs[0].stored.summary.q_prior;
        let truth = runs[0]
            .track
            .as_ref()
            .and_then(|t| t.truth().get("q").copied());
        figures.push((
            format!("{name}: posteriors of q"),
            q_posterior(&curves, prior, truth),
        ));
    }
    if figures.is_empty() {
        return Ok(Vec::new());
    }
    Ok(vec![Section {
        heading: "Samplers side by side".to_owned(),
        figures,
    }])
}
