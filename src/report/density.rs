//! Histograms, kernel densities and credible regions of weighted draws. Kernels are as wide as the effective number of draws needs.

use contour::ContourBuilder;

/// Weighted counts in equal cells of a range, as a density that integrates to the weight inside.
#[must_use]
pub fn histogram(values: &[f64], weights: &[f64], range: (f64, f64), cells: usize) -> Vec<f64> {
    let mut counts = vec![0.0; cells];
    let width = (range.1 - range.0) / cells as f64;
    let total: f64 = weights.iter().sum();
    for (v, w) in values.iter().zip(weights) {
        if let Some(cell) = cell_of(*v, range, cells) {
            counts[cell] += w / (width * total);
        }
    }
    counts
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the product lies in [0, cells)"
)]
fn cell_of(value: f64, range: (f64, f64), cells: usize) -> Option<usize> {
    let u = (value - range.0) / (range.1 - range.0);
    (0.0..1.0)
        .contains(&u)
        .then(|| ((u * cells as f64) as usize).min(cells - 1))
}

/// Cells of a kernel density.
const CELLS: usize = 256;

/// A weighted column with the width of its distribution, by which kernels are scaled.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// Standard deviation, or what a normal of the same shortest half has, if that is less: of several modes the width of the highest.
    sd: f64,
    /// Effective number of draws.
    ess: f64,
    /// Smallest and largest value.
    ends: (f64, f64),
}

impl Spread {
    /// Of values with weights, as many as `ess` independent ones.
    #[must_use]
    pub fn new(values: &[f64], weights: &[f64], ess: f64) -> Self {
        let total: f64 = weights.iter().sum();
        let weighted = || values.iter().zip(weights);
        let mean = weighted().map(|(v, w)| v * w).sum::<f64>() / total;
        let variance = weighted().map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>() / total;
        let ends = (values.iter()).fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
            (lo.min(*v), hi.max(*v))
        });
        /// Width of the central half of a standard normal.
        const HALF_OF_NORMAL: f64 = 1.349;
        let half = shortest_half(values, weights, 0.5 * total) / HALF_OF_NORMAL;
        let sd = variance.sqrt();
        Self {
            sd: if half > 0.0 { sd.min(half) } else { sd },
            ess: ess.max(1.0),
            ends,
        }
    }

    /// Standard deviation of the kernel of a density of so many dimensions (Silverman 1986).
    fn kernel(&self, dimensions: u8) -> f64 {
        0.9 * self.sd * self.ess.powf(-1.0 / f64::from(dimensions + 4))
    }

    /// The part of a range where the values lie: a density does not go on beyond a bound of the prior.
    fn inside(&self, range: (f64, f64)) -> (f64, f64) {
        (range.0.max(self.ends.0), range.1.min(self.ends.1))
    }
}

/// Width of the shortest interval with so much weight.
fn shortest_half(values: &[f64], weights: &[f64], weight: f64) -> f64 {
    let mut sorted: Vec<(f64, f64)> = values
        .iter()
        .copied()
        .zip(weights.iter().copied())
        .collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut shortest, mut first, mut inside) = (f64::INFINITY, 0, 0.0);
    for (k, (value, w)) in sorted.iter().enumerate() {
        inside += w;
        while first < k && inside - sorted[first].1 >= weight {
            inside -= sorted[first].1;
            first += 1;
        }
        if inside >= weight {
            shortest = shortest.min(value - sorted[first].0);
        }
    }
    shortest
}

/// The kernel density of weighted values in a range, as points (value, density); no points if all values are equal or none is in the range.
#[must_use]
pub fn kernel_density(
    values: &[f64],
    weights: &[f64],
    spread: &Spread,
    range: (f64, f64),
) -> Vec<(f64, f64)> {
    let range = spread.inside(range);
    if range.1 <= range.0 {
        return Vec::new();
    }
    let cell = (range.1 - range.0) / CELLS as f64;
    let counts = histogram(values, weights, range, CELLS);
    let density = smooth(&counts, CELLS, 1, spread.kernel(1) / cell);
    let centre = |i: usize| range.0 + (i as f64 + 0.5) * cell;
    let points = density.iter().enumerate().map(|(i, d)| (centre(i), *d));
    // From end to end of the range, where the density may end above zero.
    let first = density.first().map(|d| (range.0, *d));
    let last = density.last().map(|d| (range.1, *d));
    first.into_iter().chain(points).chain(last).collect()
}

