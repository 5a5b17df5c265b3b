//! `oblate evaluate`: the likelihood for programs in any language.

use super::exit::Exit;
use super::options::{ModelFlags, TrackFlags, WorkFlags};
use super::output::{Output, note};
use crate::error::{Error, Rejection, Result};
use crate::inference::{Evaluated, StreamTarget, Wanted};
use crate::params::{DIM, NAMES, ParameterLines, StreamParams, StreamPrior};
use oblate_samplers::Target;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::io::BufRead;
use std::path::PathBuf;
use std::time::Instant;

/// Flags of `oblate evaluate`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate evaluate track.ecsv --gradient < parameters.jsonl\n\n\
Each input line is a JSON object with the parameters, where fixed ones may be left out, or a list of such objects; each output line \
is\n  {\"ln_likelihood\": x or null, \"rejected\": cause or null, \"gradient\": {name: ..}, \"derived\": {name: ..}, \"seconds\": ..}\n\
or a list of these"
)]
pub struct Args {
    /// The track (ECSV or CSV)
    track: PathBuf,
    /// Print the gradient with respect to the parameters too
    #[arg(long)]
    gradient: bool,
    /// Read the free parameters as coordinates of the unit cube, and print the parameters too; the gradient is then that by the coordinates
    #[arg(long)]
    cube: bool,
    #[command(flatten)]
    reading: TrackFlags,
    /// Settings file of a fit (TOML), for model, likelihood and prior; flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    work: WorkFlags,
}

/// Answers each line before reading the next, until the reader closes the output.
pub fn run(args: &Args, input: &mut dyn BufRead, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    let settings = args.model.settings(args.config.as_deref())?;
    let track = args.reading.read(&args.track)?;
    for assumption in track.assumptions() {
        note(&format!("assumed: {assumption}"));
    }
    let target = StreamTarget::from_track(&track, &settings)?;
    args.work.tell_memory(&target.memory(1));
    let wanted = if args.gradient {
        Wanted::Gradient
    } else {
        Wanted::Value
    };
    let stdin = PathBuf::from("standard input");
    for line in ParameterLines::new(input, stdin.clone()) {
        let line = line?;
        let begin = Instant::now();
        let points: Result<Vec<Point>> = line
            .points
            .iter()
            .map(|given| Point::new(&target, given, args.cube))
            .collect();
        let points = points.map_err(|e| Error::InFile {
            path: stdin.clone(),
            line: Some(line.number),
            source: Box::new(e),
        })?;
        let evaluated = match points.as_slice() {
            [one] => vec![target.evaluate(&one.params, wanted)],
            many => target.evaluate_all(many.par_iter().map(|point| point.params), wanted),
        };
        let seconds = begin.elapsed().as_secs_f64();
        let mut answers = points.iter().zip(evaluated).map(|(point, evaluated)| {
            let mut answer = point.answer(&target, evaluated);
            answer.insert("seconds".to_owned(), seconds.into());
            Value::Object(answer)
        });
        match answers.next() {
            Some(answer) if !line.is_list => out.json(&answer)?,
            first => out.json(&first.into_iter().chain(answers).collect::<Vec<_>>())?,
        }
        if out.closed() {
            break;
        }
    }
    Ok(Exit::Done)
}

/// A point of the input.
struct Point {
    /// All parameters.
    params: StreamParams<f64>,
    /// Coordinates of the unit cube of the free ones, if the input has these.
    cube: Option<Vec<f64>>,
}

impl Point {
    /// # Errors
    /// Those of [`StreamPrior::complete`](crate::params::StreamPrior::complete).
    fn new(target: &StreamTarget, given: &StreamParams<Option<f64>>, cube: bool) -> Result<Self> {
        let prior = target.stream_prior();
        let params = prior.complete(given)?;
        if !cube {
            return Ok(Self { params, cube: None });
        }
        let cube = prior.free_values(&params.to_array());
        let mut theta = cube.clone();
        prior.prior().theta_from_u(&cube, &mut theta);
        Ok(Self {
            params: target.params(&theta),
            cube: Some(cube),
        })
    }

    /// What is printed of it.
    fn answer(
        &self,
        target: &StreamTarget,
        evaluated: std::result::Result<Evaluated, Rejection>,
    ) -> Map<String, Value> {
        let prior = target.stream_prior();
        let all = self.params.to_array();
        let mut answer = Map::new();
        match evaluated {
            Ok(evaluated) => {
                answer.insert("ln_likelihood".to_owned(), evaluated.ln_likelihood.into());
                answer.insert("rejected".to_owned(), Value::Null);
                if let Some(gradient) = &evaluated.gradient {
                    let gradient = match &self.cube {
                        None => of_present(prior, gradient),
                        Some(cube) => {
                            let mut gradient = prior.free_values(gradient);
                            prior.prior().gradient_to_u(cube, &mut gradient);
                            by_name(prior.prior().names(), &gradient)
                        }
                    };
                    answer.insert("gradient".to_owned(), gradient);
                }
            }
            Err(cause) => {
                answer.insert("ln_likelihood".to_owned(), Value::Null);
                answer.insert("rejected".to_owned(), cause.name().into());
            }
        }
        if self.cube.is_some() {
            answer.insert("parameters".to_owned(), of_present(prior, &all));
        }
        let names = target.derived_names().into_iter().map(|(name, _)| name);
        let mut derived = Vec::new();
        target.derived(&prior.free_values(&all), &mut derived);
        answer.insert("derived".to_owned(), by_name(names, &derived));
        answer
    }
}

/// An object of the numbers of those parameters that the prior has, by name.
fn of_present(prior: &StreamPrior, all: &[f64; DIM]) -> Value {
    let present = prior.present();
    let numbers: Vec<f64> = present.iter().map(|&i| all[i]).collect();
    by_name(present.iter().map(|&i| NAMES[i]), &numbers)
}

/// An object of numbers by name; numbers that are not finite are null.
fn by_name(names: impl IntoIterator<Item = impl ToString>, numbers: &[f64]) -> Value {
    let pairs = names.into_iter().zip(numbers);
    let pairs = pairs.map(|(name, number)| (name.to_string(), json!(number)));
    Value::Object(pairs.collect())
}
