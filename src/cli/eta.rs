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
        // Ten values a second tell all that is shown: the newest is replaced until the one before it is that old.
        let before = self.noted.len().checked_sub(2).map(|i| self.noted[i].0);
        if before.is_some_and(|before| seconds - before < 0.1) {
            self.noted.pop_back();
        }
        self.noted.push_back((seconds, value));
        while self.noted.len() > 2 && self.noted[1].0 < 0.5 * seconds {
            self.noted.pop_front();
        }
    }

    /// Change per second; none before two values apart in time.
    #[must_use]
    pub fn rate(&self) -> Option<f64> {
        let ((t0, first), (t1, last)) = (self.noted.front()?, self.noted.back()?);
        (t1 > t0).then(|| (last - first) / (t1 - t0))
    }

    /// Seconds until the value is 0, if it goes on falling as it did; none if it does not fall.
    #[must_use]
    pub fn seconds_to_zero(&self) -> Option<f64> {
        let rate = self.rate().filter(|rate| *rate < 0.0)?;
        self.noted.back().map(|(_, last)| last / -rate)
    }
}

/// A time as text: `40 s`, `12 min`, `3.5 h`.
#[must_use]
pub fn duration(seconds: f64) -> String {
    if seconds < 100.0 {
        format!("{:.0} s", seconds.max(1.0))
    } else if seconds < 6_000.0 {
        format!("{:.0} min", seconds / 60.0)
    } else {
        format!("{:.1} h", seconds / 3_600.0)
    }
}
