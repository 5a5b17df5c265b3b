//! Long work that Ctrl-C stops.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::ThreadPool;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Time between two looks for signals.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Does work in a pool, without Python's lock, while this thread looks for signals: Python runs their handlers on its main thread
/// only. When a handler raises an exception, the flag that `work` gets is set, and the exception is raised when the work has ended.
///
/// # Errors
/// The exception of the handler; `RuntimeError` for a defect of the library.
pub fn interruptible<T: Send>(
    py: Python<'_>,
    pool: &ThreadPool,
    work: impl FnOnce(&Arc<AtomicBool>) -> T + Send,
) -> PyResult<T> {
    let stop = Arc::new(AtomicBool::new(false));
    py.detach(|| {
        thread::scope(|scope| {
            let (sender, receiver) = channel::<()>();
            let flag = &stop;
            let worker = scope.spawn(move || {
                // Dropped at the end of the work, also by a panic: the receiver is told either way.
                let _sender = sender;
                pool.install(|| work(flag))
            });
            let mut raised = Ok(());
            while receiver.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                if raised.is_ok() {
                    raised = Python::attach(|py| py.check_signals());
                    stop.store(raised.is_err(), Ordering::Relaxed);
                }
            }
            let result = worker.join();
            raised?;
            result.map_err(|_| {
                PyRuntimeError::new_err(
                    "a defect of oblate, whose place is above; please report it",
                )
            })
        })
    })
}
