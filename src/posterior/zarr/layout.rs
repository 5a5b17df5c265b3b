//! The arrays of a posterior file: which array holds what.

use super::entries::{OF_STARS, SURROGATE};
use super::store::{Store, text};
use crate::data::{Measured, ObservedTrack, StarVelocity};
use crate::error::{ArrayFault, Result};
use crate::track::BinQuantity;
use oblate_samplers::output::{Draws, History, Method};
use oblate_samplers::rng::{Domain, stream, unit_open};
use oblate_samplers::surrogate::Surrogate;
use oblate_samplers::{Prior, Run};
use serde_json::Map;

/// Task of the resampling's stream within [`Domain::Post`].
const RESAMPLE_TASK: u64 = 0x7a61_7272;

/// Draws laid out chain by draw.
pub struct Table<'a> {
    /// Where the values are.
    pub draws: &'a Draws,
    /// Names and units.
    pub run: &'a Run,
    /// Row numbers, chain by chain, all of one length.
    pub rows: &'a [Vec<usize>],
}

impl Table<'_> {
    fn variable(
        &self,
        store: &Store,
        at: &str,
        unit: &str,
        value: impl Fn(usize) -> f64,
    ) -> Result<()> {
        let length = self.rows.first().map_or(0, Vec::len);
        let data: Vec<f64> = self.rows.iter().flatten().map(|row| value(*row)).collect();
        let dims = [("chain", self.rows.len()), ("draw", length)];
        store.array(at, &dims, &data, text(&[("units", unit)]))
    }

    /// Coordinates, parameters and derived quantities under one group.
    pub fn write(&self, store: &Store, group: &str) -> Result<()> {
        self.coordinates(store, group)?;
        let (draws, run) = (self.draws, self.run);
        for (i, (name, unit)) in run.names.iter().zip(&run.units).enumerate() {
            self.variable(store, &format!("{group}/{name}"), unit, |row| {
                draws.theta_row(row)[i]
            })?;
        }
        for (i, (name, unit)) in run.derived_names.iter().enumerate() {
            self.variable(store, &format!("{group}/{name}"), unit, |row| {
                draws.derived_row(row)[i]
            })?;
        }
        Ok(())
    }

    fn coordinates(&self, store: &Store, group: &str) -> Result<()> {
        store.group(group, &Map::new())?;
        for (name, count) in [
            ("chain", self.rows.len()),
            ("draw", self.rows.first().map_or(0, Vec::len)),
        ] {
            let index: Vec<u64> = (0..count as u64).collect();
            store.array(
                &format!("{group}/{name}"),
                &[(name, count)],
                &index,
                Map::new(),
            )?;
        }
        Ok(())
    }
}

/// Row numbers of equal-weight draws, chain by chain.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "an effective size lies between 0 and the number of rows"
)]
#[must_use]
pub fn equal_weight_rows(run: &Run) -> Vec<Vec<usize>> {
    let draws = &run.draws;
    if run.method == Method::PtHmc {
        let rows = draws.chains();
        let equal = draws
            .ln_weight
            .windows(2)
            .all(|w| (w[0] - w[1]).abs() < 1e-12);
        if equal && rows.windows(2).all(|w| w[0].len() == w[1].len()) {
            return rows;
        }
    }
    let count = oblate_samplers::diagnostics::kish_ess(&draws.ln_weight).ceil() as usize;
    let offset = unit_open(&mut stream(run.seed, Domain::Post, RESAMPLE_TASK, 0));
    vec![draws.resample(count.min(draws.len()), offset)]
}

/// Writes groups `posterior` and `sample_stats`, the latter with the density of the posterior if that of the prior is given.
pub fn write_posterior(store: &Store, run: &Run, prior: Option<&Prior>) -> Result<()> {
    let rows = equal_weight_rows(run);
    let table = Table {
        draws: &run.draws,
        run,
        rows: &rows,
    };
    table.write(store, "/posterior")?;
    table.coordinates(store, "/sample_stats")?;
    let draws = &run.draws;
    table.variable(store, "/sample_stats/ln_likelihood", "", |row| {
        draws.ln_likelihood[row]
    })?;
    let Some(prior) = prior else {
        return Ok(());
    };
    table.variable(store, "/sample_stats/lp", "", |row| {
        draws.ln_likelihood[row] + prior.ln_pdf(draws.theta_row(row))
    })
}

/// Writes group `observed_data`.
pub fn write_track(store: &Store, track: &ObservedTrack) -> Result<()> {
    store.group("/observed_data", &text(&[("name", &track.name)]))?;
    write_columns(store, "bin", bin_columns(track))?;
    write_columns(store, "star", star_columns(&track.stars))
}

/// Name, unit and values of a variable of the data.
type Column = (&'static str, &'static str, Vec<f64>);

/// Writes variables of the group `observed_data` along one dimension.
fn write_columns(store: &Store, dim: &str, columns: Vec<Column>) -> Result<()> {
    for (name, unit, values) in columns {
        store.array(
            &format!("/observed_data/{name}"),
            &[(dim, values.len())],
            &values,
            text(&[("units", unit)]),
        )?;
    }
    Ok(())
}

