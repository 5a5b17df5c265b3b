use super::chain::Motion;
use super::*;
use crate::mixture::Mixture;
use crate::nested::bound::draw_direction;
use crate::nested::bound::tests::overlapping;
use crate::nested::rank::ks_probability;
use crate::normal;
use crate::rng::{Domain, below, standard_normal, stream, unit_open};
use crate::surrogate::{Examples, Surrogate};
use crate::target::{Involution, Marginal, Orbit, Outcome, Prior};
use rayon::prelude::*;

/// A likelihood on the unit square.
struct Square {
    prior: Prior,
    ln_l: fn(&[f64]) -> f64,
    gradient: fn(&[f64], &mut [f64]),
    symmetries: Vec<Symmetry>,
}

impl Square {
    fn new(dim: usize, ln_l: fn(&[f64]) -> f64) -> Self {
        let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
        Self {
            prior: Prior::new((0..dim).map(|k| (format!("x{k}"), "", unit))).unwrap(),
            ln_l,
            gradient: |_, gradient| gradient.fill(0.0),
            symmetries: Vec::new(),
        }
    }
}

impl Target for Square {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        Outcome::from_ln_likelihood((self.ln_l)(theta))
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        (self.gradient)(theta, gradient);
        self.ln_likelihood(theta)
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }
}

/// `count` independent uniform points above the likelihood bound, found by rejection.
fn uniform_above(target: &dyn Target, contour: f64, task: u64, count: usize) -> Points {
    let context = ChainContext {
        target,
        contour,
        kernel: Kernel::Uniform,
        bounds: &[],
        halves: &Default::default(),
        scale: 1.0,
        stride: 1.0,
        steps: 1,
        along: None,
    };
    let mut points = Points::new(target.dim());
    for i in 0..count as u64 {
        let rng = stream(11, Domain::Test, task, i);
        let new = uniform::draw(&context, None, &mut { rng }).unwrap();
        points.push(&new.u, new.ln_l, f64::NEG_INFINITY, (i % 2) as u32);
    }
    points
}

/// A named function of a point: the distribution function of one of its values, uniform under the null hypothesis.
type Law<'a> = (&'a str, &'a (dyn Fn(&[f64]) -> f64 + Sync));

