//! The correction for selection: the fraction of a population's streams that are kept.

use super::cells::Cells;
use super::exponential::add_exponential;
use crate::data::Selection;
use crate::scalar::Real;

/// A selection on the cells of a family's support.
#[derive(Clone, Debug)]
pub(super) struct KeptCells {
    /// Middle of a cell, logarithm of its width, and the fraction that is kept.
    rows: Vec<(f64, f64, f64)>,
    selection: Selection,
}

impl KeptCells {
    /// The selection, which must have passed its check, on a support.
    pub fn new(selection: &Selection, support: (f64, f64)) -> Self {
        let cells = Cells::new(support);
        Self {
            rows: cells
                .iter()
                .map(|(q, ln_width)| (q, ln_width, selection.at(q)))
                .collect(),
            selection: selection.clone(),
        }
    }

    /// The selection itself.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// `ln` of the fraction of a member's streams that are kept, the integral of its density times the fraction at each q. The density is
    /// normalised on the cells, so that a member narrower than a cell has the fraction of that cell.
    pub fn ln_kept<S: Real>(&self, plain: &impl Fn(f64) -> f64, ln_pdf: &impl Fn(f64) -> S) -> S {
        let top = self
            .rows
            .iter()
            .fold(f64::NEG_INFINITY, |top, row| top.max(plain(row.0) + row.1));
        let (mut kept, mut all) = (S::zero(), S::zero());
        for (q, ln_width, fraction) in &self.rows {
            let ln_mass = ln_pdf(*q) + (ln_width - top);
            add_exponential(&mut kept, ln_mass + fraction.ln());
            add_exponential(&mut all, ln_mass);
        }
        kept.ln() - all.ln()
    }

    /// Derivatives of the same by each fraction of the table.
    pub fn slopes(&self, ln_pdf: &impl Fn(f64) -> f64) -> Vec<f64> {
        let terms = self
            .rows
            .iter()
            .map(|(q, ln_width, _)| ln_pdf(*q) + ln_width);
        let top = terms.clone().fold(f64::NEG_INFINITY, f64::max);
        let mut slopes = vec![0.0; self.selection.q.len()];
        let mut kept = 0.0;
        for (term, (q, _, fraction)) in terms.zip(&self.rows) {
            let mass = (term - top).exp();
            let (below, above, part) = self.selection.neighbours(*q);
            slopes[below] += mass * (1.0 - part);
            slopes[above] += mass * part;
            kept += mass * fraction;
        }
        slopes.into_iter().map(|slope| slope / kept).collect()
    }
}
