//! How the errors of hyperparameters fall with the number of streams.

use super::axes::{Axes, range_of};
use super::canvas::{COLOURS, Canvas, GREY};
use super::label;
use crate::posterior::ScalingRow;

/// Width and height of a panel, and distance of two, points.
const PANEL: (f64, f64) = (180.0, 140.0);
const PITCH: f64 = 240.0;

/// Space for the labels of the axes, points.
const LEFT: f64 = 48.0;
const TOP: f64 = 14.0;

/// Points of the curve.
const POINTS: usize = 60;

/// Draws for every hyperparameter the width of its central 68 % interval over the number of streams, with the standard deviation over
/// populations of so many; dashed: in proportion to one over the root of the number, through the width of the largest. `None` without rows.
#[must_use]
pub fn scaling(rows: &[ScalingRow]) -> Option<String> {
    let last = rows.last()?;
    let panels = last.widths.len();
    let mut canvas = Canvas::new(
        LEFT + PITCH * panels as f64 - (PITCH - PANEL.0) + 8.0,
        TOP + PANEL.1 + 32.0,
    );
    let sizes = || rows.iter().map(|row| row.streams as f64);
    for (panel, of_last) in last.widths.iter().enumerate() {
        let widths = rows.iter().filter_map(|row| row.widths.get(panel));
        let ends = widths.map(|w| w.mean + w.sd.unwrap_or(0.0));
        let (_, top) = range_of(ends.chain([0.0]), 0.06);
        let axes = Axes {
            rect: (LEFT + PITCH * panel as f64, TOP, PANEL.0, PANEL.1),
            x: range_of(sizes().chain([0.0]), 0.06),
            y: (0.0, top),
        };
        let (first, end) = (rows[0].streams as f64, last.streams as f64);
        let curve = (0..=POINTS).map(|k| {
            let x = first + (end - first) * k as f64 / POINTS as f64;
            axes.at(x, of_last.mean * (end / x).sqrt())
        });
        let curve: Vec<_> = curve.collect();
        canvas.clipped(axes.rect, |canvas| canvas.line(&curve, GREY, 0.9, "4 3"));
        for row in rows {
            let Some(width) = row.widths.get(panel) else {
                continue;
            };
            let x = row.streams as f64;
            if let Some(sd) = width.sd {
                let ends = [axes.at(x, width.mean - sd), axes.at(x, width.mean + sd)];
                canvas.line(&ends, COLOURS[0], 0.9, "");
            }
            canvas.dot(axes.at(x, width.mean), 2.6, COLOURS[0], 1.0, "width");
        }
        axes.frame(&mut canvas);
        axes.draw_x(&mut canvas, "number of streams", 6, 8.0);
        let (name, _) = label::sign(&of_last.name, "");
        axes.draw_y(&mut canvas, &format!("68 % width of {name}"), 5, 8.0, 32.0);
    }
    Some(canvas.finish("Width of the hyperparameters over the number of streams"))
}
