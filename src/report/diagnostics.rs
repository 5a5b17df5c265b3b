//! Diagnostic figures of the samplers.

use super::axes::{Axes, range_of};
use super::canvas::{COLOURS, Canvas, INK};
use oblate_samplers::Run;
use oblate_samplers::output::History;

/// Cells of the histogram of insertion ranks.
const RANK_CELLS: usize = 20;

/// Maximum number of points of a line, which bounds the size of the file.
const MAX_POINTS: usize = 1500;

/// Draws the diagnostics of a run.
///
/// Nested: ln L against ln X with the posterior weight per unit of ln X, and the histogram of insertion ranks with the 95 %
/// band of uniform ranks. Tempered: swap rejection and communication barrier, acceptance and step size against temperature, and the
/// trace of ln L at beta = 1 with the round trips. Bridge: ln Z and the effective number of ancestors by exponent.
#[must_use]
pub fn diagnostics(run: &Run) -> String {
    match &run.history {
        History::Nested {
            ln_x,
            ln_likelihood,
            insertion_rank,
            ..
        } => nested(ln_x, ln_likelihood, insertion_rank),
        History::Tempered {
            beta,
            swap_rejection,
            acceptance,
            step_size,
            communication_barrier,
            round_trips,
            trace,
            ..
        } => {
            let mut canvas = Canvas::new(560.0, 348.0);
            swaps(&mut canvas, beta, swap_rejection, communication_barrier);
            transitions(&mut canvas, beta, acceptance, step_size);
            traces(&mut canvas, trace, round_trips);
            canvas.finish("Diagnostics of a tempered run")
        }
        History::Bridge {
            fraction,
            ln_ratio,
            ancestors,
            ..
        } => {
            let mut canvas = Canvas::new(560.0, 220.0);
            let (left, right) = ((56.0, 12.0, 216.0, 160.0), (330.0, 12.0, 216.0, 160.0));
            bridge_axes(
                &mut canvas,
                left,
                fraction,
                ln_ratio,
                "ln Z minus that of the coarse run",
            );
            bridge_axes(
                &mut canvas,
                right,
                fraction,
                ancestors,
                "effective number of ancestors",
            );
            canvas.finish("Diagnostics of a bridge")
        }
    }
}

/// One number after every step from the coarse likelihood to the fine one.
fn bridge_axes(
    canvas: &mut Canvas,
    rect: (f64, f64, f64, f64),
    fraction: &[f64],
    values: &[f64],
    what: &str,
) {
    let axes = Axes {
        rect,
        x: range_of([0.0, 1.0], 0.04),
        y: range_of(values.iter().copied().chain([0.0]), 0.1),
    };
    let points = axes.all(fraction, values);
    canvas.line(&points, COLOURS[0], 1.1, "");
    for at in points {
        canvas.dot(at, 2.0, COLOURS[0], 1.0, "step");
    }
    axes.frame(canvas);
    axes.draw_x(canvas, "exponent s of the fine likelihood", 5, 8.0);
    axes.draw_y(canvas, what, 5, 8.0, 42.0);
}

/// Evenly spaced indices, so that at most [`MAX_POINTS`] are drawn; the last one included.
fn thin(len: usize) -> Vec<usize> {
    let step = len.div_ceil(MAX_POINTS).max(1);
    let mut rows: Vec<usize> = (0..len).step_by(step).collect();
    if let Some(last) = len.checked_sub(1)
        && rows.last() != Some(&last)
    {
        rows.push(last);
    }
    rows
}

