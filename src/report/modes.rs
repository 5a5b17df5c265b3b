//! The orientation modes on the sky: in each the stream of its best draw, and outlines of the halo.

use super::axes::Axes;
use super::canvas::{Anchor, COLOURS, Canvas, GREY, INK};
use super::curve::Curve;
use super::fit::data_on_sky;
use crate::data::ObservedTrack;
use crate::posterior::ModeWeight;
use crate::potential::{HaloParameters, squared_axis_ratio};
use crate::scalar::Vec3;

/// One mode, by its draw of the highest ln L.
#[derive(Clone, Debug)]
pub struct ModePicture {
    /// The mode and its weight.
    pub weight: ModeWeight,
    /// The halo.
    pub halo: HaloParameters<f64>,
    /// Particles on the sky, (x, y) in kpc.
    pub particles: Vec<(f64, f64)>,
    /// Its track.
    pub curve: Curve,
    /// Angle on the sky of phi = 0 in degrees.
    pub phi_zero_deg: f64,
}

/// Side of a panel and distance of two, points.
const PANEL: f64 = 150.0;
const PITCH: (f64, f64) = (172.0, 196.0);

/// Left and upper end of the first panel, points.
const LEFT: f64 = 44.0;
const TOP: f64 = 30.0;

/// Panels in a row.
const COLUMNS: usize = 3;

/// Semi-axes, across the axes of q and p, of the outlines that are drawn, as fractions of the half-width of the panel.
const OUTLINES: [f64; 3] = [0.25, 0.5, 0.75];

/// Points of an outline.
const POINTS: u32 = 90;

/// The outline on the sky of the ellipsoid m = `a`, whose semi-axes are `a q` and `a p` along the two axes of the halo and `a` across them. It is the
/// ellipse `u M^-1 u = a^2`, where M is the part on the sky of the matrix with the squared axis ratios.
#[must_use]
pub fn outline(halo: &HaloParameters<f64>, a: f64) -> Vec<(f64, f64)> {
    let (n, b) = (halo.axis, halo.second.axis);
    let along_n = squared_axis_ratio(halo.flattening) - 1.0;
    let along_b = squared_axis_ratio(halo.second.flattening) - 1.0;
    let m = |of: fn(Vec3<f64>) -> f64| along_n * of(n) + along_b * of(b);
    // The lower triangle of the Cholesky factor of M.
    let xx = (1.0 + m(|v| v.x * v.x)).sqrt();
    let xy = m(|v| v.x * v.y) / xx;
    let yy = (1.0 + m(|v| v.y * v.y) - xy * xy).sqrt();
    (0..=POINTS)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(POINTS)).sin_cos();
            (a * xx * cos, a * (xy * cos + yy * sin))
        })
        .collect()
}

/// Draws the modes of fits of a track in the order given, each a panel of the sky of the same scale. `None` without modes.
#[must_use]
pub fn modes(track: &ObservedTrack, modes: &[ModePicture]) -> Option<String> {
    let radii = |mode: &ModePicture| {
        let particles = mode.particles.iter().map(|(x, y)| x.hypot(*y));
        let mut radii: Vec<f64> = particles.chain(track.r_kpc.iter().copied()).collect();
        radii.sort_by(f64::total_cmp);
        // Few distant particles must not shrink the others.
        radii.get(radii.len() * 97 / 100).copied().unwrap_or(1.0)
    };
    let far = 1.08 * modes.iter().map(radii).reduce(f64::max)?;
    let rows = modes.len().div_ceil(COLUMNS);
    let columns = modes.len().min(COLUMNS);
    let width = LEFT + PITCH.0 * columns as f64 - (PITCH.0 - PANEL) + 12.0;
    let mut canvas = Canvas::new(width, TOP + PITCH.1 * rows as f64);
    for (k, mode) in modes.iter().enumerate() {
        let (row, column) = (k / COLUMNS, k % COLUMNS);
        let axes = Axes {
            rect: (
                LEFT + PITCH.0 * column as f64,
                TOP + PITCH.1 * row as f64,
                PANEL,
                PANEL,
            ),
            x: (-far, far),
            y: (-far, far),
        };
        panel(&mut canvas, &axes, track, mode, far);
        axes.frame(&mut canvas);
        let below = k + COLUMNS >= modes.len();
        axes.draw_x(&mut canvas, if below { "*x* [kpc]" } else { "" }, 5, 7.0);
        axes.draw_y(
            &mut canvas,
            if column == 0 { "*y* [kpc]" } else { "" },
            5,
            7.0,
            26.0,
        );
    }
    Some(canvas.finish("Orientation modes on the sky"))
}

fn panel(canvas: &mut Canvas, axes: &Axes, track: &ObservedTrack, mode: &ModePicture, far: f64) {
    let on_sheet = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
        points.iter().map(|(x, y)| axes.at(*x, *y)).collect()
    };
    canvas.clipped(axes.rect, |canvas| {
        for fraction in OUTLINES {
            let ellipse = outline(&mode.halo, fraction * far);
            canvas.line(&on_sheet(&ellipse), GREY, 0.8, "3 2");
        }
        let Vec3 { x, y, .. } = mode.halo.axis * (0.25 * far);
        canvas.line(&on_sheet(&[(-x, -y), (x, y)]), COLOURS[1], 1.2, "");
        for at in on_sheet(&mode.particles) {
            canvas.dot(at, 0.6, COLOURS[5], 0.6, "particle");
        }
        let curve = mode.curve.on_sky(track.bin_width_deg, mode.phi_zero_deg);
        canvas.line(&on_sheet(&curve), COLOURS[0], 1.1, "");
        for at in on_sheet(&data_on_sky(track, mode.phi_zero_deg)) {
            canvas.dot(at, 1.6, INK, 1.0, "sky-datum");
        }
    });
    let sign = |positive: bool| if positive { "+" } else { "\u{2212}" };
    let ModeWeight {
        mode: of,
        probability,
    } = mode.weight;
    let side = if of.prolate { "prolate" } else { "oblate" };
    let (left, top, ..) = axes.rect;
    let lines = [
        format!(
            "{side}, *n*_{{x}} {}, *n*_{{y}} {}",
            sign(of.dir_x_positive),
            sign(of.dir_y_positive)
        ),
        format!(
            "weight {:.3} \u{b1} {:.3}, *q* = {:.2}",
            probability.weight,
            probability.error,
            squared_axis_ratio(mode.halo.flattening).sqrt()
        ),
    ];
    for (k, line) in lines.iter().enumerate() {
        let y = top - 14.0 + 10.0 * k as f64;
        canvas.markup((left, y), line, 8.0, Anchor::Start, 0.0);
    }
}