/// Starts many chains from uniform points above the likelihood bound; their ends must be uniform there too.
fn stays_uniform(
    name: &str,
    target: &dyn Target,
    contour: f64,
    bounds: &[Bound],
    (kernel, scale, steps): (Kernel, f64, usize),
    laws: &[Law<'_>],
) {
    let count = 40_000;
    let starts = uniform_above(target, contour, 1, count);
    let context = ChainContext {
        target,
        contour,
        kernel,
        bounds,
        halves: &halves(target, &starts),
        scale,
        stride: scale,
        steps,
        along: None,
    };
    let ends: Vec<NewPoint> = (0..count)
        .into_par_iter()
        .map(|i| {
            let rng = stream(12, Domain::Test, 2, i as u64);
            draw(&context, &starts, i, rng).unwrap()
        })
        .collect();
    let moved = ends.iter().filter(|e| e.motion.moved).count();
    assert!(moved > count / 2, "{name}: only {moved} chains moved");
    for (law, f) in laws {
        let values: Vec<f64> = ends.iter().map(|e| f(&e.u)).collect();
        let p = ks_probability(&values);
        assert!(p > 0.001 / laws.len() as f64, "{name}, {law}: p = {p}");
    }
}

/// Above the likelihood bound 0: a ring of radii 0.2 to 0.4 about the centre of the square.
fn ring(x: &[f64]) -> f64 {
    let r = ((x[0] - 0.5).powi(2) + (x[1] - 0.5).powi(2)).sqrt();
    (0.1 - (r - 0.3).abs()).clamp(-1.0, 1.0)
}

fn ring_slope(x: &[f64], gradient: &mut [f64]) {
    let r = ((x[0] - 0.5).powi(2) + (x[1] - 0.5).powi(2)).sqrt();
    for (g, x) in gradient.iter_mut().zip(x) {
        *g = (0.3 - r).signum() * (x - 0.5) / r;
    }
}

fn ring_target() -> Square {
    Square {
        gradient: ring_slope,
        ..Square::new(2, ring)
    }
}

fn ring_radius(x: &[f64]) -> f64 {
    let r2 = (x[0] - 0.5).powi(2) + (x[1] - 0.5).powi(2);
    (r2 - 0.04) / 0.12
}

fn ring_angle(x: &[f64]) -> f64 {
    let angle = (x[1] - 0.5).atan2(x[0] - 0.5);
    (angle / std::f64::consts::TAU + 1.0).fract()
}

const STEPPERS: [(Kernel, f64, usize); 4] = [
    (Kernel::RandomSlice, 0.7, 3),
    (Kernel::Differential, 0.7, 3),
    (Kernel::RandomWalk, 0.6, 8),
    (Kernel::Galilean, 0.2, 6),
];

#[test]
fn chains_that_start_uniform_above_a_contour_stay_uniform() {
    let target = ring_target();
    let fitted = Bound::for_steps(&uniform_above(&target, 0.0, 3, 400));
    for how in STEPPERS {
        for bounds in [&fitted, &vec![overlapping()], &vec![Bound::cube(2)]] {
            let laws: [Law<'_>; 2] = [("radius", &ring_radius), ("angle", &ring_angle)];
            stays_uniform(&format!("{how:?}"), &target, 0.0, bounds, how, &laws);
        }
    }
}

/// A surrogate of the ring that is wrong: its ring lies elsewhere, and is wider.
fn wrong_surrogate() -> Surrogate {
    let mut rng = stream(17, Domain::Test, 0, 0);
    let mut examples = Examples::default();
    for _ in 0..4_000 {
        let z = [0; 2].map(|_| standard_normal(&mut rng));
        let moved = [normal::cdf(z[0]) - 0.07, normal::cdf(z[1])];
        examples.push(&z, 1.5 * ring(&moved) + 0.05, &[]);
    }
    Surrogate::fit(&examples, None, &mut rng).unwrap()
}

/// A density of the ring that is wrong: that of the points on one side and few others.
fn wrong_density(starts: &Points) -> Mixture {
    let (all, right): (Vec<usize>, Vec<usize>) = (0..2_000).partition(|&i| starts.row(i)[0] < 0.5);
    let rows = [&right[..400], &all[..100]].concat();
    let mut rng = stream(19, Domain::Test, 0, 0);
    Mixture::fit(&normal_rows(starts, &rows), 4, &mut rng).unwrap()
}

/// Moves of a chain that stands for so many others, along the surrogates and densities of all.
type Moves = fn(&mut Chain<'_>, &Along<'_>, &mut RandomStream) -> Result<()>;

/// Chains above the bound 0 that make moves along surrogates and no slice updates.
fn without_slices<'a>(
    target: &'a dyn Target,
    bounds: &'a [Bound],
    halves: &'a [DifferencePool; 2],
    along: &'a Along<'a>,
) -> ChainContext<'a> {
    ChainContext {
        target,
        contour: 0.0,
        kernel: Kernel::Surrogate,
        bounds,
        halves,
        scale: 1.0,
        stride: 1.0,
        steps: 0,
        along: Some(along),
    }
}

