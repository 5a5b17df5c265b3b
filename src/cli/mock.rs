//! `oblate mock`.

use super::exit::Exit;
use super::options::{
    JsonFlag, ModelFlags, WorkFlags, finite, fit_settings, refuse_existing, write_file,
};
use super::output::{Output, shown};
use super::progress::Progress;
use crate::config::to_toml;
use crate::data::{MockSettings, MockStars, QPopulation, mocks_with};
use crate::error::{Error, Result};
use crate::params::StreamPrior;
use oblate_samplers::{Event, Observer};
use serde_json::json;
use std::path::PathBuf;

/// Flags of `oblate mock`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate mock --count 5 --seed 7 --population 0.8,0.1 --out mocks"
)]
pub struct Args {
    /// Number of mocks
    #[arg(long, default_value_t = 1)]
    count: usize,
    /// Seed of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the tracks and their true parameters
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Settings file of a fit (TOML), for prior, halo, disc and bulge
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Draw q from a truncated Gaussian MU,SIGMA instead of the prior
    #[arg(long, value_name = "MU,SIGMA", value_parser = population)]
    population: Option<QPopulation>,
    /// Relative noise of each radius
    #[arg(long, value_parser = finite)]
    noise: Option<f64>,
    /// Add mean line-of-sight velocities with this noise, km/s
    #[arg(long, value_name = "KM_S", value_parser = finite)]
    velocity_noise: Option<f64>,
    /// Add widths of the stream with this relative noise
    #[arg(long, value_parser = finite)]
    width_noise: Option<f64>,
    /// Add densities of stars with this relative noise; the settings must have `log10_n_stars`
    #[arg(long, value_parser = finite)]
    density_noise: Option<f64>,
    /// Add line-of-sight velocities of so many single stars with this noise in km/s
    #[arg(long, value_name = "COUNT,KM_S", value_parser = stars)]
    stars: Option<MockStars>,
    /// Errors of the noise alone, as in the paper: without the standard error of a mean over the stars of a bin
    #[arg(long)]
    no_star_scatter: bool,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    model: ModelFlags,
    #[command(flatten)]
    work: WorkFlags,
    #[command(flatten)]
    output: JsonFlag,
}

fn population(text: &str) -> std::result::Result<QPopulation, String> {
    let (mu, sigma) = pair(text, finite, "two finite numbers, such as 0.8,0.1")?;
    Ok(QPopulation::gaussian(mu, sigma))
}

fn stars(text: &str) -> std::result::Result<MockStars, String> {
    let whole = |count: &str| count.parse().map_err(|_| String::new());
    let (count, velocity_noise_km_s) =
        pair(text, whole, "a whole number and a finite one, such as 50,5")?;
    Ok(MockStars {
        count,
        velocity_noise_km_s,
    })
}

/// Two values with a comma between them, of which the second is a finite number.
fn pair<T>(
    text: &str,
    first: impl Fn(&str) -> std::result::Result<T, String>,
    expected: &str,
) -> std::result::Result<(T, f64), String> {
    (text.split_once(','))
        .and_then(|(a, b)| Some((first(a.trim()).ok()?, finite(b.trim()).ok()?)))
        .ok_or_else(|| format!("give {expected}"))
}

/// Makes the mocks.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    args.work.start_threads()?;
    let mut settings = MockSettings {
        population: args.population,
        star_scatter: !args.no_star_scatter,
        velocity_noise_km_s: args.velocity_noise,
        width_noise: args.width_noise,
        density_noise: args.density_noise,
        stars: args.stars,
        ..MockSettings::default()
    };
    let fit = fit_settings(args.config.as_deref())?;
    settings.model = settings.model.with_host_of(&fit.model);
    args.model.apply_to_mocks(&mut settings.model);
    if let Some(noise) = args.noise {
        settings.noise = noise;
    }
    let prior = StreamPrior::new(&fit.prior)?;
    refuse_existing(&args.out.join("mocks.json"), args.force)?;
    let threads = rayon::current_num_threads();
    args.work.tell_memory(&settings.model.memory(threads));
    let mut progress = Progress::new("mock", args.work.quiet);
    let found = mocks_with(&prior, &settings, args.count, args.seed, &mut |found| {
        progress.event(&Event::Advanced {
            done: found.mocks.len() as u64,
            of: args.count as u64,
        })
    })?;
    drop(progress);
    for mock in &found.mocks {
        for extension in ["ecsv", "toml"] {
            let file = format!("{}.{extension}", mock.track.name);
            refuse_existing(&args.out.join(file), args.force)?;
        }
    }
    std::fs::create_dir_all(&args.out).map_err(Error::io(
        &args.out,
        "choose a folder whose parent is writable",
    ))?;
    let mut rows = Vec::new();
    for mock in &found.mocks {
        let file = args.out.join(format!("{}.ecsv", mock.track.name));
        write_file(&file, mock.track.to_ecsv().as_bytes(), args.force)?;
        let parameters = args.out.join(format!("{}.toml", mock.track.name));
        write_file(&parameters, to_toml(&mock.params)?.as_bytes(), args.force)?;
        rows.push(json!({
            "name": mock.track.name, "track": shown(&file), "q": mock.q, "bins": mock.track.len(),
            "length_kpc": mock.length_kpc, "truth": mock.params,
        }));
    }
    let all = json!({
        "seed": args.seed, "tried": found.tried, "accepted": found.mocks.len(),
        "acceptance": found.acceptance(), "settings": settings, "mocks": rows,
    });
    let listing = format!("{all:#}");
    write_file(&args.out.join("mocks.json"), listing.as_bytes(), args.force)?;
    if args.output.json {
        out.json(&all)?;
    } else {
        for mock in &found.mocks {
            out.line(&format!(
                "{}: {} bins, {:.0} kpc, q = {:.3}",
                mock.track.name,
                mock.track.len(),
                mock.length_kpc,
                mock.q
            ))?;
        }
        out.line(&format!(
            "{} of {} prior draws meet the criteria: {:.1} %",
            found.mocks.len(),
            found.tried,
            100.0 * found.acceptance()
        ))?;
    }
    Ok(Exit::Done)
}
