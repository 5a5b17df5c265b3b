//! Strips of a figure, one below the other, each with the name of a stream to the left of the panels.

use super::canvas::{Anchor, Canvas};

/// Left end of the panels, points.
pub const LEFT: f64 = 96.0;

/// Height of a strip, points.
const HEIGHT: f64 = 15.0;

/// Space above the first and below the last strip, points.
const MARGIN: f64 = 4.0;

/// Characters of a name that fit to the left of the panels.
const NAME: usize = 18;

/// Height of a panel of so many strips.
pub fn height(count: usize) -> f64 {
    2.0 * MARGIN + HEIGHT * count as f64
}

/// Height on the sheet of the middle of a strip, in a panel that begins at `top`.
pub fn middle(top: f64, strip: usize) -> f64 {
    top + MARGIN + HEIGHT * (strip as f64 + 0.5)
}

/// Writes the names beside a panel that begins at `top`; long ones are cut.
pub fn names<'a>(canvas: &mut Canvas, top: f64, names: impl Iterator<Item = &'a str>) {
    for (strip, name) in names.enumerate() {
        let mut short: String = name.chars().take(NAME).collect();
        if name.chars().count() > NAME {
            short.push('\u{2026}');
        }
        let at = (LEFT - 4.0, middle(top, strip) + 2.5);
        canvas.text(at, &short, 7.0, Anchor::End, 0.0);
    }
}
