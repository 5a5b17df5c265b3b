//! Reverse mode of the sums over the particles of each bin.

use super::grid::{BinGrid, NearestEdge, SkyPoint};
use super::smear::{Displacement, Smear, displacement_vjp, moments_below};
use super::sums::{Sums, stream_extent};
use crate::scalar::{LANES, Tangent};
use crate::spray::Neighbourhood;
use crate::stream::Particles;

impl BinGrid {
    /// Reverse mode of [`sum`](Self::sum): from derivatives with respect to the sums, writes those with respect to the particles' sky
    /// positions, per kpc, into `x_bar` and `y_bar`, and returns that with respect to the offset of the grid, per degree.
    pub fn vjp(
        &self,
        particles: &Particles,
        sums_bar: &Sums<f64>,
        x_bar: &mut Vec<f64>,
        y_bar: &mut Vec<f64>,
    ) -> f64 {
        let len = particles.len();
        let point = |i: usize| {
            let (x, y, winding_number) =
                (particles.x[i], particles.y[i], particles.winding_numbers[i]);
            self.sky_point(x, y, winding_number, self.offset())
        };
        let points: Vec<SkyPoint<f64>> = (0..len).map(point).collect();
        // Until the last loop the buffers have the derivatives with respect to angles and radii.
        let (angle_bar, r_bar) = (&mut *x_bar, &mut *y_bar);
        for column in [&mut *angle_bar, &mut *r_bar] {
            column.clear();
            column.resize(len, 0.0);
        }
        // With respect to the positions of all particles together, which the offset moves back.
        let mut positions_bar = 0.0;
        for (i, point) in points.iter().enumerate() {
            let [position, r] = match &particles.neighbourhood {
                None => self.point_vjp(*point, sums_bar),
                Some(neighbourhood) => {
                    self.smeared_vjp(neighbourhood, i, &points, sums_bar, [angle_bar, r_bar])
                }
            };
            positions_bar += position;
            angle_bar[i] += position * self.per_radian();
            r_bar[i] += r;
        }
        for (i, SkyPoint { sky, .. }) in points.iter().enumerate() {
            let (across, along) = (x_bar[i] / sky.r, y_bar[i]);
            x_bar[i] = along * sky.x - across * sky.y;
            y_bar[i] = along * sky.y + across * sky.x;
        }
        -positions_bar / self.width_deg
    }

    /// Derivatives with respect to the position and the radius of a particle without neighbours.
    fn point_vjp(
        &self,
        SkyPoint { position, sky }: SkyPoint<f64>,
        sums_bar: &Sums<f64>,
    ) -> [f64; 2] {
        let NearestEdge { edge, above } =
            self.nearest_edge(Tangent::<f64, 1>::along(position, 0, 1.0));
        let [slope] = above.eps;
        let (bins, weights, slopes) = (
            self.bins_beside(edge.re),
            [1.0 - above.re, above.re],
            [-slope, slope],
        );
        let (mut position_bar, mut r_bar) = (0.0, 0.0);
        for k in 0..2 {
            if let Some(i) = bins[k] {
                r_bar += weights[k] * (sums_bar.r[i] + 2.0 * sky.r * sums_bar.r2[i]);
                position_bar += slopes[k]
                    * (sums_bar.weight[i] + sums_bar.r[i] * sky.r + sums_bar.r2[i] * sky.r * sky.r);
            }
        }
        [position_bar, r_bar]
    }

