//! The trend of a stage, and times as text.

use oblate::cli::eta::{Trend, duration};

#[test]
fn a_line_ends_where_it_meets_zero_and_the_first_half_of_the_time_is_forgotten() {
    let mut trend = Trend::default();
    assert_eq!(trend.rate(), None);
    // Fast at first: 100 per second until 10 s, then 1 per second from 50 down to 10 at 50 s.
    for k in 0..10 {
        trend.note(f64::from(k), 1_050.0 - 100.0 * f64::from(k));
    }
    for k in 10..=50 {
        trend.note(f64::from(k), 60.0 - f64::from(k));
    }
    assert_eq!(trend.rate(), Some(-1.0));
    assert_eq!(trend.seconds_to_zero(), Some(10.0));
    trend.note(51.0, f64::INFINITY);
    assert_eq!(trend.seconds_to_zero(), Some(10.0));
}

#[test]
fn what_does_not_fall_has_no_end() {
    let mut trend = Trend::default();
    trend.note(0.0, 1.0);
    trend.note(1.0, 2.0);
    assert_eq!(trend.seconds_to_zero(), None);
}

#[test]
fn times_have_units() {
    let texts = [0.2, 40.0, 720.0, 12_600.0].map(duration);
    assert_eq!(texts, ["1 s", "40 s", "12 min", "3.5 h"]);
}

#[test]
fn values_a_hundredth_of_a_second_apart_are_forgotten_too() {
    let mut trend = Trend::default();
    // 100 per second until 10 s, then 1 per second.
    for k in 0..5_000_u32 {
        let seconds = f64::from(k) / 100.0;
        let fast = 1_050.0 - 100.0 * seconds;
        trend.note(seconds, fast.max(60.0 - seconds));
    }
    let rate = trend.rate().unwrap();
    assert!((rate + 1.0).abs() < 1e-6, "{rate}");
}
