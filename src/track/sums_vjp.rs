//! Reverse mode of the sums over the particles of each bin.

use super::grid::{BinGrid, NearestEdge};
use super::smear::{Displacement, Smear, displacement_vjp, moments_below};
use super::sums::{Quantity, Sums, line_of_sight_km_s};
use crate::scalar::{LANES, Scalar, Tangent};
use crate::stream::Particles;

/// Derivatives with respect to the particles' angles, radii, weights, and values of a quantity.
struct ParticleCotangents<'a> {
    /// Of the weights; empty if all are 1.
    weight: &'a mut [f64],
    angle: &'a mut [f64],
    r: &'a mut [f64],
    value: Values<'a>,
}

/// Where the derivatives with respect to a quantity are added.
enum Values<'a> {
    /// It is the radius.
    Radius,
    /// It is the line-of-sight velocity.
    Velocity(&'a mut [f64]),
}

impl Values<'_> {
    /// The smearing of a particle from the moments of the stream around it and its radius.
    fn smear<S: Scalar>(&self, moments: (S, S), r: S) -> Smear<S> {
        match self {
            Self::Radius => Smear::of_radius(moments, r),
            Self::Velocity(_) => Smear::of_velocity(moments),
        }
    }
}

impl ParticleCotangents<'_> {
    /// Adds derivatives with respect to the radius and the value of particle number `i`.
    fn add(&mut self, i: usize, r_bar: f64, value_bar: f64) {
        match &mut self.value {
            Values::Radius => self.r[i] += r_bar + value_bar,
            Values::Velocity(v) => {
                self.r[i] += r_bar;
                v[i] += value_bar;
            }
        }
    }
}

impl BinGrid {
    /// Reverse mode of [`sum`](Self::sum) and, if `sums_bar` has velocities, [`sum_velocities`](Self::sum_velocities): from derivatives with
    /// respect to the sums, writes those with respect to the particles' sky positions, per kpc, into `x_bar` and `y_bar`, those with
    /// respect to their velocities along z, per kpc/Gyr, into `vz_bar`, which is left empty without velocities, and those with respect to
    /// their weights into `weight_bar`, which is left empty if all are 1. Returns that with respect to the offset of the grid, per degree.
    pub fn vjp(
        &self,
        particles: &Particles,
        sums_bar: &Sums<f64>,
        [x_bar, y_bar, vz_bar, weight_bar]: [&mut Vec<f64>; 4],
    ) -> f64 {
        let len = particles.len();
        let points = self.sky_points(particles);
        // Until the last loop the buffers have the derivatives with respect to angles and radii.
        for column in [&mut *x_bar, &mut *y_bar] {
            column.clear();
            column.resize(len, 0.0);
        }
        vz_bar.clear();
        weight_bar.clear();
        weight_bar.resize(particles.weights.len(), 0.0);
        let radii: Vec<f64> = points.iter().map(|point| point.sky.r).collect();
        let mut quantity = Quantity {
            points: &points,
            values: &radii,
            neighbourhood: particles.neighbourhood.as_deref(),
            weights: &particles.weights,
        };
        let mut bars = ParticleCotangents {
            weight: weight_bar,
            angle: x_bar,
            r: y_bar,
            value: Values::Radius,
        };
        // With respect to the positions of all particles together, which the offset moves back.
        let mut positions_bar = self.quantity_vjp(
            &quantity,
            |bin| [sums_bar.weight[bin], sums_bar.r[bin], sums_bar.r2[bin]],
            &mut bars,
        );
        if sums_bar.has_velocities() {
            let velocities: Vec<f64> = (particles.v[2].iter())
                .map(|v| line_of_sight_km_s(*v))
                .collect();
            quantity.values = &velocities;
            vz_bar.resize(len, 0.0);
            bars.value = Values::Velocity(vz_bar);
            positions_bar += self.quantity_vjp(
                &quantity,
                |bin| [0.0, sums_bar.v[bin], sums_bar.v2[bin]],
                &mut bars,
            );
            for bar in vz_bar {
                *bar = line_of_sight_km_s(*bar);
            }
        }
        for (i, point) in points.iter().enumerate() {
            let sky = point.sky;
            let (across, along) = (x_bar[i] / sky.r, y_bar[i]);
            x_bar[i] = along * sky.x - across * sky.y;
            y_bar[i] = along * sky.y + across * sky.x;
        }
        -positions_bar / self.width_deg
    }

    /// Adds the derivatives by the sums of a quantity, `sums_bar` of each bin, to those with respect to the particles. Returns the sum of those
    /// with respect to the positions.
    fn quantity_vjp(
        &self,
        quantity: &Quantity<'_, f64>,
        sums_bar: impl Fn(usize) -> [f64; 3],
        bars: &mut ParticleCotangents<'_>,
    ) -> f64 {
        if !quantity.weights.is_empty() {
            // The sums are in proportion to the weights.
            let unweighted = Quantity {
                weights: &[],
                ..*quantity
            };
            let smear = |moments, r| bars.value.smear(moments, r);
            self.deposit(&unweighted, smear, |i, bin, sums| {
                for (sum, bar) in sums.into_iter().zip(sums_bar(bin)) {
                    bars.weight[i] += sum * bar;
                }
            });
        }
        let mut positions_bar = 0.0;
        for i in 0..quantity.points.len() {
            let weight = quantity.weight(i);
            let sums_bar = |bin| sums_bar(bin).map(|bar| bar * weight);
            let [position_bar, r_bar, value_bar] = if quantity.neighbourhood.is_some() {
                self.smeared_vjp(quantity, i, &sums_bar, bars)
            } else {
                self.point_vjp(quantity.points[i].position, quantity.values[i], &sums_bar)
            };
            positions_bar += position_bar;
            bars.angle[i] += position_bar * self.per_radian();
            bars.add(i, r_bar, value_bar);
        }
        positions_bar
    }

