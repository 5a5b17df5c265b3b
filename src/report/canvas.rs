//! A sheet of SVG: lines, areas and text at sub-pixel positions, in one style.
//!
//! Text is not converted to curves; its font is the generic sans-serif; lengths are in points, a printed column being
//! 250 and a page 510 wide. Colours are Okabe and Ito's (2008), which colour-blind readers can distinguish.

use super::text::{Style, escape, pieces};
use std::fmt::Write;

/// Black ink.
pub const INK: &str = "#1a1a1a";
/// Grid lines, bands of reference.
pub const GREY: &str = "#8c8c8c";
/// Okabe-Ito: blue, vermillion, bluish green, reddish purple, orange, sky blue.
pub const COLOURS: [&str; 6] = [
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9",
];

/// Width above which a drawing is wide, points.
const WIDE: f64 = 400.0;

/// Where text is anchored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// An SVG drawing under construction.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: f64,
    height: f64,
    body: String,
}

/// A number for SVG with two decimals; 0 in place of a number that is not finite.
fn place(x: f64) -> f64 {
    if x.is_finite() {
        (x.clamp(-1e6, 1e6) * 100.0).round() / 100.0
    } else {
        0.0
    }
}

impl Canvas {
    /// An empty sheet, in points.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        Self {
            width,
            height,
            body: String::new(),
        }
    }

    /// One element; writing to a string cannot fail.
    fn put(&mut self, element: std::fmt::Arguments<'_>) {
        let _ = self.body.write_fmt(element);
        self.body.push('\n');
    }

    /// A line through points; it is interrupted at points that are not finite.
    pub fn line(&mut self, points: &[(f64, f64)], colour: &str, width: f64, dash: &str) {
        let d = path(points, false);
        if d.is_empty() {
            return;
        }
        let dash = if dash.is_empty() {
            String::new()
        } else {
            format!(" stroke-dasharray=\"{dash}\"")
        };
        self.put(format_args!(
            "<path d=\"{d}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{dash} stroke-linejoin=\"round\"/>"
        ));
    }

    /// A filled polygon, or several with holes by the even-odd rule.
    pub fn area(&mut self, rings: &[Vec<(f64, f64)>], colour: &str, opacity: f64) {
        let d: String = rings.iter().map(|r| path(r, true)).collect();
        if !d.is_empty() {
            self.put(format_args!(
                "<path d=\"{d}\" fill=\"{colour}\" fill-opacity=\"{opacity}\" fill-rule=\"evenodd\"/>"
            ));
        }
    }

    /// A dot; `class` names what it represents, so that tests can count them.
    pub fn dot(&mut self, at: (f64, f64), radius: f64, colour: &str, opacity: f64, class: &str) {
        if at.0.is_finite() && at.1.is_finite() {
            self.put(format_args!(
                "<circle class=\"{class}\" cx=\"{}\" cy=\"{}\" r=\"{radius}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>",
                place(at.0),
                place(at.1)
            ));
        }
    }

    /// An empty frame.
    pub fn frame(&mut self, x: f64, y: f64, w: f64, h: f64) {
        self.put(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"{INK}\" stroke-width=\"0.6\"/>",
            place(x),
            place(y),
            place(w),
            place(h)
        ));
    }

    /// Text of a size in points, turned by `angle` degrees about its anchor.
    pub fn text(&mut self, at: (f64, f64), text: &str, size: f64, anchor: Anchor, angle: f64) {
        self.put_text(at, &escape(text), size, anchor, angle);
    }

    /// As [`text`](Self::text), of markup ([`pieces`]).
    pub fn markup(&mut self, at: (f64, f64), markup: &str, size: f64, anchor: Anchor, angle: f64) {
        let mut spans = String::new();
        // How far the line is below its own at the end of a piece.
        let mut below = 0.0;
        for (style, text) in pieces(markup) {
            let (wanted, attributes) = match style {
                Style::Plain => (0.0, String::new()),
                Style::Italic => (0.0, " font-style=\"italic\"".to_owned()),
                Style::Sub => (0.22 * size, smaller(size)),
                Style::Super => (-0.36 * size, smaller(size)),
            };
            let dy = place(wanted - below);
            below = wanted;
            let _ = write!(
                spans,
                "<tspan dy=\"{dy}\"{attributes}>{}</tspan>",
                escape(&text)
            );
        }
        self.put_text(at, &spans, size, anchor, angle);
    }

    fn put_text(&mut self, at: (f64, f64), inner: &str, size: f64, anchor: Anchor, angle: f64) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (x, y) = (place(at.0), place(at.1));
        let turn = if angle.abs() > 0.0 {
            format!(" transform=\"rotate({angle} {x} {y})\"")
        } else {
            String::new()
        };
        self.put(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{turn}>{inner}</text>"
        ));
    }

    /// Everything drawn by `inside` is cut off at a rectangle.
    pub fn clipped(&mut self, rect: (f64, f64, f64, f64), inside: impl FnOnce(&mut Self)) {
        let (x, y, w, h) = rect;
        let outer = std::mem::take(&mut self.body);
        inside(self);
        let inner = std::mem::replace(&mut self.body, outer);
        // A nested svg clips to its own box, and needs no name that could clash on a page of many figures.
        let (x, y, w, h) = (place(x), place(y), place(w), place(h));
        self.put(format_args!(
            "<svg x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" viewBox=\"{x} {y} {w} {h}\">\n{inner}</svg>"
        ));
    }

    /// The finished document; `title` is its text alternative.
    #[must_use]
    pub fn finish(self, title: &str) -> String {
        let (w, h) = (place(self.width), place(self.height));
        // A page must not shrink these to the width of a telephone.
        let class = if w > WIDE { " class=\"wide\"" } else { "" };
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\"{class} width=\"{w}pt\" height=\"{h}pt\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"Helvetica, Arial, sans-serif\" fill=\"{INK}\" role=\"img\">\n<title>{}</title>\n\
             <rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n{}</svg>\n",
            escape(title),
            self.body
        )
    }
}

/// The attribute of a subscript's or superscript's size.
fn smaller(size: f64) -> String {
    format!(" font-size=\"{}\"", place(0.75 * size))
}

fn path(points: &[(f64, f64)], close: bool) -> String {
    let mut d = String::new();
    let mut pen = false;
    for (x, y) in points {
        if !(x.is_finite() && y.is_finite()) {
            pen = false;
            continue;
        }
        let _ = write!(
            d,
            "{}{} {}",
            if pen { "L" } else { "M" },
            place(*x),
            place(*y)
        );
        pen = true;
    }
    if close && !d.is_empty() {
        d.push('Z');
    }
    d
}
