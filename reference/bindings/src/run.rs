//! A run of a scene.

use std::time::Instant;

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use stickslip::output::summary::Recorder;
use stickslip::output::time_steps::TimeSteps;
use stickslip::output::warnings::{after_run, before_run};
use stickslip::scene::Schedule;
use stickslip::{Lockstep, OwnParts, SceneError, Simulation};

use crate::columns::{Columns, Trace};
use crate::error::scene_error;
use crate::parts::Parts;
use crate::scene::Scene;
use crate::watch::{Watch, watched};

/// Why a run has no result.
enum Failure {
    Scene(SceneError),
    /// The result cannot be put together.
    Result(String),
}

/// Runs a scene in virtual time. Returns the columns of its trace and its summary as JSON.
///
/// # Errors
/// If the scene cannot start, or a custom part, a signal or `progress` raised an exception.
#[pyfunction]
pub fn run(py: Python<'_>, scene: &Scene, parts: Parts, progress: Option<Py<PyAny>>) -> PyResult<(Columns, String)> {
    if scene.inner.schedule == Schedule::Threads {
        return Err(PyValueError::new_err(
            "runs from Python are in virtual time: give `run.schedule = \"lockstep\"`, or use the program `stickslip`",
        ));
    }
    let (scene, own, raised) = parts.apply(&scene.inner);
    let done = watched(py, progress, |watch| execute(&scene, own, watch));
    if let Some(error) = raised.take() {
        return Err(error);
    }
    done?.map_err(|failure| match failure {
        Failure::Scene(error) => scene_error(py, &error),
        Failure::Result(text) => PyRuntimeError::new_err(text),
    })
}

fn execute(scene: &stickslip::Scene, own: OwnParts, watch: &mut Watch) -> Result<(Columns, String), Failure> {
    let start = Instant::now();
    let simulation = Simulation::prepare_with(scene, own).map_err(Failure::Scene)?;
    let foreseen = before_run(scene, &simulation, &TimeSteps::where_in_doubt(scene, &simulation));
    let (mut trace, mut recorder) = (Trace::new(), Recorder::default());
    let mut run = Lockstep::new(simulation);
    let result = |error: csv::Error| Failure::Result(error.to_string());
    let fault = loop {
        match run.step() {
            Ok(Some(view)) => {
                recorder.record(&view);
                trace.record(&view).map_err(result)?;
                watch.done(view.tick + 1);
            }
            Ok(None) => break None,
            Err(fault) => break Some(fault),
        }
    };
    let summary = recorder.summary(scene, fault.as_ref(), start.elapsed().as_secs_f64());
    let warnings = after_run(&foreseen, summary.contact_ticks());
    let summary = summary.with(|summary| summary.warnings = warnings);
    let summary = serde_json::to_string(&summary).map_err(|error| Failure::Result(error.to_string()))?;
    Ok((trace.columns().map_err(result)?, summary))
}
