//! Trajectories that find their own length.

use super::{assert_invariant, binomial_pair, moved, tilted};
use crate::targets::smooth;
use oblate_samplers::hmc::{LocalSampler, Metric, MetricKind, Plan, Point};
use oblate_samplers::rng::{Domain, Stream, standard_normal, stream};

/// Steps of long strides, many of which lose much energy on the way.
#[test]
fn trajectories_without_u_turns_leave_the_posterior_invariant() {
    for (metric, step) in [
        (tilted(), 0.42),
        (Metric::identity(MetricKind::Diagonal, 2), 0.38),
    ] {
        let plan = Plan {
            step,
            length: f64::NAN,
            max_leapfrogs: 15,
            max_energy_range: 1000.0,
            slack: 0.0,
        };
        assert_invariant("binomial", |index| {
            let mut rng = stream(27, Domain::Test, 0, index);
            let (point, target) = binomial_pair(&mut rng);
            let local_sampler = LocalSampler::new(target, 1.0, &metric);
            moved(local_sampler, point, &mut rng, |e, at, rng| {
                e.no_u_turn(at, &plan, rng).unwrap()
            })
        });
    }
}

#[test]
fn a_trajectory_ends_where_it_turns_back_and_where_it_must() {
    let target = smooth::iso(13);
    let sd = 0.1_f64.sqrt();
    let metric = Metric::from_covariance(
        MetricKind::Dense,
        &(nalgebra::DMatrix::identity(13, 13) * sd * sd),
    )
    .unwrap();
    let mut rng = stream(28, Domain::Test, 0, 0);
    let mut point = Point::new(13);
    point
        .z
        .iter_mut()
        .for_each(|z| *z = sd * standard_normal(&mut rng));
    let mut local_sampler = LocalSampler::new(&target, 1.0, &metric);
    point.ln_likelihood = local_sampler.evaluator.value(&point.z).unwrap();
    let mut leapfrogs = |most, rng: &mut Stream| {
        let plan = Plan {
            step: 0.1,
            length: f64::NAN,
            max_leapfrogs: most,
            max_energy_range: 1000.0,
            slack: 0.0,
        };
        let moved: Vec<_> = (0..200)
            .map(|_| local_sampler.no_u_turn(&mut point, &plan, rng).unwrap())
            .collect();
        assert!(moved.iter().all(|m| m.leapfrogs <= most));
        let capped = moved.iter().filter(|m| m.capped).count();
        let mean = moved.iter().map(|m| m.leapfrogs as f64).sum::<f64>() / 200.0;
        (mean, capped)
    };
    // Half a period is pi / 0.1 = 31 steps; a doubling that goes beyond is made in part and given up.
    let (mean, capped) = leapfrogs(1000, &mut rng);
    assert!(
        (25.0..63.0).contains(&mean) && capped == 0,
        "{mean} {capped}"
    );
    assert_eq!(leapfrogs(10, &mut rng), (7.0, 200));
}
