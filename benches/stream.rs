//! How long does one stream take, by instruction set and number of particles, and how much of it is the progenitor solution?
//!
//! `progenitor_solution` is the progenitor's orbit and the release frames; `integrate` the particles in lanes, once for each
//! instruction set that this CPU has; `one_by_one` the same particle by particle, the reference. All do the same work on the same
//! inputs; the throughput counts particle-steps.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use oblate::orbit::State;
use oblate::potential::{FlattenedNfw, Plummer};
use oblate::scalar::Level;
use oblate::scalar::Vec3;
use oblate::spray::TableSettings;
use oblate::stream::{
    Model, ModelSettings, Particles, StepRule, StepSchedules, StepSizes, StepsPer, System,
};
use std::hint::black_box;

/// A typical prior draw: an oblate halo, a progenitor at 60 kpc.
fn system() -> System<f64> {
    System {
        host: FlattenedNfw::new(10.0_f64.powf(12.1), 16.0, 0.7, Vec3::new(-0.6, 0.0, 0.8)),
        progenitor: Plummer {
            mass: 1e8,
            r_s: 1.5,
        },
        mass_loss: 1.0,
        release_peaking: 0.0,
        coulomb_logarithm: 0.0,
        today: State {
            x: Vec3::new(59.0, 0.0, 33.0),
            v: Vec3::new(-40.0, 160.0, -30.0),
        },
        age_gyr: 3.0,
    }
}

fn model(particles: usize) -> Model {
    let releases = TableSettings {
        particles,
        ..TableSettings::default()
    };
    Model::new(&ModelSettings {
        releases,
        steps: 100,
        steps_per: StepsPer::Particle,
        step_rule: StepRule::Uniform,
        ..ModelSettings::default()
    })
    .expect("a model")
}

fn progenitor_solution(c: &mut Criterion) {
    let model = model(1_000);
    let system = system();
    c.bench_function("stream/progenitor_solution/f64/n1000", |b| {
        b.iter(|| model.progenitor_solution(black_box(&system)))
    });
}

fn particles(c: &mut Criterion) {
    let system = system();
    let mut group = c.benchmark_group("stream");
    group.sample_size(20);
    for n in [1_000_usize, 10_000, 100_000] {
        let model = model(n);
        let solution = model
            .progenitor_solution(&system)
            .expect("a progenitor solution");
        group.throughput(Throughput::Elements((n * model.settings().steps) as u64));
        for &level in Level::available() {
            let (mut schedules, mut out) = (StepSchedules::default(), Particles::default());
            let id = format!("integrate/{level:?}/n{n}_s100").to_lowercase();
            group.bench_function(id, |b| {
                b.iter(|| {
                    model.integrate_at(level, black_box(&solution), &mut schedules, &mut out)
                });
            });
        }
        // One by one, large numbers take seconds and give no new information.
        if n <= 10_000 {
            group.bench_function(format!("one_by_one/f64/n{n}_s100"), |b| {
                b.iter(|| model.integrate_one_by_one(black_box(&solution), &StepSizes::default()));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, progenitor_solution, particles);
criterion_main!(benches);
