//! A library's functions, and safe calls of them on one renderer.
#![allow(unsafe_code)]

use std::ffi::{CString, c_char, c_void};
use std::fmt;
use std::path::{Path, PathBuf};
use std::ptr::{self, NonNull};
use std::sync::Arc;

use libloading::os::unix::{Library as Loaded, RTLD_LOCAL, RTLD_NOW};
use serde::{Deserialize, Serialize};

use super::LibraryError;
use super::abi::{self, CBody, COutput, CSetup, CState};
use super::arrays::{Access, Array, Memory};
use crate::Vec3;
use crate::contact::law::{Friction, Law, Mode};
use crate::contact::renderer::{Body, BodyState, Rendered, Setup};
use crate::model::springs::Spring;
use crate::model::state::ExternalForce;
use crate::surface::geometry::{ContactPoint, ContactSurface};

/// Longest message of a library that is shown, bytes.
const LONGEST_MESSAGE: usize = 2000;

type Create = unsafe extern "C" fn(*const CBody, *const CSetup) -> *mut c_void;
type Build = unsafe extern "C" fn(*mut c_void, *const CState) -> *mut c_void;
type Swap = unsafe extern "C" fn(*mut c_void, *mut c_void) -> *mut c_void;
type Tick = unsafe extern "C" fn(*mut c_void, *const f64, *const f64, *mut COutput) -> i32;
type Moved = unsafe extern "C" fn(*mut c_void, u64, *mut u32, *mut f64, *mut f64) -> u64;
type Free = unsafe extern "C" fn(*mut c_void);
type Message = unsafe extern "C" fn(*mut c_void, *mut c_char, u64) -> u64;

/// A loaded library. Its functions are valid for as long as it lives.
pub struct Library {
    path: PathBuf,
    create: Create,
    build: Build,
    swap: Swap,
    tick: Tick,
    moved: Option<Moved>,
    dispose: Free,
    destroy: Free,
    message: Option<Message>,
    _loaded: Loaded,
}

impl Library {
    /// Loads a library and looks up its functions.
    ///
    /// # Errors
    /// If it cannot be loaded, lacks a function, or has another version of the interface.
    pub fn load(path: &Path) -> Result<Self, LibraryError> {
        // A bare name would be looked for where the system keeps its libraries.
        let place = if path.components().count() == 1 { Path::new(".").join(path) } else { path.to_owned() };
        let not_loaded = |error: libloading::Error| {
            let reason = std::error::Error::source(&error).map_or_else(|| error.to_string(), ToString::to_string);
            LibraryError::NotLoaded { path: path.to_owned(), reason }
        };
        // SAFETY: loading runs the library's initialisers. A user who names a library asks for that.
        let loaded = unsafe { Loaded::open(Some(&place), RTLD_NOW | RTLD_LOCAL) }.map_err(not_loaded)?;
        // SAFETY: a library that defines a function of this name declares it as the header does.
        let version: unsafe extern "C" fn() -> u32 = unsafe { required(&loaded, path, "stickslip_renderer_abi")? };
        let found = unsafe { version() };
        if found != abi::RENDERER_ABI {
            return Err(LibraryError::OtherVersion { path: path.to_owned(), found, expected: abi::RENDERER_ABI });
        }
        // SAFETY: as above.
        unsafe {
            Ok(Self {
                create: required(&loaded, path, "stickslip_renderer_create")?,
                build: required(&loaded, path, "stickslip_renderer_build")?,
                swap: required(&loaded, path, "stickslip_renderer_swap")?,
                tick: required(&loaded, path, "stickslip_renderer_tick")?,
                moved: optional(&loaded, "stickslip_renderer_moved"),
                dispose: required(&loaded, path, "stickslip_renderer_dispose")?,
                destroy: required(&loaded, path, "stickslip_renderer_destroy")?,
                message: optional(&loaded, "stickslip_renderer_message"),
                path: path.to_owned(),
                _loaded: loaded,
            })
        }
    }

