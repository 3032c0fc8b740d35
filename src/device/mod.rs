//! The instrument in the user's hand, from the path it follows to the modelled PHANTOM 1.5. It knows only vectors.

pub mod coupled;
pub mod coupling;
pub mod instrument;
pub mod path;
pub mod phantom;
