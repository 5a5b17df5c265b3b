//! The fit overlay: the track against angle with residuals, and on the sky where particles are given.

use super::axes::{Axes, range_of};
use super::canvas::{Anchor, COLOURS, Canvas, INK};
use super::curve::{Band, Curve, legend};
use crate::data::ObservedTrack;

impl Curve {
    /// Of radii, the curve on the sky, (x, y) in kpc, with breaks where no bin is covered.
    #[must_use]
    pub fn on_sky(&self, width_deg: f64, phi_zero_deg: f64) -> Vec<(f64, f64)> {
        let points = self.broken(width_deg).into_iter();
        points
            .map(|(phi, r)| on_sky(phi, r, phi_zero_deg))
            .collect()
    }
}

/// The place on the sky of a radius at the angle phi, if phi = 0 is at the angle `phi_zero_deg` there.
fn on_sky(phi_deg: f64, r_kpc: f64, phi_zero_deg: f64) -> (f64, f64) {
    let (sin, cos) = (phi_deg + phi_zero_deg).to_radians().sin_cos();
    (r_kpc * cos, r_kpc * sin)
}

/// The data on the sky, (x, y) in kpc.
#[must_use]
pub fn data_on_sky(track: &ObservedTrack, phi_zero_deg: f64) -> Vec<(f64, f64)> {
    let bins = track.phi_deg.iter().zip(&track.r_kpc);
    bins.map(|(phi, r)| on_sky(*phi, *r, phi_zero_deg))
        .collect()
}

/// What the overlay shows.
#[derive(Clone, Copy, Debug)]
pub struct FitPicture<'a> {
    /// The data.
    pub track: &'a ObservedTrack,
    /// Radii of equal-weight posterior draws of the model.
    pub draws: &'a [Curve],
    /// Those of the best fit.
    pub best: &'a Curve,
    /// (data - best fit) / error in each row of the data, with the errors of the data that ln L has, without the model's noise; NaN where the best fit covers no bin.
    pub residuals: &'a [f64],
    /// Particles of the best fit on the sky, (x, y) in kpc; without them there is no panel of the sky.
    pub particles: &'a [(f64, f64)],
    /// Angle on the sky of phi = 0 in degrees, which turns `phi` into places there.
    pub phi_zero_deg: f64,
    /// x of the progenitor of the best fit in kpc; it is on the x axis.
    pub progenitor_kpc: f64,
}

