//! Velocities, widths or densities of a track: the data, and those of the models along it.

use super::axes::{Axes, range_of};
use super::canvas::{Anchor, Canvas, INK};
use super::curve::{Band, Curve, legend};
use crate::data::{Measured, ObservedTrack};
use crate::track::BinQuantity;

/// What the figure shows.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredPicture<'a> {
    /// The data.
    pub track: &'a ObservedTrack,
    /// Which of its quantities.
    pub quantity: BinQuantity,
    /// Equal-weight posterior draws of the model.
    pub draws: &'a [Curve],
    /// The best fit.
    pub best: &'a Curve,
}

impl MeasuredPicture<'_> {
    /// Draws the figure; `None` if the track has no such data.
    #[must_use]
    pub fn svg(&self) -> Option<String> {
        let track = self.track;
        let rows = track.measured.get(&self.quantity);
        let in_bins = (track.phi_deg.iter().zip(rows.into_iter().flatten()))
            .filter_map(|(phi, measured)| Some((*phi, (*measured)?)));
        let is_velocity = self.quantity == BinQuantity::Velocity;
        let of_stars = (track.stars.iter())
            .filter(|_| is_velocity)
            .map(|star| (star.phi_deg, star.v_km_s));
        // Means in bins have full dots, single stars small ones.
        let data: Vec<(f64, Measured, f64)> = (in_bins.map(|(phi, m)| (phi, m, 1.9)))
            .chain(of_stars.map(|(phi, m)| (phi, m, 1.0)))
            .collect();
        if data.is_empty() {
            return None;
        }
        let mut canvas = Canvas::new(320.0, 224.0);
        let width_deg = track.bin_width_deg;
        let band = Band::new(self.draws, width_deg);
        let ends = data
            .iter()
            .flat_map(|(_, m, _)| [m.value - 1.5 * m.error, m.value + 1.5 * m.error]);
        let half = 0.5 * width_deg;
        let phi = track.phi_deg.iter().flat_map(|p| [p - half, p + half]);
        let axes = Axes {
            rect: (46.0, 26.0, 262.0, 160.0),
            x: range_of(phi, 0.03),
            y: range_of(ends.chain(band.ends()), 0.08),
        };
        canvas.clipped(axes.rect, |canvas| {
            band.draw(canvas, &axes);
            self.best.draw(canvas, &axes, width_deg);
            for (phi, m, radius) in &data {
                let bar = [m.value - m.error, m.value + m.error].map(|end| axes.at(*phi, end));
                canvas.line(&bar, INK, 0.7, "");
                canvas.dot(axes.at(*phi, m.value), *radius, INK, 1.0, "datum");
            }
        });
        axes.frame(&mut canvas);
        axes.draw_x(&mut canvas, "angle \u{3c6} [deg]", 7, 8.0);
        let label = match self.quantity {
            BinQuantity::Velocity => "line-of-sight velocity [km s^{\u{2212}1}]",
            BinQuantity::Width => "standard deviation of *r* [kpc]",
            BinQuantity::Density => "density [stars deg^{\u{2212}1}]",
        };
        axes.draw_y(&mut canvas, label, 6, 8.0, 32.0);
        canvas.text((46.0, 9.0), &track.name, 8.0, Anchor::Start, 0.0);
        legend(&mut canvas, (46.0, 18.0), !band.is_empty());
        Some(canvas.finish(&format!("Fit of {}", track.name)))
    }
}
