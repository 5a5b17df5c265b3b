//! Second: a track to the posterior of q, quick and rough.
//!
//! `cargo run --release --example one_fit`
//!
//! The track was made by another code, of a stream in a spherical halo: q = 1 should lie inside the interval. To finish
//! within a minute this takes few particles and few live points, and the orbit as known, as if the progenitor had been
//! observed in full: free are the halo's mass and shape and the progenitor's mass. `oblate fit` leaves all thirteen free.

use oblate::Result;
use oblate::config::FitConfig;
use oblate::data::ObservedTrack;
use oblate::inference::sample;
use oblate::posterior::{Interval, column};
use oblate::run::target;
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::nested::Kernel;
use std::path::Path;

/// What the track was made with.
const KNOWN: [(&str, f64); 8] = [
    ("r_s_halo_kpc", 15.0),
    ("r_s_prog_kpc", 1.0),
    ("x0_kpc", 60.0),
    ("z0_kpc", 30.0),
    ("vx0_km_s", 30.0),
    ("vy0_km_s", 140.0),
    ("vz0_km_s", 45.0),
    ("age_gyr", 3.0),
];

fn main() -> Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks");
    let track = ObservedTrack::read(&folder.join("s2_spherical.ecsv"))?;
    println!("{}: {} bins", track.name, track.len());

    let mut config = FitConfig::default();
    config.model.releases.particles = 256;
    config.model.steps = 40;
    config.model.orbit_steps = 256;
    for (name, known) in KNOWN {
        config.prior.fix(name, known)?;
    }
    config.sampling.nested.n_live = 100;
    config.sampling.nested.kernel = Kernel::RandomSlice;
    config.sampling.nested.dlnz = 0.1;

    let target = target(&track, &config)?;
    let run = sample(
        &target,
        &config.sampling,
        config.seed,
        &mut Control::new(&mut Silent),
    )?;

    println!(
        "ln Z = {:.1} +- {:.1}",
        run.evidence.ln_z, run.evidence.error
    );
    println!("{} calls, {:.0} s", run.cost.calls, run.cost.wall_seconds);
    let q = Interval::new(&column(&run, "q")?.values, &run.draws.weights(), "");
    println!(
        "q = {:.2}, 95 % in [{:.2}, {:.2}]",
        q.median, q.lo95, q.hi95
    );
    for gate in run.gates.iter().filter(|gate| !gate.pass) {
        println!("not passed: {} ({})", gate.name, gate.say);
    }
    Ok(())
}
