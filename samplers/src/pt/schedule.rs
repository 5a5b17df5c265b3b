//! The schedule of inverse temperatures, evenly spaced in the communication barrier.

/// The first schedule, `(k / (n - 1))^3`: fine near the prior, where a deep likelihood changes fastest.
#[must_use]
pub fn first_schedule(n: usize) -> Vec<f64> {
    (0..n)
        .map(|k| (k as f64 / (n.max(2) - 1) as f64).powi(3))
        .collect()
}

/// Communication barrier from beta = 0 to each temperature: the sum of mean swap rejections below it.
#[must_use]
pub fn communication_barrier(rejection: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut communication_barrier = vec![0.0];
    for s in rejection {
        // A pair of temperatures without a rejection still gets a small barrier, so that the communication barrier
        // increases strictly.
        sum += s.max(1e-6);
        communication_barrier.push(sum);
    }
    communication_barrier
}

/// Round trips per scan of one chain set with independent local samples, `1 / (2 + 2 sum s / (1 - s))` (Syed et al.
/// 2022).
#[must_use]
pub fn round_trip_rate(rejection: &[f64]) -> f64 {
    let sum: f64 = rejection.iter().map(|s| s / (1.0 - s)).sum();
    1.0 / (2.0 + 2.0 * sum)
}

/// `n` inverse temperatures evenly spaced in the communication barrier, by the monotone cubic through (communication barrier, beta) pairs.
#[must_use]
pub fn respaced(beta: &[f64], communication_barrier: &[f64], n: usize) -> Vec<f64> {
    let top = communication_barrier[communication_barrier.len() - 1];
    let slopes = monotone_slopes(communication_barrier, beta);
    let mut betas: Vec<f64> = (0..n)
        .map(|k| {
            cubic(
                communication_barrier,
                beta,
                &slopes,
                top * k as f64 / (n - 1) as f64,
            )
        })
        .collect();
    // The ends are exact, without rounding.
    betas[0] = 0.0;
    betas[n - 1] = 1.0;
    betas
}

/// Where `x` lies among rising `knots`: the index of the interval and the fraction of it.
pub(super) fn locate(knots: &[f64], x: f64) -> (usize, f64) {
    let last = knots.len() - 2;
    let i = knots
        .partition_point(|k| *k <= x)
        .saturating_sub(1)
        .min(last);
    let t = (x - knots[i]) / (knots[i + 1] - knots[i]);
    (i, t.clamp(0.0, 1.0))
}

/// Slopes at the knots that keep a cubic Hermite interpolant monotone (Fritsch & Carlson 1980).
fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let secants: Vec<f64> = x
        .windows(2)
        .zip(y.windows(2))
        .map(|(x, y)| (y[1] - y[0]) / (x[1] - x[0]))
        .collect();
    let ends = secants.len() - 1;
    let mut slopes = vec![secants[0]];
    slopes.extend(secants.windows(2).map(|s| 0.5 * (s[0] + s[1])));
    slopes.push(secants[ends]);
    for (i, s) in secants.iter().enumerate() {
        if *s <= 0.0 {
            slopes[i] = 0.0;
            slopes[i + 1] = 0.0;
            continue;
        }
        let (a, b) = (slopes[i] / s, slopes[i + 1] / s);
        let norm = a.hypot(b);
        if norm > 3.0 {
            slopes[i] = 3.0 * a / norm * s;
            slopes[i + 1] = 3.0 * b / norm * s;
        }
    }
    slopes
}

fn cubic(x: &[f64], y: &[f64], slopes: &[f64], at: f64) -> f64 {
    let (i, t) = locate(x, at);
    let h = x[i + 1] - x[i];
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * y[i]
        + (t3 - 2.0 * t2 + t) * h * slopes[i]
        + (3.0 * t2 - 2.0 * t3) * y[i + 1]
        + (t3 - t2) * h * slopes[i + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn respacing_is_monotone_and_inverts_a_known_barrier() {
        // Lambda(beta) = sqrt(beta): even spacing means beta = (k / (n - 1))^2.
        let beta = first_schedule(20);
        let lambda: Vec<f64> = beta.iter().map(|b| b.sqrt()).collect();
        let new = respaced(&beta, &lambda, 9);
        for (k, b) in new.iter().enumerate() {
            assert!((b - (k as f64 / 8.0).powi(2)).abs() < 2e-3, "{k} {b}");
        }
        let rough = respaced(
            &beta,
            &communication_barrier(&[0.0, 0.9, 0.0, 0.99].repeat(5)[..19]),
            40,
        );
        assert!(rough.windows(2).all(|w| w[1] > w[0]), "{rough:?}");
    }

    #[test]
    fn the_rate_of_round_trips_is_that_of_the_toy() {
        // Eight temperatures with rejection 0.43839 each, as on the isotropic Gaussian in 13 dimensions.
        assert!((round_trip_rate(&[0.43839; 7]) - 0.0774).abs() < 1e-4);
    }

    #[test]
    fn positions_are_found_between_knots_and_clamped_outside() {
        let knots = [0.0, 1.0, 3.0];
        assert_eq!(locate(&knots, 2.0), (1, 0.5));
        assert_eq!(locate(&knots, -1.0), (0, 0.0));
        assert_eq!(locate(&knots, 3.0), (1, 1.0));
    }
}
