//! The effect of the symmetry moves on a nested fit.
//!
//! `cargo bench --bench moves` fits two gala tracks with all 13 parameters free, 512 particles, 400 live points and 8 slices per point:
//! without symmetry moves, with the exact draw along the scaling of masses, velocities and age, with the involutions between
//! orientation modes, and with all. Each fit takes about two minutes of a core. The recorded table is in benches/RESULTS.md.

use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, StreamTarget};
use oblate::params::symmetry::symmetries;
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::{Outcome, Prior, Run, Symmetry, Target, nested};
use std::path::Path;

/// A target with some of its moves.
struct With<'a> {
    target: &'a dyn Target,
    moves: Vec<Symmetry>,
}

impl Target for With<'_> {
    fn prior(&self) -> &Prior {
        self.target.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.target.ln_likelihood(theta)
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.moves
    }
}

fn check(run: &Run, name: &str) -> f64 {
    let found = run.checks.iter().find(|g| g.name == name);
    found.map_or(f64::NAN, |g| g.value)
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks");
    let mut config = FitSettings::default();
    config.model.releases.particles = 512;
    let settings = nested::Settings {
        n_live: 400,
        steps: Some(8),
        ..config.sampling.nested.clone()
    };
    println!(
        "| track | moves | ln Z | error | calls | correlation | jump | lineages left | ESS |\n|---|---|---|---|---|---|---|---|---|"
    );
    for name in ["s0_oblate_tilted", "s2_spherical"] {
        let track =
            ObservedTrack::read(&folder.join(format!("{name}.ecsv"))).expect("a gala track");
        let whole = StreamTarget::from_track(&track, &config).expect("a gala track is data");
        for (moves, scaling, twins) in [
            ("none", false, false),
            ("scaling", true, false),
            ("twins", false, true),
            ("all", true, true),
        ] {
            let mut own = symmetries(whole.stream_prior());
            own.retain(|symmetry| match symmetry {
                Symmetry::Orbit(_) => scaling,
                _ => twins,
            });
            let with = With {
                target: &whole,
                moves: own,
            };
            let run = nested::run(&with, &settings, 1, &mut Control::new(&mut Silent))
                .expect("a nested run");
            println!(
                "| {name} | {moves} | {:.2} | {:.2} | {} | {:.2} | {:.2} | {:.1} | {:.0} |",
                run.evidence.ln_z,
                run.evidence.error,
                run.cost.calls,
                check(&run, "seed-rank-correlation"),
                check(&run, "relative-jump-distance"),
                check(&run, "effective-lineages"),
                run.ess.quoted,
            );
        }
    }
}
