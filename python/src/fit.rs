//! A track with its model and prior: ln L, gradients, coordinates, tracks and streams.

use crate::errors::{no_track, to_python, wrong};
use crate::marginals::Marginal;
use crate::observer::PythonObserver;
use crate::points::Points;
use crate::pool::Threads;
use crate::run::Run;
use crate::settings::{changed, from_file, one_of, to_dict};
use crate::signals::interruptible;
use crate::tables::{particle_columns, track_columns};
use crate::track::Track;
use oblate::Rejection;
use oblate::data::ObservedTrack;
use oblate::inference::{Evaluated, FitSettings, StreamTarget, Wanted, fit_with};
use oblate::params::{PARAMETERS, StreamParams};
use oblate::run::{Destination, IfExists, Monitor};
use oblate::samplers::{Control, Prior, Target};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Points of a batch between two looks for signals, such as that of Ctrl-C.
const POINTS_AT_ONCE: usize = 256;

/// Time between two checkpoints of a fit in a folder, as of the command.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(30);

/// What happens to a run folder that exists.
const IF_EXISTS: [(&str, IfExists); 3] = [
    ("refuse", IfExists::Refuse),
    ("replace", IfExists::Replace),
    ("resume", IfExists::Resume),
];

/// How a point is given.
#[derive(Clone, Copy)]
enum Coordinates {
    /// Physical values in the units of the parameters.
    Theta,
    /// Coordinates of the unit cube.
    Cube,
    /// Standard-normal coordinates.
    Normal,
}

impl Coordinates {
    fn new(name: &str) -> PyResult<Self> {
        let choices = [
            ("theta", Self::Theta),
            ("u", Self::Cube),
            ("z", Self::Normal),
        ];
        one_of("coordinates", name, &choices)
    }

    /// The physical parameters of a point.
    fn to_theta(self, prior: &Prior, point: &[f64]) -> Vec<f64> {
        let mut theta = point.to_vec();
        match self {
            Self::Theta => {}
            Self::Cube => prior.theta_from_u(point, &mut theta),
            Self::Normal => prior.theta_from_z(point, &mut theta),
        }
        theta
    }

    /// Turns a gradient in physical parameters at a point into one in these coordinates.
    fn gradient(self, prior: &Prior, point: &[f64], gradient: &mut [f64]) {
        match self {
            Self::Theta => {}
            Self::Cube => prior.gradient_to_u(point, gradient),
            Self::Normal => prior.gradient_to_z(point, gradient),
        }
    }
}

/// What is computed at a point: ln L or the cause of its rejection.
type Answer = Result<Evaluated, Rejection>;

/// A track with its model and prior. Points have the free parameters, in the order of `names`.
#[pyclass(frozen, module = "oblate")]
pub struct Fit {
    target: StreamTarget,
    track: ObservedTrack,
    settings: FitSettings,
    threads: Threads,
}

impl Fit {
    fn build(track: ObservedTrack, settings: FitSettings, threads: Threads) -> PyResult<Self> {
        let target = StreamTarget::from_track(&track, &settings).map_err(to_python)?;
        Ok(Self {
            target,
            track,
            settings,
            threads,
        })
    }

