//! Moves between walls of the prior.

use super::{DRAWS, STEPS, farthest_moment, plane, tilted, way_back};
use oblate_samplers::difference_pool::DifferencePool;
use oblate_samplers::hmc::{LocalSampler, Plan, Point, inside, slice};
use oblate_samplers::rng::{Domain, standard_normal, stream};
use oblate_samplers::target::HalfSpace;
use oblate_samplers::{Outcome, Prior, Target};
use rayon::prelude::*;

/// The prior behind three walls that meet in corners.
struct Corner {
    prior: Prior,
    walls: Vec<HalfSpace>,
}

impl Corner {
    fn new() -> Self {
        let wall = |a: f64, b: f64, offset: f64| HalfSpace {
            normal: vec![a, b],
            offset,
        };
        Self {
            prior: plane(),
            walls: vec![
                wall(1.0, 0.0, -0.3),
                wall(0.0, 2.0, -0.8),
                wall(-1.0, -1.0, -0.5),
            ],
        }
    }
}

impl Target for Corner {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Value(0.0)
    }
    fn ln_likelihood_and_gradient(&self, _: &[f64], gradient: &mut [f64]) -> Outcome {
        gradient.fill(0.0);
        Outcome::Value(0.0)
    }
    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
    fn walls(&self) -> &[HalfSpace] {
        &self.walls
    }
}

#[test]
fn trajectories_retrace_their_steps_through_corners_of_three_walls() {
    let target = Corner::new();
    let metric = tilted();
    let mut rng = stream(21, Domain::Test, 0, 0);
    for _ in 0..200 {
        let z = [
            0.05 * standard_normal(&mut rng),
            0.05 * standard_normal(&mut rng),
        ];
        let momentum = [
            3.0 * standard_normal(&mut rng),
            3.0 * standard_normal(&mut rng),
        ];
        // Reflections double small errors at corners; 30 steps meet the walls some ten times.
        assert!(way_back(&target, &metric, &z, &momentum, 30) < 1e-8);
    }
}

#[test]
fn moves_between_walls_keep_the_truncated_prior() {
    let target = Corner::new();
    let metric = tilted();
    let plan = Plan {
        step: 1.1,
        length: 3.0,
        max_leapfrogs: 8,
        max_energy_range: 1000.0,
        slack: 0.0,
    };
    let pairs: Vec<([f64; 2], [f64; 2])> = (0..DRAWS)
        .into_par_iter()
        .map(|index| {
            let mut rng = stream(22, Domain::Test, 0, index);
            let mut local_sampler = LocalSampler::new(&target, 1.0, &metric);
            let mut point = Point::new(2);
            local_sampler
                .evaluator
                .draw_reference(&mut point.z, &mut rng)
                .unwrap();
            point.ln_likelihood = 0.0;
            let before = [point.z[0], point.z[1]];
            for _ in 0..STEPS {
                local_sampler
                    .transition(&mut point, &plan, &mut rng)
                    .unwrap();
                local_sampler
                    .no_u_turn(&mut point, &plan, &mut rng)
                    .unwrap();
                let evaluator = &mut local_sampler.evaluator;
                slice(
                    evaluator,
                    1.0,
                    &metric,
                    &DifferencePool::default(),
                    &mut point,
                    &mut rng,
                )
                .unwrap();
                assert!(inside(&target.walls, &point.z) || near_a_wall(&target, &point.z));
            }
            (before, [point.z[0], point.z[1]])
        })
        .collect();
    let apart = farthest_moment(&pairs);
    assert!(apart < 4.0, "{apart}");
}

/// A reflected point may sit on its wall to rounding.
fn near_a_wall(target: &Corner, z: &[f64]) -> bool {
    target.walls.iter().all(|wall| {
        wall.normal.iter().zip(z).map(|(a, z)| a * z).sum::<f64>() > wall.offset - 1e-12
    })
}