/// Smoothed density on an `n x n` grid, row by row (y slow), and its iso-levels that enclose 95 % and 68 %.
#[derive(Clone, Debug)]
pub struct Density2 {
    n: usize,
    grid: Vec<f64>,
    /// Range of the grid in x and y.
    ranges: [(f64, f64); 2],
    /// Level around 95 %, then around 68 %.
    pub levels: [f64; 2],
}

/// A region of the plane as closed rings, holes among them, in the units of the columns.
pub type Rings = Vec<Vec<(f64, f64)>>;

impl Density2 {
    /// The kernel density of weighted points in the part of the ranges where they lie.
    #[must_use]
    pub fn new(
        columns: [&[f64]; 2],
        weights: &[f64],
        spreads: [&Spread; 2],
        ranges: [(f64, f64); 2],
        n: usize,
    ) -> Self {
        let ranges = [0, 1].map(|k| spreads[k].inside(ranges[k]));
        let mut grid = vec![0.0; n * n];
        for ((x, y), w) in columns[0].iter().zip(columns[1]).zip(weights) {
            if let (Some(i), Some(j)) = (cell_of(*x, ranges[0], n), cell_of(*y, ranges[1], n)) {
                grid[j * n + i] += w;
            }
        }
        let kernel = [0, 1].map(|k| {
            let cell = (ranges[k].1 - ranges[k].0) / n as f64;
            // Not narrower than the grid can show.
            (spreads[k].kernel(2) / cell).max(0.7)
        });
        let grid = smooth(&smooth(&grid, n, 1, kernel[0]), n, n, kernel[1]);
        let mut sorted = grid.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let total: f64 = sorted.iter().sum();
        let level = |fraction: f64| {
            let mut sum = 0.0;
            for g in &sorted {
                sum += g;
                if sum >= fraction * total {
                    return *g;
                }
            }
            0.0
        };
        Self {
            n,
            levels: [level(0.95), level(0.68)],
            ranges,
            grid,
        }
    }

    /// The regions above both levels.
    #[must_use]
    pub fn regions(&self) -> [Rings; 2] {
        let found = ContourBuilder::new(self.n, self.n, true).contours(&self.grid, &self.levels);
        let at =
            |cells: f64, range: (f64, f64)| range.0 + (range.1 - range.0) * cells / self.n as f64;
        let mut regions = [Vec::new(), Vec::new()];
        for (region, contour) in regions.iter_mut().zip(found.into_iter().flatten()) {
            for polygon in contour.geometry() {
                for ring in std::iter::once(polygon.exterior()).chain(polygon.interiors()) {
                    let coords = ring.coords();
                    let points = coords.map(|c| (at(c.x, self.ranges[0]), at(c.y, self.ranges[1])));
                    region.push(points.collect());
                }
            }
        }
        regions
    }
}

/// One pass of a Gaussian of a standard deviation in cells along the axis of `stride`, in lines of `n` cells. What would leave a line is
/// reflected at its end, so that a uniform density stays one.
fn smooth(grid: &[f64], n: usize, stride: usize, sd: f64) -> Vec<f64> {
    let sd = sd.min(0.25 * n as f64);
    if sd.is_nan() || sd <= 0.0 {
        return grid.to_vec();
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most four times a quarter of the number of cells"
    )]
    let reach = (4.0 * sd).floor() as usize;
    let weights: Vec<f64> = (0..=2 * reach)
        .map(|k| (-0.5 * ((k as f64 - reach as f64) / sd).powi(2)).exp())
        .collect();
    let total: f64 = weights.iter().sum();
    // The cell `k` of the kernel about the cell `at`: `reach` is at most `n`, so that one reflection brings it into the line.
    let reflected = |at: usize, k: usize| {
        let shifted = at + k;
        if shifted < reach {
            reach - shifted - 1
        } else {
            (shifted - reach).min(2 * n - 1 - (shifted - reach))
        }
    };
    let mut out = vec![0.0; grid.len()];
    let other = if stride == 1 { n } else { 1 };
    for line in 0..grid.len() / n {
        for at in 0..n {
            let value = grid[line * other + at * stride] / total;
            for (k, w) in weights.iter().enumerate() {
                out[line * other + reflected(at, k) * stride] += value * w;
            }
        }
    }
    out
}
