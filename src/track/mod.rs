//! From particles to one mean radius per angle from the progenitor.

mod grid;
mod smear;
mod sums;
mod sums_lanes;
mod sums_vjp;

pub use grid::{ANGLES_DEG, BIN_WIDTHS_DEG, BinEdges, BinGrid};
pub use sums::Sums;
pub use sums_lanes::PartialSums;

use crate::error::Result;
use crate::stream::Particles;
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};

/// One bin of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackBin {
    /// Number of the bin: it covers [bin, bin + 1) widths.
    pub bin: i64,
    /// Middle of the bin, degrees from the progenitor.
    pub phi_deg: f64,
    /// Mean projected radius, kpc.
    pub r_kpc: f64,
    /// Standard error of the mean for independent particles, kpc.
    pub r_err_kpc: f64,
    /// Sum of the weights: the number of particles, those shared by two bins counted in parts.
    pub n: f64,
}

/// A whole track: the bins with particles in them, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Bin width in degrees.
    pub width_deg: f64,
    /// The bins.
    pub bins: Vec<TrackBin>,
}

/// Bins that a smeared particle or a soft edge reaches to each side, at most.
fn bins_within_reach(width_deg: f64) -> i64 {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a width above a millionth of a degree"
    )]
    let bins = (smear::MAX_REACH_DEG / width_deg).ceil() as i64;
    bins + 1
}

/// Weight of a bin of [`Particles::track`], as a fraction of all particles: the paper's threshold for mock tracks.
const MIN_FRACTION: f64 = 0.01;

impl Particles {
    /// The track in bins of `width_deg` degrees with the default edges: every bin that holds at least 1 % of the particles.
    ///
    /// # Errors
    /// As of [`Track::of`].
    pub fn track(&self, width_deg: f64) -> Result<Track> {
        let min_n = MIN_FRACTION * self.len() as f64;
        Track::of(self, width_deg, BinEdges::default(), min_n)
    }
}

impl Track {
    /// The track of particles, every bin within [`ANGLES_DEG`] with a weight of at least `min_n`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) if the width is not one of [`BIN_WIDTHS_DEG`]; as of [`BinEdges::check`].
    pub fn of(particles: &Particles, width_deg: f64, edges: BinEdges, min_n: f64) -> Result<Self> {
        in_range("width_deg", width_deg, BIN_WIDTHS_DEG)?;
        edges.check("half_width_deg", width_deg)?;
        Ok(Self::binned(particles, width_deg, edges, min_n))
    }

    /// As [`of`](Self::of), with a width and edges that were checked before.
    pub(crate) fn binned(
        particles: &Particles,
        width_deg: f64,
        edges: BinEdges,
        min_n: f64,
    ) -> Self {
        let last = (ANGLES_DEG.end() / width_deg).floor();
        let bin_of = |i: usize| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "clamped to the angles that a bin may have"
            )]
            let bin = (particles.angle(i).to_degrees() / width_deg)
                .floor()
                .clamp(-last, last - 1.0) as i64;
            bin
        };
        let numbers = (0..particles.len()).map(bin_of);
        let (lo, hi) = numbers.fold((i64::MAX, i64::MIN), |(lo, hi), b| (lo.min(b), hi.max(b)));
        if lo > hi {
            return Self {
                width_deg,
                bins: Vec::new(),
            };
        }
        // More bins at each end, as far as a smeared particle reaches.
        let beyond = bins_within_reach(width_deg);
        let first = lo - beyond;
        let len = usize::try_from(hi - lo + 1 + 2 * beyond).unwrap_or(0);
        let grid = BinGrid {
            width_deg,
            first,
            len,
            edges,
        };
        let mut sums = Sums::default();
        grid.sum(particles, &mut sums, &mut PartialSums::default());
        let bins = (0..len)
            .filter(|&i| sums.weight[i] > 0.0 && sums.weight[i] >= min_n)
            .map(|i| {
                let n = sums.weight[i];
                let mean = sums.r[i] / n;
                let variance = (sums.r2[i] / n - mean * mean).max(0.0);
                #[allow(
                    clippy::cast_possible_wrap,
                    reason = "an index below the number of bins"
                )]
                let bin = first + i as i64;
                TrackBin {
                    bin,
                    phi_deg: (bin as f64 + 0.5) * width_deg,
                    r_kpc: mean,
                    r_err_kpc: (variance / n).sqrt(),
                    n,
                }
            })
            .collect();
        Self { width_deg, bins }
    }
}
