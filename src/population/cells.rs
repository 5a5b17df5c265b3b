//! The support of q divided into cells, over which a member of a family is integrated.

/// Cells of equal width; a multiple of the cells of a histogram.
const EQUAL: u32 = 400;

/// How often the first and the last of them are halved towards the end of the support, where the density of a beta distribution may be infinite.
const HALVINGS: i32 = 40;

/// The cells, from the lowest up.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    /// Their edges, one more than cells.
    edges: Vec<f64>,
}

/// The width of the widest cells of a support: a member that is narrower may lie between the middles of two.
pub(super) fn widest((lo, hi): (f64, f64)) -> f64 {
    (hi - lo) / f64::from(EQUAL)
}

impl Cells {
    /// The cells of a support `(q_min, q_max)`.
    pub fn new((lo, hi): (f64, f64)) -> Self {
        let width = widest((lo, hi));
        let mut edges = vec![lo];
        edges.extend((1..=HALVINGS).rev().map(|k| lo + width * 0.5_f64.powi(k)));
        edges.extend((1..EQUAL).map(|i| lo + width * f64::from(i)));
        edges.extend((1..=HALVINGS).map(|k| hi - width * 0.5_f64.powi(k)));
        edges.push(hi);
        // Where halves fall below the rounding of q there is nothing between two edges.
        edges.dedup();
        Self { edges }
    }

    /// The middle and the logarithm of the width of every cell.
    pub fn iter(&self) -> impl Iterator<Item = (f64, f64)> {
        self.edges.windows(2).map(|edge| {
            let width = edge[1] - edge[0];
            (edge[0] + 0.5 * width, width.ln())
        })
    }

    /// The value of q at which `cumulative`, the masses of the cells added up, reaches the fraction `u` of its end.
    pub fn quantile(&self, cumulative: &[f64], u: f64) -> f64 {
        let Some(total) = cumulative.last() else {
            return f64::NAN;
        };
        let aim = u * total;
        let cell = cumulative.partition_point(|sum| *sum < aim);
        let cell = cell.min(cumulative.len() - 1);
        let below = if cell > 0 { cumulative[cell - 1] } else { 0.0 };
        let part = (aim - below) / (cumulative[cell] - below);
        let (lo, hi) = (self.edges[cell], self.edges[cell + 1]);
        lo + (hi - lo) * part.clamp(0.0, 1.0)
    }
}
