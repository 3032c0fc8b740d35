//! Conformance of a renderer.

use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use stickslip::verify::conformance::Conformance;

use crate::accuracy::json;
use crate::error::scene_error;
use crate::parts::Parts;
use crate::raised::Raised;
use crate::scene::Scene;
use crate::watch::watched;

/// Examines a renderer over a scene's body. Returns the conformance as JSON.
///
/// What a renderer in Python raises in a run is a finding about it, as a fault is. An interrupt ends the call.
#[pyfunction]
pub fn conform(py: Python<'_>, scene: &Scene, parts: Parts, progress: Option<Py<PyAny>>) -> PyResult<String> {
    let (scene, renderer, raised) = parts.renderers(&scene.inner);
    let examined = watched(py, progress, |watch| {
        let mut runs = 0;
        Conformance::of_renderer(&scene, renderer, || {
            runs += 1;
            if let Some(error) = interrupt(&raised) {
                watch.stop(error);
            }
            watch.done(runs);
        })
    })?;
    let examined = examined.map_err(|error| raised.take().unwrap_or_else(|| scene_error(py, &error)))?;
    if let Some(error) = interrupt(&raised) {
        return Err(error);
    }
    match examined {
        Some(conformance) => json(&conformance),
        None => Err(PyValueError::new_err(format!(
            "the path of {} never touches the body, so there is no place to press",
            scene.name
        ))),
    }
}

/// Takes what a run has raised, and returns it if it is an interrupt and no error of the renderer.
fn interrupt(raised: &Raised) -> Option<PyErr> {
    raised.take().filter(|error| !Python::attach(|py| error.is_instance_of::<PyException>(py)))
}
