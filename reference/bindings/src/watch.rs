//! What long calls do beside their work: report progress, and notice Ctrl-C.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between two looks at signals: short for a person, and so rare that taking the interpreter's lock costs nothing.
const EVERY: Duration = Duration::from_millis(50);

/// What unwinds a call that is to end. The library's long calls have an observer, and no way for it to end them.
struct Stop;

/// Observer of a long call, on a thread that has released the interpreter's lock.
pub struct Watch {
    progress: Option<Py<PyAny>>,
    last: Instant,
    raised: Option<PyErr>,
}

impl Watch {
    /// Notes how much is done. Now and then, lets Python handle signals and calls `progress`; an exception in either ends
    /// the call.
    pub fn done(&mut self, amount: u64) {
        if self.last.elapsed() < EVERY {
            return;
        }
        let looked = Python::attach(|py| {
            py.check_signals()?;
            self.progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (amount,)).map(|_| ()))
        });
        self.last = Instant::now();
        if let Err(error) = looked {
            self.stop(error);
        }
    }

    /// Ends the call with an exception.
    pub fn stop(&mut self, error: PyErr) -> ! {
        self.raised = Some(error);
        resume_unwind(Box::new(Stop))
    }
}

/// Does long work without the interpreter's lock. `progress` is called with the amount done.
///
/// # Errors
/// With the exception that ended the work.
pub fn watched<R: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&mut Watch) -> R + Send,
) -> PyResult<R> {
    let mut watch = Watch { progress, last: Instant::now(), raised: None };
    // What the work has left half done is dropped with it.
    let done = py.detach(|| catch_unwind(AssertUnwindSafe(|| work(&mut watch))));
    match (done, watch.raised) {
        (_, Some(error)) => Err(error),
        (Ok(result), None) => Ok(result),
        (Err(panic), None) => resume_unwind(panic),
    }
}
