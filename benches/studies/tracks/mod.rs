//! Tracks of mocks and the distance between two tracks, for the studies of errors.

use oblate::data::{MockSettings, mocks};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::stream::{Model, Particles, StepSchedules, System};
use oblate::track::{BinEdges, Track};

/// Systems of prior draws that meet the paper's criteria.
#[allow(dead_code, reason = "the study of accuracy needs the mocks themselves")]
pub fn systems(count: usize) -> Vec<System<f64>> {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let drawn = mocks(&prior, &MockSettings::default(), count, 1).expect("mocks");
    let system = |mock: &oblate::data::Mock| System::from_params(&mock.params, prior.q_range());
    drawn.mocks.iter().map(system).collect()
}

/// The track of a system: bins with at least one per cent of the particles.
#[allow(dead_code, reason = "some studies bin particles themselves")]
pub fn track(model: &Model, system: &System<f64>) -> Option<Track> {
    Some(binned(&particles(model, system)?, BinEdges::default()))
}

/// The particles of a system's stream today.
pub fn particles(model: &Model, system: &System<f64>) -> Option<Particles> {
    let solution = model.progenitor_solution(system).ok()?;
    let (mut schedules, mut particles) = (StepSchedules::default(), Particles::default());
    model
        .integrate(&solution, &mut schedules, &mut particles)
        .ok()?;
    Some(particles)
}

/// The track of particles in bins with these edges.
pub fn binned(particles: &Particles, edges: BinEdges) -> Track {
    Track::new(particles, 10.0, edges, 0.01 * particles.len() as f64).expect("a track")
}

/// Root mean square of the relative difference in per cent, over the bins that both tracks have.
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

/// The values at the middle and at 95 per cent; NaN for no values.
#[allow(dead_code, reason = "the study of steps prints other quantiles")]
pub fn median_and_95(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    let at = |place: usize| values.get(place).copied().unwrap_or(f64::NAN);
    (at(last / 2), at(last * 95 / 100))
}
