//! How long does one stream take, by number type, instruction set and number of particles?
//!
//! Particle-steps per second are what the throughput column counts. All variants do the same work on the same inputs.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use oblate::orbit::{Level, State};
use oblate::potential::{FlattenedNfw, Plummer};
use oblate::scalar::Vec3;
use oblate::spray::TableSettings;
use oblate::stream::{Arrivals, Galaxy, Model, ModelSettings};
use std::hint::black_box;

/// A typical prior draw: an oblate halo, a progenitor at 60 kpc.
fn galaxy() -> Galaxy<f64> {
    Galaxy {
        host: FlattenedNfw::new(10.0_f64.powf(12.1), 16.0, 0.7, Vec3::new(-0.6, 0.0, 0.8)),
        sphere: Plummer {
            mass: 1e8,
            r_s: 1.5,
        },
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
        ..ModelSettings::default()
    })
    .expect("a model")
}

fn setup(c: &mut Criterion) {
    let model = model(1_000);
    let galaxy = galaxy();
    c.bench_function("setup/f64/n1000", |b| {
        b.iter(|| model.setup(black_box(&galaxy)))
    });
}

fn particles(c: &mut Criterion) {
    let galaxy = galaxy();
    let mut group = c.benchmark_group("particles");
    group.sample_size(20);
    for n in [1_000_usize, 10_000] {
        let model = model(n);
        let setup = model.setup(&galaxy).expect("a setup");
        group.throughput(Throughput::Elements((n * model.settings().steps) as u64));
        for level in Level::available() {
            let (mut path, mut out) = (Vec::new(), Arrivals::default());
            group.bench_function(BenchmarkId::new(format!("{level:?}"), n), |b| {
                b.iter(|| model.carry_at(level, black_box(&setup), &mut path, &mut out));
            });
        }
        group.bench_function(BenchmarkId::new("scalar", n), |b| {
            b.iter(|| model.particles(black_box(&setup)))
        });
    }
    group.finish();
}

criterion_group!(benches, setup, particles);
criterion_main!(benches);
