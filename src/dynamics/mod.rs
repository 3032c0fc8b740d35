//! Time: integrators of the full model, the global cycle, limits of explicit steps, energy.

pub mod energy;
mod explicit;
pub mod global;
pub mod implicit;
pub mod integrators;
pub mod settle;
pub mod stability;
pub mod statics;
