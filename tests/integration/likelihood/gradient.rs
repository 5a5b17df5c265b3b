//! The gradient against central differences in three coordinate systems, and the exact symmetry.

use super::*;

#[test]
fn the_gradient_matches_central_differences_in_theta_u_and_z() {
    let model = model(small());
    let settings = LikelihoodSettings::default();
    let prior = prior();
    let check = |n: u64| -> Option<bool> {
        let (z, theta) = draw(n);
        let likelihood = likelihood_at(&theta, &model, &settings)?;
        let (_, by_theta) = likelihood.gradient(&theta).ok()?;
        if rounding(&likelihood, &theta)
            > 1e-9
                * likelihood
                    .ln_likelihood(&theta)
                    .map_or(0.0, |e| e.ln_likelihood.abs().max(1.0))
        {
            return None;
        }
        let value = |theta: &Theta| {
            likelihood
                .ln_likelihood(theta)
                .map_or(f64::NAN, |e| e.ln_likelihood)
        };
        let scale = largest(&in_z(&z, &by_theta));
        let mut converged = 0;
        for i in 0..REQUIRED {
            let marginal = prior.marginals()[i];
            let slope = marginal.dtheta_dz(z[i]);
            let du_dz = oblate_samplers::normal::ln_pdf(z[i]).exp();
            let u = marginal.u_from_theta(theta[i]);
            let at = |value_i: f64| {
                let mut t = theta;
                t[i] = value_i;
                value(&t)
            };
            // One derivative, in three coordinates, all in units of z.
            let h = 1e-3;
            let by_z = by_theta[i] * slope;
            let numeric = [
                central(|d| at(theta[i] + d), h * slope),
                central(|d| at(marginal.theta_from_z(z[i] + d)), h),
                central(|d| at(marginal.theta_from_u(u + d)), h * du_dz),
            ];
            for ((d, moved), unit) in numeric.into_iter().zip([slope, 1.0, du_dz]) {
                // Where particles meet a centre in steps too long for it, ln L is rough below any step: no central
                // difference converges, and there is nothing to compare.
                if moved * unit < 1e-5 * scale {
                    converged += 1;
                    let error = (d * unit - by_z).abs();
                    assert!(
                        error < 1e-6 * scale + 5.0 * moved * unit,
                        "draw {n}, {i}: {by_z} {d}, of {scale}"
                    );
                }
            }
        }
        Some(converged == 3 * REQUIRED)
    };
    let outcomes: Vec<bool> = (100..200_u64).into_par_iter().filter_map(check).collect();
    let (checked, tried) = (outcomes.iter().filter(|c| **c).count(), outcomes.len());
    println!("{checked} of {tried} draws have converged differences in all coordinates");
    assert!(checked >= 50, "{checked} of {tried}");
}

