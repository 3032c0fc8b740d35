//! Instruments in the user's hand, from a tip on a path to the modelled PHANTOM 1.5. This module deals in vectors only.

pub mod coupled;
pub mod coupling;
pub mod instrument;
pub mod path;
pub mod phantom;
#[cfg(feature = "files")]
pub mod recording;
pub mod sampling;