    /// Returns what the library says went wrong last in one of its renderers, or in `create` for NULL.
    fn message_of(&self, renderer: *mut c_void) -> Option<String> {
        let message = self.message?;
        let mut text = vec![0_u8; LONGEST_MESSAGE];
        // SAFETY: the buffer has the capacity that is passed with it.
        let length = unsafe { message(renderer, text.as_mut_ptr().cast(), LONGEST_MESSAGE as u64) };
        text.truncate(usize::try_from(length).unwrap_or(LONGEST_MESSAGE).min(LONGEST_MESSAGE));
        let text = String::from_utf8_lossy(&text);
        // The text goes to terminals and files, and comes from outside.
        let printable = |c: char| if c.is_control() && c != '\n' { char::REPLACEMENT_CHARACTER } else { c };
        let text: String = text.trim_end_matches('\0').trim().chars().map(printable).collect();
        (!text.is_empty()).then_some(text)
    }
}

impl fmt::Debug for Library {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Library").field("path", &self.path).finish_non_exhaustive()
    }
}

/// Looks up a function that a library may define.
///
/// # Safety
/// `F` is the type of the function.
unsafe fn optional<F: Copy>(loaded: &Loaded, symbol: &str) -> Option<F> {
    // SAFETY: the caller's.
    unsafe { loaded.get::<F>(symbol.as_bytes()) }.ok().map(|function| *function)
}

/// Looks up a function that a library has to define.
///
/// # Safety
/// `F` is the type of the function.
unsafe fn required<F: Copy>(loaded: &Loaded, path: &Path, symbol: &str) -> Result<F, LibraryError> {
    // SAFETY: the caller's.
    unsafe { optional(loaded, symbol) }
        .ok_or_else(|| LibraryError::Lacks { path: path.to_owned(), symbol: symbol.to_owned() })
}

/// The body in the layout of the interface.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BodyData {
    rest: Vec<[f64; 3]>,
    mass: Vec<f64>,
    fixed: Vec<u8>,
    spring_nodes: Vec<[u32; 2]>,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
    rest_length: Vec<f64>,
    triangle_nodes: Vec<[u32; 3]>,
    gravity: [f64; 3],
    drag: f64,
}

impl From<Body<'_>> for BodyData {
    fn from(Body { network, surface }: Body<'_>) -> Self {
        let topology = &surface.topology;
        let springs: Vec<Spring> = network.springs.iter().collect();
        let (mut gravity, mut drag) = (Vec3::zeros(), 0.0);
        for external in &network.external {
            match external {
                ExternalForce::Gravity(acceleration) => gravity = *acceleration,
                ExternalForce::Drag(coefficient) => drag = *coefficient,
            }
        }
        Self {
            rest: network.rest.iter().map(|&x| x.into()).collect(),
            mass: network.mass.clone(),
            fixed: network.fixed.iter().map(|&fixed| u8::from(fixed)).collect(),
            spring_nodes: springs.iter().map(|spring| spring.nodes).collect(),
            stiffness: springs.iter().map(|spring| spring.stiffness).collect(),
            damping: springs.iter().map(|spring| spring.damping).collect(),
            rest_length: springs.iter().map(|spring| spring.rest_length).collect(),
            triangle_nodes: (0..topology.triangles.len() as u32).map(|i| topology.triangle_nodes(i)).collect(),
            gravity: gravity.into(),
            drag,
        }
    }
}

/// The setup in the layout of the interface.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SetupData {
    tick_s: f64,
    cycle_s: f64,
    law: i32,
    surface: i32,
    friction: [f64; 2],
    adhesion: f64,
    radius: f64,
    options: String,
}

impl SetupData {
    /// Collects the setup of a scene with the options for its library. `None` for a custom contact law, which has no
    /// number.
    pub fn new(setup: &Setup, options: &str) -> Option<Self> {
        let (law, friction) = match setup.law {
            Law::Sliding => (abi::LAW_SLIDING, Friction::single(0.0)),
            Law::Sticking => (abi::LAW_STICKING, Friction::single(0.0)),
            Law::StickSlip { friction } => (abi::LAW_STICK_SLIP, friction),
            Law::Own(_) => return None,
        };
        let surface = match setup.surface {
            ContactSurface::Faceted => abi::SURFACE_FACETED,
            ContactSurface::Shaded => abi::SURFACE_SHADED,
            ContactSurface::Subdivision => abi::SURFACE_SUBDIVISION,
        };
        Some(Self {
            tick_s: setup.tick_s,
            cycle_s: setup.cycle_s,
            law,
            surface,
            friction: [friction.static_coefficient, friction.kinetic_coefficient],
            adhesion: setup.adhesion_n,
            radius: setup.radius_m,
            options: options.to_owned(),
        })
    }
}

