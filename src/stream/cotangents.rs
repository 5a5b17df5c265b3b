//! Derivatives of a result with respect to the progenitor solution, summed over particles.

use super::lane_groups::{Bundle, Interleaved, UNROLL};
use super::progenitor_solution::ReleaseFrame;
use crate::orbit::{Node, State};
use crate::potential::{HostCotangent, PlummerCotangent};
use crate::scalar::{Isa, Vec3};
use std::ops::Range;

/// Derivatives with respect to the progenitor solution, summed over the particles of consecutive release times.
#[derive(Clone, Debug, Default)]
pub(super) struct Cotangents {
    /// The first release time.
    pub first_release_time: usize,
    /// With respect to the release frames, from the first release time on.
    pub release_frames: Vec<ReleaseFrame<f64>>,
    /// With respect to the nodes of the orbit.
    pub nodes: Vec<Node<f64>>,
    /// With respect to the potentials and the age.
    pub shared: SharedCotangent,
}

impl Cotangents {
    /// Sets all derivatives to zero, for these release times and an orbit with this number of nodes.
    pub fn reset(&mut self, release_times: &Range<usize>, nodes: usize) {
        let zero = Vec3::zero();
        let no_frame = ReleaseFrame {
            state: State { x: zero, v: zero },
            position: [zero; 3],
            velocity: [zero; 3],
            winding_number: 0.0,
        };
        self.first_release_time = release_times.start;
        self.release_frames.clear();
        self.release_frames.resize(release_times.len(), no_frame);
        self.nodes.clear();
        self.nodes.resize(nodes, Node::zero());
        self.shared = SharedCotangent::zero();
    }
}

/// Derivatives with respect to the weights of the release times.
#[derive(Clone, Debug, Default)]
pub struct WeightCotangents {
    /// With respect to the weight of each.
    pub of_release_times: Vec<f64>,
    /// With respect to the mean of their squares.
    pub mean_square: f64,
}

/// Derivatives with respect to what the particles of all release times share: potentials and age.
#[derive(Clone, Copy, Debug)]
pub(super) struct SharedCotangent {
    pub host: HostCotangent<f64>,
    pub progenitor: PlummerCotangent<f64>,
    pub age_gyr: f64,
}

impl SharedCotangent {
    fn zero() -> Self {
        Self {
            host: HostCotangent::zero(),
            progenitor: PlummerCotangent::zero(),
            age_gyr: 0.0,
        }
    }

    fn add(&mut self, other: &Self) {
        let (halo, disc, bulge) = (
            &mut self.host.halo,
            &mut self.host.baryons.disc,
            &mut self.host.baryons.bulge,
        );
        halo.ln_mass += other.host.halo.ln_mass;
        halo.ln_r_s += other.host.halo.ln_r_s;
        halo.flattening += other.host.halo.flattening;
        halo.axis += other.host.halo.axis;
        halo.second.flattening += other.host.halo.second.flattening;
        halo.second.axis += other.host.halo.second.axis;
        disc.ln_mass += other.host.baryons.disc.ln_mass;
        disc.ln_r_s += other.host.baryons.disc.ln_r_s;
        disc.normal += other.host.baryons.disc.normal;
        bulge.ln_mass += other.host.baryons.bulge.ln_mass;
        bulge.ln_r_s += other.host.baryons.bulge.ln_r_s;
        self.progenitor.ln_mass += other.progenitor.ln_mass;
        self.progenitor.r_s += other.progenitor.r_s;
        self.progenitor.mass_loss += other.progenitor.mass_loss;
        self.age_gyr += other.age_gyr;
    }
}

impl Default for SharedCotangent {
    fn default() -> Self {
        Self::zero()
    }
}

impl Cotangents {
    /// Reverse mode of [`ReleaseFrame::release`]: adds the derivatives with respect to the initial states of a pair to those with respect to
    /// its release frames.
    #[inline(always)]
    pub fn release_vjp<I: Isa>(&mut self, pair: &Bundle<'_>, start_bar: &State<Interleaved<I>>) {
        let State { x, v } = *start_bar;
        let (position, velocity) = (pair.position::<I, UNROLL>(), pair.velocity::<I, UNROLL>());
        let (x_bar, v_bar) = (sums_of_vector(x), sums_of_vector(v));
        // A lane group without particles adds zeros.
        for k in 0..UNROLL {
            let release_frame = &mut self.release_frames
                [pair.lane_groups[k].release_time - self.first_release_time];
            release_frame.state.x += x_bar[k];
            release_frame.state.v += v_bar[k];
        }
        for c in 0..3 {
            let position_bar = sums_of_vector(x * position[c]);
            let velocity_bar = sums_of_vector(v * velocity[c]);
            for k in 0..UNROLL {
                let release_frame = &mut self.release_frames
                    [pair.lane_groups[k].release_time - self.first_release_time];
                release_frame.position[c] += position_bar[k];
                release_frame.velocity[c] += velocity_bar[k];
            }
        }
    }

    /// Adds the derivatives from the release times that follow.
    pub fn append(&mut self, next: &mut Self) {
        self.shared.add(&next.shared);
        for (sum, node_bar) in self.nodes.iter_mut().zip(&next.nodes) {
            for row in 0..3 {
                sum.add(row, node_bar.vector(row));
            }
        }
        self.release_frames.append(&mut next.release_frames);
    }
}

/// The sums over the lanes of each lane array of a vector.
#[inline(always)]
pub(super) fn sums_of_vector<I: Isa>(v: Vec3<Interleaved<I>>) -> [Vec3<f64>; UNROLL] {
    let ([x, x_2], [y, y_2], [z, z_2]) = (v.x.sums(), v.y.sums(), v.z.sums());
    [Vec3::new(x, y, z), Vec3::new(x_2, y_2, z_2)]
}
