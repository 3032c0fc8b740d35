//! The global and local sides, their messages and their timing: the global cycle, the servo tick, the timeline, the
//! energy balance and the fail-safe.

pub mod energy;
pub mod failsafe;
pub mod global;
pub mod messages;
pub mod servo;
pub mod timeline;
pub mod trajectory;
