//! `oblate compare`.

use super::exit::Exit;
use super::options::JsonFlag;
use super::output::{Output, note};
use crate::error::{Error, Result};
use crate::inference::FitSettings;
use crate::posterior::{Comparison, compare, compare_models};
use crate::run::{RunFolder, StoredRun, distinct_names};
use std::path::PathBuf;

/// Flags of `oblate compare`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate compare runs/s0_nested runs/s0_pt-hmc\n\n\
Columns: diff/err, the difference of the means over its standard error; diff/w68, that of the medians over the half-width of the 68 % interval;\n\
distance, the Wasserstein distance over that half-width; expected, its expectation for equal posteriors."
)]
pub struct Args {
    /// Finished runs of one track, by other samplers, with other seeds or in other hosts
    #[arg(required = true, num_args = 2..)]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Compares every run with the first.
pub fn run(args: &Args, out: &mut Output<'_>) -> Result<Exit> {
    let stored: Vec<StoredRun> = args
        .runs
        .iter()
        .map(|path| RunFolder::open(path)?.read())
        .collect::<Result<_>>()?;
    let Some((first, others)) = stored.split_first() else {
        return Err(Error::TooFewRuns { given: 0, min: 2 });
    };
    tell_other_tracks(&args.runs)?;
    let of_first = tell_other_posteriors(&args.runs, &stored)?;
    let names = distinct_names(&args.runs, &stored.iter().collect::<Vec<_>>());
    let mut agree = true;
    for ((other, name), one_model) in others.iter().zip(&names[1..]).zip(&of_first[1..]) {
        let comparison = if *one_model {
            compare(&names[0], &first.run, name, &other.run)?
        } else {
            compare_models(&names[0], &first.run, name, &other.run)?
        };
        agree &= comparison.agree();
        if args.output.json {
            out.json(&comparison)?;
        } else {
            print(&comparison, out)?;
        }
    }
    if agree {
        return Ok(Exit::Done);
    }
    note(
        "To decide between runs that disagree, continue those that have not converged; if all have, fit again with another seed, and trust \
         those that agree.",
    );
    Ok(Exit::Failed)
}

/// Says which fits are of another track than the first.
fn tell_other_tracks(runs: &[PathBuf]) -> Result<()> {
    let track = |path: &PathBuf| {
        let folder = RunFolder::open(path)?;
        // A population has none.
        folder
            .track()
            .is_file()
            .then(|| folder.read_track())
            .transpose()
    };
    let Some(first) = track(&runs[0])? else {
        return Ok(());
    };
    for path in &runs[1..] {
        if track(path)?.is_some_and(|other| !other.has_data_of(&first)) {
            note(&format!(
                "{} is the fit of another track, or of the other sense of phi, than {}: they need not agree.",
                path.display(),
                runs[0].display()
            ));
        }
    }
    Ok(())
}

/// Whether each run asks for the posterior that the first asks for, and says which fits do not.
fn tell_other_posteriors(runs: &[PathBuf], stored: &[StoredRun]) -> Result<Vec<bool>> {
    let of_run =
        |(path, stored): (&PathBuf, &StoredRun)| stored.fit_settings(&RunFolder::open(path)?);
    let settings: Vec<Option<FitSettings>> =
        (runs.iter().zip(stored).map(of_run)).collect::<Result<_>>()?;
    let mut of_first = vec![true; runs.len()];
    for ((path, other), same) in runs.iter().zip(&settings).zip(&mut of_first) {
        let (Some(first), Some(other)) = (&settings[0], other) else {
            continue;
        };
        *same = first.has_posterior_of(other);
        let (first, other, host) = (
            &first.model,
            &other.model,
            first.model.has_host_of(&other.model),
        );
        if !*same && host {
            note(&format!(
                "{} is a fit with another prior, or with other errors of the data, than {}: they need not agree.",
                path.display(),
                runs[0].display()
            ));
        } else if !host {
            note(&format!(
                "{} is a fit in another host ({}) than {} ({}): they need not agree. The difference of ln Z is the evidence for one host \
                 over the other, under their priors.",
                path.display(),
                other.host_in_words(),
                runs[0].display(),
                first.host_in_words()
            ));
        }
    }
    Ok(of_first)
}

fn print(c: &Comparison, out: &mut Output<'_>) -> Result<()> {
    out.line(&format!(
        "{} against {}: {}",
        c.names[0],
        c.names[1],
        c.verdict()
    ))?;
    out.line(&format!(
        "ln Z {:.3} +- {:.3} and {:.3} +- {:.3}: difference {:+.2} combined errors",
        c.ln_z[0].value, c.ln_z[0].error, c.ln_z[1].value, c.ln_z[1].error, c.ln_z_sigma
    ))?;
    out.line(
        "           quantity     median_1     median_2  diff/err  diff/w68  distance  expected",
    )?;
    for row in &c.marginals {
        out.line(&format!(
            "{:>19} {:12.4} {:12.4} {:+9.2} {:9.3} {:9.3} {:9.3}",
            row.name,
            row.median[0],
            row.median[1],
            row.sigma,
            row.shift,
            row.wasserstein,
            row.wasserstein_expected
        ))?;
    }
    for mode in &c.modes {
        out.line(&format!(
            "{:>19} {:6.3} +- {:.3} {:6.3} +- {:.3} {:+9.2}",
            mode.name, mode.weight[0], mode.error[0], mode.weight[1], mode.error[1], mode.sigma
        ))?;
    }
    for (i, cost) in c.cost.iter().enumerate() {
        let mut line = format!(
            "{}: {} calls, {} gradients, ESS {:.0}, {:.0} CPU seconds",
            c.names[i], cost.calls, cost.gradients, cost.ess, cost.cpu_seconds
        );
        if let Some(rate) = cost.q_ess_per_cpu_second {
            line.push_str(&format!(", ESS of q {rate:.3} per CPU second"));
        }
        out.line(&line)?;
    }
    Ok(())
}