#[test]
fn the_gradient_holds_near_q_min_q_one_and_the_bounds() {
    // Enough steps for the heaviest halo.
    let model = model(ModelSettings {
        steps: 400,
        ..small()
    });
    let settings = LikelihoodSettings::default();
    let prior = prior();
    // A well-behaved stream with one coordinate pushed to its edge at a time.
    let base = BASE;
    let mut cases = vec![base];
    for (i, value) in [
        (0, 11.0 + 1e-7),
        (0, 14.0 - 1e-7),
        (1, 10.0 + 1e-7),
        (1, 25.0 - 1e-7),
        (5, 7.0 + 1e-9),
        (5, 9.0 - 1e-9),
        (6, 1.0 + 1e-7),
        (6, 5.0 - 1e-7),
        (12, 1.0 + 1e-7),
        (12, 4.0 - 1e-7),
        (4, 1e-9),
        (4, 6.0),
    ] {
        let mut theta = base;
        theta[i] = value;
        if (i, value > 13.0) == (0, true) {
            // A heavier halo holds a faster progenitor: without this it would fall through the centre.
            for v in &mut theta[9..12] {
                *v *= 7.0;
            }
            theta[12] = 1.0 + 1e-7;
        }
        cases.push(theta);
    }
    // |dir| -> 0 is q_min; |dir| = 1.538 is q = 1.
    let length = f64::sqrt(0.25 * 0.25 + 0.4 * 0.4 + 1.64 * 1.64);
    for target in [1e-3, 1.538_172_254_455_5, 5.0] {
        let mut theta = base;
        for d in &mut theta[2..5] {
            *d *= target / length;
        }
        cases.push(theta);
    }
    for (n, theta) in cases.iter().enumerate() {
        let likelihood = likelihood_at(theta, &model, &settings).expect("a stream");
        let (_, fast) = likelihood.gradient(theta).expect("a gradient");
        let (_, slow) = gradient_by_duals(&likelihood, theta).expect("a gradient");
        let mut z = [0.0; DIM];
        prior.z_from_theta(theta, &mut z);
        let (fast, slow) = (in_z(&z, &fast), in_z(&z, &slow));
        let d = fast
            .iter()
            .zip(&slow)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(d < 1e-9 * largest(&slow), "case {n}: {fast:?} {slow:?}");
        for i in 2..5 {
            let value = |d: f64| {
                let mut t = *theta;
                t[i] += d;
                likelihood.ln_likelihood(&t).expect("finite").ln_likelihood
            };
            let (numeric, moved) = central(value, 1e-3);
            let exact = likelihood.gradient(theta).expect("a gradient").1[i];
            let scale = largest(&slow).max(1.0);
            assert!(moved < 1e-5 * scale, "case {n}, dir {i}: {moved}");
            let error = (numeric - exact).abs();
            assert!(
                error < 1e-6 * scale + 5.0 * moved,
                "case {n}, dir {i}: {exact} {numeric}"
            );
        }
    }
}

/// Masses by s, velocities by sqrt(s), age by 1/sqrt(s).
pub fn scaled(theta: &Theta, s: f64) -> Theta {
    let mut t = *theta;
    for i in [0, 5] {
        t[i] += s.log10();
    }
    for v in &mut t[9..12] {
        *v *= s.sqrt();
    }
    t[12] /= s.sqrt();
    t
}

#[test]
fn the_scaling_symmetry_is_exact_in_value_and_gradient() {
    let model = model(small());
    let mut checked = 0;
    for n in 200..280 {
        let (_, theta) = draw(n);
        let Some(likelihood) = likelihood_at(&theta, &model, &LikelihoodSettings::default()) else {
            continue;
        };
        let value = |t: &Theta| likelihood.ln_likelihood(t).expect("finite").ln_likelihood;
        let here = value(&theta);
        let rounding = rounding(&likelihood, &theta);
        if rounding > 1e-9 * here.abs().max(1.0) {
            continue;
        }
        for s in [1.7, 0.6] {
            let there = value(&scaled(&theta, s));
            let tolerance = 1e-11 * here.abs().max(1.0) + 30.0 * rounding;
            assert!(
                (here - there).abs() < tolerance,
                "{n} {s}: {here} {there} {rounding:e}"
            );
        }
        // The derivative along ln s: 1/ln 10 for the logarithms of mass, v/2 for velocities, -T/2 for the age.
        let terms = |g: &Theta| {
            [
                g[0] / std::f64::consts::LN_10,
                g[5] / std::f64::consts::LN_10,
                0.5 * theta[9] * g[9],
                0.5 * theta[10] * g[10],
                0.5 * theta[11] * g[11],
                -0.5 * theta[12] * g[12],
            ]
        };
        let (_, g) = likelihood.gradient(&theta).expect("a gradient");
        let along = |g: &Theta| terms(g).iter().sum::<f64>();
        let moved = shaken(&likelihood, &theta)
            .map(|(_, shaken)| (along(&shaken) - along(&g)).abs())
            .fold(0.0, f64::max);
        let exact = 1e-9 * largest(&terms(&g));
        assert!(
            along(&g).abs() < exact + 30.0 * moved,
            "{n}: {:e} of {:?}, {moved:e}",
            along(&g),
            terms(&g)
        );
        // A chaotic particle may be counted out by its rounding, but only here and there.
        checked += usize::from(along(&g).abs() < exact);
    }
    println!("{checked} draws");
    assert!(checked >= 25, "{checked}");
}
