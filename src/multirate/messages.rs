//! Messages between the two sides: a new local model from the global side, the past cycle from the local side.

use super::trajectory::Trajectory;
use crate::Vec3;
use crate::contact::renderer::{Rendered, RendererModel};
use crate::contact::state::Contact;
use crate::local::model::{LocalModel, LocalState};

/// Message of the local side at a cycle boundary.
#[derive(Debug, Clone)]
pub struct CycleMessage {
    /// Path of the patch in the past cycle.
    pub trajectory: Trajectory,
    /// Contact at the boundary, if any.
    pub contact: Option<Contact>,
    /// Tip position at the boundary, m.
    pub tip: Vec3,
    /// Result of the last tick before the boundary, for a custom renderer.
    pub rendered: Rendered,
}

/// Message of the global side at a cycle boundary, or some ticks later.
#[derive(Debug, Clone)]
pub struct ModelMessage {
    /// Local model of the next cycle.
    pub model: LocalModel,
    /// State of the model, to be merged with that of the local side.
    pub state: LocalState,
    /// Model of a custom renderer, which takes the local model's place.
    pub renderer: Option<Box<dyn RendererModel>>,
}
