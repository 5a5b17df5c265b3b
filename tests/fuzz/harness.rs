//! Runs one reader on many damaged inputs, and counts the outcomes.

use oblate_samplers::rng::{Domain, RandomStream, stream};
use std::cell::RefCell;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;
use std::time::{Duration, Instant};

/// The outcome of one input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It was accepted, and the following code could use it.
    Accepted,
    /// It returned an error.
    Refused,
}

/// One kind of input: its name, and the number of its random streams.
#[derive(Clone, Copy, Debug)]
pub struct Reader {
    pub name: &'static str,
    pub task: u64,
}

/// The outcomes of the cases of one reader.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    pub name: &'static str,
    pub accepted: u64,
    pub refused: u64,
    /// Number of each case that panicked, and where.
    pub panics: Vec<(u64, String)>,
    /// The case that took longest, and how long.
    pub slowest: (u64, Duration),
    /// The case that took the most memory, and how much.
    pub peak: (u64, u64),
}

impl Reader {
    /// Runs the first `cases`; case number i is the same in every run, so that a failure can be repeated alone with
    /// `OBLATE_FUZZ_CASE=i`.
    pub fn run(&self, cases: u64, mut case: impl FnMut(&mut RandomStream) -> Verdict) -> Counts {
        let mut counts = Counts {
            name: self.name,
            ..Counts::default()
        };
        note_panics();
        // All work is on this thread, where memory and panics are recorded.
        let _pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .use_current_thread()
            .build();
        let one = std::env::var("OBLATE_FUZZ_CASE");
        let range = match one.as_ref().map(|number| number.parse::<u64>()) {
            Ok(Ok(number)) => number..number + 1,
            _ => 0..cases,
        };
        for number in range {
            let mut rng = stream(1, Domain::Test, self.task, number);
            let begin = Instant::now();
            let mut verdict = None;
            PANIC.set(Some(String::new()));
            let memory = allocation_counter::measure(|| {
                verdict = catch_unwind(AssertUnwindSafe(|| case(&mut rng))).ok();
            });
            let time = begin.elapsed();
            if time > counts.slowest.1 {
                counts.slowest = (number, time);
            }
            if memory.bytes_max > counts.peak.1 {
                counts.peak = (number, memory.bytes_max);
            }
            let panic = PANIC.take().unwrap_or_default();
            match verdict {
                Some(Verdict::Accepted) => counts.accepted += 1,
                Some(Verdict::Refused) => counts.refused += 1,
                None => counts.panics.push((number, panic)),
            }
        }
        counts
    }
}

impl Counts {
    /// Asserts that nothing panicked, that memory stayed below a bound, and that some cases were accepted and some
    /// refused.
    pub fn assert(&self, bound: u64) {
        println!("{self} (cases {} and {})", self.slowest.0, self.peak.0);
        assert!(self.panics.is_empty(), "{self}");
        assert!(self.peak.1 < bound, "case {}: {self}", self.peak.0);
        assert!(self.accepted > 0 && self.refused > 0, "{self}");
    }
}

thread_local! {
    /// Where this thread's case panicked; none outside of cases.
    static PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Panics of cases are recorded, not printed.
fn note_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let print = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            let noted = PANIC.with_borrow_mut(|place| {
                place
                    .as_mut()
                    .map(|place| *place = info.to_string())
                    .is_some()
            });
            if !noted {
                print(info);
            }
        }));
    });
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "| {} | {} | {} | {} | {:.2} | {:.1} |",
            self.name,
            self.accepted,
            self.refused,
            self.panics.len(),
            self.slowest.1.as_secs_f64(),
            self.peak.1 as f64 / f64::from(1 << 20),
        )?;
        // One case of each panic.
        let mut seen = std::collections::BTreeSet::new();
        for (number, place) in &self.panics {
            if seen.insert(place) {
                write!(f, "\ncase {number}: {place}")?;
            }
        }
        Ok(())
    }
}
