//! Track files.

use crate::harness::Verdict;
use crate::mutate;
use oblate::FitSettings;
use oblate::data::ObservedTrack;
use oblate::inference::StreamTarget;
use oblate_samplers::rng::{RandomStream, below};
use std::path::Path;

/// Tracks in ECSV: our own, and one by astropy.
pub fn ecsv_seeds() -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    [
        "examples/tracks/s0_oblate_tilted.ecsv",
        "examples/tracks/s4_prolate_wrapped.ecsv",
        "tests/golden/astropy_track.ecsv",
    ]
    .map(|file| std::fs::read(root.join(file)).unwrap())
    .into()
}

/// Tracks in CSV.
pub fn csv_seeds() -> Vec<Vec<u8>> {
    [
        "# distance: 20 Mpc\n# units: phi arcmin, r arcsec\n# assume_error: 2%\nphi,r\n-900,600\n-300,610\n300,630\n900,625\n",
        "# by hand\n# progenitor_pa: 10\n# handedness: mirrored\nPA,r,r_err_lo,r_err_hi,n\n\"-25\",60,1.2,1.5,300\n5,61,1e0,2,0\n15,63,.5,1,12\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .into()
}

/// Reads a damaged track; one that is accepted is the data of a posterior, and is written and read again.
pub fn case(rng: &mut RandomStream, seeds: &[Vec<u8>], path: &Path) -> Verdict {
    let own = &seeds[below(rng, seeds.len())];
    let other = &seeds[below(rng, seeds.len())];
    std::fs::write(path, mutate::bytes(rng, own, other)).unwrap();
    let Ok(track) = ObservedTrack::read(path) else {
        return Verdict::Refused;
    };
    let text = path.with_extension("again.ecsv");
    track.write(&text).unwrap();
    assert_eq!(ObservedTrack::read(&text).unwrap(), track);
    // Memory and time grow with the bins from the first to the last.
    let bins = track.bins();
    let length = bins[bins.len() - 1].checked_sub(bins[0]);
    if length.is_some_and(|bins| bins < 10_000) {
        let mut settings = FitSettings::default();
        settings.model.releases.particles = 64;
        // A bin that is narrower than its soft edges is refused.
        if let Ok(target) = StreamTarget::from_track(&track, &settings) {
            assert!(target.likelihood().track().data().count() == track.len());
        }
    }
    Verdict::Accepted
}
