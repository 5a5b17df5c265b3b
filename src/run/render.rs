//! From run folders to figures and one page: reads the runs, computes the model tracks again, and passes the numbers to the report.

use super::asked::Asked;
use super::folder::{RunFolder, StoredRun, distinct_names};
use super::population::DENSITY_POINTS;
use crate::config::PopulationConfig;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::{FitSettings, StreamTarget, residuals};
use crate::params::StreamParams;
use crate::posterior::{
    Column, Comparison, column, columns, compare, compare_models, mode_weights, modes_of_draws,
};
use crate::potential::{Galaxy, HaloParameters, Host};
use crate::report::{
    CornerColumn, Curve, Figure, FigureFormat, FigureWriter, FitPicture, Group, MeasuredPicture,
    ModePicture, PageRun, QCurve, corner, diagnostics, influence, modes, page, population_density,
    q_posterior, streams_of_population,
};
use crate::stream::{Particles, System};
use crate::track::{BinQuantity, TrackBin};
use oblate_samplers::Error as SamplerError;
use oblate_samplers::files::write_atomically;
use oblate_samplers::rng::{Domain, stream, unit_open};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Number of posterior draws whose tracks are shown.
const TRACKS: usize = 100;

/// Number of the best fit's particles that are shown.
const DOTS: usize = 1_500;

/// Number of particles that are shown of each mode.
const MODE_DOTS: usize = 500;

/// Smallest weight of an orientation mode that is drawn.
const SMALLEST_MODE: f64 = 0.01;

/// Points of a model's track for each bin of the data.
const PER_BIN: u32 = 5;

/// Substream within [`Domain::Post`] of the choice of posterior draws.
const CHOICE_TASK: u64 = 0x7061_6765;

/// A run with its figures and their names.
struct RunFigures {
    stored: StoredRun,
    folder: RunFolder,
    asked: Asked,
    names: Vec<&'static str>,
    figures: Vec<Figure>,
}

impl RunFigures {
    fn push(&mut self, name: &'static str, caption: &str, svg: String) {
        self.names.push(name);
        self.figures.push(Figure {
            caption: caption.to_owned(),
            svg,
        });
    }

    /// Writes its figures into its folder, in all formats of the writer.
    fn write(&self, writer: &FigureWriter) -> Result<()> {
        for (name, figure) in self.names.iter().zip(&self.figures) {
            for (format, bytes) in writer.files(&figure.svg)? {
                write_figure(&self.folder.figure(name, format), &bytes)?;
            }
        }
        Ok(())
    }

    /// The run as the page shows it, under a name and with its comparison.
    fn on_page<'a>(&'a self, name: &'a str, comparison: Option<&'a Comparison>) -> PageRun<'a> {
        PageRun {
            name,
            summary: &self.stored.summary,
            comparison,
            config: &self.stored.config,
            figures: &self.figures,
        }
    }

    /// Whether it has draws: one that was stopped before the first has none.
    fn has_draws(&self) -> bool {
        !self.stored.run.draws.is_empty()
    }

    /// The name of its group: that of the track, with what was changed on reading it.
    fn data_name(&self) -> String {
        match self.asked.track() {
            Some(track) if track.is_mirrored() => format!("{}, mirrored", track.name),
            Some(track) => track.name.clone(),
            None => "population".to_owned(),
        }
    }
}

/// Runs as one page.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Self-contained HTML.
    pub page: String,
    /// Run folders that are not writable, and so have no files of their figures.
    pub without_figures: Vec<PathBuf>,
}

