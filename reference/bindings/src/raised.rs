//! Exceptions that calls into Python raised, kept until the run has ended.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::PyErr;

/// The first exception that a renderer or an instrument of a run raised. Its copies share it.
#[derive(Debug, Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Keeps an exception unless one is kept already. Returns its type and its message, for the run's fault.
    pub fn keep(&self, error: PyErr) -> String {
        let text = error.to_string();
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        text
    }

    /// Whether there is an exception.
    pub fn is_kept(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Takes the exception out.
    pub fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
