//! `oblate compare`.

use super::exit::Exit;
use super::options::JsonFlag;
use super::output::{Output, note};
use crate::error::{Error, Result};
use crate::posterior::{Comparison, compare, compare_models, compare_other_data};
use crate::run::{Asked, Difference, RunFolder, StoredRun, distinct_names};
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
    let mut stored: Vec<StoredRun> = Vec::new();
    let mut asked: Vec<Asked> = Vec::new();
    for path in &args.runs {
        let folder = RunFolder::open(path)?;
        let run = folder.read()?;
        asked.push(Asked::of(&run, &folder)?);
        stored.push(run);
    }
    let Some((first, others)) = stored.split_first() else {
        return Err(Error::TooFewRuns { given: 0, min: 2 });
    };
    let names = distinct_names(&args.runs, &stored.iter().collect::<Vec<_>>());
    let mut agree = true;
    for (i, other) in (1..).zip(others) {
        let difference = asked[0].difference(&asked[i]);
        if let Some(difference) = difference {
            let paths = [i, 0].map(|k| args.runs[k].display().to_string());
            note(&why_they_differ(difference, &paths, [&asked[i], &asked[0]]));
        }
        let (first_name, first, name, other) = (&names[0], &first.run, &names[i], &other.run);
        let comparison = match difference {
            None => compare(first_name, first, name, other)?,
            Some(difference) if difference.has_odds() => {
                compare_models(first_name, first, name, other)?
            }
            Some(_) => compare_other_data(first_name, first, name, other)?,
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

/// Why a run need not agree with another one, as a sentence.
fn why_they_differ(
    difference: Difference,
    [this, other]: &[String; 2],
    asked: [&Asked; 2],
) -> String {
    let host = |asked: &Asked| match asked {
        Asked::Fit { settings, .. } => settings.model.host_in_words(),
        Asked::Population { .. } => String::new(),
    };
    match difference {
        Difference::Kind => format!(
            "{this} and {other} are a fit and a population: only what has one name in both is compared."
        ),
        Difference::Track => format!(
            "{this} is the fit of another track, or of the other sense of phi, than {other}: they need not agree."
        ),
        Difference::Host => format!(
            "{this} is a fit in another host ({}) than {other} ({}): they need not agree, and masses, radii and q of one host are not \
             those of the other. The difference of ln Z is the evidence for one host over the other, under their priors.",
            host(asked[0]),
            host(asked[1])
        ),
        Difference::Prior => format!(
            "{this} is a fit with another prior, or with other errors of the data, than {other}: they need not agree."
        ),
        Difference::Streams => {
            format!("{this} is the population of other streams than {other}: they need not agree.")
        }
        Difference::Selection => format!(
            "{this} is a population with another selection than {other}: they need not agree, and the difference of ln Z is no evidence for \
             either, because each is relative to the streams that its selection keeps."
        ),
        Difference::Family => format!(
            "{this} is a population with another family, support or hyperprior than {other}: they need not agree."
        ),
    }
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
