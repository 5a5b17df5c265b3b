//! The density of q in a population: its posterior mean, median and bands.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use crate::population::PopulationDensity;

/// Draws the density of q: the mean (solid), which is the predictive density of a new halo, the median (dashed), and the pointwise
/// central 68 and 95 % (shaded).
#[must_use]
pub fn population_density(density: &PopulationDensity) -> String {
    let PopulationDensity {
        q,
        mean,
        median,
        lo68,
        hi68,
        lo95,
        hi95,
    } = density;
    let mut canvas = Canvas::new(330.0, 252.0);
    let top = hi95.iter().chain(mean).copied().fold(0.0, f64::max);
    let axes = Axes {
        rect: (44.0, 12.0, 274.0, 186.0),
        x: super::axes::range_of(q.iter().copied(), 0.0),
        y: (0.0, if top > 0.0 { 1.08 * top } else { 1.0 }),
    };
    let colour = COLOURS[0];
    for (lo, hi, opacity) in [(lo95, hi95, 0.16), (lo68, hi68, 0.24)] {
        let mut ring = axes.all(q, lo);
        ring.extend(axes.all(q, hi).into_iter().rev());
        canvas.area(&[ring], colour, opacity);
    }
    canvas.line(&axes.all(q, median), colour, 0.9, "4 2");
    canvas.line(&axes.all(q, mean), colour, 1.3, "");
    axes.mark(&mut canvas, 1.0, GREY, "1 2");
    axes.frame(&mut canvas);
    axes.draw_x(
        &mut canvas,
        "axis ratio *q*  (< 1 oblate, > 1 prolate)",
        8,
        8.0,
    );
    axes.draw_y(
        &mut canvas,
        "density of *q* in the population",
        6,
        8.0,
        30.0,
    );
    for (k, (label, dash)) in [("mean", ""), ("median", "4 2")].into_iter().enumerate() {
        let (x, y) = (44.0 + 60.0 * k as f64, 242.0);
        canvas.line(&[(x, y), (x + 18.0, y)], colour, 1.1, dash);
        canvas.text((x + 22.0, y + 2.5), label, 7.0, Anchor::Start, 0.0);
    }
    canvas.finish("Density of q in the population")
}
