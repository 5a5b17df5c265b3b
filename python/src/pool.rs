//! Pools of threads, which a forked process makes anew.

use crate::errors::to_python;
use oblate::samplers::limits::in_range;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};

/// Allowed numbers of threads, as for the command.
const THREADS: RangeInclusive<usize> = 1..=1024;

/// Pools by process and number of threads. A process that was forked has the memory of its parent but not its threads, and work for
/// those would wait for ever; so it makes pools of its own.
static POOLS: Mutex<Option<HashMap<(u32, usize), Arc<ThreadPool>>>> = Mutex::new(None);

/// A number of threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads {
    /// 0: all cores, or as many as the environment variable `RAYON_NUM_THREADS` says.
    count: usize,
}

impl Threads {
    /// From an argument; none: all cores.
    ///
    /// # Errors
    /// `OblateError` for a number out of range.
    pub fn new(count: Option<usize>) -> PyResult<Self> {
        if let Some(count) = count {
            in_range("threads", count, THREADS).map_err(|e| to_python(e.into()))?;
        }
        Ok(Self {
            count: count.unwrap_or(0),
        })
    }

    /// The number that was given.
    pub fn given(self) -> Option<usize> {
        (self.count > 0).then_some(self.count)
    }

    /// The pool of so many threads.
    ///
    /// # Errors
    /// `RuntimeError` if the system gives no threads.
    pub fn pool(self) -> PyResult<Arc<ThreadPool>> {
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        let pools = pools.get_or_insert_default();
        let key = (std::process::id(), self.count);
        if let Some(pool) = pools.get(&key) {
            return Ok(Arc::clone(pool));
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(self.count)
            .build()
            .map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
        let pool = Arc::new(pool);
        pools.insert(key, Arc::clone(&pool));
        Ok(pool)
    }
}
