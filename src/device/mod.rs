//! The instrument in the user's hand, and what protects it.

pub mod coupled;
pub mod coupling;
pub mod failsafe;
pub mod instrument;
pub mod phantom;
