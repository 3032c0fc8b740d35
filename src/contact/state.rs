//! The contact between two ticks.

use super::law::Mode;
use crate::surface::geometry::ContactPoint;

/// A contact between two ticks: its material point, and the state that decides where the next tick looks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Material point of the surface.
    pub point: ContactPoint,
    /// State of the contact in its last tick.
    pub state: ContactState,
}

/// State of a contact in its last tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactState {
    /// The contact held its point.
    Stick,
    /// The contact slid without friction, or over rigid ground.
    Slide,
    /// The contact slipped at the Coulomb bound.
    Slip,
    /// The contact was under tension: it exerted no force and is kept until the tip is outside.
    Tension,
}

impl ContactState {
    pub(super) fn after(mode: Mode) -> Self {
        match mode {
            Mode::Stick => ContactState::Stick,
            Mode::Slip => ContactState::Slip,
            Mode::Slide | Mode::Free => ContactState::Slide,
        }
    }
}
