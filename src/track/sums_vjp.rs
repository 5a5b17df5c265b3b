//! Reverse mode of the sums over bins.

use super::grid::{BinGrid, Placed, SkyPoint};
use super::smear::{Apart, Smear, apart_vjp, below};
use super::sums::{Sums, surroundings};
use crate::scalar::{LANES, Tangent};
use crate::spray::Neighbourhood;
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
        // With respect to angles and radii first.
        let (angle_bar, r_bar) = (&mut *x_bar, &mut *y_bar);
        for column in [&mut *angle_bar, &mut *r_bar] {
            column.clear();
            column.resize(len, 0.0);
        }
        for (i, point) in points.iter().enumerate() {
            let [position, r] = match &particles.neighbourhood {
                None => self.point_vjp(*point, by),
                Some(neighbourhood) => {
                    self.smeared_vjp(neighbourhood, i, &points, by, [angle_bar, r_bar])
                }
            };
            angle_bar[i] += position * self.per_radian();
            r_bar[i] += r;
        }
        for (i, SkyPoint { sky, .. }) in points.iter().enumerate() {
            let (across, along) = (x_bar[i] / sky.r, y_bar[i]);
            x_bar[i] = along * sky.x - across * sky.y;
            y_bar[i] = along * sky.y + across * sky.x;
        }
    }

    /// Derivatives with respect to the position and the radius of a particle without neighbours.
    fn point_vjp(&self, SkyPoint { position, sky }: SkyPoint<f64>, by: &Sums<f64>) -> [f64; 2] {
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
                r_bar += weights[k] * (by.r[i] + 2.0 * sky.r * by.r2[i]);
                position_bar +=
                    slopes[k] * (by.weight[i] + by.r[i] * sky.r + by.r2[i] * sky.r * sky.r);
            }
        }
        [position_bar, r_bar]
    }

    /// Derivatives with respect to the position and the radius of a smeared particle; those by way of the neighbours are added to
    /// `angle_and_r_bar`.
    fn smeared_vjp(
        &self,
        neighbourhood: &Neighbourhood,
        i: usize,
        points: &[SkyPoint<f64>],
        by: &Sums<f64>,
        [angle_bar, all_r_bar]: [&mut Vec<f64>; 2],
    ) -> [f64; 2] {
        let SkyPoint { position, sky } = points[i];
        let around = surroundings(neighbourhood, i, |j| points[j].sky);
        let (variance, covariance) = around.moments();
        // With respect to variance, covariance and radius.
        let numbers = [variance, covariance, sky.r];
        let [variance, covariance, r] =
            std::array::from_fn(|k| Tangent::<f64, 3>::along(numbers[k], k, 1.0));
        let smear = Smear::new((variance, covariance), r);
        let half_width = smear.half_width(self.soft());
        let rise = smear.slope * half_width;
        let scale = 1.0 / (half_width.re * self.per_radian());
        let (middle, reach) = self.edges_within(position, half_width.re);
        let (mut r_bar, mut u_bar, mut scale_bar, mut rise_bar) = (0.0, 0.0, 0.0, 0.0);
        let bar = |edge: f64| {
            self.beside(edge)[0].map_or([0.0; 3], |b| [by.weight[b], by.r[b], by.r2[b]])
        };
        // Derivatives with respect to the three moments of the kernel in a bin, and by the radius and the rise with fixed moments.
        let rise2 = rise.re * rise.re;
        let moments_bar = |[weight, r, r2]: [f64; 3]| {
            [
                weight + sky.r * r + sky.r * sky.r * r2,
                rise.re * (r + 2.0 * sky.r * r2),
                rise2 * r2,
            ]
        };
        let mut lower = bar(middle - f64::from(reach));
        let mut before = [0.0; 3];
        for k in -reach..=reach + 1 {
            let edge = middle + f64::from(k);
            let u = if k > reach {
                1.0
            } else {
                ((edge - position) * scale).clamp(-1.0, 1.0)
            };
            let here = below(u);
            let [share, offset, offset2]: [f64; 3] = std::array::from_fn(|c| here[c] - before[c]);
            let [_, by_r, by_r2] = lower;
            r_bar += share * (by_r + 2.0 * sky.r * by_r2) + 2.0 * rise.re * offset * by_r2;
            rise_bar += offset * (by_r + 2.0 * sky.r * by_r2) + 2.0 * rise.re * offset2 * by_r2;
            if k > reach {
                break;
            }
            let upper = bar(edge + 1.0);
            let (below_bar, above_bar) = (moments_bar(lower), moments_bar(upper));
            let rest = 1.0 - u * u;
            let mut by_u = 0.0;
            for (c, power) in [1.0, u, u * u].into_iter().enumerate() {
                by_u += (below_bar[c] - above_bar[c]) * power;
            }
            by_u *= 15.0 / 16.0 * rest * rest;
            u_bar += by_u;
            scale_bar += by_u * u;
            (lower, before) = (upper, here);
        }
        // u is (edge - position) times a scale that falls with the half-width.
        let width_bar = -scale_bar / half_width.re;
        let [variance_bar, covariance_bar, own_r_bar]: [f64; 3] =
            std::array::from_fn(|k| width_bar * half_width.eps[k] + rise_bar * rise.eps[k]);
        let mut to = |j: usize, by: Apart<f64>| {
            let [angle, here_r, other_r] = apart_vjp(sky, points[j].sky, by);
            angle_bar[j] += angle;
            angle_bar[i] -= angle;
            all_r_bar[j] += other_r;
            all_r_bar[i] += here_r;
        };
        let along: Vec<Apart<f64>> = (0..neighbourhood.numbers)
            .map(|k| Apart {
                angle: 2.0 * around.angle[k] * variance_bar + around.r[k] * covariance_bar,
                r: around.angle[k] * covariance_bar,
            })
            .collect();
        let (block, lane) = (i / LANES, i % LANES);
        for j in 0..neighbourhood.count {
            let row = block * neighbourhood.count + j;
            let mut apart_bar = Apart { angle: 0.0, r: 0.0 };
            for (k, along) in along.iter().enumerate() {
                let weight = neighbourhood.weights[row * neighbourhood.numbers + k][lane];
                apart_bar.angle += weight * along.angle;
                apart_bar.r += weight * along.r;
            }
            to(neighbourhood.indices[row][lane] as usize, apart_bar);
        }
        let partner_bar = around.partner_vjp(variance_bar, covariance_bar);
        to(neighbourhood.partners[block][lane] as usize, partner_bar);
        [-u_bar * scale, r_bar + own_r_bar]
    }
}
