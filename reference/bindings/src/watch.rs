//! What long calls do beside their work: report progress, and notice Ctrl-C.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between two looks at signals: short for a person, and so rare that taking the interpreter's lock costs nothing.
const EVERY: Duration = Duration::from_millis(50);

/// Watches a long call from a thread that has released the interpreter's lock.
pub struct Watch {
    progress: Option<Py<PyAny>>,
    last: Instant,
    raised: Option<PyErr>,
}

impl Watch {
    /// Begins to watch. `progress` is called with the amount done.
    pub fn new(progress: Option<Py<PyAny>>) -> Self {
        Self { progress, last: Instant::now(), raised: None }
    }

    /// Notes how much is done. Breaks if a signal or `progress` has raised an exception.
    pub fn done(&mut self, amount: u64) -> ControlFlow<()> {
        if self.raised.is_none() && self.last.elapsed() < EVERY {
            return ControlFlow::Continue(());
        }
        let looked = Python::attach(|py| {
            py.check_signals()?;
            self.progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (amount,)).map(|_| ()))
        });
        self.last = Instant::now();
        match looked {
            Ok(()) if self.raised.is_none() => ControlFlow::Continue(()),
            Ok(()) => ControlFlow::Break(()),
            Err(error) => {
                self.raised.get_or_insert(error);
                ControlFlow::Break(())
            }
        }
    }

    /// Ends the watch.
    ///
    /// # Errors
    /// With the exception that broke the call.
    pub fn end(self) -> PyResult<()> {
        self.raised.map_or(Ok(()), Err)
    }
}