/// Whether chains that start uniform above the bound stay so by these moves alone, and what they counted.
fn stay_uniform_along_a_wrong_surrogate(moves: Moves, task: u64) -> Motion {
    let target = ring_target();
    let surrogate = wrong_surrogate();
    let count = 40_000;
    let starts = uniform_above(&target, 0.0, task, count);
    let density = wrong_density(&starts);
    let bounds = [Bound::cube(2)];
    let metrics = starts
        .halves()
        .map(|rows| factor_of_covariance(&starts, &rows).unwrap());
    let proposals = [(); 2].map(|()| {
        Some(Proposals {
            mixture: &density,
            ln_most: 1.0,
        })
    });
    let along = Along {
        surrogates: [&surrogate; 2],
        width: 0.02,
        step: 0.1,
        sets: 1,
        metrics,
        proposals,
    };
    let no_pairs = Default::default();
    let context = without_slices(&target, &bounds, &no_pairs, &along);
    let ends: Vec<(Vec<f64>, Motion)> = (0..count)
        .into_par_iter()
        .map(|i| {
            let mut rng = stream(18, Domain::Test, task, i as u64);
            let mut chain = Chain::new(&context, &bounds[0], &starts, i);
            moves(&mut chain, &along, &mut rng).unwrap();
            (chain.x, chain.motion)
        })
        .collect();
    let laws: [Law<'_>; 2] = [("radius", &ring_radius), ("angle", &ring_angle)];
    for (law, f) in laws {
        let values: Vec<f64> = ends.iter().map(|(u, _)| f(u)).collect();
        let p = ks_probability(&values);
        assert!(p > 0.001 / 2.0, "{law}: p = {p}");
    }
    let mut all = Motion::default();
    for (_, motion) in &ends {
        all.trajectories.add(motion.trajectories);
        all.proposals.add(motion.proposals);
    }
    all
}

#[test]
fn trajectories_along_a_wrong_surrogate_stay_uniform() {
    let moves: Moves = |chain, along, rng| {
        WIDTHS
            .iter()
            .try_for_each(|width| trajectory::steps(chain, &along.other_half(true, *width), rng))
    };
    let counted = stay_uniform_along_a_wrong_surrogate(moves, 9).trajectories;
    let accepted = counted.accepted as f64 / counted.made as f64;
    // A surrogate that is right would be accepted nearly always; this one is wrong enough to matter.
    assert!((0.2..0.8).contains(&accepted), "{accepted}");
}

#[test]
fn proposals_of_a_wrong_density_screened_by_a_wrong_surrogate_stay_uniform() {
    let moves: Moves = |chain, along, rng| {
        WIDTHS
            .iter()
            .try_for_each(|width| independent::step(chain, &along.other_half(true, *width), rng))
    };
    let counted = stay_uniform_along_a_wrong_surrogate(moves, 10).proposals;
    let accepted = counted.accepted as f64 / counted.tried as f64;
    assert!((0.1..0.7).contains(&accepted), "{accepted}");
}

#[test]
fn a_chain_moves_along_the_surrogate_of_the_half_that_does_not_contain_its_seed() {
    let target = ring_target();
    let surrogate = wrong_surrogate();
    let starts = uniform_above(&target, 0.0, 11, 2_000);
    let density = wrong_density(&starts);
    let bounds = [Bound::cube(2), Bound::cube(2)];
    // Only the half of even lineages has proposals: chains of odd ones make them.
    let along = Along {
        surrogates: [&surrogate; 2],
        width: 0.02,
        step: 0.1,
        sets: 1,
        metrics: (starts.halves()).map(|rows| factor_of_covariance(&starts, &rows).unwrap()),
        proposals: [
            Some(Proposals {
                mixture: &density,
                ln_most: 1.0,
            }),
            None,
        ],
    };
    let no_pairs = Default::default();
    let context = without_slices(&target, &bounds, &no_pairs, &along);
    for seed in 0..4 {
        let rng = stream(20, Domain::Test, 0, seed as u64);
        let born = draw(&context, &starts, seed, rng).unwrap();
        let odd = !starts.genealogy[seed].lineage.is_multiple_of(2);
        assert_eq!(born.motion.proposals.tried, u64::from(odd));
    }
}

#[test]
fn independent_draws_from_a_bound_are_uniform_above_the_contour() {
    let target = Square::new(2, ring);
    let points = uniform_above(&target, 0.0, 4, 400);
    let bound = Bound::for_draws(&points, 1, 0).unwrap();
    stays_uniform(
        "uniform",
        &target,
        0.0,
        &[bound],
        (Kernel::Uniform, 1.0, 1),
        &[("radius", &ring_radius), ("angle", &ring_angle)],
    );
}

#[test]
fn the_metric_rule_keeps_a_walk_over_two_overlapping_ellipsoids_uniform() {
    // A million steps on the whole square, whose regions are two ellipsoids that overlap and the rest.
    let target = Square::new(2, |_| 0.0);
    let bounds = [overlapping()];
    // 10^4 chains on the even lineages; on the odd ones six points, unevenly spread, because for every fixed other half its
    // differences must leave the uniform distribution of chains of the first half invariant.
    let walkers = 10_000;
    let mut kept = Points::new(2);
    for w in 0..walkers {
        let mut rng = stream(13, Domain::Test, 6, w);
        kept.push(
            &[unit_open(&mut rng), unit_open(&mut rng)],
            0.0,
            f64::NEG_INFINITY,
            0_u32,
        );
    }
    for u in [
        [0.3, 0.5],
        [0.31, 0.5],
        [0.4, 0.52],
        [0.6, 0.45],
        [0.62, 0.5],
        [0.9, 0.9],
    ] {
        kept.push(&u, 0.0, f64::NEG_INFINITY, 1_u32);
    }
    for kernel in [
        Kernel::RandomSlice,
        Kernel::Differential,
        Kernel::RandomWalk,
        Kernel::Galilean,
    ] {
        let context = ChainContext {
            target: &target,
            contour: -1.0,
            kernel,
            bounds: &bounds,
            halves: &halves(&target, &kept),
            scale: 1.0,
            stride: 1.0,
            steps: 1,
            along: None,
        };
        // Most regions do not exchange chains: all start uniform and take 100 steps each, counted after half of them and at the
        // end, when all are independent of each other.
        let visits: Vec<[usize; 2]> = (0..walkers)
            .into_par_iter()
            .map(|w| {
                let mut rng = stream(13, Domain::Test, 5, w);
                let row = usize::try_from(w).unwrap();
                let mut chain = Chain::new(&context, &bounds[0], &kept, row);
                let mut cells = [0_usize; 2];
                for half in &mut cells {
                    for _ in 0..50 {
                        match kernel {
                            Kernel::RandomWalk => walk::step(&mut chain, &mut rng).unwrap(),
                            Kernel::Differential => difference::step(&mut chain, &mut rng).unwrap(),
                            Kernel::Galilean => galilean::step(&mut chain, &mut rng).unwrap(),
                            _ => slice::step(&mut chain, &mut rng).unwrap(),
                        }
                    }
                    let cell = |x: f64| (0..10).rev().find(|k| 10.0 * x >= f64::from(*k)).unwrap();
                    *half = usize::try_from(cell(chain.x[0]) * 10 + cell(chain.x[1])).unwrap();
                }
                cells
            })
            .collect();
        for half in 0..2 {
            let mut counts = [0.0_f64; 100];
            for cells in &visits {
                counts[cells[half]] += 1.0;
            }
            let chi2: f64 = counts.iter().map(|c| (c - 100.0).powi(2) / 100.0).sum();
            // 99 degrees of freedom: p = 1e-3 at 148.2.
            assert!(chi2 < 148.2, "{kernel:?}: chi2 {chi2}");
        }
    }
}

/// `z1 -> z2 / 2, z2 -> 2 z1`: its own inverse, with a unit Jacobian, that does not keep the prior.
struct Squeeze;

impl Involution for Squeeze {
    fn name(&self) -> &str {
        "squeeze"
    }
    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        (z[0], z[1]) = (0.5 * z[1], 2.0 * z[0]);
        Some(0.0)
    }
}

