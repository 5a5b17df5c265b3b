//! How fast a stage advances and how long it still takes, from the latest half of its time.

use std::collections::VecDeque;

/// A number that was noted at several times of a stage, in seconds since its beginning.
#[derive(Debug, Default)]
pub struct Trend {
    noted: VecDeque<(f64, f64)>,
}

impl Trend {
    /// Notes a value. Those of the first half of the time so far are forgotten.
    pub fn note(&mut self, seconds: f64, value: f64) {
        if !value.is_finite() {
            return;
        }
        // Ten values a second tell all that is shown.
        if self
            .noted
            .back()
            .is_some_and(|(last, _)| seconds - last < 0.1)
            && self.noted.len() > 1
        {
            self.noted.pop_back();
        }
        self.noted.push_back((seconds, value));
        while self.noted.len() > 2 && self.noted[1].0 < 0.5 * seconds {
            self.noted.pop_front();
        }
    }

    /// Change per second; none before two values apart in time.
    pub fn rate(&self) -> Option<f64> {
        let ((t0, first), (t1, last)) = (self.noted.front()?, self.noted.back()?);
        (t1 > t0).then(|| (last - first) / (t1 - t0))
    }

    /// Seconds until the value is 0, if it goes on falling as it did; none if it does not fall.
    pub fn seconds_to_zero(&self) -> Option<f64> {
        let rate = self.rate().filter(|rate| *rate < 0.0)?;
        self.noted.back().map(|(_, last)| last / -rate)
    }
}

/// A time as text: `40 s`, `12 min`, `3.5 h`.
pub fn duration(seconds: f64) -> String {
    if seconds < 100.0 {
        format!("{:.0} s", seconds.max(1.0))
    } else if seconds < 6_000.0 {
        format!("{:.0} min", seconds / 60.0)
    } else {
        format!("{:.1} h", seconds / 3_600.0)
    }
}

#[cfg(test)]
mod tests {
    use super::{Trend, duration};

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
}
