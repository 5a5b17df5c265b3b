//! CPU time of a run.

use cpu_time::{ProcessTime, ThreadTime};
use std::time::Duration;

/// CPU time since the clock was started: in a rayon pool of one thread that of this thread, so that runs at once in such pools do not count each
/// other's; else that of the process.
pub(crate) enum CpuClock {
    Thread(ThreadTime),
    Process(ProcessTime),
    /// The system has no such clock.
    None,
}

impl CpuClock {
    /// Starts a clock.
    pub fn start() -> Self {
        let alone = rayon::current_thread_index().is_some() && rayon::current_num_threads() == 1;
        if alone {
            ThreadTime::try_now().map_or(Self::None, Self::Thread)
        } else {
            ProcessTime::try_now().map_or(Self::None, Self::Process)
        }
    }

    /// Time since the start, by the thread that started it; zero without a clock.
    pub fn elapsed(&self) -> Duration {
        let elapsed = match self {
            Self::Thread(start) => start.try_elapsed(),
            Self::Process(start) => start.try_elapsed(),
            Self::None => return Duration::ZERO,
        };
        elapsed.unwrap_or(Duration::ZERO)
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

    /// What the clock of a pool of so many threads says after so many tasks of 0.1 s.
    fn in_pool(threads: usize, tasks: usize) -> f64 {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let clock = CpuClock::start();
            let sum: f64 = (0..tasks).into_par_iter().map(|_| work(0.1)).sum();
            assert!(sum.is_finite());
            clock.elapsed().as_secs_f64()
        })
    }

    #[test]
    fn runs_in_pools_of_one_thread_do_not_count_each_others_time() {
        std::thread::scope(|scope| {
            let other = scope.spawn(|| in_pool(1, 4));
            let own = in_pool(1, 6);
            // Little else is done; together it would be 1.
            assert!((0.6..0.9).contains(&own), "{own}");
            let other = other.join().unwrap();
            assert!((0.4..0.9).contains(&other), "{other}");
        });
    }

    #[test]
    fn all_threads_of_a_larger_pool_count() {
        assert!(in_pool(2, 6) >= 0.6);
    }
}