    /// Derivatives with respect to the position and the radius of a smeared particle. Those by the smearing, which depends on neighbours
    /// and partner, are added to the derivatives with respect to all angles and radii.
    fn smeared_vjp(
        &self,
        neighbourhood: &Neighbourhood,
        i: usize,
        points: &[SkyPoint<f64>],
        sums_bar: &Sums<f64>,
        [angle_bar, all_r_bar]: [&mut Vec<f64>; 2],
    ) -> [f64; 2] {
        let SkyPoint { position, sky } = points[i];
        let extent = stream_extent(neighbourhood, i, |j| points[j].sky);
        let (variance, covariance) = extent.moments();
        // Tangents with respect to variance, covariance and radius.
        let numbers = [variance, covariance, sky.r];
        let [variance, covariance, r] =
            std::array::from_fn(|k| Tangent::<f64, 3>::along(numbers[k], k, 1.0));
        let smear = Smear::new((variance, covariance), r);
        let half_width = smear.half_width(self.soft());
        let rise = smear.slope * half_width;
        let scale = 1.0 / (half_width.re * self.per_radian());
        let (middle, reach) = self.edges_within(position, half_width.re);
        let (mut r_bar, mut u_bar, mut scale_bar, mut rise_bar) = (0.0, 0.0, 0.0, 0.0);
        let sums_bar_below = |edge: f64| {
            self.bins_beside(edge)[0].map_or([0.0; 3], |b| {
                [sums_bar.weight[b], sums_bar.r[b], sums_bar.r2[b]]
            })
        };
        // Derivatives with respect to the three moments of the kernel in a bin.
        let rise2 = rise.re * rise.re;
        let moments_bar = |[weight, r, r2]: [f64; 3]| {
            [
                weight + sky.r * r + sky.r * sky.r * r2,
                rise.re * (r + 2.0 * sky.r * r2),
                rise2 * r2,
            ]
        };
        let mut lower = sums_bar_below(middle - f64::from(reach));
        let mut before = [0.0; 3];
        for k in -reach..=reach + 1 {
            let edge = middle + f64::from(k);
            let u = if k > reach {
                1.0
            } else {
                ((edge - position) * scale).clamp(-1.0, 1.0)
            };
            let here = moments_below(u);
            let [weight, offset, offset2]: [f64; 3] = std::array::from_fn(|c| here[c] - before[c]);
            let [_, sum_r_bar, sum_r2_bar] = lower;
            r_bar += weight * (sum_r_bar + 2.0 * sky.r * sum_r2_bar)
                + 2.0 * rise.re * offset * sum_r2_bar;
            rise_bar += offset * (sum_r_bar + 2.0 * sky.r * sum_r2_bar)
                + 2.0 * rise.re * offset2 * sum_r2_bar;
            if k > reach {
                break;
            }
            let upper = sums_bar_below(edge + 1.0);
            let (below_bar, above_bar) = (moments_bar(lower), moments_bar(upper));
            let rest = 1.0 - u * u;
            let mut edge_bar = 0.0;
            for (c, power) in [1.0, u, u * u].into_iter().enumerate() {
                edge_bar += (below_bar[c] - above_bar[c]) * power;
            }
            edge_bar *= 15.0 / 16.0 * rest * rest;
            u_bar += edge_bar;
            scale_bar += edge_bar * u;
            (lower, before) = (upper, here);
        }
        // u is (edge - position) times the scale, and the scale is inversely proportional to the half-width.
        let width_bar = -scale_bar / half_width.re;
        let [variance_bar, covariance_bar, own_r_bar]: [f64; 3] =
            std::array::from_fn(|k| width_bar * half_width.eps[k] + rise_bar * rise.eps[k]);
        let mut add = |j: usize, displacement_bar: Displacement<f64>| {
            let [angle, here_r, other_r] = displacement_vjp(sky, points[j].sky, displacement_bar);
            angle_bar[j] += angle;
            angle_bar[i] -= angle;
            all_r_bar[j] += other_r;
            all_r_bar[i] += here_r;
        };
        let extent_bar: Vec<Displacement<f64>> = (0..neighbourhood.normals)
            .map(|k| Displacement {
                angle: 2.0 * extent.angle[k] * variance_bar + extent.r[k] * covariance_bar,
                r: extent.angle[k] * covariance_bar,
            })
            .collect();
        let (block, lane) = (i / LANES, i % LANES);
        for j in 0..neighbourhood.count {
            let row = block * neighbourhood.count + j;
            let mut displacement_bar = Displacement { angle: 0.0, r: 0.0 };
            for (k, extent_bar) in extent_bar.iter().enumerate() {
                let weight = neighbourhood.weights[row * neighbourhood.normals + k][lane];
                displacement_bar.angle += weight * extent_bar.angle;
                displacement_bar.r += weight * extent_bar.r;
            }
            add(neighbourhood.indices[row][lane] as usize, displacement_bar);
        }
        let partner_bar = extent.partner_vjp(variance_bar, covariance_bar);
        add(neighbourhood.partners[block][lane] as usize, partner_bar);
        [-u_bar * scale, r_bar + own_r_bar]
    }
}
