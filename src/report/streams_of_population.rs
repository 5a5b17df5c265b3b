//! q of every stream of a population: in its own fit, and given the population.

use super::axes::{Axes, range_of};
use super::canvas::{Anchor, COLOURS, Canvas, GREY};
use super::strips;
use crate::posterior::{Interval, StreamInPopulation};

/// Top of the panel, points.
const TOP: f64 = 12.0;

/// Draws the medians, 68 % (thick) and 95 % (thin) of q of each stream in its own fit (grey) and given the population (blue).
#[must_use]
pub fn streams_of_population(streams: &[StreamInPopulation]) -> String {
    let height = strips::height(streams.len());
    let mut canvas = Canvas::new(330.0, TOP + height + 50.0);
    let ends = |i: &Interval| [i.lo95, i.hi95];
    let axes = Axes {
        rect: (strips::LEFT, TOP, 222.0, height),
        x: range_of(
            streams
                .iter()
                .flat_map(|s| [ends(&s.q), ends(&s.q_given_population)].concat()),
            0.04,
        ),
        y: (0.0, 1.0),
    };
    let mut bar = |interval: &Interval, y: f64, colour: &str| {
        let px = |q: f64| axes.at(q, 0.0).0;
        canvas.line(
            &[(px(interval.lo95), y), (px(interval.hi95), y)],
            colour,
            0.8,
            "",
        );
        canvas.line(
            &[(px(interval.lo68), y), (px(interval.hi68), y)],
            colour,
            2.2,
            "",
        );
        canvas.dot((px(interval.median), y), 2.0, colour, 1.0, "median");
    };
    for (k, stream) in streams.iter().enumerate() {
        let y = strips::middle(TOP, k);
        bar(&stream.q, y - 3.0, GREY);
        bar(&stream.q_given_population, y + 3.0, COLOURS[0]);
    }
    strips::names(&mut canvas, TOP, streams.iter().map(|s| s.name.as_str()));
    axes.mark(&mut canvas, 1.0, GREY, "1 2");
    axes.frame(&mut canvas);
    axes.draw_x(
        &mut canvas,
        "axis ratio *q*  (< 1 oblate, > 1 prolate)",
        6,
        8.0,
    );
    for (x, colour, label) in [
        (strips::LEFT, GREY, "own fit"),
        (190.0, COLOURS[0], "given the population"),
    ] {
        let y = TOP + height + 42.0;
        canvas.line(&[(x, y), (x + 18.0, y)], colour, 2.2, "");
        canvas.text((x + 22.0, y + 2.5), label, 7.0, Anchor::Start, 0.0);
    }
    canvas.finish("q of the streams of a population")
}