/// The second coordinate does not matter to the likelihood.
struct Second;

impl Orbit for Second {
    fn name(&self) -> &str {
        "second"
    }
    fn refresh(&self, z: &mut [f64], rng: &mut RandomStream) {
        z[1] = standard_normal(rng);
    }
}

#[test]
fn involutions_and_orbits_keep_the_prior_above_the_contour() {
    // Above the bound: the left three fifths of the square.
    let mut target = Square::new(2, |x| if x[0] < 0.6 { 0.0 } else { -2.0 });
    // Not a gradient of anything: any reflection is valid that depends on its own position alone.
    target.gradient = |x, gradient| gradient.copy_from_slice(&[-1.0, x[1]]);
    target.symmetries = vec![
        Symmetry::Involution(Box::new(Squeeze)),
        Symmetry::Orbit(Box::new(Second)),
    ];
    for how in STEPPERS {
        for bound in [overlapping(), Bound::cube(2)] {
            let first = |x: &[f64]| x[0] / 0.6;
            let second = |x: &[f64]| x[1];
            let laws: [Law<'_>; 2] = [("first", &first), ("second", &second)];
            let bounds = [bound];
            stays_uniform(&format!("{how:?}"), &target, -1.0, &bounds, how, &laws);
        }
    }
}

#[test]
fn a_jump_without_its_jacobian_would_be_caught() {
    // The negative control of the test above: the squeeze always accepted is far from uniform.
    let mut rng = stream(14, Domain::Test, 0, 0);
    let values: Vec<f64> = (0..40_000)
        .map(|_| {
            let mut z = [standard_normal(&mut rng), standard_normal(&mut rng)];
            if below(&mut rng, 2) == 0 {
                Squeeze.apply(&mut z);
            }
            normal::cdf(z[0])
        })
        .collect();
    assert!(ks_probability(&values) < 1e-6);
}

#[test]
fn galilean_trajectories_between_the_cube_a_mirror_and_rejected_points_stay_uniform() {
    // Above the bound: over 0.3, where moves are reflected. Beyond 0.8 all is rejected; the other two sides are those of the
    // cube.
    let target = Square {
        gradient: |_, gradient| gradient.copy_from_slice(&[0.0, 1.0]),
        ..Square::new(2, |x| if x[0] > 0.8 { f64::NAN } else { x[1] - 0.3 })
    };
    let first = |x: &[f64]| x[0] / 0.8;
    let second = |x: &[f64]| (x[1] - 0.3) / 0.7;
    let laws: [Law<'_>; 2] = [("first", &first), ("second", &second)];
    for scale in [0.1, 0.5] {
        for bound in [overlapping(), Bound::cube(2)] {
            let how = (Kernel::Galilean, scale, 5);
            stays_uniform(&format!("{how:?}"), &target, 0.0, &[bound], how, &laws);
        }
    }
}

/// The context of Galilean Monte Carlo trajectories in the ring from `kept`.
fn in_the_ring<'a>(
    target: &'a Square,
    bounds: &'a [Bound],
    halves: &'a [DifferencePool; 2],
) -> ChainContext<'a> {
    ChainContext {
        target,
        contour: 0.0,
        kernel: Kernel::Galilean,
        bounds,
        halves,
        scale: 0.2,
        stride: 1.0,
        steps: 1,
        along: None,
    }
}

