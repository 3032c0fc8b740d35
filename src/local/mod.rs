//! The local model that the haptic loop runs: the patch, its linear forces, the exterior model, and its own
//! integrators.

pub mod coarse;
pub mod condensation;
pub mod elimination;
pub mod error;
pub mod linearization;
pub mod model;
pub mod patch;
pub mod step;
