//! A panel with two linear axes: ranges, ticks at round numbers, labels with units.

use super::canvas::{Anchor, Canvas, GREY, INK};

/// A panel on a sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Left, top, width and height in points.
    pub rect: (f64, f64, f64, f64),
    /// Range of x.
    pub x: (f64, f64),
    /// Range of y.
    pub y: (f64, f64),
}

/// Round tick values inside a range, at most `max_ticks` of them.
#[must_use]
pub fn ticks(range: (f64, f64), max_ticks: usize) -> Vec<f64> {
    let span = range.1 - range.0;
    if !(span.is_finite() && span > 0.0) || max_ticks == 0 {
        return Vec::new();
    }
    let scale = 10_f64.powf((span / max_ticks as f64).log10().floor());
    for factor in [1.0, 2.0, 5.0, 10.0, 20.0] {
        let step = factor * scale;
        let (first, last) = ((range.0 / step).ceil(), (range.1 / step).floor());
        if last - first < max_ticks as f64 {
            // Counted from the first one, because far from zero adding 1 to it may change nothing.
            let beyond = (0..max_ticks).map(|k| k as f64);
            let ticks = beyond.take_while(|k| *k <= last - first);
            return ticks.map(|k| (first + k) * step).collect();
        }
    }
    Vec::new()
}

/// The text of a tick, with as many digits as its step needs.
#[must_use]
pub fn tick_text(value: f64, all: &[f64]) -> String {
    let step = all.windows(2).map(|w| w[1] - w[0]).fold(f64::NAN, f64::min);
    let step = if step.is_finite() {
        step
    } else {
        value.abs().max(1e-12)
    };
    let size = all.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if size >= 1e5 || (size > 0.0 && size < 1e-3) {
        return format!("{value:.1e}");
    }
    let mut digits = 0;
    let mut unit = 1.0;
    while digits < 6 && ((step / unit) - (step / unit).round()).abs() > 1e-6 {
        digits += 1;
        unit /= 10.0;
    }
    // No minus before a zero that rounding made.
    let text = format!("{value:.digits$}");
    if text.trim_start_matches(['-', '0', '.']).is_empty() {
        text.trim_start_matches('-').to_owned()
    } else {
        text.replace('-', "\u{2212}")
    }
}

/// The finite range of values, widened by a fraction on both sides; `[0, 1]` without values.
#[must_use]
pub fn range_of(values: impl IntoIterator<Item = f64>, margin: f64) -> (f64, f64) {
    let (lo, hi) = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
    if lo > hi {
        return (0.0, 1.0);
    }
    let pad = if hi > lo {
        margin * (hi - lo)
    } else {
        0.5 * lo.abs().max(1.0)
    };
    (lo - pad, hi + pad)
}

impl Axes {
    /// A point of the panel on the sheet.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let (left, top, w, h) = self.rect;
        (
            left + w * (x - self.x.0) / (self.x.1 - self.x.0),
            top + h * (self.y.1 - y) / (self.y.1 - self.y.0),
        )
    }

    /// Points of the panel on the sheet.
    #[must_use]
    pub fn all(&self, x: &[f64], y: &[f64]) -> Vec<(f64, f64)> {
        x.iter().zip(y).map(|(x, y)| self.at(*x, *y)).collect()
    }

    /// The outline of a density over the lower edge of the panel, from its points (value, density).
    #[must_use]
    pub fn hill(&self, density: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let foot = |end: Option<&(f64, f64)>| end.map(|(x, _)| self.at(*x, self.y.0));
        let top = density.iter().map(|(x, d)| self.at(*x, *d));
        let first = foot(density.first()).into_iter();
        first.chain(top).chain(foot(density.last())).collect()
    }

    /// A horizontal line through the panel.
    pub fn level(&self, canvas: &mut Canvas, y: f64, colour: &str, dash: &str) {
        let ends = [self.at(self.x.0, y), self.at(self.x.1, y)];
        canvas.line(&ends, colour, 0.7, dash);
    }

    /// A vertical line through the panel, if it lies inside.
    pub fn mark(&self, canvas: &mut Canvas, x: f64, colour: &str, dash: &str) {
        if x >= self.x.0 && x <= self.x.1 {
            let ends = [self.at(x, self.y.0), self.at(x, self.y.1)];
            canvas.line(&ends, colour, 0.9, dash);
        }
    }

    /// Inward ticks and, where `label` is not empty, tick texts and the label's lines, which are markup, below.
    pub fn draw_x(&self, canvas: &mut Canvas, label: &str, max_ticks: usize, size: f64) {
        let (left, top, w, h) = self.rect;
        let values = ticks(self.x, max_ticks);
        for v in &values {
            let (x, _) = self.at(*v, self.y.0);
            canvas.line(&[(x, top + h), (x, top + h - 3.0)], INK, 0.6, "");
            // Where panels adjoin, labels at their corners are left out.
            let inside = (x - left).min(left + w - x) > 0.08 * w || w > 100.0;
            if !label.is_empty() && inside {
                let text = tick_text(*v, &values);
                canvas.text((x, top + h + size + 2.0), &text, size, Anchor::Middle, 0.0);
            }
        }
        for (k, line) in label.lines().enumerate() {
            let y = top + h + (2.4 + 1.3 * k as f64) * size + 3.0;
            canvas.markup((left + 0.5 * w, y), line, size + 1.0, Anchor::Middle, 0.0);
        }
    }

    /// As [`Axes::draw_x`], on the left; the label stands `gap` points away from the frame.
    pub fn draw_y(&self, canvas: &mut Canvas, label: &str, max_ticks: usize, size: f64, gap: f64) {
        let (left, top, _, h) = self.rect;
        let values = ticks(self.y, max_ticks);
        for v in &values {
            let (_, y) = self.at(self.x.0, *v);
            canvas.line(&[(left, y), (left + 3.0, y)], INK, 0.6, "");
            let inside = (y - top).min(top + h - y) > 0.08 * h || h > 60.0;
            if !label.is_empty() && inside {
                let text = tick_text(*v, &values);
                canvas.text((left - 3.0, y + 0.35 * size), &text, size, Anchor::End, 0.0);
            }
        }
        let lines: Vec<&str> = label.lines().rev().collect();
        for (k, line) in lines.into_iter().enumerate() {
            let x = left - gap - 1.3 * size * k as f64;
            canvas.markup((x, top + 0.5 * h), line, size + 1.0, Anchor::Middle, -90.0);
        }
    }

    /// The frame, over what was drawn.
    pub fn frame(&self, canvas: &mut Canvas) {
        let (left, top, w, h) = self.rect;
        canvas.frame(left, top, w, h);
    }

    /// A text above the panel's upper left corner.
    pub fn caption(&self, canvas: &mut Canvas, text: &str, size: f64) {
        let (left, top, ..) = self.rect;
        canvas.text((left, top - 4.0), text, size, Anchor::Start, 0.0);
    }

    /// A band of reference between two values of y.
    pub fn band(&self, canvas: &mut Canvas, y: (f64, f64), opacity: f64) {
        let ring = vec![
            self.at(self.x.0, y.0),
            self.at(self.x.1, y.0),
            self.at(self.x.1, y.1),
            self.at(self.x.0, y.1),
        ];
        canvas.area(&[ring], GREY, opacity);
    }
}
