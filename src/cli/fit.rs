//! `oblate fit`.

use super::Exit;
use super::options::{Common, FitFlags, FolderFlags, sampler, say, say_json};
use super::progress::Progress;
use crate::config::text;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::Sampler;
use crate::posterior::Summary;
use crate::run::{RunFolder, fit};
use oblate_samplers::output::Status;
use std::io::Write;
use std::path::PathBuf;

/// Flags of `oblate fit`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  oblate fit track.ecsv --sampler pt-hmc --seed 3 --out runs/track_pt"
)]
pub struct Args {
    /// The track (ECSV or CSV)
    #[arg(required_unless_present = "print_config")]
    track: Option<PathBuf>,
    /// nested or pt-hmc
    #[arg(long, value_parser = sampler)]
    sampler: Option<Sampler>,
    /// Print the settings as TOML, every default spelled out, and stop
    #[arg(long)]
    print_config: bool,
    /// Particles of the coarse model that the fit begins with; 0: none
    #[arg(long)]
    coarse_particles: Option<usize>,
    /// Live points of the nested sampler
    #[arg(long)]
    live: Option<usize>,
    /// Rounds of the tempered sampler, each twice as long as the one before
    #[arg(long)]
    rounds: Option<usize>,
    /// How many times the tempered sampler's last round may go on until it passes; with --resume, more than before
    #[arg(long)]
    extensions: Option<usize>,
    #[command(flatten)]
    settings: FitFlags,
    #[command(flatten)]
    folder: OptionalFolder,
}

/// The folder's flags, of which `--out` is not needed to print settings.
#[derive(clap::Args, Debug)]
struct OptionalFolder {
    /// The run folder to make
    #[arg(long, value_name = "FOLDER", required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Replace a run folder that is there
    #[arg(long, conflicts_with = "resume")]
    force: bool,
    /// Continue from its checkpoint
    #[arg(long)]
    resume: bool,
    /// Exit with 0 even if the run has not converged
    #[arg(long)]
    allow_unconverged: bool,
}

/// Fits one track.
pub fn run(args: &Args, common: &Common, command: &str, out: &mut dyn Write) -> Result<Exit> {
    let mut config = args.settings.settings()?;
    if let Some(sampler) = args.sampler {
        config.sampling.sampler = sampler;
    }
    if let Some(particles) = args.coarse_particles {
        config.coarse_particles = particles;
    }
    if let Some(live) = args.live {
        config.sampling.nested.n_live = live;
    }
    if let Some(rounds) = args.rounds {
        config.sampling.pt_hmc.rounds = rounds;
    }
    if let Some(extensions) = args.extensions {
        config.sampling.pt_hmc.extensions = extensions;
    }
    if args.print_config {
        write!(out, "{}", text(&config)?).map_err(super::options::output)?;
        return Ok(Exit::Done);
    }
    let (Some(path), Some(folder)) = (&args.track, &args.folder.out) else {
        return Err(Error::Setting {
            key: "TRACK, --out".to_owned(),
            value: "missing".to_owned(),
            remedy: "give both".to_owned(),
        });
    };
    let folder = FolderFlags::new(
        folder.clone(),
        args.folder.force,
        args.folder.resume,
        args.folder.allow_unconverged,
    );
    let track = ObservedTrack::read(path)?;
    let mut progress = Progress::new(
        &format!("{} {}", track.name, config.sampling.sampler.name()),
        common,
    );
    let (run, summary) = fit(
        &track,
        &config,
        &folder.out,
        folder.existing(),
        command,
        &mut progress.watch(),
    )?;
    if run.status == Status::BudgetSpent && !RunFolder::open(&folder.out)?.finished() {
        eprintln!(
            "the time was up in the coarse fit, which is what follows; continue with the same command and --resume"
        );
    }
    let tempered = config.sampling.sampler == Sampler::PtHmc;
    if tempered && run.status == Status::Complete && !run.converged() {
        eprintln!(
            "the same command goes on from here with --resume and more --extensions than {}",
            config.sampling.pt_hmc.extensions
        );
    }
    finish(run.status, &summary, &folder, common, out)
}

/// Prints a run's verdict and numbers, and chooses the exit.
pub fn finish(
    status: Status,
    summary: &Summary,
    folder: &FolderFlags,
    common: &Common,
    out: &mut dyn Write,
) -> Result<Exit> {
    if status == Status::Interrupted {
        eprintln!("interrupted; continue with the same command and --resume");
        return Ok(Exit::Interrupted);
    }
    if common.json {
        say_json(out, summary)?;
    } else {
        say(out, &summary.verdict())?;
        say(
            out,
            &format!(
                "ln Z = {:.3} +- {:.3}",
                summary.ln_z.value, summary.ln_z.error
            ),
        )?;
        let rows = summary.parameters.iter().chain(&summary.derived);
        for (name, i) in rows {
            say(
                out,
                &format!(
                    "{name:>16} {:10.4}   68 % [{:.4}, {:.4}]   95 % [{:.4}, {:.4}]",
                    i.median, i.lo68, i.hi68, i.lo95, i.hi95
                ),
            )?;
        }
        say(
            out,
            &format!(
                "ESS {:.0}, {} calls, {} gradients, {:.0} CPU seconds; in {}",
                summary.ess,
                summary.cost.calls,
                summary.cost.gradients,
                summary.cost.cpu_seconds,
                folder.out.display()
            ),
        )?;
    }
    Ok(if summary.converged || folder.allow_unconverged {
        Exit::Done
    } else {
        Exit::Failed
    })
}
