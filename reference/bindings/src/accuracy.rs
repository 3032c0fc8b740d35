//! Force errors against the whole network at the haptic rate.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;
use stickslip::device::instrument::InstrumentKind;
use stickslip::local::condensation::CondensationCounts;
use stickslip::model::work::WorkCounts;
use stickslip::verify::accuracy::{Assessment, Errors, Method, Names, REFINEMENT, Record, Reference as WholeNetwork};
use stickslip::verify::judge::{ForceTrace, Judgement, ReferenceError, TraceFormat};

use crate::error::scene_error;
use crate::parts::Parts;
use crate::scene::Scene;
use crate::watch::watched;

/// The whole network's run, at the scene's tick and at shorter ones.
#[pyclass(frozen, module = "stickslip._stickslip")]
pub struct Reference {
    inner: WholeNetwork,
    /// All that the forces depend on.
    problem: String,
}

#[pymethods]
impl Reference {
    /// Ticks of a reference, for a tick of its scene.
    #[classattr]
    const TICKS: u64 = 1 + REFINEMENT as u64;

    /// Runs the references of a scene.
    #[staticmethod]
    fn run(py: Python<'_>, scene: &Scene, progress: Option<Py<PyAny>>) -> PyResult<Self> {
        let touching = Method::of(&scene.inner).touching;
        let done =
            watched(py, progress, |watch| WholeNetwork::watched(&scene.inner, touching, |ticks| watch.done(ticks)));
        let inner = done?.map_err(|error| scene_error(py, &error))?;
        Ok(Self { inner, problem: problem(&scene.inner) })
    }

    /// Times, s, and forces, N, at the ends of the ticks: four numbers a row.
    #[getter]
    fn rows<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        rows(py, &self.inner.coarse)
    }

    /// Rows of the reference whose ticks are an eighth as long.
    #[getter]
    fn fine_rows<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        rows(py, &self.inner.fine)
    }

    #[getter]
    fn floor(&self) -> f64 {
        self.inner.floor
    }

    #[getter]
    fn fault(&self) -> Option<&str> {
        self.inner.coarse.fault.as_deref().or(self.inner.fine.fault.as_deref())
    }
}

impl Reference {
    /// Refuses another scene than the reference's: only its local model and its cycle may be others.
    fn check(&self, scene: &stickslip::Scene) -> PyResult<()> {
        if self.problem == problem(scene) {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "the reference is one of another problem than {}: body, contact, path and tick have to be the same",
            scene.name
        )))
    }
}

/// Returns all that a reference's forces depend on.
fn problem(scene: &stickslip::Scene) -> String {
    let body = (&scene.mesh, &scene.fixed, &scene.material, scene.settle);
    let contact = (&scene.contact, &scene.surface, scene.contact_radius);
    format!("{:?}", (body, contact, &scene.instrument, &scene.path, scene.tick_s(), scene.tick_count()))
}

fn rows<'py>(py: Python<'py>, record: &Record) -> Bound<'py, PyBytes> {
    let rows = record.samples().into_iter().map(|sample| [sample.time, sample.force.x, sample.force.y, sample.force.z]);
    PyBytes::new(py, bytemuck::cast_slice(&rows.collect::<Vec<_>>()))
}

/// A point of `accuracy.json`, without times.
#[derive(Serialize)]
struct Point<'a> {
    name: String,
    #[serde(flatten)]
    names: Names,
    status: &'static str,
    fault: &'a Option<String>,
    below_floor: bool,
    #[serde(flatten)]
    errors: &'a Errors,
    work: WorkCounts,
    condensation: Option<CondensationCounts>,
    reference: ReferenceEntry<'a>,
}

/// A reference of `accuracy.json`, without times.
#[derive(Serialize)]
struct ReferenceEntry<'a> {
    contact: String,
    refinement: u32,
    floor_rms_rel: f64,
    force_rms_n: f64,
    energy_residual_rel: f64,
    energy_residual_rel_fine: f64,
    fault: &'a Option<String>,
    fault_fine: &'a Option<String>,
}

/// Runs a scene and returns its force errors as JSON.
#[pyfunction]
pub fn accuracy(
    py: Python<'_>,
    scene: &Scene,
    parts: Parts,
    reference: &Reference,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    reference.check(&scene.inner)?;
    let (scene, own, raised) = parts.apply(&scene.inner);
    let done = watched(py, progress, |watch| {
        Record::of_parts(&scene, own, |ticks| watch.done(ticks))
            .map(|record| Assessment::of_record(record, &reference.inner))
    });
    if let Some(error) = raised.take() {
        return Err(error);
    }
    let assessment = done?.map_err(|error| scene_error(py, &error))?;
    let (method, WholeNetwork { touching, coarse, fine, floor }) = (Method::of(&scene), &reference.inner);
    json(&Point {
        name: method.name(&scene),
        names: method.names(),
        // Nothing is timed, so there is no budget.
        status: assessment.status(true).name(),
        fault: &assessment.record.fault,
        below_floor: assessment.is_unresolved,
        errors: &assessment.errors,
        work: assessment.record.work,
        condensation: assessment.record.condensation,
        reference: ReferenceEntry {
            contact: touching.to_string(),
            refinement: REFINEMENT,
            floor_rms_rel: *floor,
            force_rms_n: coarse.force_rms_n(),
            energy_residual_rel: coarse.energy_residual_rel,
            energy_residual_rel_fine: fine.energy_residual_rel,
            fault: &coarse.fault,
            fault_fine: &fine.fault,
        },
    })
}

/// Judges forces of another program, given as the text of a CSV file. Returns the judgement as JSON.
#[pyfunction]
pub fn judge(py: Python<'_>, scene: &Scene, reference: &Reference, text: &str) -> PyResult<String> {
    reference.check(&scene.inner)?;
    let scene = &scene.inner;
    if let InstrumentKind::Phantom(_) = scene.instrument {
        return Err(PyValueError::new_err(ReferenceError::ByHand { scene: scene.name.clone() }.to_string()));
    }
    let judged = py.detach(|| {
        let trace = ForceTrace::parse(text.as_bytes(), &TraceFormat::default())?;
        Judgement::of(&trace, scene, &reference.inner)
    });
    json(&judged.map_err(|error| PyValueError::new_err(error.to_string()))?)
}

/// Writes a result as JSON.
///
/// # Errors
/// Never in practice: results have only names as keys.
pub fn json(result: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(result).map_err(|error| PyValueError::new_err(error.to_string()))
}