    /// Derivatives with respect to the position, the radius and the value of a particle without neighbours.
    fn point_vjp(
        &self,
        position: f64,
        value: f64,
        sums_bar: &impl Fn(usize) -> [f64; 3],
    ) -> [f64; 3] {
        let NearestEdge { edge, above } =
            self.nearest_edge(Tangent::<f64, 1>::along(position, 0, 1.0));
        let [slope] = above.eps;
        let (bins, weights, slopes) = (
            self.bins_beside(edge.re),
            [1.0 - above.re, above.re],
            [-slope, slope],
        );
        let (mut position_bar, mut value_bar) = (0.0, 0.0);
        for k in 0..2 {
            if let Some(bin) = bins[k] {
                let [weight, sum, square] = sums_bar(bin);
                value_bar += weights[k] * (sum + 2.0 * value * square);
                position_bar += slopes[k] * (weight + sum * value + square * value * value);
            }
        }
        [position_bar, 0.0, value_bar]
    }

    /// Derivatives with respect to the position, the radius and the value of a smeared particle. Those by the smearing, which depends on neighbours
    /// and partner, are added to the derivatives with respect to all particles.
    fn smeared_vjp(
        &self,
        quantity: &Quantity<'_, f64>,
        i: usize,
        sums_bar: &impl Fn(usize) -> [f64; 3],
        bars: &mut ParticleCotangents<'_>,
    ) -> [f64; 3] {
        let (Some(neighbourhood), Some(extent)) = (quantity.neighbourhood, quantity.extent(i))
        else {
            return [0.0; 3];
        };
        let (points, values) = (quantity.points, quantity.values);
        let (position, sky, value) = (points[i].position, points[i].sky, values[i]);
        let (variance, covariance) = extent.moments();
        // Tangents with respect to variance, covariance and radius.
        let numbers = [variance, covariance, sky.r];
        let [variance, covariance, r] =
            std::array::from_fn(|k| Tangent::<f64, 3>::along(numbers[k], k, 1.0));
        let smear = bars.value.smear((variance, covariance), r);
        let half_width = smear.half_width(self.soft());
        let rise = smear.slope * half_width;
        let scale = 1.0 / (half_width.re * self.per_radian());
        let (middle, reach) = self.edges_within(position, half_width.re);
        let (mut value_bar, mut u_bar, mut scale_bar, mut rise_bar) = (0.0, 0.0, 0.0, 0.0);
        let sums_bar_below = |edge: f64| self.bins_beside(edge)[0].map_or([0.0; 3], sums_bar);
        // Derivatives with respect to the three moments of the kernel in a bin.
        let rise2 = rise.re * rise.re;
        let moments_bar = |[weight, sum, square]: [f64; 3]| {
            [
                weight + value * sum + value * value * square,
                rise.re * (sum + 2.0 * value * square),
                rise2 * square,
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
            let [_, sum_bar, square_bar] = lower;
            value_bar +=
                weight * (sum_bar + 2.0 * value * square_bar) + 2.0 * rise.re * offset * square_bar;
            rise_bar += offset * (sum_bar + 2.0 * value * square_bar)
                + 2.0 * rise.re * offset2 * square_bar;
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
            let change = values[j] - values[i];
            let [angle, here_r, other_r, change_bar] =
                displacement_vjp(sky, points[j].sky, change, displacement_bar);
            bars.angle[j] += angle;
            bars.angle[i] -= angle;
            bars.add(j, other_r, change_bar);
            bars.add(i, here_r, -change_bar);
        };
        let extent_bar: Vec<Displacement<f64>> = (0..neighbourhood.normals)
            .map(|k| Displacement {
                angle: 2.0 * extent.angle[k] * variance_bar + extent.change[k] * covariance_bar,
                change: extent.angle[k] * covariance_bar,
            })
            .collect();
        let (block, lane) = (i / LANES, i % LANES);
        for j in 0..neighbourhood.count {
            let row = block * neighbourhood.count + j;
            let mut displacement_bar = Displacement {
                angle: 0.0,
                change: 0.0,
            };
            for (k, extent_bar) in extent_bar.iter().enumerate() {
                let weight = neighbourhood.weights[row * neighbourhood.normals + k][lane];
                displacement_bar.angle += weight * extent_bar.angle;
                displacement_bar.change += weight * extent_bar.change;
            }
            add(neighbourhood.indices[row][lane] as usize, displacement_bar);
        }
        let partner_bar = extent.partner_vjp(variance_bar, covariance_bar);
        add(neighbourhood.partners[block][lane] as usize, partner_bar);
        [-u_bar * scale, own_r_bar, value_bar]
    }
}