fn nested(ln_x: &[f64], ln_likelihood: &[f64], insertion_rank: &[f64]) -> String {
    let mut canvas = Canvas::new(560.0, 226.0);
    let rows = thin(ln_x.len().min(ln_likelihood.len()));
    let x: Vec<f64> = rows.iter().map(|i| -ln_x[*i]).collect();
    let y: Vec<f64> = rows.iter().map(|i| ln_likelihood[*i]).collect();
    // Posterior mass per unit of ln X, L X, scaled to its peak.
    let mass: Vec<f64> = x.iter().zip(&y).map(|(x, y)| y - x).collect();
    let peak = mass
        .iter()
        .copied()
        .filter(|m| m.is_finite())
        .fold(f64::NEG_INFINITY, f64::max);
    let mut sorted: Vec<f64> = y.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    // The first points of the prior can be anywhere below: the axis begins at the 5 % quantile.
    let floor = sorted.get(sorted.len() / 20).copied().unwrap_or(0.0);
    let axes = Axes {
        rect: (56.0, 18.0, 216.0, 160.0),
        x: range_of(x.iter().copied(), 0.02),
        y: range_of(sorted.last().copied().into_iter().chain([floor]), 0.08),
    };
    canvas.clipped(axes.rect, |canvas| {
        let fraction: Vec<f64> = mass
            .iter()
            .map(|m| axes.y.0 + 0.6 * (axes.y.1 - axes.y.0) * (m - peak).exp())
            .collect();
        let mut ring = axes.all(&x, &fraction);
        if let (Some(first), Some(last)) = (x.first(), x.last()) {
            ring.push(axes.at(*last, axes.y.0));
            ring.push(axes.at(*first, axes.y.0));
        }
        canvas.area(&[ring], COLOURS[4], 0.45);
        canvas.line(&axes.all(&x, &y), COLOURS[0], 1.1, "");
    });
    axes.frame(&mut canvas);
    axes.draw_x(&mut canvas, "\u{2212}ln *X* (prior volume)", 6, 8.0);
    axes.draw_y(&mut canvas, "ln *L*", 6, 8.0, 42.0);
    axes.caption(&mut canvas, "shaded: posterior mass per ln X", 7.0);
    ranks(&mut canvas, insertion_rank);
    canvas.finish("Diagnostics of a nested run")
}

fn ranks(canvas: &mut Canvas, insertion_rank: &[f64]) {
    let weights = vec![1.0; insertion_rank.len()];
    let density = super::density::histogram(insertion_rank, &weights, (0.0, 1.0), RANK_CELLS);
    let p = 1.0 / RANK_CELLS as f64;
    let count = (insertion_rank.len() as f64).max(1.0);
    // Binomial standard error of a cell's count, relative to its mean.
    let sd = ((1.0 - p) / (p * count)).sqrt();
    let max = density.iter().fold(1.0 + 3.0 * sd, |m, d| m.max(*d));
    let min = density
        .iter()
        .fold(1.0 - 3.0 * sd, |m, d| m.min(*d))
        .max(0.0);
    let margin = 0.1 * (max - min);
    let axes = Axes {
        rect: (330.0, 18.0, 216.0, 160.0),
        x: (0.0, 1.0),
        y: ((min - margin).max(0.0), max + margin),
    };
    axes.band(
        canvas,
        ((1.0 - 1.96 * sd).max(axes.y.0), 1.0 + 1.96 * sd),
        0.25,
    );
    axes.level(canvas, 1.0, INK, "4 2");
    let mut outline = Vec::new();
    for (i, d) in density.iter().enumerate() {
        outline.push(axes.at(i as f64 * p, *d));
        outline.push(axes.at((i + 1) as f64 * p, *d));
    }
    canvas.line(&outline, COLOURS[0], 1.1, "");
    axes.frame(canvas);
    axes.draw_x(canvas, "insertion rank / live points", 6, 8.0);
    axes.draw_y(canvas, "density", 5, 8.0, 32.0);
    axes.caption(canvas, "grey: 95 % of each cell if ranks are uniform", 7.0);
}

/// Axes over the number of a temperature, because most inverse temperatures are close to 0.
fn number_axes(rect: (f64, f64, f64, f64), count: usize, y: (f64, f64)) -> Axes {
    Axes {
        rect,
        x: (-0.4, count as f64 - 0.6),
        y,
    }
}