impl FitPicture<'_> {
    /// Draws the overlay.
    #[must_use]
    pub fn svg(&self) -> String {
        let sky = !self.particles.is_empty();
        let mut canvas = Canvas::new(if sky { 560.0 } else { 320.0 }, 304.0);
        let track = self.track;
        let half = 0.5 * track.bin_width_deg;
        let x = range_of(
            track.phi_deg.iter().flat_map(|p| [p - half, p + half]),
            0.03,
        );
        let ends = (0..track.len()).flat_map(|i| {
            let r = track.r_kpc[i];
            [
                r - 1.5 * track.r_err_lo_kpc[i],
                r + 1.5 * track.r_err_hi_kpc[i],
            ]
        });
        let top = Axes {
            rect: (46.0, 26.0, 262.0, 160.0),
            x,
            y: range_of(ends, 0.08),
        };
        self.radii(&mut canvas, &top);
        self.residuals(&mut canvas, x);
        if sky {
            self.sky(&mut canvas);
        }
        canvas.finish(&format!("Fit of {}", track.name))
    }

    fn radii(&self, canvas: &mut Canvas, axes: &Axes) {
        let width_deg = self.track.bin_width_deg;
        let band = Band::new(self.draws, width_deg);
        canvas.clipped(axes.rect, |canvas| {
            band.draw(canvas, axes);
            self.best.draw(canvas, axes, width_deg);
            for (i, phi) in self.track.phi_deg.iter().enumerate() {
                let (r, track) = (self.track.r_kpc[i], self.track);
                let ends = [r - track.r_err_lo_kpc[i], r + track.r_err_hi_kpc[i]];
                canvas.line(&ends.map(|end| axes.at(*phi, end)), INK, 0.7, "");
                canvas.dot(axes.at(*phi, r), 1.9, INK, 1.0, "datum");
            }
        });
        axes.frame(canvas);
        axes.draw_x(canvas, "", 7, 8.0);
        axes.draw_y(canvas, "projected radius *r* [kpc]", 6, 8.0, 32.0);
        // The track's name and the legend, above the panels.
        canvas.text((46.0, 9.0), &self.track.name, 8.0, Anchor::Start, 0.0);
        legend(canvas, (46.0, 18.0), !band.is_empty());
    }

    fn residuals(&self, canvas: &mut Canvas, x: (f64, f64)) {
        let residuals = self.residuals.iter().copied();
        let worst = residuals
            .clone()
            .filter(|z| z.is_finite())
            .fold(2.5_f64, |m, z| m.max(z.abs() + 1.2));
        let axes = Axes {
            rect: (46.0, 196.0, 262.0, 72.0),
            x,
            y: (-worst, worst),
        };
        axes.band(canvas, (-2.0, 2.0), 0.12);
        axes.band(canvas, (-1.0, 1.0), 0.18);
        axes.level(canvas, 0.0, COLOURS[0], "");
        canvas.clipped(axes.rect, |canvas| {
            for (phi, z) in self.track.phi_deg.iter().copied().zip(residuals) {
                if z.is_finite() {
                    let bar = [axes.at(phi, z - 1.0), axes.at(phi, z + 1.0)];
                    canvas.line(&bar, INK, 0.7, "");
                    canvas.dot(axes.at(phi, z), 1.9, INK, 1.0, "residual");
                } else {
                    // The best fit does not cover this bin: a cross on the zero line.
                    let at = axes.at(phi, 0.0);
                    canvas.text((at.0, at.1 + 3.0), "\u{d7}", 10.0, Anchor::Middle, 0.0);
                }
            }
        });
        axes.frame(canvas);
        axes.draw_x(canvas, "angle \u{3c6} [deg]", 7, 8.0);
        axes.draw_y(canvas, "(data \u{2212} fit) / \u{3c3}", 5, 8.0, 32.0);
    }

    fn sky(&self, canvas: &mut Canvas) {
        let data = data_on_sky(self.track, self.phi_zero_deg);
        // The axes span the data and the bulk of the particles: few distant ones must not shrink it.
        let mut reach: Vec<f64> = self.particles.iter().map(|p| p.0.hypot(p.1)).collect();
        reach.sort_by(f64::total_cmp);
        let bulk = reach.get(reach.len() * 98 / 100).copied().unwrap_or(0.0);
        let far = self.track.r_kpc.iter().fold(bulk, |m, r| m.max(*r)) * 1.08;
        let axes = Axes {
            rect: (352.0, 26.0, 196.0, 196.0),
            x: (-far, far),
            y: (-far, far),
        };
        canvas.clipped(axes.rect, |canvas| {
            for (x, y) in self.particles {
                canvas.dot(axes.at(*x, *y), 0.6, COLOURS[5], 0.5, "particle");
            }
            let best = self
                .best
                .on_sky(self.track.bin_width_deg, self.phi_zero_deg);
            let best: Vec<_> = best.iter().map(|(x, y)| axes.at(*x, *y)).collect();
            canvas.line(&best, COLOURS[0], 1.2, "");
            let place = axes.at(self.progenitor_kpc, 0.0);
            canvas.dot(place, 3.4, COLOURS[4], 1.0, "progenitor");
            for (x, y) in &data {
                canvas.dot(axes.at(*x, *y), 1.9, INK, 1.0, "sky-datum");
            }
            let centre = axes.at(0.0, 0.0);
            canvas.text((centre.0, centre.1 + 3.5), "+", 10.0, Anchor::Middle, 0.0);
        });
        axes.frame(canvas);
        let (left, y) = (axes.rect.0, 18.0);
        let word = |canvas: &mut Canvas, x: f64, word: &str| {
            canvas.text((x, y + 2.5), word, 7.0, Anchor::Start, 0.0);
        };
        canvas.dot((left + 3.0, y), 3.4, COLOURS[4], 1.0, "legend");
        word(canvas, left + 9.0, "progenitor");
        canvas.dot((left + 59.0, y), 1.2, COLOURS[5], 1.0, "legend");
        word(canvas, left + 64.0, "particles of the best fit");
        axes.draw_x(canvas, "*x* [kpc]", 5, 8.0);
        axes.draw_y(canvas, "*y* [kpc]", 5, 8.0, 30.0);
    }
}