/// Writes every figure of finished runs into their folders, in these formats, and returns one self-contained HTML page of all of them, with
/// `others` at its end, figures of many runs under headings. A folder that is not writable is left as it is.
///
/// # Errors
/// As of [`FigureWriter::new`]; [`Io`](crate::Error::Io), [`Syntax`](crate::Error::Syntax), [`Checksum`](crate::Error::Checksum),
/// [`Array`](crate::Error::Array), [`TrackFile`](crate::Error::TrackFile) or [`InFile`](crate::Error::InFile) if a folder cannot be read;
/// [`Setting`](crate::Error::Setting) if its settings cannot be used; [`Io`](crate::Error::Io) or [`Sampler`](crate::Error::Sampler) if a
/// figure cannot be written.
pub fn render_report(
    title: &str,
    folders: &[PathBuf],
    formats: &[FigureFormat],
    others: &[(&str, Figure)],
) -> Result<Rendered> {
    let writer = FigureWriter::new(formats)?;
    let rendered: Vec<RunFigures> = folders
        .iter()
        .map(|f| figures_of(f))
        .collect::<Result<_>>()?;
    let mut without_figures = Vec::new();
    for drawn in &rendered {
        match drawn.write(&writer) {
            Err(error) if is_of_unwritable_folder(&error) => {
                without_figures.push(drawn.folder.path().to_path_buf());
            }
            written => written?,
        }
    }
    let stored: Vec<&StoredRun> = rendered.iter().map(|d| &d.stored).collect();
    let names = distinct_names(folders, &stored);
    let groups = groups_of_same_data(&rendered);
    let comparisons = comparisons(&rendered, &names, &groups)?;
    let together: Vec<Vec<Figure>> = groups
        .iter()
        .map(|group| together(&rendered, &names, group))
        .collect();
    let of_runs = groups.iter().zip(&comparisons).zip(&together);
    let shown: Vec<Group<'_>> = of_runs
        .map(|((group, comparisons), figures)| Group {
            name: rendered[group[0]].data_name(),
            runs: group
                .iter()
                .zip(comparisons)
                .map(|(i, comparison)| rendered[*i].on_page(&names[*i], comparison.as_ref()))
                .collect(),
            figures,
        })
        .chain(others.iter().map(|(name, figure)| Group {
            name: (*name).to_owned(),
            runs: Vec::new(),
            figures: std::slice::from_ref(figure),
        }))
        .collect();
    Ok(Rendered {
        page: page(title, &shown),
        without_figures,
    })
}

/// Whether nothing may be written where a file was to be.
fn is_of_unwritable_folder(error: &Error) -> bool {
    use ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
    let Error::Sampler(SamplerError::Io { source, .. }) = error else {
        return false;
    };
    matches!(source.kind(), PermissionDenied | ReadOnlyFilesystem)
}

