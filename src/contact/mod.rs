//! Contact of the instrument's tip with the surface: collision detection, tracking over the surface, the friction law,
//! and the tick that runs them in order.

pub mod collision;
pub mod impedance;
pub mod law;
pub mod literal;
pub mod local_renderer;
pub mod massless;
pub mod nearest;
pub mod renderer;
pub mod report;
pub mod rules;
pub mod shape;
pub mod simulation;
pub mod smooth_surface;
pub mod state;
mod tick;