/// Result of a tick in the layout of the interface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OutputData {
    force: [f64; 3],
    mode: i32,
    triangle: u32,
    weights: [f64; 3],
    normal: [f64; 3],
}

impl OutputData {
    /// Returns the result of a tick; `None` for a mode that does not exist.
    pub fn rendered(&self) -> Option<Rendered> {
        let mode = match self.mode {
            abi::MODE_FREE => Mode::Free,
            abi::MODE_STICK => Mode::Stick,
            abi::MODE_SLIDE => Mode::Slide,
            abi::MODE_SLIP => Mode::Slip,
            _ => return None,
        };
        let point = ContactPoint { triangle: self.triangle, weights: self.weights };
        let contact = (mode != Mode::Free).then(|| (point, Vec3::from(self.normal)));
        Some(Rendered { force: self.force.into(), mode, contact })
    }
}

impl From<Rendered> for OutputData {
    fn from(rendered: Rendered) -> Self {
        let mode = match rendered.mode {
            Mode::Free => abi::MODE_FREE,
            Mode::Stick => abi::MODE_STICK,
            Mode::Slide => abi::MODE_SLIDE,
            Mode::Slip => abi::MODE_SLIP,
        };
        let (triangle, weights, normal) = match rendered.contact {
            Some((point, normal)) => (point.triangle, point.weights, normal.into()),
            None => (0, [0.0; 3], [0.0; 3]),
        };
        Self { force: rendered.force.into(), mode, triangle, weights, normal }
    }
}

/// State of the network in the layout of the interface.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StateData {
    tick: u64,
    x: Vec<[f64; 3]>,
    v: Vec<[f64; 3]>,
    tip: [f64; 3],
    last: OutputData,
}

impl From<BodyState<'_>> for StateData {
    fn from(state: BodyState<'_>) -> Self {
        let rows = |vectors: &[Vec3]| vectors.iter().map(|&vector| vector.into()).collect();
        Self { tick: state.tick, x: rows(state.x), v: rows(state.v), tip: state.tip.into(), last: state.last.into() }
    }
}

/// Arrays for the nodes that a renderer moves, as large as the body.
#[derive(Debug)]
pub struct MovedArrays {
    nodes: Array<u32>,
    x: Array<[f64; 3]>,
    v: Array<[f64; 3]>,
    count: usize,
}

impl MovedArrays {
    /// Allocates the arrays for a body of this many nodes.
    pub fn new(nodes: usize, memory: Memory) -> Self {
        let vectors = || Array::new(&vec![[0.0; 3]; nodes], memory, Access::Write);
        Self { nodes: Array::new(&vec![0; nodes], memory, Access::Write), x: vectors(), v: vectors(), count: 0 }
    }

    /// Returns the number of nodes for which there is room.
    pub fn capacity(&self) -> usize {
        self.x.values().len()
    }

    /// Returns the nodes that the last tick has moved, with their positions, m, and velocities, m/s.
    pub fn get(&self) -> (&[u32], &[[f64; 3]], &[[f64; 3]]) {
        (&self.nodes.values()[..self.count], &self.x.values()[..self.count], &self.v.values()[..self.count])
    }
}

/// More nodes than the body has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooMany(pub u64);

/// A renderer of a library. Calls may come from two threads at once, as the header says.
#[derive(Debug)]
pub struct Instance {
    library: Arc<Library>,
    renderer: NonNull<c_void>,
    nodes: usize,
    memory: Memory,
    // The library may refer to these for as long as the renderer lives.
    _body: BodyArrays,
    _options: CString,
}

