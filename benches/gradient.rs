//! What does the gradient of ln L cost, in units of its value?
//!
//! One track with 100 steps per particle and a dense orbit of 512 steps. `value` runs in lanes; `adjoint13` adds all
//! derivatives in reverse, `truncated13` the truncated gradient of the samplers; `dual13` is the reference, every
//! number a dual, one particle after the other. All do the same work on the same inputs.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use oblate::likelihood::{DataBin, LikelihoodSettings, StreamLikelihood, TrackLikelihood};
use oblate::params::{DIM, QRange, StreamParams, without_optional};
use oblate::potential::Nfw;
use oblate::scalar::{Dual, gradient_of, lift};
use oblate::spray::TableSettings;
use oblate::stream::{Model, ModelSettings, Particles, StepRule, StepSchedules, StepsPer, System};
use oblate::track::{BinEdges, Track};
use std::hint::black_box;

/// A nearly spherical halo with a tilted axis, a progenitor at 80 kpc, 3 Gyr.
const THETA: [f64; DIM] = without_optional([
    12.1, 16.0, -0.25, -0.4, 1.64, 8.0, 1.5, 59.0, 53.0, -41.0, 156.0, -29.0, 3.0,
]);

/// The likelihood of the model's own track, 2 % errors.
fn likelihood(particles: usize) -> StreamLikelihood {
    let model = Model::new(&ModelSettings {
        releases: TableSettings {
            particles,
            ..TableSettings::default()
        },
        steps: 100,
        steps_per: StepsPer::Particle,
        step_rule: StepRule::Uniform,
        ..ModelSettings::default()
    })
    .expect("a model");
    let releases = model.settings().releases;
    let settings = LikelihoodSettings::default();
    let q_range = QRange {
        q_min: 0.5,
        q_max: 1.5,
    };
    let track =
        |data: &[DataBin]| TrackLikelihood::new(&settings, 10.0, data, &releases).expect("a track");
    let system = System::from_params(&StreamParams::from_array(THETA), q_range);
    let solution = model.progenitor_solution(&system).expect("an orbit");
    let (mut schedules, mut out) = (StepSchedules::default(), Particles::default());
    model
        .integrate(&solution, &mut schedules, &mut out)
        .expect("particles");
    let data: Vec<DataBin> = Track::new(&out, 10.0, BinEdges::default(), 0.01 * particles as f64)
        .expect("a track")
        .bins
        .iter()
        .map(|b| DataBin::symmetric(b.bin, b.r_kpc, 0.02 * b.r_kpc))
        .collect();
    StreamLikelihood::new(model, track(&data), q_range)
}

/// The reference: the likelihood with every number a dual.
fn gradient_by_duals(likelihood: &StreamLikelihood, theta: &[f64; DIM]) -> [f64; DIM] {
    let duals: [Dual<DIM>; DIM] = lift(theta);
    let value = likelihood.ln_likelihood_on::<Nfw, _>(&StreamParams::from_array(duals));
    gradient_of(&value.expect("a value"))
}

fn gradient(c: &mut Criterion) {
    let mut group = c.benchmark_group("gradient");
    group.sample_size(20);
    for n in [1_000_usize, 4_096] {
        let likelihood = likelihood(n);
        group.throughput(Throughput::Elements(100 * n as u64));
        group.bench_function(format!("value/n{n}_s100"), |b| {
            b.iter(|| likelihood.ln_likelihood(black_box(&THETA)));
        });
        group.bench_function(format!("adjoint13/n{n}_s100"), |b| {
            b.iter(|| likelihood.gradient(black_box(&THETA)));
        });
        group.bench_function(format!("truncated13/n{n}_s100"), |b| {
            b.iter(|| likelihood.truncated_gradient(black_box(&THETA)));
        });
        // The reference is slow, so it is timed with one number of particles only.
        if n == 1_000 {
            group.sample_size(10);
            group.bench_function(format!("dual13/n{n}_s100"), |b| {
                b.iter(|| gradient_by_duals(&likelihood, black_box(&THETA)));
            });
        }
    }
    group.finish();
}

/// The gain from all cores, for many points and for one point.
fn threads(c: &mut Criterion) {
    let mut group = c.benchmark_group("threads");
    group.sample_size(20);
    let likelihood = likelihood(4_096);
    let points = vec![THETA; 64];
    group.throughput(Throughput::Elements(100 * 4_096 * 64));
    group.bench_function("batch64/one_by_one/n4096_s100", |b| {
        b.iter(|| {
            let values = points.iter().map(|theta| likelihood.ln_likelihood(theta));
            values.filter(Result::is_ok).count()
        });
    });
    group.bench_function("batch64/all_threads/n4096_s100", |b| {
        b.iter(|| likelihood.ln_likelihoods(black_box(&points)));
    });
    group.throughput(Throughput::Elements(100 * 4_096));
    group.bench_function("value/all_threads/n4096_s100", |b| {
        b.iter(|| likelihood.ln_likelihood_in_parallel(black_box(&THETA)));
    });
    group.bench_function("adjoint13/all_threads/n4096_s100", |b| {
        b.iter(|| likelihood.gradient_in_parallel(black_box(&THETA)));
    });
    group.finish();
}

criterion_group!(benches, gradient, threads);
criterion_main!(benches);
