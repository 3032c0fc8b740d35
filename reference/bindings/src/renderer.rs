//! Renderers that are written in Python, called through the adapters of `python/stickslip/_adapters.py`.

use std::any::Any;

use pyo3::intern;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};
use stickslip::contact::law::{Friction, Law, Mode};
use stickslip::model::springs::Spring;
use stickslip::model::state::ExternalForce;
use stickslip::{
    Body, BodyState, ContactPoint, MovedNodes, Rendered, Renderer, RendererFault, RendererModel, Setup, Vec3,
};

use crate::raised::Raised;

/// Why the copy of a run with a renderer in Python does not go on.
const NOT_COPIED: RendererFault =
    RendererFault("a renderer in Python has state that cannot be copied: prepare the scene again instead");

/// Modes of contact by their number in a reply.
const MODES: [Mode; 4] = [Mode::Free, Mode::Stick, Mode::Slide, Mode::Slip];

/// A contact as it crosses: triangle, weights, normal.
type Contact = (u32, [f64; 3], [f64; 3]);

/// Reply to a tick: force, number of the mode, contact, and the nodes that were moved, with their positions and velocities.
type Reply = ([f64; 3], usize, Option<Contact>, Option<[PyBackedBytes; 3]>);

/// A renderer in Python. A copy of it cannot go on.
#[derive(Debug)]
pub struct PythonRenderer {
    adapter: Option<Py<PyAny>>,
    raised: Raised,
}

/// Model of a renderer in Python. A copy of it cannot go on.
#[derive(Debug)]
struct PythonModel {
    adapter: Option<Py<PyAny>>,
    raised: Raised,
    /// Why the model cannot render.
    fault: Option<RendererFault>,
    moves_nodes: bool,
    nodes: Vec<u32>,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
}

impl PythonRenderer {
    /// Wraps the adapter of a renderer. What it raises is kept in `raised`.
    pub fn new(adapter: Py<PyAny>, raised: Raised) -> Self {
        Self { adapter: Some(adapter), raised }
    }

    /// Calls a method of the adapter; an exception becomes a fault with its type and its message.
    fn call<R>(
        &self,
        call: impl for<'py> FnOnce(Python<'py>, &Bound<'py, PyAny>) -> PyResult<R>,
    ) -> Result<R, RendererFault> {
        let adapter = self.adapter.as_ref().ok_or(NOT_COPIED)?;
        let called = Python::attach(|py| call(py, adapter.bind(py)));
        called.map_err(|error| RendererFault::with_text(self.raised.keep(error)))
    }
}

impl Clone for PythonRenderer {
    fn clone(&self) -> Self {
        Self { adapter: None, raised: self.raised.clone() }
    }
}

impl Clone for PythonModel {
    fn clone(&self) -> Self {
        let (nodes, x, v) = (self.nodes.clone(), self.x.clone(), self.v.clone());
        Self { adapter: None, raised: self.raised.clone(), nodes, x, v, ..*self }
    }
}

impl Renderer for PythonRenderer {
    fn create(&mut self, body: Body<'_>, setup: &Setup) -> Result<(), RendererFault> {
        self.call(|py, adapter| {
            let arguments = (body_arrays(py, body)?, setup_values(py, setup)?);
            adapter.call_method1(intern!(py, "create"), arguments).map(|_| ())
        })
    }

    fn build(&mut self, _: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        let built = self.call(|py, adapter| {
            let contact =
                state.last.contact.map(|(point, normal)| (point.triangle, point.weights, <[f64; 3]>::from(normal)));
            let last = (<[f64; 3]>::from(state.last.force), mode_number(state.last.mode), contact);
            let arguments = (state.tick, bytes(py, state.x), bytes(py, state.v), <[f64; 3]>::from(state.tip), last);
            adapter.call_method1(intern!(py, "build"), arguments)?.extract::<(Py<PyAny>, bool)>()
        });
        let (adapter, moves_nodes) = built?;
        Ok(Box::new(PythonModel {
            adapter: Some(adapter),
            raised: self.raised.clone(),
            fault: None,
            moves_nodes,
            nodes: Vec::new(),
            x: Vec::new(),
            v: Vec::new(),
        }))
    }
}

impl RendererModel for PythonModel {
    fn take_over(&mut self, old: Option<&mut dyn RendererModel>) {
        let Some(adapter) = &self.adapter else { return };
        let old = old.and_then(|old| (old as &mut dyn Any).downcast_ref::<Self>()?.adapter.as_ref());
        let called = Python::attach(|py| adapter.call_method1(py, intern!(py, "take_over"), (old,)).map(|_| ()));
        // There is no result to refuse; the first tick is the fault.
        self.fault = called.err().map(|error| RendererFault::with_text(self.raised.keep(error)));
    }

