//! The posterior of q: one or several runs over one prior.

use super::axes::{Axes, range_of};
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use super::density::{Spread, kernel_density};
use crate::params::QPrior;
use crate::posterior::Interval;

/// One run's q.
#[derive(Clone, Debug)]
pub struct QCurve {
    /// The run's name.
    pub name: String,
    /// Draws.
    pub q: Vec<f64>,
    /// Their weights.
    pub weights: Vec<f64>,
    /// Their effective number.
    pub ess: f64,
}

/// Colours of the runs; vermillion is reserved for the truth.
const INKS: [usize; 5] = [0, 2, 3, 4, 5];

/// Left end and width of the panels, points.
const LEFT: f64 = 44.0;
const WIDTH: f64 = 274.0;

/// Height of the panel of densities, of a strip with an interval, and of a line of the legend, points.
const HEIGHT: f64 = 170.0;
const STRIP: f64 = 11.0;
const LINE: f64 = 11.0;

/// Draws the posteriors of q with their medians, 68 and 95 %, the prior (dashed) and the truth (vermillion). The legend is below the axes.
#[must_use]
pub fn q_posterior(curves: &[QCurve], prior: Option<QPrior>, truth: Option<f64>) -> String {
    let all = curves.iter().flat_map(|c| c.q.iter().copied());
    let (x, level) = match prior {
        Some(QPrior::Uniform { lo, hi }) => ((lo, hi), Some(1.0 / (hi - lo))),
        _ => (range_of(all.chain(truth), 0.04), None),
    };
    let densities: Vec<Vec<(f64, f64)>> = curves
        .iter()
        .map(|c| kernel_density(&c.q, &c.weights, &Spread::new(&c.q, &c.weights, c.ess), x))
        .collect();
    let heights = densities.iter().flatten().map(|(_, d)| *d);
    let most = heights.chain(level).fold(0.0, f64::max);
    let strips = 6.0 + STRIP * curves.len() as f64;
    let axes = Axes {
        rect: (LEFT, 12.0, WIDTH, HEIGHT),
        x,
        y: (0.0, 1.08 * most.max(f64::MIN_POSITIVE)),
    };
    let below = Axes {
        rect: (LEFT, 16.0 + HEIGHT, WIDTH, strips),
        x,
        y: (0.0, 1.0),
    };
    let mut keys = curves.len();
    keys += usize::from(level.is_some()) + usize::from(truth.is_some());
    let legend = below.rect.1 + strips + 42.0;
    let mut canvas = Canvas::new(330.0, legend + LINE * keys as f64);
    let ink = |k: usize| COLOURS[INKS[k % INKS.len()]];
    for (k, density) in densities.iter().enumerate() {
        let outline = axes.hill(density);
        canvas.area(std::slice::from_ref(&outline), ink(k), 0.18);
        canvas.line(&outline, ink(k), 1.1, "");
    }
    if let Some(level) = level {
        axes.level(&mut canvas, level, GREY, "4 2");
    }
    let mut key = {
        let mut y = legend - LINE + 4.0;
        move |canvas: &mut Canvas, text: &str, colour: &str, width: f64, dash: &str| {
            y += LINE;
            canvas.line(&[(LEFT, y), (LEFT + 18.0, y)], colour, width, dash);
            canvas.text((LEFT + 24.0, y + 2.5), text, 7.5, Anchor::Start, 0.0);
        }
    };
    for (k, curve) in curves.iter().enumerate() {
        let y = below.rect.1 + 3.0 + STRIP * (k as f64 + 0.5);
        let i = Interval::new(&curve.q, &curve.weights, "");
        let px = |q: f64| below.at(q, 0.0).0;
        canvas.line(&[(px(i.lo95), y), (px(i.hi95), y)], ink(k), 1.0, "");
        canvas.line(&[(px(i.lo68), y), (px(i.hi68), y)], ink(k), 3.2, "");
        canvas.dot((px(i.median), y), 3.0, ink(k), 1.0, "median");
        let text = format!(
            "{}: {:.3}, 68 % in [{:.3}, {:.3}]",
            curve.name, i.median, i.lo68, i.hi68
        );
        key(&mut canvas, &text, ink(k), 3.2, "");
    }
    if level.is_some() {
        key(&mut canvas, "prior", GREY, 0.7, "4 2");
    }
    for panel in [&axes, &below] {
        panel.mark(&mut canvas, 1.0, GREY, "1 2");
        if let Some(truth) = truth {
            panel.mark(&mut canvas, truth, COLOURS[1], "");
        }
        panel.frame(&mut canvas);
    }
    if truth.is_some() {
        key(&mut canvas, "truth", COLOURS[1], 0.9, "");
    }
    axes.draw_x(&mut canvas, "", 8, 8.0);
    axes.draw_y(&mut canvas, "posterior density of *q*", 6, 8.0, 30.0);
    let label = "axis ratio *q*  (< 1 oblate, > 1 prolate)";
    below.draw_x(&mut canvas, label, 8, 8.0);
    canvas.finish("Posterior of q")
}
