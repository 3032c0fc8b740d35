//! Instruments that are written in Python, called through the adapter of `python/stickslip/_adapters.py`.

use pyo3::intern;
use pyo3::prelude::*;
use stickslip::{Instrument, InstrumentFault, Vec3};

use crate::raised::Raised;

/// Why the copy of a run with an instrument in Python does not go on.
const NOT_COPIED: InstrumentFault =
    InstrumentFault("an instrument in Python has state that cannot be copied: prepare the scene again instead");
/// Why a run ends whose instrument failed in a call that returns no error; the exception says more.
const FAILED_BEFORE: InstrumentFault = InstrumentFault("it raised an exception");

/// No tip and no force: what a call that raised an exception stands for. The run ends in the tick after at the latest.
const NOTHING: Vec3 = Vec3::new(f64::NAN, f64::NAN, f64::NAN);

/// An instrument in Python. A copy of it cannot go on.
#[derive(Debug)]
pub struct PythonInstrument {
    adapter: Option<Py<PyAny>>,
    raised: Raised,
    /// Its estimate of the tip's velocity after the last `sense`, m/s.
    velocity: Option<Vec3>,
}

impl PythonInstrument {
    /// Wraps the adapter of an instrument. What it raises is kept in `raised`.
    pub fn new(adapter: Py<PyAny>, raised: Raised) -> Self {
        Self { adapter: Some(adapter), raised, velocity: None }
    }

    /// Calls the adapter. `None` after an exception, which is kept.
    fn call<R>(&self, call: impl for<'py> FnOnce(Python<'py>, &Bound<'py, PyAny>) -> PyResult<R>) -> Option<R> {
        let adapter = self.adapter.as_ref()?;
        let called = Python::attach(|py| call(py, adapter.bind(py)));
        called.map_err(|error| self.raised.keep(error)).ok()
    }
}

impl Clone for PythonInstrument {
    fn clone(&self) -> Self {
        Self { adapter: None, raised: self.raised.clone(), velocity: self.velocity }
    }
}

impl Instrument for PythonInstrument {
    fn start(&self) -> Vec3 {
        let start = self.call(|py, adapter| adapter.call_method0(intern!(py, "start"))?.extract::<[f64; 3]>());
        start.map_or(NOTHING, Vec3::from)
    }

    fn sense(&mut self, begin_s: f64, end_s: f64, contact_force: &Vec3) -> Result<Vec3, InstrumentFault> {
        if self.adapter.is_none() {
            return Err(NOT_COPIED);
        }
        if self.raised.is_kept() {
            return Err(FAILED_BEFORE);
        }
        let arguments = (begin_s, end_s, <[f64; 3]>::from(*contact_force));
        let sensed = self.call(|py, adapter| {
            adapter.call_method1(intern!(py, "sense"), arguments)?.extract::<([f64; 3], Option<[f64; 3]>)>()
        });
        let (tip, velocity) = sensed.ok_or(FAILED_BEFORE)?;
        self.velocity = velocity.map(Vec3::from);
        Ok(tip.into())
    }

    fn tip_velocity(&self) -> Option<Vec3> {
        self.velocity
    }

    fn command(&mut self, contact_force: &Vec3) -> Vec3 {
        let force = <[f64; 3]>::from(*contact_force);
        let commanded =
            self.call(|py, adapter| adapter.call_method1(intern!(py, "command"), (force,))?.extract::<[f64; 3]>());
        commanded.map_or(NOTHING, Vec3::from)
    }

    fn release(&mut self) {
        self.call(|py, adapter| adapter.call_method0(intern!(py, "release")).map(|_| ()));
    }
}
