//! Second: from a track to the posterior of q, quick and rough.
//!
//! `cargo run --release --example one_fit`
//!
//! The track was made by another code, from a stream in a spherical halo: q = 1 should lie inside the interval. To finish
//! within a minute this takes few particles and few live points, and the progenitor's orbit as known; free are the halo's mass and
//! shape and the progenitor's mass. By default all thirteen parameters are free, as in `oblate fit`.

use oblate::FitSettings;
use oblate::data::ObservedTrack;
use oblate::inference::Sampler;
use oblate::samplers::nested::Kernel;
use std::path::Path;

/// The parameters that are taken as known.
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

fn main() -> oblate::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks");
    let track = ObservedTrack::read(&folder.join("s2_spherical.ecsv"))?;
    println!("{}: {} bins", track.name, track.len());

    let mut settings = FitSettings::default();
    settings.model.releases.particles = 256;
    for (name, value) in KNOWN {
        settings.prior.fix(name, value)?;
    }
    settings.sampling.sampler = Sampler::Nested;
    settings.sampling.nested.n_live = 100;
    settings.sampling.nested.max_batches = 1;
    settings.sampling.nested.kernel = Kernel::RandomSlice;
    settings.sampling.nested.dlnz = 0.1;

    let fit = oblate::fit(&track, &settings)?;
    println!("{}", fit.summary);
    for check in fit.run.checks.iter().filter(|check| !check.pass) {
        println!("failed: {} ({})", check.name, check.message);
    }
    Ok(())
}
