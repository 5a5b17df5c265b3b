//! The posterior of q: one or several runs over one prior.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use super::density::histogram;
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
}

/// Draws the posteriors of q with their medians, 68 and 95 %, the prior (dashed) and the truth (vermillion).
#[must_use]
pub fn q_posterior(curves: &[QCurve], prior: Option<QPrior>, truth: Option<f64>) -> String {
    const CELLS: usize = 80;
    // Vermillion is reserved for the truth.
    const INKS: [usize; 5] = [0, 2, 3, 4, 5];
    let x = match prior {
        Some(QPrior::Uniform { lo, hi }) => (lo, hi),
        _ => super::axes::range_of(curves.iter().flat_map(|c| c.q.iter().copied()), 0.02),
    };
    let strip = 13.0;
    let under = 8.0 + strip * curves.len() as f64;
    let mut canvas = Canvas::new(330.0, 190.0 + under + 38.0);
    let step = (x.1 - x.0) / CELLS as f64;
    let densities: Vec<Vec<f64>> = curves
        .iter()
        .map(|c| histogram(&c.q, &c.weights, x, CELLS))
        .collect();
    let most = densities
        .iter()
        .flatten()
        .copied()
        .fold(1.0 / (x.1 - x.0), f64::max);
    let axes = Axes {
        rect: (44.0, 12.0, 274.0, 176.0),
        x,
        y: (0.0, 1.12 * most),
    };
    for (k, density) in densities.iter().enumerate() {
        let mut outline = vec![axes.at(x.0, 0.0)];
        for (i, d) in density.iter().enumerate() {
            outline.push(axes.at(x.0 + i as f64 * step, *d));
            outline.push(axes.at(x.0 + (i + 1) as f64 * step, *d));
        }
        outline.push(axes.at(x.1, 0.0));
        let colour = COLOURS[INKS[k % INKS.len()]];
        canvas.area(std::slice::from_ref(&outline), colour, 0.18);
        canvas.line(&outline, colour, 1.0, "");
    }
    if let Some(QPrior::Uniform { lo, hi }) = prior {
        axes.level(&mut canvas, 1.0 / (hi - lo), GREY, "4 2");
        let at = axes.at(x.1, 1.0 / (hi - lo));
        canvas.text((at.0 - 4.0, at.1 - 3.0), "prior", 7.0, Anchor::End, 0.0);
    }
    axes.mark(&mut canvas, 1.0, GREY, "1 2");
    axes.frame(&mut canvas);
    axes.draw_x(&mut canvas, "", 8, 8.0);
    axes.draw_y(&mut canvas, "posterior density of q", 6, 8.0, 30.0);
    let below = Axes {
        rect: (44.0, 192.0, 274.0, under),
        x,
        y: (0.0, 1.0),
    };
    for (k, curve) in curves.iter().enumerate() {
        let colour = COLOURS[INKS[k % INKS.len()]];
        let y = 192.0 + 4.0 + strip * (k as f64 + 0.5);
        let i = Interval::new(&curve.q, &curve.weights, "");
        let px = |q: f64| below.at(q, 0.0).0;
        canvas.line(&[(px(i.lo95), y), (px(i.hi95), y)], colour, 1.0, "");
        canvas.line(&[(px(i.lo68), y), (px(i.hi68), y)], colour, 3.2, "");
        canvas.dot((px(i.median), y), 3.0, colour, 1.0, "median");
        // The text is next to the bar.
        let text = format!(
            "{}  {:.3} [{:.3}, {:.3}]",
            curve.name, i.median, i.lo68, i.hi68
        );
        if px(i.median) < below.rect.0 + 0.5 * below.rect.2 {
            canvas.text((312.0, y + 2.5), &text, 7.0, Anchor::End, 0.0);
        } else {
            canvas.text((50.0, y + 2.5), &text, 7.0, Anchor::Start, 0.0);
        }
    }
    if let Some(truth) = truth {
        axes.mark(&mut canvas, truth, COLOURS[1], "");
        below.mark(&mut canvas, truth, COLOURS[1], "");
        let at = axes.at(truth, axes.y.1);
        canvas.text((at.0 + 3.0, at.1 + 9.0), "truth", 7.0, Anchor::Start, 0.0);
    }
    below.frame(&mut canvas);
    below.draw_x(
        &mut canvas,
        "axis ratio q  (< 1 oblate, > 1 prolate)",
        8,
        8.0,
    );
    canvas.finish("Posterior of q")
}