/// The velocities of single stars; none of a track without such.
fn star_columns(stars: &[StarVelocity]) -> Vec<Column> {
    if stars.is_empty() {
        return Vec::new();
    }
    let of = |value: fn(&StarVelocity) -> f64| stars.iter().map(value).collect();
    let unit = BinQuantity::Velocity.column().unit;
    let [phi, v, v_err] = OF_STARS;
    vec![
        (phi, "deg", of(|star| star.phi_deg)),
        (v, unit, of(|star| star.v_km_s.value)),
        (v_err, unit, of(|star| star.v_km_s.error)),
    ]
}

/// What is measured in each bin.
fn bin_columns(track: &ObservedTrack) -> Vec<Column> {
    let mut columns = vec![
        ("phi", "deg", track.phi_deg.clone()),
        ("r", "kpc", track.r_kpc.clone()),
    ];
    if track.has_symmetric_errors() {
        columns.push(("r_err", "kpc", track.r_err_lo_kpc.clone()));
    } else {
        columns.push(("r_err_lo", "kpc", track.r_err_lo_kpc.clone()));
        columns.push(("r_err_hi", "kpc", track.r_err_hi_kpc.clone()));
    }
    if let Some(n) = &track.n {
        columns.push(("n", "", n.clone()));
    }
    for (quantity, rows) in &track.measured {
        let column = quantity.column();
        // NaN where nothing is measured.
        let values = |of: fn(&Measured) -> f64| -> Vec<f64> {
            rows.iter()
                .map(|m| m.as_ref().map_or(f64::NAN, of))
                .collect()
        };
        columns.push((column.value, column.unit, values(|m| m.value)));
        columns.push((column.error, column.unit, values(|m| m.error)));
    }
    columns
}

/// Writes group `weighted`: the sampler's own draws with weights and labels.
pub fn write_weighted(store: &Store, draws: &Draws) -> Result<()> {
    store.group("/weighted", &Map::new())?;
    let row = ("row", draws.len());
    let none = Map::new;
    let theta = [row, ("parameter", draws.dim)];
    store.array("/weighted/theta", &theta, &draws.theta, none())?;
    let derived = [row, ("quantity", draws.derived_dim)];
    store.array("/weighted/derived", &derived, &draws.derived, none())?;
    store.array(
        "/weighted/ln_likelihood",
        &[row],
        &draws.ln_likelihood,
        none(),
    )?;
    store.array("/weighted/ln_weight", &[row], &draws.ln_weight, none())?;
    store.array("/weighted/chain", &[row], &draws.chain, none())?;
    store.array("/weighted/cluster", &[row], &draws.cluster, none())
}

/// Reads group `weighted`.
pub fn read_weighted(store: &Store, dim: usize, derived_dim: usize) -> Result<Draws> {
    let ln_likelihood: Vec<f64> = store.read("/weighted/ln_likelihood", &[None])?;
    let row = Some(ln_likelihood.len());
    Ok(Draws {
        dim,
        derived_dim,
        theta: store.read("/weighted/theta", &[row, Some(dim)])?,
        derived: store.read("/weighted/derived", &[row, Some(derived_dim)])?,
        ln_weight: store.read("/weighted/ln_weight", &[row])?,
        chain: store.read("/weighted/chain", &[row])?,
        cluster: store.read("/weighted/cluster", &[row])?,
        ln_likelihood,
    })
}

/// Writes group `history`.
pub fn write_history(store: &Store, history: &History) -> Result<()> {
    store.group("/history", &Map::new())?;
    let floats = |name: &str, dim: &str, values: &[f64]| {
        let dims = [(dim, values.len())];
        store.array(&format!("/history/{name}"), &dims, values, Map::new())
    };
    match history {
        History::Nested {
            ln_x,
            ln_likelihood,
            ln_likelihood_birth,
            live,
            insertion_rank,
        } => {
            floats("ln_x", "step", ln_x)?;
            floats("ln_likelihood", "step", ln_likelihood)?;
            floats("ln_likelihood_birth", "step", ln_likelihood_birth)?;
            store.array("/history/live", &[("step", live.len())], live, Map::new())?;
            floats("insertion_rank", "insertion", insertion_rank)
        }
        History::Tempered {
            beta,
            mean_ln_likelihood,
            variance_ln_likelihood,
            swap_rejection,
            acceptance,
            step_size,
            mean_leapfrogs,
            divergences,
            communication_barrier,
            round_trips,
            trace,
        } => {
            floats("beta", "temperature", beta)?;
            floats("mean_ln_likelihood", "temperature", mean_ln_likelihood)?;
            floats(
                "variance_ln_likelihood",
                "temperature",
                variance_ln_likelihood,
            )?;
            floats("swap_rejection", "pair", swap_rejection)?;
            floats("acceptance", "temperature", acceptance)?;
            floats("step_size", "temperature", step_size)?;
            floats("mean_leapfrogs", "temperature", mean_leapfrogs)?;
            let per_temperature = [("temperature", divergences.len())];
            store.array(
                "/history/divergences",
                &per_temperature,
                divergences,
                Map::new(),
            )?;
            floats(
                "communication_barrier",
                "temperature",
                communication_barrier,
            )?;
            let chain_sets = [("chain_set", round_trips.len())];
            store.array("/history/round_trips", &chain_sets, round_trips, Map::new())?;
            // Chain sets may differ in length: one flat array, and the length of each.
            let lengths: Vec<u64> = trace.iter().map(|t| t.len() as u64).collect();
            store.array(
                "/history/trace_length",
                &[("chain_set", lengths.len())],
                &lengths,
                Map::new(),
            )?;
            floats("trace", "scan", &trace.concat())
        }
        History::Bridge {
            fraction,
            ln_ratio,
            ancestors,
            correlation,
        } => {
            floats("fraction", "step", fraction)?;
            floats("ln_ratio", "step", ln_ratio)?;
            floats("ancestors", "step", ancestors)?;
            floats("correlation", "step", correlation)
        }
    }
}