// SAFETY: the header lets two threads call a renderer, one of them the functions of the global side and the other those
// of the servo side.
unsafe impl Send for Instance {}
// SAFETY: as above.
unsafe impl Sync for Instance {}

/// A model that a renderer has built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model(NonNull<c_void>);

// SAFETY: models pass from the global thread to the servo thread and back.
unsafe impl Send for Model {}

impl Model {
    /// Returns the model's address, as its name for another process.
    pub fn name(self) -> u64 {
        self.0.as_ptr().expose_provenance() as u64
    }

    /// Returns the model of a name that [`name`](Self::name) gave.
    pub fn named(name: u64) -> Option<Self> {
        NonNull::new(ptr::with_exposed_provenance_mut(name as usize)).map(Self)
    }
}

#[derive(Debug)]
struct BodyArrays {
    rest: Array<[f64; 3]>,
    mass: Array<f64>,
    fixed: Array<u8>,
    spring_nodes: Array<[u32; 2]>,
    stiffness: Array<f64>,
    damping: Array<f64>,
    rest_length: Array<f64>,
    triangle_nodes: Array<[u32; 3]>,
}

impl BodyArrays {
    fn new(body: &BodyData, memory: Memory) -> Self {
        Self {
            rest: Array::new(&body.rest, memory, Access::Read),
            mass: Array::new(&body.mass, memory, Access::Read),
            fixed: Array::new(&body.fixed, memory, Access::Read),
            spring_nodes: Array::new(&body.spring_nodes, memory, Access::Read),
            stiffness: Array::new(&body.stiffness, memory, Access::Read),
            damping: Array::new(&body.damping, memory, Access::Read),
            rest_length: Array::new(&body.rest_length, memory, Access::Read),
            triangle_nodes: Array::new(&body.triangle_nodes, memory, Access::Read),
        }
    }
}

impl Instance {
    /// Creates a renderer.
    ///
    /// # Errors
    /// If the library refuses the body or the setup, with its message.
    pub fn create(library: Arc<Library>, body: &BodyData, setup: &SetupData, memory: Memory) -> Result<Self, String> {
        let options = CString::new(setup.options.as_str()).map_err(|_| "its options contain a NUL character")?;
        let arrays = BodyArrays::new(body, memory);
        let c_body = CBody {
            size: size_of::<CBody>() as u64,
            nodes: body.rest.len() as u64,
            rest: arrays.rest.as_ptr().cast(),
            mass: arrays.mass.as_ptr(),
            fixed: arrays.fixed.as_ptr(),
            springs: body.stiffness.len() as u64,
            spring_nodes: arrays.spring_nodes.as_ptr().cast(),
            stiffness: arrays.stiffness.as_ptr(),
            damping: arrays.damping.as_ptr(),
            rest_length: arrays.rest_length.as_ptr(),
            triangles: body.triangle_nodes.len() as u64,
            triangle_nodes: arrays.triangle_nodes.as_ptr().cast(),
            gravity: body.gravity,
            drag: body.drag,
        };
        let c_setup = CSetup {
            size: size_of::<CSetup>() as u64,
            tick_s: setup.tick_s,
            cycle_s: setup.cycle_s,
            law: setup.law,
            surface: setup.surface,
            friction_static: setup.friction[0],
            friction_kinetic: setup.friction[1],
            adhesion: setup.adhesion,
            radius: setup.radius,
            options: options.as_ptr(),
        };
        // SAFETY: both structs and all arrays are complete and live through the call; the arrays, through the renderer.
        let renderer = unsafe { (library.create)(&c_body, &c_setup) };
        match NonNull::new(renderer) {
            Some(renderer) => {
                Ok(Self { library, renderer, nodes: body.rest.len(), memory, _body: arrays, _options: options })
            }
            None => Err(library.message_of(ptr::null_mut()).unwrap_or_else(|| "it gives no reason".to_owned())),
        }
    }

    /// Whether the library reports the nodes that it moves.
    pub fn moves_nodes(&self) -> bool {
        self.library.moved.is_some()
    }