/// Indices of the runs in groups of the same data, in the order of their first runs.
fn groups_of_same_data(rendered: &[RunFigures]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, drawn) in rendered.iter().enumerate() {
        let mut known = groups.iter_mut();
        match known.find(|group| rendered[group[0]].asked.has_data_of(&drawn.asked)) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Comparisons of the first run of each group with every run of it: `None` for the first run itself, for runs that cannot be compared, and
/// where one of the two has no draws.
fn comparisons(
    rendered: &[RunFigures],
    names: &[String],
    groups: &[Vec<usize>],
) -> Result<Vec<Vec<Option<Comparison>>>> {
    let compared = |first: usize, i: usize| {
        if i == first || ![first, i].iter().all(|k| rendered[*k].has_draws()) {
            return Ok(None);
        }
        let [a, b] = [first, i].map(|k| &rendered[k].stored.run);
        match rendered[first].asked.difference(&rendered[i].asked) {
            None if a.names == b.names => compare(&names[first], a, &names[i], b).map(Some),
            Some(difference) if difference.has_odds() => {
                compare_models(&names[first], a, &names[i], b).map(Some)
            }
            _ => Ok(None),
        }
    };
    groups
        .iter()
        .map(|group| group.iter().map(|i| compared(group[0], *i)).collect())
        .collect()
}

/// Writes a figure into a run folder.
fn write_figure(path: &Path, bytes: &[u8]) -> Result<()> {
    match write_atomically(path, bytes) {
        // A run that begins in the folder at this moment may remove the temporary file as a left-over; then it is
        // written once more.
        Err(SamplerError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            Ok(write_atomically(path, bytes)?)
        }
        written => Ok(written?),
    }
}

fn figures_of(path: &Path) -> Result<RunFigures> {
    let folder = RunFolder::open(path)?;
    let stored = folder.read()?;
    let asked = Asked::of(&stored, &folder)?;
    let truth = asked.track().map(ObservedTrack::truth).unwrap_or_default();
    let mut drawn = RunFigures {
        stored,
        folder,
        asked: asked.clone(),
        names: Vec::new(),
        figures: Vec::new(),
    };
    match &asked {
        Asked::Fit { track, settings } => draw_streams(&mut drawn, track, settings)?,
        Asked::Population { settings, .. } => draw_population(&mut drawn, settings)?,
    }
    let weights = drawn.stored.run.draws.weights();
    if let Some(curve) = q_curve(&drawn.stored, &drawn.stored.name) {
        let q_prior = drawn.stored.summary.q_prior;
        let svg = q_posterior(&[curve], q_prior, truth.get("q").copied());
        let halo = drawn.stored.summary.halo.unwrap_or_default();
        let caption = format!("Posterior of the flattening q of the {}", halo.flattened());
        drawn.push("q", &caption, svg);
    }
    let draws = &drawn.stored.run.draws;
    let shown: Vec<CornerColumn> = corner_columns(&drawn.stored)
        .into_iter()
        .map(|column| CornerColumn {
            truth: truth.get(&column.name).copied(),
            ess: draws.ess_of_mean(&column.values),
            column,
        })
        .collect();
    if drawn.has_draws() {
        let svg = corner(&shown, &weights, &drawn.stored.name);
        let caption = "Marginals: 68 and 95 % regions; lines: the truth, where it is known";
        drawn.push("corner", caption, svg);
    }
    let svg = diagnostics(&drawn.stored.run);
    drawn.push("diagnostics", "Diagnostics of the sampler", svg);
    if let Ok(coarse) = RunFolder::open(&drawn.folder.coarse()) {
        let caption = "Diagnostics of the sampler in the coarse fit that came first";
        let svg = diagnostics(&coarse.read()?.run);
        drawn.push("coarse-diagnostics", caption, svg);
    }
    Ok(drawn)
}

/// Figures of a fit: its tracks, and its orientation modes.
fn draw_streams(
    drawn: &mut RunFigures,
    track: &ObservedTrack,
    settings: &FitSettings,
) -> Result<()> {
    let target = StreamTarget::from_track(track, settings)?;
    for (name, caption, svg) in overlays(&target, track, &drawn.stored).unwrap_or_default() {
        drawn.push(name, caption, svg);
    }
    if let Some(svg) = orientations(&target, track, &drawn.stored) {
        let surfaces = settings.model.halo.flattened();
        let caption = format!(
            "Orientation modes of a weight of at least 1 %: track and particles of the draw of the highest ln L in each, the data (black), \
             the projected axis of q (vermillion) and outlines of surfaces of equal {surfaces} of the halo (dashed)"
        );
        drawn.push("modes", &caption, svg);
    }
    Ok(())
}

/// Figures of a population: its density of q, and its streams.
fn draw_population(drawn: &mut RunFigures, config: &PopulationConfig) -> Result<()> {
    if drawn.has_draws() {
        let density = (config.family).density(&drawn.stored.run.draws, DENSITY_POINTS)?;
        let caption = "Density of q in the population: posterior mean and median, pointwise 68 and 95 % (shaded)";
        drawn.push("density", caption, population_density(&density));
    }
    let Some(population) = drawn.stored.summary.population.clone() else {
        return Ok(());
    };
    let caption = "q of each stream: median, 68 and 95 % in its own fit and given the population";
    let svg = streams_of_population(&population.streams);
    drawn.push("streams", caption, svg);
    if let Some(svg) = influence(&population) {
        let caption = "Move of each hyperparameter's mean without each stream; faint: not reliable (Pareto k)";
        drawn.push("influence", caption, svg);
    }
    Ok(())
}

/// q of a run under a name; `None` if it has none, or no draws.
fn q_curve(stored: &StoredRun, name: &str) -> Option<QCurve> {
    let draws = Some(&stored.run.draws).filter(|draws| !draws.is_empty())?;
    let q = column(&stored.run, "q").ok()?.values;
    Some(QCurve {
        name: name.to_owned(),
        weights: draws.weights(),
        ess: draws.ess_of_mean(&q),
        q,
    })
}

/// The parameters, and q where there is one.
fn corner_columns(stored: &StoredRun) -> Vec<Column> {
    columns(&stored.run)
        .into_iter()
        .filter(|c| stored.run.names.contains(&c.name) || c.name == "q")
        .collect()
}

/// The bins along the track of a row of draws, and its particles; `None` if it has no track.
fn bins_of(
    target: &StreamTarget,
    params: &StreamParams<f64>,
) -> Option<(Vec<TrackBin>, Particles)> {
    target.likelihood().curve_at(params, PER_BIN).ok()
}

/// A quantity of bins as a curve.
fn curve_of(bins: &[TrackBin], value: impl Fn(&TrackBin) -> f64) -> Curve {
    Curve {
        phi_deg: bins.iter().map(|bin| bin.phi_deg).collect(),
        values: bins.iter().map(value).collect(),
    }
}

/// Some of the particles on the sky, at the distance of the data.
fn dots(particles: &Particles, params: &StreamParams<f64>, most: usize) -> Vec<(f64, f64)> {
    let every = (particles.len() / most).max(1);
    let all = particles.x.iter().zip(&particles.y).step_by(every);
    let factor = params.distance_factor;
    all.map(|(x, y)| (x / factor, y / factor)).collect()
}

/// Data, tracks of posterior draws and the best fit: a figure of the radii, and one of each quantity that is measured beside them, with the
/// name and the caption of each. None if the best fit has no track.
fn overlays(
    target: &StreamTarget,
    track: &ObservedTrack,
    stored: &StoredRun,
) -> Option<Vec<(&'static str, &'static str, String)>> {
    let draws = &stored.run.draws;
    let params = target.params(draws.theta_row(draws.best()?));
    let (best, particles) = bins_of(target, &params)?;
    let offset = unit_open(&mut stream(stored.run.seed, Domain::Post, CHOICE_TASK, 0));
    let tracks: Vec<Vec<TrackBin>> = draws
        .resample(TRACKS, offset)
        .into_iter()
        .filter_map(|row| Some(bins_of(target, &target.params(draws.theta_row(row)))?.0))
        .collect();
    let curves = |value: &dyn Fn(&TrackBin) -> f64| -> Vec<Curve> {
        tracks.iter().map(|bins| curve_of(bins, value)).collect()
    };
    let picture = FitPicture {
        track,
        draws: &curves(&|bin| bin.r_kpc),
        best: &curve_of(&best, |bin| bin.r_kpc),
        residuals: &residuals(target, track, &params),
        particles: &dots(&particles, &params, DOTS),
        phi_zero_deg: -params.phi0_deg,
        progenitor_kpc: params.x0_kpc / params.distance_factor,
    };
    let caption = "Data, tracks of posterior draws, and the best fit; residuals in units of the data's errors; the best fit's particles \
                   on the sky";
    let mut figures = vec![("fit", caption, picture.svg())];
    let has = |quantity: &BinQuantity| {
        track.measured.contains_key(quantity)
            || (*quantity == BinQuantity::Velocity && track.has_velocities())
    };
    for quantity in BinQuantity::ALL.into_iter().filter(has) {
        let picture = MeasuredPicture {
            track,
            quantity,
            draws: &curves(&|bin| bin.value(quantity)),
            best: &curve_of(&best, |bin| bin.value(quantity)),
        };
        let (name, caption) = match quantity {
            BinQuantity::Velocity => (
                "velocities",
                "Mean line-of-sight velocities, away from the observer and relative to the host: data, posterior draws, and the best fit",
            ),
            BinQuantity::Width => (
                "widths",
                "Widths of the stream, standard deviations of the projected radii in a bin: data, posterior draws, and the best fit",
            ),
            BinQuantity::Density => (
                "densities",
                "Stars per degree along the stream: data, posterior draws, and the best fit",
            ),
        };
        figures.extend(picture.svg().map(|svg| (name, caption, svg)));
    }
    Some(figures)
}

/// The orientation modes with a weight that can be seen, the heaviest first; `None` where the run has none.
fn orientations(
    target: &StreamTarget,
    track: &ObservedTrack,
    stored: &StoredRun,
) -> Option<String> {
    let run = &stored.run;
    let of_draws = modes_of_draws(run)?;
    let weights = mode_weights(run)?.into_iter().enumerate();
    let mut pictures: Vec<ModePicture> = weights
        .filter(|(_, mode)| mode.probability.weight >= SMALLEST_MODE)
        .filter_map(|(index, weight)| {
            let rows = (0..of_draws.len()).filter(|row| of_draws[*row] == index);
            let l = &run.draws.ln_likelihood;
            let row = rows.max_by(|a, b| l[*a].total_cmp(&l[*b]))?;
            let params = target.params(run.draws.theta_row(row));
            let (bins, particles) = bins_of(target, &params)?;
            Some(ModePicture {
                weight,
                halo: halo_of(target, &params),
                particles: dots(&particles, &params, MODE_DOTS),
                curve: curve_of(&bins, |bin| bin.r_kpc),
                phi_zero_deg: -params.phi0_deg,
            })
        })
        .collect();
    pictures.sort_by(|a, b| {
        let [a, b] = [a, b].map(|picture| picture.weight.probability.weight);
        b.total_cmp(&a)
    });
    modes(track, &pictures)
}

/// The halo of a parameter set.
fn halo_of(target: &StreamTarget, params: &StreamParams<f64>) -> HaloParameters<f64> {
    let q_range = target.stream_prior().q_range();
    let settings = target.likelihood().model().settings();
    let system = System::<f64, Galaxy>::with_host(params, q_range, settings);
    Galaxy::parts(&system.host).halo
}

/// Figures of several runs of the same data at once: their posteriors of q side by side.
fn together(rendered: &[RunFigures], names: &[String], group: &[usize]) -> Vec<Figure> {
    let curves: Vec<QCurve> = group
        .iter()
        .filter_map(|i| q_curve(&rendered[*i].stored, &names[*i]))
        .collect();
    if curves.len() < 2 {
        return Vec::new();
    }
    let first = &rendered[group[0]];
    let truth = first.asked.track().map(ObservedTrack::truth);
    let truth = truth.and_then(|truth| truth.get("q").copied());
    let q_prior = first.stored.summary.q_prior;
    let one_prior = group
        .iter()
        .all(|i| rendered[*i].stored.summary.q_prior == q_prior);
    vec![Figure {
        caption: format!("{}: posteriors of q", first.data_name()),
        svg: q_posterior(&curves, q_prior.filter(|_| one_prior), truth),
    }]
}
