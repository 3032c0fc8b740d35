//! What passes between the two sides: a model down once a cycle, the cycle just past up.

use super::trajectory::Trajectory;
use crate::Vec3;
use crate::contact::renderer::RendererModel;
use crate::contact::state::Contact;
use crate::local::model::{LocalModel, LocalState};

/// Goes up at a boundary.
#[derive(Debug, Clone)]
pub struct CycleMessage {
    /// Where the patch went.
    pub trajectory: Trajectory,
    /// The contact at the boundary.
    pub contact: Option<Contact>,
    /// The tip at the boundary, m.
    pub tip: Vec3,
}

/// Goes down at a boundary, or some ticks later.
#[derive(Debug, Clone)]
pub struct ModelMessage {
    /// The model of the next cycle.
    pub model: LocalModel,
    /// Its state, to be merged with that of the local side.
    pub state: LocalState,
    /// The model of a renderer of one's own, which takes the local model's place.
    pub renderer: Option<Box<dyn RendererModel>>,
}
