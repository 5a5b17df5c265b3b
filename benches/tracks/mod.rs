//! Tracks of mocks, and how far apart two are: for the tables of errors.

use oblate::data::{MockSettings, mocks};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::stream::{Arrivals, Flights, Galaxy, Model};
use oblate::track::{BinEdges, Track};

/// Galaxies of prior draws that meet the paper's criteria.
pub fn galaxies(count: usize) -> Vec<Galaxy<f64>> {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let drawn = mocks(&prior, &MockSettings::default(), count, 1).expect("mocks");
    let galaxy = |mock: &oblate::data::Mock| Galaxy::from_params(&mock.params, prior.q_range());
    drawn.mocks.iter().map(galaxy).collect()
}

/// The track of a galaxy: bins with at least a hundredth of the particles.
pub fn track(model: &Model, galaxy: &Galaxy<f64>) -> Option<Track> {
    Some(binned(&stars(model, galaxy)?, BinEdges::default()))
}

/// Where the particles of a galaxy's stream are today.
pub fn stars(model: &Model, galaxy: &Galaxy<f64>) -> Option<Arrivals> {
    let setup = model.setup(galaxy).ok()?;
    let (mut flights, mut stars) = (Flights::default(), Arrivals::default());
    model.carry(&setup, &mut flights, &mut stars).ok()?;
    Some(stars)
}

/// Their track in bins with these edges.
pub fn binned(stars: &Arrivals, edges: BinEdges) -> Track {
    Track::of(stars, 10.0, edges, 0.01 * stars.len() as f64)
}

/// Rms over the bins that both have of the relative difference, in per cent.
pub fn distance(track: &Track, reference: &Track) -> f64 {
    let squares: Vec<f64> = reference
        .bins
        .iter()
        .filter_map(|b| {
            let a = track.bins.iter().find(|a| a.bin == b.bin)?;
            Some((a.r_kpc / b.r_kpc - 1.0).powi(2))
        })
        .collect();
    100.0 * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}
