//! The compiled part of the Python package `stickslip`: scenes, runs and comparisons, and the calls back into renderers
//! and instruments that are written in Python.
//!
//! What users see is in `python/stickslip`. Arrays cross as bytes, which numpy takes without a copy, so that nothing here
//! depends on a version of numpy. Runs release the interpreter's lock and take it back for the calls into Python alone.
#![deny(unsafe_code)]
#![warn(missing_docs)]

mod accuracy;
mod columns;
mod conform;
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
    /// Number of runs that `conform` makes.
    #[pymodule_export]
    const RUNS: u64 = stickslip::verify::conformance::RUNS;

    #[pymodule_export]
    use super::accuracy::{Reference, accuracy, judge};
    #[pymodule_export]
    use super::conform::conform;
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::scene::Scene;
}
