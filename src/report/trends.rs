//! The errors of q over how far the tracks extend.

use super::axes::{Axes, range_of};
use super::canvas::{COLOURS, Canvas, GREY, INK};
use crate::posterior::{RankedFit, Trend};

/// Width and height of a panel, and distance of two, points.
const PANEL: (f64, f64) = (190.0, 120.0);
const PITCH: (f64, f64) = (206.0, 168.0);

/// Panels in a row.
const COLUMNS: usize = 2;

/// Space for the labels of the axes, points.
const LEFT: f64 = 44.0;
const TOP: f64 = 8.0;

/// What the x axis of each number shows.
const LABELS: [(&str, &str); 4] = [
    ("length_deg", "angle covered [deg]"),
    ("length_kpc", "length [kpc]"),
    ("mean_kpc", "mean radius [kpc]"),
    ("spread_kpc", "standard deviation of the radii [kpc]"),
];

/// Draws the error of q of every fit over each number of the tracks. Blue: fits that have passed their checks, grey: others; the lines are
/// `trends`. `None` without lines.
#[must_use]
pub fn q_errors(fits: &[RankedFit], trends: &[Trend]) -> Option<String> {
    let rows = trends.len().div_ceil(COLUMNS);
    trends.first()?;
    let mut canvas = Canvas::new(LEFT + PITCH.0 * COLUMNS as f64, TOP + PITCH.1 * rows as f64);
    let errors = fits.iter().filter_map(|fit| fit.q_error);
    let (_, top) = range_of(errors.chain([0.0]), 0.06);
    for (k, trend) in trends.iter().enumerate() {
        let points: Vec<(f64, f64, bool)> = fits
            .iter()
            .filter_map(|fit| {
                let named = fit.extent.named();
                let (_, x) = named.into_iter().find(|(name, _)| *name == trend.name)?;
                Some((x, fit.q_error?, fit.converged))
            })
            .collect();
        let column = (k % COLUMNS) as f64;
        let axes = Axes {
            rect: (
                LEFT + PITCH.0 * column,
                TOP + PITCH.1 * (k / COLUMNS) as f64,
                PANEL.0,
                PANEL.1,
            ),
            x: range_of(points.iter().map(|(x, ..)| *x), 0.06),
            y: (0.0, top),
        };
        let line = |x: f64| axes.at(x, trend.q_error + trend.slope * (x - trend.mean));
        canvas.clipped(axes.rect, |canvas| {
            canvas.line(&[line(axes.x.0), line(axes.x.1)], INK, 0.9, "");
        });
        for (x, error, converged) in points {
            let colour = if converged { COLOURS[0] } else { GREY };
            canvas.dot(axes.at(x, error), 2.0, colour, 0.8, "fit");
        }
        axes.frame(&mut canvas);
        let label = LABELS.iter().find(|(name, _)| *name == trend.name);
        axes.draw_x(&mut canvas, label.map_or("", |(_, label)| label), 5, 7.0);
        let label = if column > 0.0 {
            ""
        } else {
            "mean |*q* \u{2212} true *q*|"
        };
        axes.draw_y(&mut canvas, label, 5, 7.0, 28.0);
    }
    Some(canvas.finish("Errors of q over the extent of the tracks"))
}
