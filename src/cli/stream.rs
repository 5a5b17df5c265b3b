//! `oblate stream`.

use super::exit::Exit;
use super::options::{JsonFlag, ModelFlags, WorkFlags, finite, refuse_existing, write_file};
use super::output::Output;
use crate::config::read;
use crate::error::{Error, Result};
use crate::params::{StreamParams, StreamPrior};
use crate::stream::{Model, Particles, StreamInput, Threads, Workspace, host_of};
use crate::track::{BIN_WIDTHS_DEG, BinEdges, Track};
use oblate_samplers::limits::in_range;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Flags of `oblate stream`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  oblate stream mocks/mock_7_3.toml --json")]
pub struct Args {
    /// The parameters as TOML, optional ones of the model too; those that the settings fix may be left out
    params: PathBuf,
    /// Bin width in degrees
    #[arg(long, default_value_t = 10.0, value_parser = finite)]
    bin_width: f64,
    /// Half-width of soft bin edges in degrees; 0: hard edges [default: that of the settings, 2]
    #[arg(long, value_parser = finite)]
    edge: Option<f64>,
    /// Minimum fraction of all particles that a bin of the track must have [default: that of the settings, 0.005]
    #[arg(long, value_parser = finite)]
    min_fraction: Option<f64>,
    /// Write the particles to this CSV file
    #[arg(long, value_name = "FILE")]
    particles_out: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    /// Settings file of a fit (TOML), for model, bin edges and the range of q; flags override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

/// Computes one stream.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    let given: StreamParams<Option<f64>> = read(&args.params)?;
    let settings = args.model.settings(args.config.as_deref())?;
    let prior = (settings.prior.with_required_free()).with_optional_of(&given);
    let prior = StreamPrior::new(&prior)?;
    let in_file = |e| Error::InFile {
        path: args.params.clone(),
        line: None,
        source: Box::new(e),
    };
    settings.model.check_prior(&prior).map_err(in_file)?;
    let params = prior.complete(&given).map_err(in_file)?;
    prior.check_inside(&params).map_err(in_file)?;
    in_range("--bin-width", args.bin_width, BIN_WIDTHS_DEG)?;
    let edge = args.edge.unwrap_or(match settings.likelihood.edges {
        BinEdges::Hard => 0.0,
        BinEdges::Soft { half_width_deg } => half_width_deg,
    });
    in_range("--edge", edge, 0.0..=0.5 * args.bin_width)?;
    let edges = match edge {
        0.0 => BinEdges::Hard,
        half_width_deg => BinEdges::Soft { half_width_deg },
    };
    let min_fraction = args
        .min_fraction
        .unwrap_or(settings.likelihood.min_fraction);
    in_range("--min-fraction", min_fraction, 0.0..=1.0)?;
    let settings = settings.model;
    if let Some(file) = &args.particles_out {
        refuse_existing(file, args.force)?;
    }
    let model = Model::new(&settings)?;
    args.work.tell_memory(&settings.memory(1));
    let begin = Instant::now();
    let input = StreamInput {
        params: &params,
        q_range: prior.q_range(),
        threads: Threads::All,
    };
    let mut work = Workspace::default();
    (model.particles(&input, &mut work)).map_err(Error::NoTrack)?;
    let particles = work.particles;
    let min_n = min_fraction * particles.len() as f64;
    // As data have it whose progenitor is at another phi, or whose distance is another.
    let track = Track::new(&particles, args.bin_width, edges, min_n)?.measured_with(&params);
    let seconds = begin.elapsed().as_secs_f64();
    if let Some(file) = &args.particles_out {
        let csv = particles_csv(&particles, &model);
        write_file(file, csv.as_bytes(), args.force)?;
    }
    let shape = prior.shape(&params);
    if args.output.json {
        let column =
            |f: fn(&crate::track::TrackBin) -> f64| track.bins.iter().map(f).collect::<Vec<f64>>();
        out.json(&json!({
            "track": {
                "phi_deg": column(|b| b.phi_deg), "r_kpc": column(|b| b.r_kpc),
                "r_err_kpc": column(|b| b.r_err_kpc), "n": column(|b| b.n),
                "v_km_s": column(|b| b.v_km_s), "v_err_km_s": column(|b| b.v_err_km_s),
                "width_kpc": column(|b| b.width_kpc), "density_per_deg": column(|b| b.density_per_deg),
            },
            "q": shape.q,
            "axis": shape.axis.to_array(),
            "diagnostics": {
                "bounded_tidal_radius": particles.tally.bounded_tidal_radius,
                "ambiguous_windings": particles.tally.ambiguous_windings,
                "orbit_energy_error": host_of(&settings).orbit_energy_error(&model, &input).map_err(Error::NoTrack)?,
                "particles": particles.len(),
            },
            "seconds": seconds,
        }))?;
    } else {
        out.line(&format!(
            "q = {:.4}, axis = {:.3?}",
            shape.q,
            shape.axis.to_array()
        ))?;
        out.line(" phi/deg     r/kpc   +-/kpc        n    v/(km/s) +-/(km/s) width/kpc")?;
        for b in &track.bins {
            out.line(&format!(
                "{:8.1} {:9.3} {:8.3} {:8.1} {:11.2} {:9.2} {:9.3}",
                b.phi_deg, b.r_kpc, b.r_err_kpc, b.n, b.v_km_s, b.v_err_km_s, b.width_kpc
            ))?;
        }
        if particles.tally.ambiguous_windings > 0 {
            out.line(&format!(
                    "{} eighths of particle steps turn by more than 90 degrees, so that windings are ambiguous: give more --steps",
                    particles.tally.ambiguous_windings
                ),
            )?;
        }
    }
    Ok(Exit::Done)
}

/// The particles as CSV.
fn particles_csv(particles: &Particles, model: &Model) -> String {
    let table = model.particle_table(particles);
    let names = table.columns.each_ref().map(|(name, _)| *name);
    let mut text = format!("tail,{}\n", names.join(","));
    for (i, tail) in table.tails.iter().enumerate() {
        text += tail.name();
        for (_, values) in &table.columns {
            text += &format!(",{}", values[i]);
        }
        text.push('\n');
    }
    text
}
