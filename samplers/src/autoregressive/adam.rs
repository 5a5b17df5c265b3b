//! The optimiser Adam (Kingma & Ba 2015).

/// Averaging factors of the gradients and of their squares, and the guard against division by zero.
const MOMENTS: [f32; 2] = [0.9, 0.999];
const TINY: f32 = 1e-8;

/// The averages of an optimisation.
pub(super) struct Adam {
    /// Means of the gradients and of their squares.
    averages: [Vec<f32>; 2],
    /// What the averages still lack.
    decay: [f32; 2],
}

impl Adam {
    /// Averages at zero, of so many parameters.
    pub fn new(parameters: usize) -> Self {
        Self {
            averages: [vec![0.0; parameters], vec![0.0; parameters]],
            decay: [1.0; 2],
        }
    }

    /// A step of length `rate` up the gradient times `scale`.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], scale: f32, rate: f32) {
        for (decay, moment) in self.decay.iter_mut().zip(MOMENTS) {
            *decay *= moment;
        }
        let decay = self.decay;
        let [means, squares] = &mut self.averages;
        let averages = means.iter_mut().zip(squares);
        for ((p, g), (m, s)) in parameters.iter_mut().zip(gradient).zip(averages) {
            let g = g * scale;
            *m = MOMENTS[0] * *m + (1.0 - MOMENTS[0]) * g;
            *s = MOMENTS[1] * *s + (1.0 - MOMENTS[1]) * g * g;
            let mean = *m / (1.0 - decay[0]);
            *p += rate * mean / ((*s / (1.0 - decay[1])).sqrt() + TINY);
        }
    }
}
