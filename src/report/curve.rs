//! A quantity of a model along a track, and the band of many.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, INK};
use oblate_samplers::diagnostics::weighted_quantile;

/// A quantity of one model along its track: values in bins that move along phi, at the angles of the data and between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Bin centres in degrees, increasing.
    pub phi_deg: Vec<f64>,
    /// Values, such as projected radii in kpc.
    pub values: Vec<f64>,
}

impl Curve {
    /// The curve with breaks where it jumps over more than `width_deg` and the rounding of angles: no bin is covered there.
    pub(super) fn broken(&self, width_deg: f64) -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (phi, value) in self.phi_deg.iter().zip(&self.values) {
            if points
                .last()
                .is_some_and(|last| phi - last.0 > 1.01 * width_deg)
            {
                points.push((f64::NAN, f64::NAN));
            }
            points.push((*phi, *value));
        }
        points
    }

    /// The value in the bin with this centre, if it is covered.
    pub(super) fn at(&self, phi_deg: f64, width_deg: f64) -> Option<f64> {
        let at = self
            .phi_deg
            .iter()
            .position(|p| (p - phi_deg).abs() < 0.01 * width_deg)?;
        self.values.get(at).copied().filter(|r| r.is_finite())
    }

    /// Draws it as a line.
    pub(super) fn draw(&self, canvas: &mut Canvas, axes: &Axes, width_deg: f64) {
        let points = self.broken(width_deg).into_iter();
        let points: Vec<_> = points.map(|(phi, value)| axes.at(phi, value)).collect();
        canvas.line(&points, COLOURS[0], 1.2, "");
    }
}

/// Quantiles of curves in one bin: 2.5, 16, 84 and 97.5 %, over those that cover it.
pub(super) struct Band {
    phi_deg: Vec<f64>,
    quantiles: Vec<[f64; 4]>,
}

impl Band {
    pub fn new(curves: &[Curve], width_deg: f64) -> Self {
        let mut phi: Vec<f64> = curves
            .iter()
            .flat_map(|d| d.phi_deg.iter().copied())
            .collect();
        phi.sort_by(f64::total_cmp);
        phi.dedup_by(|a, b| (*a - *b).abs() < 0.01 * width_deg);
        let mut band = Self {
            phi_deg: Vec::new(),
            quantiles: Vec::new(),
        };
        for centre in phi {
            let values: Vec<f64> = curves
                .iter()
                .filter_map(|d| d.at(centre, width_deg))
                .collect();
            // A bin that most curves do not cover has no band.
            if 2 * values.len() < curves.len() {
                continue;
            }
            let weights = vec![1.0; values.len()];
            band.phi_deg.push(centre);
            band.quantiles
                .push([0.025, 0.16, 0.84, 0.975].map(|p| weighted_quantile(&values, &weights, p)));
        }
        band
    }

    pub fn is_empty(&self) -> bool {
        self.phi_deg.is_empty()
    }

    /// The smallest and the largest 2.5 and 97.5 % quantile.
    pub fn ends(&self) -> impl Iterator<Item = f64> {
        self.quantiles.iter().flat_map(|q| [q[0], q[3]])
    }

    fn rings(&self, axes: &Axes, lo: usize, hi: usize) -> Vec<Vec<(f64, f64)>> {
        let up = self
            .phi_deg
            .iter()
            .zip(&self.quantiles)
            .map(|(p, q)| axes.at(*p, q[hi]));
        let down = self.phi_deg.iter().zip(&self.quantiles).rev();
        vec![up.chain(down.map(|(p, q)| axes.at(*p, q[lo]))).collect()]
    }

    /// Shades 95 and 68 %.
    pub fn draw(&self, canvas: &mut Canvas, axes: &Axes) {
        canvas.area(&self.rings(axes, 0, 3), COLOURS[5], 0.30);
        canvas.area(&self.rings(axes, 1, 2), COLOURS[5], 0.55);
    }
}

/// The legend of data, best fit and, if there is one, band, from `left` on at the height `y`.
pub(super) fn legend(canvas: &mut Canvas, (left, y): (f64, f64), band: bool) {
    let text = |canvas: &mut Canvas, x: f64, text: &str| {
        canvas.text((x, y + 2.5), text, 7.0, Anchor::Start, 0.0);
    };
    canvas.dot((left + 3.0, y), 1.9, INK, 1.0, "legend");
    text(canvas, left + 9.0, "data");
    let best = left + 36.0;
    canvas.line(&[(best, y), (best + 14.0, y)], COLOURS[0], 1.2, "");
    text(canvas, best + 18.0, "best fit");
    if band {
        let x = left + 90.0;
        let strip = |d: f64| vec![(x, y - d), (x + 14.0, y - d), (x + 14.0, y + d), (x, y + d)];
        canvas.area(&[strip(4.0)], COLOURS[5], 0.30);
        canvas.area(&[strip(2.0)], COLOURS[5], 0.55);
        text(canvas, x + 18.0, "68, 95 % of draws");
    }
}
