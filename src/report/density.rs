//! Histograms and credible regions of weighted draws.

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

/// Smoothed density on an `n x n` grid, row by row (y slow), and its iso-levels that enclose 95 % and 68 %.
#[derive(Clone, Debug)]
pub struct Density2 {
    n: usize,
    grid: Vec<f64>,
    /// Level around 95 %, then around 68 %.
    pub levels: [f64; 2],
}

/// A region of the plane as closed rings, holes among them, in cells of the grid.
pub type Rings = Vec<Vec<(f64, f64)>>;

impl Density2 {
    /// The density of weighted points, smoothed by a Gaussian of 1.2 grid cells, which widens contours by a few per cent and
    /// suppresses the noise of the draws.
    #[must_use]
    pub fn new(x: &[f64], y: &[f64], weights: &[f64], ranges: [(f64, f64); 2], n: usize) -> Self {
        let mut grid = vec![0.0; n * n];
        for ((x, y), w) in x.iter().zip(y).zip(weights) {
            if let (Some(i), Some(j)) = (cell_of(*x, ranges[0], n), cell_of(*y, ranges[1], n)) {
                grid[j * n + i] += w;
            }
        }
        let grid = smooth(&smooth(&grid, n, 1), n, n);
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
            grid,
        }
    }

    /// The regions above both levels, in units of the grid: cell (i, j) has its centre at (i + 1/2, j + 1/2).
    #[must_use]
    pub fn regions(&self) -> [Rings; 2] {
        let found = ContourBuilder::new(self.n, self.n, true).contours(&self.grid, &self.levels);
        let mut regions = [Vec::new(), Vec::new()];
        for (region, contour) in regions.iter_mut().zip(found.into_iter().flatten()) {
            for polygon in contour.geometry() {
                for ring in std::iter::once(polygon.exterior()).chain(polygon.interiors()) {
                    region.push(ring.coords().map(|c| (c.x, c.y)).collect());
                }
            }
        }
        regions
    }
}

/// One pass of a Gaussian of standard deviation 1.2 cells along the axis of `stride`, mass kept at the edges.
fn smooth(grid: &[f64], n: usize, stride: usize) -> Vec<f64> {
    const SD: f64 = 1.2;
    const REACH: i64 = 4;
    let kernel: Vec<f64> = (-REACH..=REACH)
        .map(|k| (-0.5 * (k as f64 / SD).powi(2)).exp())
        .collect();
    let other = if stride == 1 { n } else { 1 };
    let mut out = vec![0.0; grid.len()];
    for line in 0..n {
        for at in 0..n {
            let reach: Vec<(usize, f64)> = (-REACH..=REACH)
                .zip(&kernel)
                .filter_map(|(k, w)| {
                    let to = usize::try_from(i64::try_from(at).ok()? + k).ok()?;
                    (to < n).then_some((to, *w))
                })
                .collect();
            let total: f64 = reach.iter().map(|r| r.1).sum();
            for (to, w) in reach {
                out[line * other + to * stride] += grid[line * other + at * stride] * w / total;
            }
        }
    }
    out
}
