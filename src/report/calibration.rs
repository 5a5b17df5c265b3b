//! The ranks of true values: how far their distribution is from the uniform one.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use super::label;
use crate::posterior::{Calibration, RankedFit};

/// Width and height of a panel, and distance of two, points. The panels are not wider, so that they leave out labels at their corners.
const PANEL: (f64, f64) = (100.0, 78.0);
const PITCH: (f64, f64) = (110.0, 118.0);

/// Panels in a row.
const COLUMNS: usize = 4;

/// Space for the labels of the axes, points.
const LEFT: f64 = 44.0;
const TOP: f64 = 20.0;

/// The largest distance times the root of the number of fits that uniform ranks exceed with a probability of 5 % (Kolmogorov 1933).
const BAND: f64 = 1.358;

/// Draws for every quantity the fraction of fits whose rank is at most u, minus u, and the band that it leaves with a probability of 5 % if
/// ranks are uniform. Grey: all fits; blue: those that have passed their checks. `None` without fits.
#[must_use]
pub fn calibration(fits: &[RankedFit]) -> Option<String> {
    // As in the table, every quantity of any fit.
    let rows = Calibration::new(fits).all;
    let panels: Vec<Panel> = (rows.iter())
        .map(|row| Panel::new(&row.name, fits))
        .collect();
    if panels.is_empty() {
        return None;
    }
    let largest = panels.iter().map(Panel::largest).fold(0.0, f64::max);
    let rows = panels.len().div_ceil(COLUMNS);
    let mut canvas = Canvas::new(LEFT + PITCH.0 * COLUMNS as f64, TOP + PITCH.1 * rows as f64);
    for (k, panel) in panels.iter().enumerate() {
        let left = LEFT + PITCH.0 * (k % COLUMNS) as f64;
        let top = TOP + PITCH.1 * (k / COLUMNS) as f64;
        let axes = Axes {
            rect: (left, top, PANEL.0, PANEL.1),
            x: (0.0, 1.0),
            y: (-1.1 * largest, 1.1 * largest),
        };
        axes.band(&mut canvas, (-panel.band, panel.band), 0.15);
        axes.level(&mut canvas, 0.0, GREY, "1 2");
        for (points, colour) in [(&panel.all, GREY), (&panel.converged, COLOURS[0])] {
            let at: Vec<_> = points.iter().map(|(u, d)| axes.at(*u, *d)).collect();
            canvas.line(&at, colour, 1.0, "");
        }
        axes.frame(&mut canvas);
        axes.draw_x(&mut canvas, "rank", 3, 7.0);
        let label = if k % COLUMNS == 0 { "difference" } else { "" };
        axes.draw_y(&mut canvas, label, 4, 7.0, 28.0);
        let title = (left + 0.5 * PANEL.0, top - 5.0);
        let (name, _) = label::sign(panel.name, "");
        canvas.markup(title, &name, 8.0, Anchor::Middle, 0.0);
    }
    Some(canvas.finish("Distribution of the ranks of true values minus the uniform one"))
}

/// One quantity.
struct Panel<'a> {
    name: &'a str,
    /// Differences of all fits.
    all: Vec<(f64, f64)>,
    /// Differences of the fits that have passed.
    converged: Vec<(f64, f64)>,
    /// Half of the height of the band.
    band: f64,
}

impl<'a> Panel<'a> {
    fn new(name: &'a str, fits: &[RankedFit]) -> Self {
        let of = |wanted: fn(&RankedFit) -> bool| -> Vec<f64> {
            let ranks = fits.iter().filter(|fit| wanted(fit));
            let ranks = ranks.flat_map(|fit| &fit.ranks);
            ranks.filter(|(n, _)| n == name).map(|(_, u)| *u).collect()
        };
        let (all, converged) = (of(|_| true), of(|fit| fit.converged));
        let judged = if converged.is_empty() {
            all.len()
        } else {
            converged.len()
        };
        Self {
            name,
            all: differences(all),
            converged: differences(converged),
            band: BAND / (judged as f64).sqrt(),
        }
    }

    /// The largest value that it shows.
    fn largest(&self) -> f64 {
        let points = self.all.iter().chain(&self.converged);
        points.fold(self.band, |most, (_, d)| most.max(d.abs()))
    }
}

/// The empirical distribution of ranks minus the uniform one, on both sides of each step; empty without ranks.
fn differences(mut ranks: Vec<f64>) -> Vec<(f64, f64)> {
    if ranks.is_empty() {
        return Vec::new();
    }
    ranks.sort_by(f64::total_cmp);
    let n = ranks.len() as f64;
    let mut points = vec![(0.0, 0.0)];
    for (i, u) in ranks.iter().enumerate() {
        points.push((*u, i as f64 / n - u));
        points.push((*u, (i + 1) as f64 / n - u));
    }
    points.push((1.0, 0.0));
    points
}
