//! What does the progenitor's orbit cost, plain and with 13 derivatives, and what does accuracy cost over the paper's
//! leapfrog?
//!
//! One orbit of 3 Gyr in a flattened halo: `dense` is the 4th-order method with 512 steps (four forces each), `leapfrog`
//! the paper's, with 100 steps (two forces each). The throughput counts steps.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use oblate::orbit::{DenseOrbit, OrbitMethod, State};
use oblate::potential::FlattenedNfw;
use oblate::scalar::{Dual, Real, Vec3, lift};
use std::hint::black_box;

/// Every number that an orbit depends on: mass, radius, q, axis, position, velocity (kpc/Gyr), age.
const INPUTS: [f64; 13] = [
    1.26e12, 16.0, 0.7, -0.6, 0.0, 0.8, 59.0, 0.0, 33.0, -40.0, 160.0, -30.0, 3.0,
];

fn orbit<S: Real>(inputs: [S; 13], steps: usize, method: OrbitMethod) -> DenseOrbit<S> {
    let [mass, r_s, q, a, b, c, x, y, z, vx, vy, vz, age] = inputs;
    let host = FlattenedNfw::new(mass, r_s, q, Vec3::new(a, b, c));
    let today = State {
        x: Vec3::new(x, y, z),
        v: Vec3::new(vx, vy, vz),
    };
    DenseOrbit::integrate(&host, today, age, steps, method)
}

fn progenitor(c: &mut Criterion) {
    let mut group = c.benchmark_group("orbit");
    for (name, steps, method) in [
        ("dense", 512, OrbitMethod::Accurate),
        ("leapfrog", 100, OrbitMethod::Leapfrog),
    ] {
        group.throughput(Throughput::Elements(steps as u64));
        group.bench_function(format!("{name}/f64/s{steps}"), |b| {
            b.iter(|| orbit(black_box(INPUTS), steps, method));
        });
        group.bench_function(format!("{name}/dual13/s{steps}"), |b| {
            b.iter(|| orbit::<Dual<13>>(lift(black_box(&INPUTS)), steps, method));
        });
    }
    group.finish();
}

criterion_group!(benches, progenitor);
criterion_main!(benches);
