//! Whether the minor axes of haloes are aligned with a direction (docs/physics.md, section 10).
//!
//! The prior of one axis is isotropic, so that the cosine of its angle with any direction is uniform between 0 and 1, as an axis has no sign. A population has one or two hyperparameters, which are integrated on a grid.

use crate::error::{Error, PosteriorFault, Result};
use crate::posterior::Interval;
use serde::Serialize;

/// The posterior of the cosine of the angle between the minor axis of one stream's halo and a direction.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisPosterior {
    /// The stream's name.
    pub name: String,
    /// The cosines of each draw, from 0 to 1: one, or several that are equally probable.
    pub cosines: Vec<Vec<f64>>,
    /// The weights of draws.
    pub weights: Vec<f64>,
    /// The number of independent draws that they are worth.
    pub effective_size: f64,
    /// Whether the fit has converged.
    pub converged: bool,
}

/// How the axes of a population lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// In all directions alike.
    Isotropic,
    /// All about the direction, within an angle.
    Aligned,
    /// A fraction of them about the direction, the others in all directions alike.
    Mixture,
}

/// A population of axes, compared with isotropic ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlignmentEvidence {
    /// How the axes lie.
    pub alignment: Alignment,
    /// ln Z less that of isotropic axes.
    pub ln_odds: f64,
    /// The standard error of this by the number of draws, at the hyperparameters of the largest likelihood.
    pub error: f64,
    /// The scale of the angles of those that are aligned, degrees.
    pub scale_deg: Option<Interval>,
    /// The fraction that is aligned.
    pub fraction: Option<Interval>,
}

/// The range of the scale, over which its prior is uniform, degrees. Axes within 60 degrees are nearly isotropic.
const SCALES_DEG: (f64, f64) = (5.0, 60.0);

/// Numbers of cells of the grid over the scale and over the fraction.
const SCALE_CELLS: usize = 110;
const FRACTION_CELLS: usize = 100;

/// Numbers of cells for the normalisation of a density over the cosine.
const COSINE_CELLS: usize = 2_000;

/// The middle of a cell.
fn middle((lo, hi): (f64, f64), cells: usize, cell: usize) -> f64 {
    lo + (hi - lo) * (cell as f64 + 0.5) / cells as f64
}

/// The density of the cosine mu of the angle of aligned axes: proportional to `exp(-(1 - mu^2) / (2 scale^2))`, the distribution of
/// Watson (1965).
struct Aligned {
    concentration: f64,
    normalisation: f64,
}

impl Aligned {
    fn new(scale_deg: f64) -> Self {
        let concentration = 0.5 / scale_deg.to_radians().powi(2);
        let total: f64 = (0..COSINE_CELLS)
            .map(|cell| middle((0.0, 1.0), COSINE_CELLS, cell))
            .map(|mu| (-concentration * (1.0 - mu * mu)).exp())
            .sum();
        Self {
            concentration,
            normalisation: COSINE_CELLS as f64 / total,
        }
    }

    fn density(&self, mu: f64) -> f64 {
        self.normalisation * (-self.concentration * (1.0 - mu * mu)).exp()
    }
}

/// The likelihood of one stream in a population over that in an isotropic one, and its relative variance by the number of draws.
#[derive(Clone, Copy)]
struct Ratio {
    value: f64,
    variance: f64,
}

