//! A library's renderer in this process, on the threads that call it.

use std::sync::Arc;

use super::arrays::Memory;
use super::library::{Instance, Library, Model, MovedArrays, SetupData, StateData, TickOutput};
use super::{LibraryError, RendererLibrary};
use crate::Vec3;
use crate::contact::renderer::{Body, BodyState, MovedNodes, Rendered, Renderer, RendererFault, RendererModel, Setup};

/// Why the copy of a run with a library's renderer does not go on.
pub(super) const NOT_COPIED: RendererFault =
    RendererFault("a renderer in a library has state that cannot be copied: prepare the scene again instead");
/// Why a tick has no result.
pub(super) const NO_MODE: RendererFault = RendererFault("its mode is none of the interface");
/// Why a scene is refused.
pub(super) const OWN_LAW: RendererFault = RendererFault("a custom contact law has no number in the C interface");

/// A library's renderer in this process. A copy of it cannot go on.
#[derive(Debug)]
pub struct LibraryRenderer {
    library: Arc<Library>,
    options: String,
    instance: Option<Arc<Instance>>,
}

impl LibraryRenderer {
    /// Loads a library.
    ///
    /// # Errors
    /// If it cannot be loaded, lacks a function, or has another version of the interface.
    pub fn open(library: &RendererLibrary) -> Result<Self, LibraryError> {
        let loaded = Arc::new(Library::load(library.path())?);
        Ok(Self { library: loaded, options: library.options().to_owned(), instance: None })
    }
}

impl Clone for LibraryRenderer {
    fn clone(&self) -> Self {
        Self { library: self.library.clone(), options: self.options.clone(), instance: None }
    }
}

impl Renderer for LibraryRenderer {
    fn create(&mut self, body: Body<'_>, setup: &Setup) -> Result<(), RendererFault> {
        let setup = SetupData::new(setup, &self.options).ok_or(OWN_LAW)?;
        let instance = Instance::create(self.library.clone(), &body.into(), &setup, Memory::Ordinary);
        self.instance = Some(Arc::new(instance.map_err(RendererFault::with_text)?));
        Ok(())
    }

    fn build(&mut self, _: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        let instance = self.instance.clone().ok_or(NOT_COPIED)?;
        let model = instance.build(&StateData::from(state)).ok_or_else(|| no_model(instance.message()))?;
        Ok(Box::new(LibraryModel {
            moved: Moved::new(instance.moved_arrays()),
            output: TickOutput::new(Memory::Ordinary),
            instance: Some(instance),
            model: Some(model),
            is_in_use: false,
        }))
    }
}

/// Returns the fault of a model that could not be built.
pub(super) fn no_model(message: Option<String>) -> RendererFault {
    RendererFault::with_text(match message {
        Some(message) => format!("stickslip_renderer_build: {message}"),
        None => "stickslip_renderer_build returned NULL".to_owned(),
    })
}

/// Returns the fault of a tick that failed with a number.
pub(super) fn tick_failed(number: i32, message: Option<String>) -> RendererFault {
    RendererFault::with_text(match message {
        Some(message) => format!("stickslip_renderer_tick returned {number}: {message}"),
        None => format!("stickslip_renderer_tick returned {number}"),
    })
}

/// Returns the fault of a renderer that moves too many nodes.
pub(super) fn moves_too_many(count: u64) -> RendererFault {
    RendererFault::with_text(format!("stickslip_renderer_moved: {count} nodes are more than the body has"))
}

/// Nodes that a library has moved, as vectors.
#[derive(Debug)]
struct Moved {
    arrays: MovedArrays,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
}

impl Moved {
    fn new(arrays: MovedArrays) -> Self {
        let room = || Vec::with_capacity(arrays.capacity());
        Self { x: room(), v: room(), arrays }
    }

    /// Takes over what the library has written. Allocates nothing.
    fn update(&mut self) {
        let (_, x, v) = self.arrays.get();
        self.x.clear();
        self.v.clear();
        self.x.extend(x.iter().map(|&x| Vec3::from(x)));
        self.v.extend(v.iter().map(|&v| Vec3::from(v)));
    }
}

/// A model of a library's renderer. It allocates nothing in a tick that succeeds.
#[derive(Debug)]
struct LibraryModel {
    /// `None` in a copy.
    instance: Option<Arc<Instance>>,
    /// The model that is disposed of with this value, or that is in use.
    model: Option<Model>,
    /// Whether the renderer uses the model, and frees it itself.
    is_in_use: bool,
    moved: Moved,
    output: TickOutput,
}

impl Clone for LibraryModel {
    fn clone(&self) -> Self {
        Self {
            instance: None,
            model: None,
            is_in_use: false,
            moved: Moved::new(MovedArrays::new(0, Memory::Ordinary)),
            output: TickOutput::new(Memory::Ordinary),
        }
    }
}

impl RendererModel for LibraryModel {
    fn take_over(&mut self, old: Option<&mut dyn RendererModel>) {
        let (Some(instance), Some(model)) = (&self.instance, self.model) else { return };
        let returned = instance.swap(model);
        self.is_in_use = true;
        let old = old.and_then(|old| (old as &mut dyn std::any::Any).downcast_mut::<Self>());
        if let Some(old) = old {
            (old.model, old.is_in_use) = (returned, false);
        }
    }

    fn tick(&mut self, before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
        let instance = self.instance.as_ref().ok_or(NOT_COPIED)?;
        let output = instance
            .tick(before.into(), tip.into(), &mut self.output)
            .map_err(|number| tick_failed(number, instance.message()))?;
        if instance.moves_nodes() {
            instance.moved(&mut self.moved.arrays).map_err(|many| moves_too_many(many.0))?;
            self.moved.update();
        }
        output.rendered().ok_or(NO_MODE)
    }

    fn moved(&self) -> Option<MovedNodes<'_>> {
        let moves = self.instance.as_ref().is_some_and(|instance| instance.moves_nodes());
        moves.then(|| MovedNodes { nodes: self.moved.arrays.get().0, x: &self.moved.x, v: &self.moved.v })
    }
}

impl Drop for LibraryModel {
    fn drop(&mut self) {
        if let (Some(instance), Some(model), false) = (&self.instance, self.model, self.is_in_use) {
            instance.dispose(model);
        }
    }
}