#[test]
fn a_move_of_a_galilean_then_a_flip_is_its_own_inverse() {
    let target = ring_target();
    let kept = uniform_above(&target, 0.0, 7, 10_000);
    let bounds = [overlapping()];
    let halves = Default::default();
    let context = in_the_ring(&target, &bounds, &halves);
    let mut seen = [0; 3];
    for row in 0..kept.len() {
        let mut rng = stream(15, Domain::Test, 7, row as u64);
        let mut chain = Chain::new(&context, &bounds[0], &kept, row);
        draw_direction(&mut rng, &mut chain.ball);
        let velocity = chain.ball.clone();
        for turn in 0..2 {
            let moved = galilean::advance(&mut chain, 0.15).unwrap();
            // A reversal of the velocity undoes the reversal of a chain that cannot move.
            if moved {
                chain.ball.iter_mut().for_each(|w| *w = -*w);
            }
            if turn == 0 {
                let straight = chain.motion.local.grown > 0;
                seen[usize::from(moved) + usize::from(straight)] += 1;
            }
        }
        let away = |a: &[f64], b: &[f64]| {
            let both = a.iter().zip(b);
            both.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(away(&chain.x, kept.row(row)) < 1e-12, "{row}");
        assert!(away(&chain.ball, &velocity) < 1e-12, "{row}");
    }
    assert!(seen.iter().all(|n| *n > 500), "{seen:?}");
}

/// Kolmogorov-Smirnov probability of the radii after trajectories of two moves that began uniform in the ring; a chain
/// that can neither move nor be reflected reverses its velocity or, as the wrong rule, keeps it.
fn radii_after_galilean_trajectories(turns: bool) -> f64 {
    let target = ring_target();
    let count = 40_000;
    let kept = uniform_above(&target, 0.0, 8, count);
    let bounds = [Bound::cube(2)];
    let halves = Default::default();
    let context = in_the_ring(&target, &bounds, &halves);
    let radii: Vec<f64> = (0..count)
        .into_par_iter()
        .map(|row| {
            let mut rng = stream(16, Domain::Test, 8, row as u64);
            let mut chain = Chain::new(&context, &bounds[0], &kept, row);
            for _ in 0..6 {
                draw_direction(&mut rng, &mut chain.ball);
                for _ in 0..2 {
                    let moved = galilean::advance(&mut chain, context.scale).unwrap();
                    if turns && !moved {
                        chain.ball.iter_mut().for_each(|w| *w = -*w);
                    }
                }
            }
            ring_radius(&chain.x)
        })
        .collect();
    ks_probability(&radii)
}

#[test]
fn a_galilean_that_waits_where_it_should_turn_round_would_be_caught() {
    let (right, wrong) = (
        radii_after_galilean_trajectories(true),
        radii_after_galilean_trajectories(false),
    );
    assert!(right > 0.001 && wrong < 1e-6, "{right} {wrong}");
}