impl Ratio {
    /// With aligned axes.
    fn aligned(stream: &AxisPosterior, population: &Aligned) -> Self {
        let (mut total, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for (cosines, weight) in stream.cosines.iter().zip(&stream.weights) {
            let densities = cosines.iter().map(|mu| population.density(*mu));
            let density = densities.sum::<f64>() / cosines.len() as f64;
            total += weight;
            sum += weight * density;
            squares += weight * density * density;
        }
        let value = sum / total;
        Self {
            value,
            variance: (squares / total / (value * value) - 1.0).max(0.0) / stream.effective_size,
        }
    }

    /// With a fraction of aligned axes.
    fn mixed(self, fraction: f64) -> Self {
        let value = fraction * self.value + 1.0 - fraction;
        let share = fraction * self.value / value;
        Self {
            value,
            variance: self.variance * share * share,
        }
    }
}

/// One point of a grid over hyperparameters.
struct GridPoint {
    scale_deg: f64,
    fraction: f64,
    ln_likelihood: f64,
    variance: f64,
}

impl GridPoint {
    fn new(scale_deg: f64, fraction: f64, ratios: impl Iterator<Item = Ratio>) -> Self {
        let (ln_likelihood, variance) = ratios.fold((0.0, 0.0), |(sum, variance), ratio| {
            (sum + ratio.value.ln(), variance + ratio.variance)
        });
        Self {
            scale_deg,
            fraction,
            ln_likelihood,
            variance,
        }
    }
}

/// The evidence of each way in which the axes of streams may lie, isotropic first.
///
/// # Errors
/// [`Error::Posterior`] for a stream without draws.
pub fn alignments(streams: &[AxisPosterior]) -> Result<Vec<AlignmentEvidence>> {
    let is_empty = |stream: &&AxisPosterior| {
        stream.cosines.is_empty() || stream.cosines.iter().any(Vec::is_empty)
    };
    if let Some(empty) = streams.iter().find(is_empty) {
        return Err(Error::Posterior {
            name: empty.name.clone(),
            fault: PosteriorFault::NoDraws,
        });
    }
    let mut aligned = Vec::with_capacity(SCALE_CELLS);
    let mut mixture = Vec::with_capacity(SCALE_CELLS * FRACTION_CELLS);
    for cell in 0..SCALE_CELLS {
        let scale_deg = middle(SCALES_DEG, SCALE_CELLS, cell);
        let population = Aligned::new(scale_deg);
        let ratios: Vec<Ratio> = (streams.iter())
            .map(|stream| Ratio::aligned(stream, &population))
            .collect();
        aligned.push(GridPoint::new(scale_deg, 1.0, ratios.iter().copied()));
        for cell in 0..FRACTION_CELLS {
            let fraction = middle((0.0, 1.0), FRACTION_CELLS, cell);
            let mixed = ratios.iter().map(|ratio| ratio.mixed(fraction));
            mixture.push(GridPoint::new(scale_deg, fraction, mixed));
        }
    }
    let isotropic = AlignmentEvidence {
        alignment: Alignment::Isotropic,
        ln_odds: 0.0,
        error: 0.0,
        scale_deg: None,
        fraction: None,
    };
    Ok(vec![
        isotropic,
        evidence(Alignment::Aligned, &aligned),
        evidence(Alignment::Mixture, &mixture),
    ])
}

/// The evidence of a population from its likelihood on a grid of equal prior weights.
fn evidence(alignment: Alignment, grid: &[GridPoint]) -> AlignmentEvidence {
    let best = (grid.iter())
        .max_by(|a, b| a.ln_likelihood.total_cmp(&b.ln_likelihood))
        .map_or((0.0, 0.0), |point| (point.ln_likelihood, point.variance));
    let weights: Vec<f64> = (grid.iter())
        .map(|point| (point.ln_likelihood - best.0).exp())
        .collect();
    let interval = |of: fn(&GridPoint) -> f64, unit: &str| {
        let values: Vec<f64> = grid.iter().map(of).collect();
        Interval::new(&values, &weights, unit)
    };
    let is_mixture = alignment == Alignment::Mixture;
    AlignmentEvidence {
        alignment,
        ln_odds: best.0 + (weights.iter().sum::<f64>() / grid.len() as f64).ln(),
        error: best.1.sqrt(),
        scale_deg: Some(interval(|point| point.scale_deg, "deg")),
        fraction: is_mixture.then(|| interval(|point| point.fraction, "")),
    }
}

impl AxisPosterior {
    /// The angle between axis and direction, degrees.
    #[must_use]
    pub fn angle_deg(&self) -> Interval {
        let (mut angles, mut weights) = (Vec::new(), Vec::new());
        for (cosines, weight) in self.cosines.iter().zip(&self.weights) {
            angles.extend(cosines.iter().map(|mu| mu.acos().to_degrees()));
            let share = weight / cosines.len() as f64;
            weights.extend(cosines.iter().map(|_| share));
        }
        Interval::new(&angles, &weights, "deg")
    }
}
