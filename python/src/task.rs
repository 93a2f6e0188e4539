//! Runs long work without the interpreter's lock, so that Ctrl-C can end it.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use ewa_splat::session::with_workers;
use ewa_splat::{Result, Task};
use pyo3::prelude::*;

use crate::errors::exception;

/// Time between checks for a signal.
const PATIENCE: Duration = Duration::from_millis(20);

/// Runs `work` in a thread of its own, and waits for it with the interpreter released. A signal
/// whose handler raises, as for Ctrl-C, cancels the task. It then still waits for the work, so that
/// no part of it runs on.
///
/// # Errors
/// The handler's exception, or the work's error.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Task) -> Result<T> + Send,
) -> PyResult<T> {
    let task = Task::new();
    let (send, mut done) = channel();
    let mut raised = None;
    let result = thread::scope(|scope| {
        let task = &task;
        scope.spawn(move || {
            // A panic is passed to the caller, with its message.
            let result = catch_unwind(AssertUnwindSafe(|| with_workers(|| work(task))));
            // The receiver waits until this result has arrived.
            let _ = send.send(result);
        });
        loop {
            let (back, waited) = py.detach(move || {
                let waited = done.recv_timeout(PATIENCE);
                (done, waited)
            });
            done = back;
            if let Ok(result) = waited {
                return result;
            }
            if raised.is_none()
                && let Err(error) = py.check_signals()
            {
                task.cancel();
                raised = Some(error);
            }
        }
    });
    match (raised, result) {
        (_, Err(panic)) => resume_unwind(panic),
        (Some(error), _) => Err(error),
        (None, Ok(result)) => result.map_err(|error| exception(&error)),
    }
}

/// Releases the interpreter and runs `work` in a pool that has workers for its parallel loops.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| with_workers(work))
}