fn numbered(values: &[f64], offset: f64) -> Vec<f64> {
    (0..values.len()).map(|k| k as f64 + offset).collect()
}

fn swaps(canvas: &mut Canvas, beta: &[f64], swap_rejection: &[f64], communication_barrier: &[f64]) {
    let top = communication_barrier
        .iter()
        .copied()
        .filter(|b| b.is_finite())
        .fold(0.0, f64::max);
    let axes = number_axes((44.0, 18.0, 216.0, 116.0), beta.len(), (0.0, 1.05));
    let x = numbered(swap_rejection, 0.5);
    canvas.line(&axes.all(&x, swap_rejection), COLOURS[0], 1.0, "");
    for at in axes.all(&x, swap_rejection) {
        canvas.dot(at, 2.0, COLOURS[0], 1.0, "gap");
    }
    if top > 0.0 {
        let fraction: Vec<f64> = communication_barrier.iter().map(|b| b / top).collect();
        canvas.line(
            &axes.all(&numbered(communication_barrier, 0.0), &fraction),
            COLOURS[1],
            1.0,
            "4 2",
        );
    }
    axes.frame(canvas);
    axes.draw_x(
        canvas,
        "temperature (0: reference, last: posterior)",
        8,
        8.0,
    );
    axes.draw_y(canvas, "swap rejection", 5, 8.0, 30.0);
    let text = format!("dots: rejection; dashed: communication barrier / {top:.2}");
    axes.caption(canvas, &text, 7.0);
}

fn transitions(canvas: &mut Canvas, beta: &[f64], acceptance: &[f64], step_size: &[f64]) {
    let max = step_size
        .iter()
        .chain(acceptance)
        .copied()
        .filter(|s| s.is_finite())
        .fold(1.0, f64::max);
    let axes = number_axes((330.0, 18.0, 216.0, 116.0), beta.len(), (0.0, 1.08 * max));
    for (values, colour, class) in [
        (acceptance, COLOURS[0], "acceptance"),
        (step_size, COLOURS[1], "step"),
    ] {
        let points = axes.all(&numbered(values, 0.0), values);
        canvas.line(
            &points,
            colour,
            1.0,
            if class == "step" { "4 2" } else { "" },
        );
        for at in points {
            canvas.dot(at, 2.0, colour, 1.0, class);
        }
    }
    axes.frame(canvas);
    axes.draw_x(
        canvas,
        "temperature (0: reference, last: posterior)",
        8,
        8.0,
    );
    axes.draw_y(canvas, "HMC transitions", 5, 8.0, 30.0);
    axes.caption(canvas, "solid: acceptance; dashed: step size", 7.0);
}

fn traces(canvas: &mut Canvas, trace: &[Vec<f64>], round_trips: &[u64]) {
    let longest = trace.iter().map(Vec::len).max().unwrap_or(0);
    let axes = Axes {
        rect: (56.0, 190.0, 490.0, 112.0),
        x: (0.0, (longest as f64).max(1.0)),
        y: range_of(trace.iter().flatten().copied(), 0.12),
    };
    canvas.clipped(axes.rect, |canvas| {
        for (chain_set, values) in trace.iter().enumerate() {
            let points: Vec<(f64, f64)> = thin(values.len())
                .into_iter()
                .map(|i| axes.at(i as f64, values[i]))
                .collect();
            canvas.line(&points, COLOURS[chain_set % COLOURS.len()], 0.5, "");
        }
    });
    axes.frame(canvas);
    axes.draw_x(canvas, "scan", 8, 8.0);
    axes.draw_y(canvas, "ln *L* at \u{3b2} = 1", 5, 8.0, 42.0);
    let trips: Vec<String> = round_trips.iter().map(u64::to_string).collect();
    let text = format!("round trips per chain set: {}", trips.join(", "));
    axes.caption(canvas, &text, 7.0);
}
