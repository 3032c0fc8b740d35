//! The three contact constraints: what the instrument feels, and how the mesh goes on.

use super::operators::Support;
use crate::Vec3;

/// The constraint between tip and surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// The tip keeps the surface out of its way and nothing else.
    Sliding,
    /// The tip holds the point it touched.
    Sticking,
    /// Sticking up to the Coulomb bound (5), frictional sliding beyond.
    StickSlip {
        /// μ ≥ 0.
        friction: f64,
    },
}

/// What the contact did in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// No force: no contact, or one kept under tension.
    Free,
    /// The contact point is held.
    Stick,
    /// Frictionless, or rigid.
    Slide,
    /// At the Coulomb bound.
    Slip,
}

impl Mode {
    /// The name in a trace.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Free => "free",
            Mode::Stick => "stick",
            Mode::Slide => "slide",
            Mode::Slip => "slip",
        }
    }
}

impl Law {
    /// The force on the instrument, N, for a reaction λ with F_N = λ·n̂ > 0.
    ///
    /// (5) decides between sticking and slipping; (28): beyond it
    /// f̂ = F_N n̂ + μF_N t̂ with t̂ = (λ − F_N n̂)/F_T. F_T = 0 never slips, so t̂ is never formed
    /// from zero.
    pub fn contact_force(self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3) {
        let normal_force = reaction.dot(&normal);
        match self {
            Law::Sliding => (Mode::Slide, normal * normal_force),
            Law::Sticking => (Mode::Stick, reaction),
            Law::StickSlip { friction } => {
                let tangential = reaction - normal * normal_force;
                let tangential_force = tangential.norm();
                let bound = friction * normal_force;
                if tangential_force <= bound {
                    (Mode::Stick, reaction)
                } else {
                    (Mode::Slip, normal * normal_force + tangential * (bound / tangential_force))
                }
            }
        }
    }
}

impl Mode {
    /// Stops the contact point as the mode demands: (12) sticking, (20) and (26) along the normal.
    pub fn project_velocity(self, support: &Support, normal: Vec3, v: &mut [Vec3]) {
        match self {
            Mode::Free => {}
            Mode::Stick => support.project_sticking(v),
            Mode::Slide | Mode::Slip => support.project_sliding(normal, v),
        }
    }
}