/// Writes group `surrogate`.
pub fn write_surrogate(store: &Store, surrogate: &Surrogate) -> Result<()> {
    store.group("/surrogate", &Map::new())?;
    for (name, numbers) in SURROGATE.iter().zip(surrogate.numbers()) {
        let dims = [(*name, numbers.len())];
        store.array(&format!("/surrogate/{name}"), &dims, &numbers, Map::new())?;
    }
    Ok(())
}

/// Reads group `surrogate`; none if the run had no surrogate.
pub fn read_surrogate(store: &Store) -> Result<Option<Surrogate>> {
    if !store.has("/surrogate") {
        return Ok(None);
    }
    let array = |name: &str| store.read::<f64>(&format!("/surrogate/{name}"), &[None]);
    let [features, outputs, parameters] = SURROGATE;
    let numbers = [array(features)?, array(outputs)?, array(parameters)?];
    let fault = || store.fault("/surrogate", ArrayFault::Surrogate);
    Surrogate::of_numbers(&numbers).map(Some).ok_or_else(fault)
}

/// Reads group `history`.
pub fn read_history(store: &Store, method: Method) -> Result<History> {
    let array = |name: &str, length| store.read::<f64>(&format!("/history/{name}"), &[length]);
    Ok(match method {
        Method::Nested => {
            let ln_x = array("ln_x", None)?;
            let step = Some(ln_x.len());
            History::Nested {
                ln_x,
                ln_likelihood: array("ln_likelihood", step)?,
                ln_likelihood_birth: array("ln_likelihood_birth", step)?,
                live: store.read("/history/live", &[step])?,
                insertion_rank: array("insertion_rank", None)?,
            }
        }
        Method::PtHmc => {
            let beta = array("beta", None)?;
            let (temperature, gap) = (Some(beta.len()), Some(beta.len().saturating_sub(1)));
            History::Tempered {
                beta,
                mean_ln_likelihood: array("mean_ln_likelihood", temperature)?,
                variance_ln_likelihood: array("variance_ln_likelihood", temperature)?,
                swap_rejection: array("swap_rejection", gap)?,
                acceptance: array("acceptance", temperature)?,
                step_size: array("step_size", temperature)?,
                mean_leapfrogs: array("mean_leapfrogs", temperature)?,
                divergences: store.read("/history/divergences", &[temperature])?,
                communication_barrier: array("communication_barrier", temperature)?,
                round_trips: store.read("/history/round_trips", &[None])?,
                trace: read_traces(store)?,
            }
        }
        Method::Bridge => {
            let fraction = array("fraction", None)?;
            let step = Some(fraction.len());
            History::Bridge {
                fraction,
                ln_ratio: array("ln_ratio", step)?,
                ancestors: array("ancestors", step)?,
                correlation: array("correlation", step)?,
            }
        }
    })
}

/// The traces of all chain sets, from one flat array and the length of each.
fn read_traces(store: &Store) -> Result<Vec<Vec<f64>>> {
    const LENGTHS: &str = "/history/trace_length";
    let flat: Vec<f64> = store.read("/history/trace", &[None])?;
    let lengths: Vec<u64> = store.read(LENGTHS, &[None])?;
    let mut rest = flat.as_slice();
    let mut traces = Vec::with_capacity(lengths.len());
    for length in &lengths {
        let split = usize::try_from(*length)
            .ok()
            .and_then(|n| rest.split_at_checked(n));
        let Some((trace, after)) = split else { break };
        traces.push(trace.to_vec());
        rest = after;
    }
    if traces.len() < lengths.len() || !rest.is_empty() {
        let sum: u128 = lengths.iter().map(|length| u128::from(*length)).sum();
        let needed = flat.len();
        return Err(store.fault(LENGTHS, ArrayFault::TraceLengths { sum, needed }));
    }
    Ok(traces)
}
