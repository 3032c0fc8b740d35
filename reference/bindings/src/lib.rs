//! The compiled part of the Python package `stickslip`: scenes, runs and comparisons, and the calls back into renderers
//! and instruments that are written in Python.
//!
//! What users see is in `python/stickslip`. Arrays cross as bytes, which numpy takes without a copy, so that nothing here
//! depends on a version of numpy. Runs release the interpreter's lock and take it back for the calls into Python alone.
#![deny(unsafe_code)]
#![warn(missing_docs)]

mod columns;
mod error;
mod instrument;
mod keys;
mod parts;
mod raised;
mod renderer;
mod run;
mod scene;
mod watch;

use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _stickslip {
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::scene::Scene;
}