    fn points<'py>(&self, given: &Bound<'py, PyAny>, name: &str) -> PyResult<Points<'py>> {
        Points::new(given, name, self.target.dim())
    }

    /// Evaluates all points on the threads of this fit, without Python's lock.
    fn answers(
        &self,
        points: &Points<'_>,
        coordinates: Coordinates,
        wanted: Wanted,
        py: Python<'_>,
    ) -> PyResult<Vec<Answer>> {
        let pool = self.threads.pool()?;
        let (numbers, dim) = (points.numbers()?, points.dim());
        let params = |point: &[f64]| {
            let theta = coordinates.to_theta(self.target.prior(), point);
            self.target.params(&theta)
        };
        if points.is_one() {
            let answer = || self.target.evaluate(&params(numbers), wanted);
            return Ok(vec![py.detach(|| pool.install(answer))]);
        }
        let mut answers = Vec::with_capacity(numbers.len() / dim);
        for part in numbers.chunks(dim * POINTS_AT_ONCE) {
            let work = || {
                let all = part.par_chunks_exact(dim).map(params);
                self.target.evaluate_all(all, wanted)
            };
            answers.extend(py.detach(|| pool.install(work)));
            py.check_signals()?;
        }
        Ok(answers)
    }

    /// ln L of each answer, minus infinity for rejected points.
    fn ln_likelihoods(answers: &[Answer]) -> Vec<f64> {
        let value = |answer: &Answer| match answer {
            Ok(evaluated) => evaluated.ln_likelihood,
            Err(_) => f64::NEG_INFINITY,
        };
        answers.iter().map(value).collect()
    }

    /// The derivatives by the free parameters of each answer, NaN for rejected points.
    fn gradients(
        &self,
        points: &Points<'_>,
        coordinates: Coordinates,
        answers: &[Answer],
    ) -> PyResult<Vec<f64>> {
        let (prior, free) = (self.target.prior(), self.target.stream_prior().free());
        let mut numbers = Vec::with_capacity(answers.len() * free.len());
        for (point, answer) in points.numbers()?.chunks_exact(free.len()).zip(answers) {
            let all = answer
                .as_ref()
                .ok()
                .and_then(|evaluated| evaluated.gradient);
            let of_parameter = |place: &usize| all.map_or(f64::NAN, |all| all[*place]);
            let mut gradient: Vec<f64> = free.iter().map(of_parameter).collect();
            coordinates.gradient(prior, point, &mut gradient);
            numbers.extend(gradient);
        }
        Ok(numbers)
    }

    /// All parameters of one point inside the prior.
    fn one(&self, theta: &Bound<'_, PyAny>) -> PyResult<StreamParams<f64>> {
        let points = self.points(theta, "theta")?;
        if !points.is_one() {
            return Err(wrong(
                "theta",
                "many points",
                "give one point, an array with one axis",
            ));
        }
        let params = self.target.params(points.numbers()?);
        let checked = self.target.stream_prior().check_point(&params);
        checked.map_err(no_track)?;
        Ok(params)
    }

    /// The stream of one point: its track in the data's bins and its particles.
    fn modelled(
        &self,
        theta: &Bound<'_, PyAny>,
    ) -> PyResult<(oblate::track::Track, oblate::stream::Particles)> {
        let params = self.one(theta)?;
        let pool = self.threads.pool()?;
        let likelihood = self.target.likelihood();
        let modelled = theta
            .py()
            .detach(|| pool.install(|| likelihood.track_at(&params)));
        modelled.map_err(no_track)
    }

    /// Points in other coordinates.
    fn converted<'py>(
        &self,
        given: &Bound<'py, PyAny>,
        name: &str,
        convert: impl Fn(&Prior, &[f64], &mut [f64]),
    ) -> PyResult<Bound<'py, PyAny>> {
        let points = self.points(given, name)?;
        let (from, dim) = (points.numbers()?, points.dim());
        let mut to = vec![0.0; from.len()];
        for (from, to) in from.chunks_exact(dim).zip(to.chunks_exact_mut(dim)) {
            convert(self.target.prior(), from, to);
        }
        points.rows(to, dim)
    }
}

