//! How the hyperparameters of a population move without each stream.

use super::axes::{Axes, range_of};
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use super::label;
use super::strips;
use crate::posterior::PopulationSummary;

/// Width of a panel, and distance of two, points.
const PANEL: f64 = 104.0;
const PITCH: f64 = 116.0;

/// Top of the panels, points.
const TOP: f64 = 22.0;

/// What the axes show.
const AXIS: &str = "move of the mean\n[standard deviations]";

/// Opacity of a move whose weights are not reliable.
const FAINT: f64 = 0.3;

/// Draws the move of every hyperparameter's mean without each stream, in standard deviations, a panel for each hyperparameter; faint where
/// the weights are not reliable. `None` if no stream was left out.
#[must_use]
pub fn influence(population: &PopulationSummary) -> Option<String> {
    let left_out: Vec<_> = population.left_out().collect();
    let (_, first) = left_out.first()?;
    let panels = first.parameters.len();
    let height = strips::height(left_out.len());
    let width = PITCH * panels as f64 - (PITCH - PANEL);
    let mut canvas = Canvas::new(strips::LEFT + width + 12.0, TOP + height + 42.0);
    let moves = left_out.iter().flat_map(|(_, without)| &without.parameters);
    let x = range_of(moves.map(|(_, moved)| moved.mean_move).chain([0.0]), 0.06);
    let names = left_out.iter().map(|(stream, _)| stream.name.as_str());
    strips::names(&mut canvas, TOP, names);
    for (panel, (name, _)) in first.parameters.iter().enumerate() {
        let left = strips::LEFT + PITCH * panel as f64;
        let axes = Axes {
            rect: (left, TOP, PANEL, height),
            x,
            y: (0.0, 1.0),
        };
        axes.mark(&mut canvas, 0.0, GREY, "1 2");
        for (k, (_, without)) in left_out.iter().enumerate() {
            let Some((_, moved)) = without.parameters.get(panel) else {
                continue;
            };
            let opacity = if without.reliable() { 1.0 } else { FAINT };
            let at = (axes.at(moved.mean_move, 0.0).0, strips::middle(TOP, k));
            canvas.dot(at, 2.4, COLOURS[0], opacity, "move");
        }
        axes.frame(&mut canvas);
        axes.draw_x(&mut canvas, AXIS, 4, 7.0);
        let title = (left + 0.5 * PANEL, TOP - 7.0);
        let (name, _) = label::sign(name, "");
        canvas.markup(title, &name, 8.0, Anchor::Middle, 0.0);
    }
    Some(canvas.finish("move of the hyperparameters without each stream"))
}