    /// Allocates arrays for the nodes that the renderer moves.
    pub fn moved_arrays(&self) -> MovedArrays {
        MovedArrays::new(if self.moves_nodes() { self.nodes } else { 0 }, self.memory)
    }

    /// Builds a model; `None` if the library cannot.
    pub fn build(&self, state: &StateData) -> Option<Model> {
        let lent = |values: &[[f64; 3]]| Array::new(values, self.memory, Access::Read);
        let (x, v, tip) = (lent(&state.x), lent(&state.v), Array::new(&state.tip, self.memory, Access::Read));
        let c_state = CState {
            size: size_of::<CState>() as u64,
            tick: state.tick,
            x: x.as_ptr().cast(),
            v: v.as_ptr().cast(),
            tip: tip.as_ptr(),
            mode: state.last.mode,
            triangle: state.last.triangle,
            weights: state.last.weights,
            normal: state.last.normal,
        };
        // SAFETY: the struct and its arrays live through the call; `build` may run beside the servo thread's calls.
        NonNull::new(unsafe { (self.library.build)(self.renderer.as_ptr(), &c_state) }).map(Model)
    }

    /// Puts a model to use. Returns the model that was in use.
    pub fn swap(&self, model: Model) -> Option<Model> {
        // SAFETY: the model was built by this renderer and is in nobody else's hands.
        NonNull::new(unsafe { (self.library.swap)(self.renderer.as_ptr(), model.0.as_ptr()) }).map(Model)
    }

    /// Renders a tick into `output`, which is lent to the library.
    ///
    /// # Errors
    /// With the fault's number.
    pub fn tick(&self, before: [f64; 3], tip: [f64; 3], output: &mut TickOutput) -> Result<OutputData, i32> {
        let lent = output.0.as_mut_ptr();
        // SAFETY: the output is one struct of this size; a value that the library does not set stays zero.
        let fault = unsafe {
            lent.write(TickOutput::EMPTY);
            (self.library.tick)(self.renderer.as_ptr(), before.as_ptr(), tip.as_ptr(), lent)
        };
        let COutput { force, mode, triangle, weights, normal, .. } = output.0.values()[0];
        if fault == 0 { Ok(OutputData { force, mode, triangle, weights, normal }) } else { Err(fault) }
    }

    /// Copies the nodes that the last tick has moved into arrays of [`moved_arrays`](Self::moved_arrays).
    ///
    /// # Errors
    /// If there are more than the body has.
    pub fn moved(&self, arrays: &mut MovedArrays) -> Result<(), TooMany> {
        let Some(moved) = self.library.moved else { return Ok(()) };
        let (nodes, x, v) = (arrays.nodes.as_mut_ptr(), arrays.x.as_mut_ptr().cast(), arrays.v.as_mut_ptr().cast());
        // SAFETY: the arrays have room for every node of the body, which is the capacity.
        let count = unsafe { moved(self.renderer.as_ptr(), self.nodes as u64, nodes, x, v) };
        arrays.count = usize::try_from(count).ok().filter(|&count| count <= self.nodes).ok_or(TooMany(count))?;
        Ok(())
    }

    /// Frees a model that is not in use.
    pub fn dispose(&self, model: Model) {
        // SAFETY: the model was never swapped in, or `swap` has returned it; its owner gives it up here.
        unsafe { (self.library.dispose)(model.0.as_ptr()) };
    }

    /// Returns what went wrong last, in the library's words.
    pub fn message(&self) -> Option<String> {
        self.library.message_of(self.renderer.as_ptr())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: no thread has the renderer any more.
        unsafe { (self.library.destroy)(self.renderer.as_ptr()) };
    }
}

/// Room for the result of a tick.
#[derive(Debug)]
pub struct TickOutput(Array<COutput>);

impl TickOutput {
    const EMPTY: COutput = COutput {
        size: size_of::<COutput>() as u64,
        force: [0.0; 3],
        mode: abi::MODE_FREE,
        triangle: 0,
        weights: [0.0; 3],
        normal: [0.0; 3],
    };

    /// Allocates the room.
    pub fn new(memory: Memory) -> Self {
        Self(Array::new(&[Self::EMPTY], memory, Access::Write))
    }
}
