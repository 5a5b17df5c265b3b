//! Corner plots: every column's marginal, and 68 and 95 % regions of every pair.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, INK};
use super::density::{Density2, Spread, kernel_density};
use super::label;
use crate::posterior::Column;
use oblate_samplers::diagnostics::weighted_quantile;

/// One column of a corner plot.
#[derive(Clone, Debug)]
pub struct CornerColumn {
    /// Name, unit and draws.
    pub column: Column,
    /// Effective number of its draws.
    pub ess: f64,
    /// The true value, where it is known.
    pub truth: Option<f64>,
}

/// The part of a column's range that is shown: 99.4 % of the weight and a margin, and the truth.
fn range(column: &CornerColumn, weights: &[f64]) -> (f64, f64) {
    let at = |p| weighted_quantile(&column.column.values, weights, p);
    super::axes::range_of([at(0.003), at(0.997)].into_iter().chain(column.truth), 0.06)
}

/// A corner plot of columns with common weights: `columns x columns` panels that fill a page.
///
/// Filled regions contain 68 and 95 % of the weight; orange lines are the truth; each marginal has its median and central 68 % as
/// text.
#[must_use]
pub fn corner(columns: &[CornerColumn], weights: &[f64], title: &str) -> String {
    let n = columns.len().max(1);
    let (left, bottom, above) = (48.0, 48.0, if n > 6 { 22.0 } else { 16.0 });
    let gap = if n > 6 { 2.0 } else { 4.0 };
    // Two columns make a small square, fourteen fill a sheet: the panels must stay legible.
    let panel = (720.0 / n as f64 - gap).clamp(52.0, 150.0);
    let side = n as f64 * (panel + gap);
    let mut canvas = Canvas::new(left + side + 12.0, above + side + bottom);
    let ranges: Vec<(f64, f64)> = columns.iter().map(|c| range(c, weights)).collect();
    let spread = |c: &CornerColumn| Spread::new(&c.column.values, weights, c.ess);
    let spreads: Vec<Spread> = columns.iter().map(spread).collect();
    let size = if n > 6 { 6.0 } else { 8.0 };
    for row in 0..columns.len() {
        for col in 0..=row {
            let rect = (
                left + col as f64 * (panel + gap),
                above + row as f64 * (panel + gap),
                panel,
                panel,
            );
            let label = |shown: bool, at: usize| {
                if shown {
                    label::axis(&columns[at].column.name, &columns[at].column.unit, n > 6)
                } else {
                    String::new()
                }
            };
            let below = label(row + 1 == columns.len(), col);
            let most = if n > 6 { 3 } else { 5 };
            if row == col {
                let x = ranges[row];
                let own = (&columns[row], &spreads[row]);
                let axes = marginal(&mut canvas, own, weights, x, rect, size, n > 6);
                axes.draw_x(&mut canvas, &below, most, size);
            } else {
                let axes = Axes {
                    rect,
                    x: ranges[col],
                    y: ranges[row],
                };
                pair(
                    &mut canvas,
                    &axes,
                    [&columns[col], &columns[row]],
                    [&spreads[col], &spreads[row]],
                    weights,
                    n,
                );
                axes.draw_x(&mut canvas, &below, most, size);
                axes.draw_y(&mut canvas, &label(col == 0, row), most, size, 28.0);
            }
        }
    }
    canvas.finish(title)
}

fn marginal(
    canvas: &mut Canvas,
    (column, spread): (&CornerColumn, &Spread),
    weights: &[f64],
    x: (f64, f64),
    rect: (f64, f64, f64, f64),
    size: f64,
    is_narrow: bool,
) -> Axes {
    let density = kernel_density(&column.column.values, weights, spread, x);
    let most = density.iter().map(|(_, d)| *d).fold(0.0, f64::max);
    let axes = Axes {
        rect,
        x,
        y: (0.0, 1.15 * most.max(f64::MIN_POSITIVE)),
    };
    let outline = axes.hill(&density);
    canvas.area(std::slice::from_ref(&outline), COLOURS[5], 0.45);
    canvas.line(&outline, COLOURS[0], 0.8, "");
    let at = |p| weighted_quantile(&column.column.values, weights, p);
    let (median, lo, hi) = (at(0.5), at(0.16), at(0.84));
    for (q, dash) in [(median, ""), (lo, "2 2"), (hi, "2 2")] {
        axes.mark(canvas, q, INK, dash);
    }
    if let Some(truth) = column.truth {
        axes.mark(canvas, truth, COLOURS[1], "");
    }
    axes.frame(canvas);
    let (median, sides) = credible(median, lo, hi);
    let middle = rect.0 + 0.5 * rect.2;
    // In one line both are wider than a narrow panel.
    let lines = if is_narrow {
        vec![sides, median]
    } else {
        vec![format!("{median} {sides}")]
    };
    for (line, text) in lines.iter().enumerate() {
        let height = rect.1 - 3.0 - 1.2 * size * line as f64;
        canvas.text((middle, height), text, size, Anchor::Middle, 0.0);
    }
    axes
}

/// The median, and `+up -down` with two digits of the smaller side.
fn credible(median: f64, lo: f64, hi: f64) -> (String, String) {
    let (down, up) = (median - lo, hi - median);
    let least = down.min(up);
    let mut digits = 0;
    let mut unit = 1.0;
    while digits < 5 && least < 10.0 * unit {
        digits += 1;
        unit /= 10.0;
    }
    let median = format!("{median:.digits$}");
    let is_zero = median.trim_start_matches(['-', '0', '.']).is_empty();
    let sign = if is_zero { "" } else { "\u{2212}" };
    let median = median.replace('-', sign);
    (median, format!("+{up:.digits$} \u{2212}{down:.digits$}"))
}

fn pair(
    canvas: &mut Canvas,
    axes: &Axes,
    columns: [&CornerColumn; 2],
    spreads: [&Spread; 2],
    weights: &[f64],
    n: usize,
) {
    let cells = if n > 6 { 36 } else { 48 };
    let values = columns.map(|c| c.column.values.as_slice());
    let density = Density2::new(values, weights, spreads, [axes.x, axes.y], cells);
    for (region, opacity) in density.regions().iter().zip([0.35, 0.6]) {
        let on_sheet = |ring: &Vec<(f64, f64)>| ring.iter().map(|(x, y)| axes.at(*x, *y)).collect();
        let rings: Vec<Vec<(f64, f64)>> = region.iter().map(on_sheet).collect();
        canvas.area(&rings, COLOURS[5], opacity);
        for ring in &rings {
            canvas.line(ring, COLOURS[0], 0.6, "");
        }
    }
    if let Some(truth) = columns[0].truth {
        axes.mark(canvas, truth, COLOURS[1], "");
    }
    if let Some(truth) = columns[1].truth {
        axes.level(canvas, truth, COLOURS[1], "");
    }
    if let (Some(x), Some(y)) = (columns[0].truth, columns[1].truth) {
        canvas.dot(axes.at(x, y), 1.6, COLOURS[1], 1.0, "truth");
    }
    axes.frame(canvas);
}
