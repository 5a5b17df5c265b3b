//! Tracks of mocks, and how far apart two are: for the tables of errors.

use oblate::data::{MockSettings, mocks};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::stream::{Model, Particles, StepSchedules, System};
use oblate::track::{BinEdges, Track};

/// Galaxies of prior draws that meet the paper's criteria.
pub fn galaxies(count: usize) -> Vec<System<f64>> {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let drawn = mocks(&prior, &MockSettings::default(), count, 1).expect("mocks");
    let system = |mock: &oblate::data::Mock| System::from_params(&mock.params, prior.q_range());
    drawn.mocks.iter().map(system).collect()
}

/// The track of a galaxy: bins with at least a hundredth of the particles.
pub fn track(model: &Model, system: &System<f64>) -> Option<Track> {
    Some(binned(&stars(model, system)?, BinEdges::default()))
}

/// Where the particles of a galaxy's stream are today.
pub fn stars(model: &Model, system: &System<f64>) -> Option<Particles> {
    let solution = model.progenitor_solution(system).ok()?;
    let (mut schedules, mut stars) = (StepSchedules::default(), Particles::default());
    model
        .integrate(&solution, &mut schedules, &mut stars)
        .ok()?;
    Some(stars)
}

/// Their track in bins with these edges.
pub fn binned(stars: &Particles, edges: BinEdges) -> Track {
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
