//! Time integration of the full network, its static equilibrium, and stability limits of explicit steps.

pub mod constraint;
mod explicit;
pub mod implicit;
pub mod integrators;
mod rk4;
pub mod settle;
pub mod sparse;
pub mod stability;
pub mod statics;