#[pymethods]
impl Fit {
    #[new]
    #[pyo3(signature = (track, *, config=None, settings=None, threads=None))]
    fn new(
        track: &Bound<'_, PyAny>,
        config: Option<PathBuf>,
        settings: Option<&Bound<'_, PyDict>>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let track = match track.cast::<Track>() {
            Ok(track) => track.get().observed.clone(),
            Err(_) => Track::from_file(&track.extract::<PathBuf>()?, None, None)?.observed,
        };
        let settings = changed(from_file(config)?, "", settings)?;
        Self::build(track, settings, Threads::new(threads)?)
    }

    /// Names of the free parameters.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.target.prior().names().to_vec()
    }

    /// Units of the free parameters.
    #[getter]
    fn units(&self) -> Vec<String> {
        self.target.prior().units().to_vec()
    }

    /// Number of free parameters.
    #[getter]
    fn dim(&self) -> usize {
        self.target.dim()
    }

    /// Values of the fixed parameters.
    #[getter]
    fn fixed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let fixed = PyDict::new(py);
        let values = self.settings.prior.fixed.to_array();
        for (parameter, value) in PARAMETERS.iter().zip(values) {
            if let Some(value) = value {
                fixed.set_item(parameter.name, value)?;
            }
        }
        Ok(fixed)
    }

    /// The prior of each free parameter.
    #[getter]
    fn prior<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let prior = PyDict::new(py);
        let marginals = self.target.prior().marginals();
        for (name, marginal) in self.target.prior().names().iter().zip(marginals) {
            prior.set_item(name, Marginal::from(*marginal))?;
        }
        Ok(prior)
    }

    /// All settings.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_dict(py, &self.settings)
    }

    /// The data.
    #[getter]
    fn data(&self) -> Track {
        Track {
            observed: self.track.clone(),
        }
    }

    /// ln L of one point, a float, or of many, an array; minus infinity at rejected points.
    ///
    /// `theta` has the free parameters in their units, of shape `(dim,)` or `(n, dim)`; an array of 64-bit floats in C order is not
    /// copied. With `coordinates="u"` or `"z"` it has coordinates of the unit cube or standard-normal ones, in which the prior is
    /// uniform or standard normal. Many points are computed on all threads at once; the numbers do not depend on their number.
    #[pyo3(signature = (theta, *, coordinates="theta"))]
    fn ln_likelihood<'py>(
        &self,
        theta: &Bound<'py, PyAny>,
        coordinates: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let points = self.points(theta, coordinates)?;
        let coordinates = Coordinates::new(coordinates)?;
        let answers = self.answers(&points, coordinates, Wanted::Value, theta.py())?;
        Ok(points.values(Self::ln_likelihoods(&answers)))
    }

    /// ln L and its derivatives by `theta`, in the given coordinates: those of ln L alone, without the prior. NaN at rejected points.
    #[pyo3(signature = (theta, *, coordinates="theta"))]
    fn gradient<'py>(
        &self,
        theta: &Bound<'py, PyAny>,
        coordinates: &str,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let points = self.points(theta, coordinates)?;
        let coordinates = Coordinates::new(coordinates)?;
        let answers = self.answers(&points, coordinates, Wanted::Gradient, theta.py())?;
        let gradients = self.gradients(&points, coordinates, &answers)?;
        Ok((
            points.values(Self::ln_likelihoods(&answers)),
            points.rows(gradients, points.dim())?,
        ))
    }

    /// Why points have no likelihood: a cause, such as `outside_prior`, or `None` where they have one (docs/physics.md, section 7).
    #[pyo3(signature = (theta, *, coordinates="theta"))]
    fn rejected<'py>(
        &self,
        theta: &Bound<'py, PyAny>,
        coordinates: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let points = self.points(theta, coordinates)?;
        let coordinates = Coordinates::new(coordinates)?;
        let answers = self.answers(&points, coordinates, Wanted::Value, theta.py())?;
        let causes = answers.iter().map(|a| a.as_ref().err().map(|c| c.name()));
        let causes: Vec<Option<&str>> = causes.collect();
        match causes.as_slice() {
            [cause] if points.is_one() => Ok(cause.into_pyobject(theta.py())?.into_any()),
            _ => Ok(causes.into_pyobject(theta.py())?.into_any()),
        }
    }

    /// ln of the prior density of the free parameters; minus infinity outside.
    fn ln_prior<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let points = self.points(theta, "theta")?;
        let rows = points.numbers()?.chunks_exact(points.dim());
        Ok(points.values(rows.map(|row| self.target.prior().ln_pdf(row)).collect()))
    }

    /// Physical parameters from coordinates of the unit cube.
    fn prior_transform<'py>(&self, u: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let outside = |u: &&f64| !(0.0..=1.0).contains(*u);
        if let Some(wrong_u) = self.points(u, "u")?.numbers()?.iter().find(outside) {
            return Err(wrong("u", wrong_u, "give numbers from 0 to 1"));
        }
        self.converted(u, "u", Prior::theta_from_u)
    }

    /// Physical parameters from standard-normal coordinates.
    fn theta_from_z<'py>(&self, z: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.converted(z, "z", Prior::theta_from_z)
    }

    /// Standard-normal coordinates from physical parameters; infinite at the bounds of the prior.
    fn z_from_theta<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.converted(theta, "theta", Prior::z_from_theta)
    }

    /// Derived quantities by name: q, the components of the axis, `log10_m200_halo`.
    fn derived<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let points = self.points(theta, "theta")?;
        let names = self.target.derived_names();
        let mut all = Vec::new();
        for theta in points.numbers()?.chunks_exact(points.dim()) {
            self.target.derived(theta, &mut all);
        }
        let derived = PyDict::new(theta.py());
        for (i, (name, _)) in names.iter().enumerate() {
            let column = all.iter().skip(i).step_by(names.len()).copied();
            derived.set_item(name, points.values(column.collect()))?;
        }
        Ok(derived)
    }

    /// The track of the model at one point, in the data's bins, by columns: `phi_deg`, `r_kpc`, `r_err_kpc` (Monte-Carlo error of the
    /// mean), `n` (sum of weights), `v_km_s`, `v_err_km_s`, `width_kpc`, `density_per_deg`.
    fn track<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let (track, _) = self.modelled(theta)?;
        track_columns(theta.py(), &track)
    }

    /// The particles of the model at one point, by columns: `tail`, `t_release_fraction`, positions in kpc, velocities in km/s, `phi_deg`, `weight`.
    fn stream<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let (_, particles) = self.modelled(theta)?;
        let model = self.target.likelihood().model();
        particle_columns(theta.py(), model.particle_table(&particles))
    }

    /// Fits the track, as `oblate fit` with the same settings.
    ///
    /// With `out` the result is written into a run folder, with checkpoints; `if_exists` is `refuse`, `replace` or `resume`.
    /// `on_event` is called with each event of `log.jsonl`, a dictionary. Ctrl-C stops the fit.
    #[pyo3(signature = (*, out=None, if_exists="refuse", seed=None, max_minutes=None, on_event=None))]
    fn sample(
        &self,
        py: Python<'_>,
        out: Option<PathBuf>,
        if_exists: &str,
        seed: Option<u64>,
        max_minutes: Option<f64>,
        on_event: Option<Py<PyAny>>,
    ) -> PyResult<Run> {
        let mut settings = self.settings.clone();
        settings.seed = seed.unwrap_or(settings.seed);
        let if_exists = one_of("if_exists", if_exists, &IF_EXISTS)?;
        let max_wall = match max_minutes {
            None => Duration::MAX,
            Some(minutes) => Duration::try_from_secs_f64(60.0 * minutes)
                .map_err(|e| wrong("max_minutes", minutes, &e.to_string()))?,
        };
        let pool = self.threads.pool()?;
        let fitted = interruptible(py, &pool, |stop| {
            let mut observer = PythonObserver::new(on_event);
            let interrupt = Arc::clone(stop);
            let fitted = match &out {
                None => {
                    let mut control = Control::new(&mut observer);
                    control.interrupt = interrupt;
                    control.budget.max_wall = max_wall;
                    fit_with(&self.track, &settings, &mut control)
                }
                Some(folder) => {
                    let destination = Destination {
                        folder,
                        if_exists,
                        command: "oblate.Fit.sample",
                    };
                    let mut monitor = Monitor {
                        observer: &mut observer,
                        interrupt,
                        checkpoint_every: CHECKPOINT_EVERY,
                        max_wall,
                    };
                    oblate::run::fit(&self.track, &settings, destination, &mut monitor)
                }
            };
            observer.finish(fitted)
        })?;
        Ok(fitted?.map_err(to_python)?.into())
    }

    /// For pickle: the track and the settings themselves, so that no file is read again.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let track = serde_json::to_string(&self.track)
            .map_err(|e| wrong("track", e, "give a track with finite numbers"))?;
        let settings = oblate::config::to_toml(&self.settings).map_err(to_python)?;
        let restore = py.import("oblate._oblate")?.getattr("_restore_fit")?;
        let arguments = (track, settings, self.threads.given()).into_pyobject(py)?;
        Ok((restore, arguments))
    }

    fn __repr__(&self) -> String {
        format!(
            "Fit({:?}, {} bins, free: {})",
            self.track.name,
            self.track.len(),
            self.target.prior().names().join(", ")
        )
    }
}

/// The fit that `Fit.__reduce__` has packed.
#[pyfunction]
pub fn _restore_fit(track: &str, settings: &str, threads: Option<usize>) -> PyResult<Fit> {
    let track =
        serde_json::from_str(track).map_err(|e| wrong("track", e, "pickle the fit again"))?;
    let settings = oblate::config::parse(settings, &PathBuf::from("pickle")).map_err(to_python)?;
    Fit::build(track, settings, Threads::new(threads)?)
}
