//! CPU time of a run: that of the threads of the present rayon pool, so that runs that have pools of their own do not count each other's.

use cpu_time::ThreadTime;
use std::time::{Duration, Instant};

/// Asking every thread of a pool wakes it, so that it is not done more often than this.
const LEAST_INTERVAL: Duration = Duration::from_millis(20);

/// CPU time since the clock was started. Work of others on the same pool counts too.
pub(crate) struct CpuClock {
    /// None where the system has no such clock.
    start: Option<Duration>,
    asked: Instant,
    elapsed: Duration,
}

impl CpuClock {
    /// Starts a clock of the present pool and, where it is none of that pool's, of the present thread.
    pub fn start() -> Self {
        Self {
            start: now(),
            asked: Instant::now(),
            elapsed: Duration::ZERO,
        }
    }

    /// Time since the start, at most some hundredths of a second ago.
    pub fn elapsed(&mut self) -> Duration {
        let one = rayon::current_num_threads() == 1;
        if one || self.asked.elapsed() >= LEAST_INTERVAL {
            self.asked = Instant::now();
            self.elapsed = (now().zip(self.start))
                .map_or(Duration::ZERO, |(now, start)| now.saturating_sub(start));
        }
        self.elapsed
    }
}

fn now() -> Option<Duration> {
    let own = || Some(ThreadTime::try_now().ok()?.as_duration());
    let pool: Option<Duration> = rayon::broadcast(|_| own()).into_iter().sum();
    if rayon::current_thread_index().is_some() {
        pool
    } else {
        Some(pool? + own()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    /// Works for so long.
    fn work(seconds: f64) -> f64 {
        let began = ThreadTime::now();
        let mut x = 0.1_f64;
        while began.elapsed().as_secs_f64() < seconds {
            x = (x + 1.0).sin();
        }
        x
    }

    #[test]
    fn all_threads_of_the_own_pool_count_and_those_of_another_do_not() {
        let pool = |threads: usize| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
        };
        let in_pool = |threads: usize, tasks: usize| {
            pool(threads).install(|| {
                let mut clock = CpuClock::start();
                let sum: f64 = (0..tasks).into_par_iter().map(|_| work(0.1)).sum();
                assert!(sum.is_finite());
                std::thread::sleep(LEAST_INTERVAL);
                clock.elapsed().as_secs_f64()
            })
        };
        std::thread::scope(|scope| {
            let other = scope.spawn(|| in_pool(1, 4));
            let own = in_pool(2, 6);
            // Each task works for 0.1 s of its thread's own time; little else is done. Together it would be 1.
            assert!((0.6..0.9).contains(&own), "{own}");
            let other = other.join().unwrap();
            assert!((0.4..0.9).contains(&other), "{other}");
        });
    }

    #[test]
    fn a_thread_outside_of_the_pool_counts_too() {
        let mut clock = CpuClock::start();
        assert!(work(0.1).is_finite());
        std::thread::sleep(LEAST_INTERVAL);
        assert!(clock.elapsed().as_secs_f64() >= 0.1);
    }
}
