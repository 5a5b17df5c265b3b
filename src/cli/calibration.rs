//! `oblate calibration`.

use super::exit::Exit;
use super::options::{JsonFlag, refuse_existing, write_file};
use super::output::{Output, note};
use super::run_folders::{finished, run_folders, with_track};
use crate::error::Result;
use crate::posterior::{
    Calibration, CalibrationRow, LEVELS, MIN_P_VALUE, RankedFit, Trend, trends,
};
use crate::report::{calibration, q_errors};
use crate::run::ranked_fits;
use oblate_samplers::diagnostics::weighted_quantile;
use serde_json::json;
use std::path::PathBuf;

/// Flags of `oblate calibration`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("figures").args(["figure", "errors"]).multiple(true),
    after_help = "Example:\n  oblate mock --count 100 --out mocks\n  oblate calibration runs/mock_* --figure ranks.svg\n  \
oblate calibration runs/mock_* --json > part1.json\n  oblate calibration part1.json more_runs/mock_*\n\n\
The mocks must come from the prior of the fits. Columns: mean rank, the mean of the posterior probabilities below the true values, 0.5 if they are \
right; p-value, of the Kolmogorov-Smirnov test that these are uniform; the fraction of true values within central intervals of each probability."
)]
pub struct Args {
    /// Finished fits of mocks, each of another one, and tables that --json has printed (FILE.json); unfinished fits, and other files and folders, are skipped with a note
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Figure of the distribution of ranks to write (SVG)
    #[arg(long, value_name = "FILE")]
    figure: Option<PathBuf>,
    /// Figure of the error of q over how far the tracks extend to write (SVG)
    #[arg(long, value_name = "FILE")]
    errors: Option<PathBuf>,
    /// Replace figures that exist
    #[arg(long, requires = "figures")]
    force: bool,
    #[command(flatten)]
    output: JsonFlag,
}

/// Ranks the true values of mocks in their fits.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    for path in [&args.figure, &args.errors].into_iter().flatten() {
        refuse_existing(path, args.force)?;
    }
    let is_table = |path: &PathBuf| path.extension().is_some_and(|e| e == "json");
    let (mut paths, runs): (Vec<PathBuf>, Vec<PathBuf>) =
        args.runs.iter().cloned().partition(is_table);
    paths.extend(finished(&with_track(&run_folders(&runs))));
    let fits = ranked_fits(&paths)?;
    let (found, trends) = (Calibration::new(&fits), trends(&fits));
    for (path, svg) in [
        (&args.figure, calibration(&fits)),
        (&args.errors, q_errors(&fits, &trends)),
    ] {
        match (path, svg) {
            (Some(path), Some(svg)) => write_file(path, svg.as_bytes(), args.force)?,
            (Some(path), None) => note(&format!(
                "{} is not written: {} fits are too few for it.",
                path.display(),
                fits.len()
            )),
            (None, _) => (),
        }
    }
    if args.output.json {
        out.json(
            &json!({"levels": LEVELS, "calibration": found, "q_errors": trends, "fits": fits}),
        )?;
    } else {
        print(&found, &trends, out)?;
        out.line(&price(&fits))?;
    }
    if found.is_uniform() {
        return Ok(Exit::Done);
    }
    note(
        "Find out where the ranks depart before these fits are used: compare fits of the same mocks with more particles and time steps, and by \
         the other sampler; a mean rank below 0.5 is a posterior that lies too high.",
    );
    Ok(Exit::Failed)
}

fn print(found: &Calibration, trends: &[Trend], out: &mut Output<'_>) -> Result<()> {
    let fits = |rows: &[CalibrationRow]| rows.first().map_or(0, |row| row.fits);
    let (all, converged) = (fits(&found.all), fits(&found.converged));
    if converged > 0 {
        table("fits that have passed their checks", &found.converged, out)?;
    }
    if all > converged {
        table("fits, whether they have passed or not", &found.all, out)?;
    }
    if !found.q_by_bins.is_empty() {
        out.line("\nq by the number of bins, of the fits that have passed:")?;
        out.line(&head("bins"))?;
        for group in &found.q_by_bins {
            let (lo, hi) = group.bins;
            out.line(&line(&format!("{lo} to {hi}"), &group.row))?;
        }
    }
    if let Some(first) = trends.first() {
        out.line(&format!(
            "\nThe mean of |q - true q| over a posterior is {:.3} on average over {} fits. Its straight line over the extent of the tracks:",
            first.q_error, first.fits
        ))?;
        out.line(&format!(
            "{:>19} {:>9} {:>22} {:>12}",
            "number", "mean", "slope", "correlation"
        ))?;
        for trend in trends {
            let slope = format!("{:.1e} +- {:.1e}", trend.slope, trend.slope_error);
            out.line(&format!(
                "{:>19} {:9.1} {slope:>22} {:12.2}",
                trend.name, trend.mean, trend.correlation
            ))?;
        }
    }
    if let Some((row, p)) = found.worst() {
        let verdict = if found.is_uniform() {
            "The ranks are as uniform as they should be"
        } else {
            "The ranks are NOT UNIFORM"
        };
        out.line(&format!(
            "\n{verdict}: the worst quantity is {}, p-value {p:.2} with the number of quantities taken into account (limit {MIN_P_VALUE}).",
            row.name
        ))?;
    }
    Ok(())
}

/// How many fits have passed, and what fits cost.
fn price(fits: &[RankedFit]) -> String {
    let passed = fits.iter().filter(|fit| fit.converged).count();
    let seconds: Vec<f64> = fits.iter().map(|fit| fit.cpu_seconds).collect();
    let weights = vec![1.0; seconds.len()];
    let [median, nine_tenths, largest] =
        [0.5, 0.9, 1.0].map(|p| weighted_quantile(&seconds, &weights, p));
    format!(
        "{passed} of {} fits have passed their checks. CPU seconds of a fit: median {median:.0}, 90 % below {nine_tenths:.0}, largest {largest:.0}.",
        fits.len()
    )
}

/// A table with a row for each quantity.
fn table(what: &str, rows: &[CalibrationRow], out: &mut Output<'_>) -> Result<()> {
    let Some(first) = rows.first() else {
        return Ok(());
    };
    out.line(&format!("\n{} {what}:", first.fits))?;
    out.line(&head("quantity"))?;
    for row in rows {
        out.line(&line(&row.name, row))?;
    }
    let errors = LEVELS.map(|level| format!("{:8.3}", first.coverage_error(level)));
    out.line(&format!(
        "{:>19} {:5} {:10.3} {:8} {}",
        "standard error",
        "",
        1.0 / (12.0 * first.fits as f64).sqrt(),
        "",
        errors.join("")
    ))
}

/// The names of the columns.
fn head(first: &str) -> String {
    let levels = LEVELS.map(|level| format!("{:>8}", format!("{:.0} %", 100.0 * level)));
    format!(
        "{first:>19} {:>5} {:>10} {:>8} {}",
        "fits",
        "mean rank",
        "p-value",
        levels.join("")
    )
}

/// One row.
fn line(name: &str, row: &CalibrationRow) -> String {
    let coverage = row.coverage.map(|fraction| format!("{fraction:8.3}"));
    format!(
        "{name:>19} {:5} {:10.3} {:8.3} {}",
        row.fits,
        row.mean_rank,
        row.p_value,
        coverage.join("")
    )
}
