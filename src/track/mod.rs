//! The track: mean projected radius of the particles per bin of phi (docs/physics.md, section 6).

mod grid;
mod quantity;
mod smear;
mod sums;
mod sums_lanes;
mod sums_vjp;

pub use grid::{ANGLES_DEG, BIN_WIDTHS_DEG, BinEdges, BinGrid};
pub use quantity::BinQuantity;
pub use sums::Sums;
pub(crate) use sums::moments;
pub use sums_lanes::PartialSums;

use crate::error::Result;
use crate::params::StreamParams;
use crate::stream::Particles;
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};

/// One bin of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackBin {
    /// Number of the bin: it covers [bin, bin + 1) widths from the lower edge of bin 0, which is at the progenitor or at the offset of the
    /// data's bins.
    pub bin: i64,
    /// phi at the centre of the bin, degrees.
    pub phi_deg: f64,
    /// Mean projected radius, kpc.
    pub r_kpc: f64,
    /// Standard error of the mean for independent particles, kpc.
    pub r_err_kpc: f64,
    /// Sum of the weights: the number of particles, where one in several bins adds a fraction to each.
    pub n: f64,
    /// Number of particles of equal weight whose means are as accurate: fewer than `n` if weights are uneven.
    pub effective_n: f64,
    /// Mean line-of-sight velocity relative to the host, away from the observer, km/s.
    pub v_km_s: f64,
    /// Standard error of the mean for independent particles, km/s.
    pub v_err_km_s: f64,
    /// Standard deviation of the projected radii, kpc.
    pub width_kpc: f64,
    /// Fraction of all particles per degree of phi, times the number of stars of the stream.
    pub density_per_deg: f64,
}

impl TrackBin {
    /// A quantity beside the radius.
    #[must_use]
    pub fn value(&self, quantity: BinQuantity) -> f64 {
        match quantity {
            BinQuantity::Velocity => self.v_km_s,
            BinQuantity::Width => self.width_kpc,
            BinQuantity::Density => self.density_per_deg,
        }
    }

    /// Its standard error for independent particles: of the width, that of the standard deviation of a normal distribution; of the density,
    /// Poisson's.
    #[must_use]
    pub fn error(&self, quantity: BinQuantity) -> f64 {
        match quantity {
            BinQuantity::Velocity => self.v_err_km_s,
            BinQuantity::Width => self.width_kpc / (2.0 * self.effective_n).sqrt(),
            BinQuantity::Density => self.density_per_deg / self.effective_n.sqrt(),
        }
    }
}

/// The track of a model: the bins with particles in them, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Bin width in degrees.
    pub width_deg: f64,
    /// The bins.
    pub bins: Vec<TrackBin>,
}

/// Largest number of bins to each side that a smeared particle or a soft edge reaches.
fn bins_within_reach(width_deg: f64) -> i64 {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a width above a millionth of a degree"
    )]
    let bins = (smear::MAX_REACH_DEG / width_deg).ceil() as i64;
    bins + 1
}

/// Smallest weight of a bin of [`Particles::track`] over the number of particles: that of mock tracks (docs/physics.md, section 11).
const MIN_FRACTION: f64 = 0.01;

impl Particles {
    /// The track in bins of `width_deg` degrees with the default edges: every bin with a weight of at least 1 % of the particles.
    ///
    /// # Errors
    /// Those of [`Track::new`].
    pub fn track(&self, width_deg: f64) -> Result<Track> {
        let min_n = MIN_FRACTION * self.len() as f64;
        Track::new(self, width_deg, BinEdges::default(), min_n)
    }
}

impl Track {
    /// The track of particles, every bin within [`ANGLES_DEG`] with a weight of at least `min_n`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) if the width is outside of [`BIN_WIDTHS_DEG`]; those of [`BinEdges::check`].
    pub fn new(particles: &Particles, width_deg: f64, edges: BinEdges, min_n: f64) -> Result<Self> {
        in_range("width_deg", width_deg, BIN_WIDTHS_DEG)?;
        edges.check("half_width_deg", width_deg)?;
        Ok(Self::from_checked(particles, width_deg, 0.0, edges, min_n))
    }

    /// The track as it is measured with these parameters of the observation: at angles from `phi0_deg`, with radii converted by the distance
    /// over `distance_factor`, in a host that moves away from the observer with `v_host_km_s`, of a stream of 10 to the `log10_n_stars` stars.
    #[must_use]
    pub fn measured_with(mut self, params: &StreamParams<f64>) -> Self {
        let StreamParams {
            phi0_deg,
            distance_factor,
            v_host_km_s,
            log10_n_stars,
            ..
        } = *params;
        for bin in &mut self.bins {
            bin.phi_deg += phi0_deg;
            bin.r_kpc /= distance_factor;
            bin.r_err_kpc /= distance_factor;
            bin.width_kpc /= distance_factor;
            bin.v_km_s += v_host_km_s;
            bin.density_per_deg *= 10.0_f64.powf(log10_n_stars);
        }
        self
    }

    /// As [`new`](Self::new), with a width, an offset and edges that have been checked.
    pub(crate) fn from_checked(
        particles: &Particles,
        width_deg: f64,
        offset_deg: f64,
        edges: BinEdges,
        min_n: f64,
    ) -> Self {
        let last = (ANGLES_DEG.end() / width_deg).floor();
        let bin_of = |i: usize| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "clamped to the angles that a bin may have"
            )]
            let bin = ((particles.angle(i).to_degrees() - offset_deg) / width_deg)
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
        // A smeared particle reaches bins beyond the outermost angles.
        let beyond = bins_within_reach(width_deg);
        let first = lo - beyond;
        let len = usize::try_from(hi - lo + 1 + 2 * beyond).unwrap_or(0);
        let grid = BinGrid {
            width_deg,
            offset_deg,
            first,
            len,
            edges,
        };
        let mut sums = Sums::default();
        grid.sum(particles, &mut sums, &mut PartialSums::default());
        grid.sum_velocities(particles, &mut sums);
        let unevenness = sums.mean_square_weight;
        let bins = (0..len)
            .filter(|&i| sums.weight[i] > 0.0 && sums.weight[i] >= min_n)
            .map(|i| {
                let n = sums.weight[i];
                let effective_n = n / unevenness;
                let (mean, variance) = moments(n, sums.r[i], sums.r2[i]);
                let (v_km_s, variance_of_v) = moments(n, sums.v[i], sums.v2[i]);
                #[allow(
                    clippy::cast_possible_wrap,
                    reason = "an index below the number of bins"
                )]
                let bin = first + i as i64;
                TrackBin {
                    bin,
                    phi_deg: grid.centre_deg(bin),
                    r_kpc: mean,
                    r_err_kpc: (variance / effective_n).sqrt(),
                    n,
                    effective_n,
                    v_km_s,
                    v_err_km_s: (variance_of_v / effective_n).sqrt(),
                    width_kpc: variance.sqrt(),
                    density_per_deg: n / (particles.len() as f64 * width_deg),
                }
            })
            .collect();
        Self { width_deg, bins }
    }
}