    fn tick(&mut self, before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
        let adapter = self.adapter.as_ref().ok_or(NOT_COPIED)?;
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let reply = Python::attach(|py| {
            let tips = (<[f64; 3]>::from(before), <[f64; 3]>::from(tip));
            adapter.bind(py).call_method1(intern!(py, "tick"), tips)?.extract::<Reply>()
        });
        let (force, mode, contact, moved) = reply.map_err(|error| RendererFault::with_text(self.raised.keep(error)))?;
        if let Some([nodes, x, v]) = moved {
            self.nodes = values(&nodes);
            self.x = values(&x);
            self.v = values(&v);
        }
        let contact = contact.map(|(triangle, weights, normal)| (ContactPoint { triangle, weights }, normal.into()));
        let mode = *MODES.get(mode).ok_or(RendererFault("its mode does not exist"))?;
        Ok(Rendered { force: force.into(), mode, contact })
    }

    fn moved(&self) -> Option<MovedNodes<'_>> {
        self.moves_nodes.then_some(MovedNodes { nodes: &self.nodes, x: &self.x, v: &self.v })
    }
}

fn mode_number(mode: Mode) -> usize {
    MODES.iter().position(|&other| other == mode).unwrap_or_default()
}

fn bytes<'py, T: bytemuck::NoUninit>(py: Python<'py>, values: &[T]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, bytemuck::cast_slice(values))
}

/// Reads an array from bytes, which need no alignment.
fn values<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

/// Returns the arguments of `stickslip.Body`.
fn body_arrays<'py>(py: Python<'py>, Body { network, surface }: Body<'_>) -> PyResult<Bound<'py, PyDict>> {
    let topology = &surface.topology;
    let springs: Vec<Spring> = network.springs.iter().collect();
    let of_springs = |value: fn(&Spring) -> f64| bytes(py, &springs.iter().map(value).collect::<Vec<_>>());
    let triangles: Vec<[u32; 3]> = (0..topology.triangles.len() as u32).map(|i| topology.triangle_nodes(i)).collect();
    let (mut gravity, mut drag) = (Vec3::zeros(), 0.0);
    for external in &network.external {
        match external {
            ExternalForce::Gravity(acceleration) => gravity = *acceleration,
            ExternalForce::Drag(coefficient) => drag = *coefficient,
        }
    }
    let body = PyDict::new(py);
    body.set_item("rest", bytes(py, &network.rest))?;
    body.set_item("mass", bytes(py, &network.mass))?;
    body.set_item("fixed", bytes(py, &network.fixed.iter().map(|&fixed| u8::from(fixed)).collect::<Vec<_>>()))?;
    body.set_item("spring_nodes", bytes(py, &springs.iter().map(|spring| spring.nodes).collect::<Vec<_>>()))?;
    body.set_item("stiffness", of_springs(|spring| spring.stiffness))?;
    body.set_item("damping", of_springs(|spring| spring.damping))?;
    body.set_item("rest_length", of_springs(|spring| spring.rest_length))?;
    body.set_item("triangles", bytes(py, &triangles))?;
    body.set_item("gravity", bytes(py, &[gravity]))?;
    body.set_item("drag", drag)?;
    Ok(body)
}

/// Returns the arguments of `stickslip.Setup`.
fn setup_values<'py>(py: Python<'py>, setup: &Setup) -> PyResult<Bound<'py, PyDict>> {
    let (law, friction) = match setup.law {
        Law::Sliding => ("sliding", Friction::single(0.0)),
        Law::Sticking => ("sticking", Friction::single(0.0)),
        Law::StickSlip { friction } => ("stick-slip", friction),
        // No scene from Python has one.
        Law::Own(_) => ("own", Friction::single(0.0)),
    };
    let values = PyDict::new(py);
    values.set_item("tick_s", setup.tick_s)?;
    values.set_item("cycle_s", setup.cycle_s)?;
    values.set_item("law", law)?;
    values.set_item("friction_static", friction.static_coefficient)?;
    values.set_item("friction_kinetic", friction.kinetic_coefficient)?;
    values.set_item("adhesion_n", setup.adhesion_n)?;
    values.set_item("surface", setup.surface.name())?;
    values.set_item("radius_m", setup.radius_m)?;
    Ok(values)
}
