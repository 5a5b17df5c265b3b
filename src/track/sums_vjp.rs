//! Reverse mode of the sums over bins.

use super::grid::{BinGrid, Placed};
use super::segment::{Segment, SegmentRun, SkyPoint};
use super::sums::Sums;
use crate::scalar::Tangent;
use crate::stream::Particles;

impl BinGrid {
    /// Reverse mode of [`sum`](Self::sum): turns derivatives with respect to the sums into derivatives with respect to
    /// the particles' sky positions.
    pub fn vjp(
        &self,
        particles: &Particles,
        by: &Sums<f64>,
        x_bar: &mut Vec<f64>,
        y_bar: &mut Vec<f64>,
    ) {
        let len = particles.len();
        let points: Vec<SkyPoint<f64>> = (0..len)
            .map(|i| self.sky_point(particles.x[i], particles.y[i], particles.turns[i]))
            .collect();
        // With respect to positions and radii first.
        let (position_bar, r_bar) = (&mut *x_bar, &mut *y_bar);
        for column in [&mut *position_bar, &mut *r_bar] {
            column.clear();
            column.resize(len, 0.0);
        }
        for run in SegmentRun::all(0..len, len, particles.neighbour_offset) {
            for i in run.particles.clone() {
                let (here, other) = (points[i], run.neighbour(i));
                let segment = here.segment(points[other]);
                let ours = Segment {
                    d_phi: Tangent::<f64, 3>::along(segment.d_phi, 0, 1.0),
                    d_r: Tangent::along(segment.d_r, 1, 1.0),
                }
                .limited(Tangent::along(here.r, 2, 1.0));
                let along = Segment {
                    d_phi: ours.d_phi.re,
                    d_r: ours.d_r.re,
                };
                // Derivatives with respect to the particle's own position, and with respect to the segment.
                let (mut point_bar, mut segment_bar) = ([0.0; 2], [0.0; 2]);
                for k in 0..run.points {
                    let quadrature_bar = self.point_vjp(run.sky_point(here, along, k), by);
                    for d in 0..2 {
                        point_bar[d] += run.weight() * quadrature_bar[d];
                        segment_bar[d] += run.weight() * run.fraction(k) * quadrature_bar[d];
                    }
                }
                let along_segment = ours.d_phi * segment_bar[0] + ours.d_r * segment_bar[1];
                let [d_phi_bar, d_r_bar, own_r_bar] = along_segment.eps;
                position_bar[i] += point_bar[0] - d_phi_bar;
                r_bar[i] += point_bar[1] - d_r_bar + own_r_bar;
                position_bar[other] += d_phi_bar;
                r_bar[other] += d_r_bar;
            }
        }
        for (i, sky_point) in points.iter().enumerate() {
            let (angle_bar, r_bar) = (x_bar[i] * self.per_radian(), y_bar[i]);
            let (x, y, r) = (particles.x[i], particles.y[i], sky_point.r);
            x_bar[i] = r_bar * x / r - angle_bar * y / sky_point.r2;
            y_bar[i] = r_bar * y / r + angle_bar * x / sky_point.r2;
        }
    }

    /// Derivatives with respect to the position and the radius of a quadrature point of weight one.
    #[inline(always)]
    fn point_vjp(&self, SkyPoint { position, r, r2 }: SkyPoint<f64>, by: &Sums<f64>) -> [f64; 2] {
        let Placed { edge, above } = self.place(Tangent::<f64, 1>::along(position, 0, 1.0));
        let [slope] = above.eps;
        let (bins, weights, slopes) = (
            self.beside(edge.re),
            [1.0 - above.re, above.re],
            [-slope, slope],
        );
        let (mut position_bar, mut r_bar) = (0.0, 0.0);
        for k in 0..2 {
            if let Some(i) = bins[k] {
                r_bar += weights[k] * (by.r[i] + 2.0 * r * by.r2[i]);
                position_bar += slopes[k] * (by.weight[i] + by.r[i] * r + by.r2[i] * r2);
            }
        }
        [position_bar, r_bar]
    }
}
