//! The deformable object: from a mesh to the network that moves, and to the local model of it
//! that the haptic loop runs.

pub mod coarse;
pub mod columns;
pub mod condensation;
pub mod elimination;
pub mod linearization;
pub mod local;
pub mod material;
pub mod mesh;
pub mod network;
pub mod patch;
pub mod springs;
pub mod step;
pub mod surface;
pub mod work;
