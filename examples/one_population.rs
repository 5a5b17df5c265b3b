//! Third: many posteriors of q to one population, by both samplers.
//!
//! `cargo run --release --example one_population`
//!
//! The posteriors are made here: twenty haloes drawn from N(0.8, 0.1), each known to 0.1. A real population reads them
//! from the run folders of fits, as `oblate population` does.

use oblate::Result;
use oblate::inference::{Sampler, SamplerSettings, sample};
use oblate::params::QPrior;
use oblate::population::{
    PopulationSettings, PopulationTarget, QPosterior, TruncatedGaussian, TruncatedGaussianSettings,
};
use oblate::posterior::{Interval, column};
use oblate::samplers::control::{Control, Silent};
use oblate::samplers::rng::{Domain, standard_normal, stream};

const TRUE_MEAN: f64 = 0.8;
const TRUE_WIDTH: f64 = 0.1;
const ERROR: f64 = 0.1;

fn main() -> Result<()> {
    let streams: Vec<QPosterior> = (0..20).map(posterior).collect();
    let family = TruncatedGaussian::new(TruncatedGaussianSettings::default())?;
    let target = PopulationTarget::new(family, &streams, PopulationSettings { max_draws: 500 })?;
    println!(
        "{} streams from N({TRUE_MEAN}, {TRUE_WIDTH})",
        target.streams()
    );

    for sampler in [Sampler::Nested, Sampler::PtHmc] {
        let mut settings = SamplerSettings {
            sampler,
            ..SamplerSettings::default()
        };
        settings.pt_hmc.rounds = 8;
        let run = sample(&target, &settings, 1, &mut Control::new(&mut Silent))?;
        let of = |name: &str| -> Result<Interval> {
            let column = column(&run, name)?;
            Ok(Interval::new(&column.values, &run.draws.weights(), ""))
        };
        let (mean, width) = (of("mu_pop")?, of("sigma_pop")?);
        println!(
            "{:8} ln Z = {:.2} +- {:.2}, mean {:.3} in [{:.3}, {:.3}], width {:.3} in [{:.3}, {:.3}] (68 %), {}",
            sampler.name(),
            run.evidence.ln_z,
            run.evidence.error,
            mean.median,
            mean.lo68,
            mean.hi68,
            width.median,
            width.lo68,
            width.hi68,
            if run.converged() {
                "converged"
            } else {
                "not converged"
            },
        );
    }
    Ok(())
}

/// A fit's posterior of q under its uniform prior: equal-weight draws around a measurement of one halo.
fn posterior(number: u64) -> QPosterior {
    let mut rng = stream(1, Domain::Prior, 0, number);
    let truth = TRUE_MEAN + TRUE_WIDTH * standard_normal(&mut rng);
    let measured = truth + ERROR * standard_normal(&mut rng);
    let (lo, hi) = (0.5, 1.5);
    let mut q = Vec::with_capacity(1_000);
    while q.len() < 1_000 {
        let draw = measured + ERROR * standard_normal(&mut rng);
        if (lo..=hi).contains(&draw) {
            q.push(draw);
        }
    }
    QPosterior::equal_weights(&format!("stream {number}"), q, QPrior::Uniform { lo, hi })
}
