//! Elementary functions against the standard library, and dual numbers in lanes against the reference.

use oblate::scalar::{
    Dual, LaneDual, Portable, Real, angle, gradient_of, ln_1p, smooth_step, variable,
};
use std::f64::consts::{FRAC_PI_2, PI};

#[test]
fn ln_1p_is_within_two_ulp_of_the_library() {
    let mut s = 1e-300;
    while s < 1e300 {
        let (ours, theirs) = (ln_1p(s), f64::ln_1p(s));
        let ulp = f64::from_bits(theirs.to_bits() + 1) - theirs;
        assert!((ours - theirs).abs() <= 2.0 * ulp, "{s}: {ours} {theirs}");
        s *= 1.000_7;
    }
}

#[test]
fn angles_are_those_of_the_library() {
    for i in 0..100_000 {
        // Along the circle in steps that fall nowhere twice, and at all sizes.
        let (at, r) = (
            f64::from(i) * 2.399_963,
            (f64::from(i % 600) - 300.0).exp2(),
        );
        let (y, x) = (r * at.sin(), r * at.cos());
        let (ours, theirs) = (angle(y, x), y.atan2(x));
        assert!(
            (ours - theirs).abs() <= 4e-16 * theirs.abs().max(1.0),
            "{y}, {x}: {ours} {theirs}"
        );
    }
    for (y, x, is) in [
        (0.0, 1.0, 0.0),
        (0.0, -1.0, PI),
        (0.0, 0.0, 0.0),
        (-1.0, 0.0, -FRAC_PI_2),
    ] {
        assert!((angle(y, x) - is).abs() < 1e-300, "{y}, {x}");
    }
}

#[test]
fn smooth_step_has_two_continuous_derivatives_at_its_ends() {
    let at = |x: f64| smooth_step(x);
    for edge in [0.0, 1.0] {
        let h = 1e-3;
        let second = (at(edge + h) - 2.0 * at(edge) + at(edge - h)) / (h * h);
        assert!(second.abs() < 0.07, "{second}");
    }
    assert!(
        (at(0.5) - 0.5).abs() < 1e-15 && at(-1.0).abs() < 1e-300 && (at(2.0) - 1.0).abs() < 1e-300
    );
}

/// All operations of a number type, on two numbers.
fn everything<S: Real>(a: S, b: S) -> Vec<S> {
    let mut sum = a;
    sum += b;
    sum -= b * 0.25;
    sum *= a;
    vec![
        a + b,
        a - b,
        a * b,
        a / b,
        -a,
        a + 0.7,
        a - 0.7,
        a * 0.7,
        a / 0.7,
        sum,
        a.sqrt(),
        a.mul_add(b, a),
        a.max(b),
        a.min(b),
        a.exp(),
        a.ln(),
        a.cbrt(),
        a.round_ties_even(),
        angle(a, b),
        a.with_derivative(2.0, -3.0),
        ln_1p(a),
        smooth_step(a),
    ]
}

#[test]
fn lane_duals_do_what_duals_do_and_their_real_parts_are_doubles() {
    for (a, b) in [(0.3, 1.9), (2.5, 0.4), (0.9, 0.8)] {
        let reals = everything(a, b);
        let duals = everything::<Dual<3>>(variable(a, 0), variable(b, 2));
        let lanes =
            everything::<LaneDual<Portable, 1>>(LaneDual::variable(a, 0), LaneDual::variable(b, 2));
        for (i, ((real, dual), lane)) in reals.iter().zip(&duals).zip(&lanes).enumerate() {
            assert_eq!(real.to_bits(), lane.re.to_bits(), "{i} at {a}, {b}");
            for (d, l) in gradient_of(dual).iter().zip(lane.eps.store().0[0]) {
                assert!((d - l).abs() <= 1e-14 * d.abs(), "{i} at {a}, {b}: {d} {l}");
            }
        }
    }
}
