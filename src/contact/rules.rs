//! The contact settings of a scene, apart from the surface: law, scheme and rigid ground.

use super::law::Law;
use crate::surface::support::Metric;
use crate::word::words;

/// A contact point with less than this share of its weight on free patch nodes is rigid.
pub const RIGID_BELOW: f64 = 0.5;

/// Rule by which the mesh is moved out of (or back to) the tip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Deformation {
    /// Moves every free support node by d/Σ_free w: the triangle is pushed (the paper).
    #[default]
    Rigid,
    /// Moves node i by wᵢd/s: the smallest displacement that brings the contact point to the tip.
    LeastNorm,
}

words!(Deformation { Rigid = "rigid", LeastNorm = "least-norm" });

/// Response of a surface that cannot yield: a spring and a damper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Damping, N·s/m.
    pub damping: f64,
}

impl Default for Wall {
    /// Returns 1 kN/m, without damping.
    fn default() -> Self {
        Self { stiffness: 1000.0, damping: 0.0 }
    }
}

/// Scheme by which a contact constrains the mesh.
///
/// ```
/// use stickslip::{contact::rules::{Deformation, Scheme}, surface::support::Metric};
///
/// let paper = Scheme::Geometric { deformation: Deformation::Rigid, metric: Metric::Euclidean };
/// assert_eq!((paper, paper.metric()), (Scheme::default(), Metric::Euclidean));
/// // An impulse acts through the masses, whatever P of the global cycle does.
/// assert_eq!(Scheme::Velocity.metric(), Metric::Mass);
/// assert_eq!(Scheme::Velocity.overwrite_metric(), Metric::Euclidean);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scheme {
    /// The mesh is moved to the tip and stopped there (the paper). Moving it takes no work.
    Geometric {
        /// Rule by which the mesh is moved to the tip.
        deformation: Deformation,
        /// Inner product of P and Q.
        metric: Metric,
    },
    /// An impulse makes the contact point follow the tip, and the instrument feels all of it. Momentum and energy are
    /// balanced. The mass m_c under the tip is felt at first contact as m_c v/h, which grows without bound with the rate.
    Velocity,
    /// The contact point follows the tip as under [`Velocity`](Self::Velocity), but the instrument feels the internal
    /// forces alone, not the inertia of the contact point. The force converges as the tick becomes shorter.
    Massless,
}

impl Default for Scheme {
    /// Returns the paper's scheme.
    fn default() -> Self {
        Scheme::Geometric { deformation: Deformation::default(), metric: Metric::default() }
    }
}

impl Scheme {
    /// Returns the inner product in which a tick projects. An impulse acts through the masses.
    pub fn metric(self) -> Metric {
        match self {
            Scheme::Geometric { metric, .. } => metric,
            Scheme::Velocity | Scheme::Massless => Metric::Mass,
        }
    }

    /// Returns the inner product of the P with which a cycle holds the contact point under
    /// [`SyncMode::Overwrite`](crate::multirate::global::SyncMode::Overwrite): the paper's, unless the scene says
    /// otherwise.
    pub fn overwrite_metric(self) -> Metric {
        match self {
            Scheme::Geometric { metric, .. } => metric,
            Scheme::Velocity | Scheme::Massless => Metric::Euclidean,
        }
    }

    /// Whether the scheme constrains velocities by an impulse, which every integrator takes. The geometric scheme moves
    /// the mesh, which only the explicit one does.
    pub fn is_impulsive(self) -> bool {
        match self {
            Scheme::Geometric { .. } => false,
            Scheme::Velocity | Scheme::Massless => true,
        }
    }
}

/// All contact settings of a scene except the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactRules {
    /// The contact law.
    pub law: Law,
    /// The scheme by which the law acts on the mesh.
    pub scheme: Scheme,
    /// Adhesion A ≥ 0, N: a contact is under tension, and exerts no force, only where F_N ≤ −A. Infinite for a contact
    /// that is never under tension.
    pub adhesion_n: f64,
    /// Stiffness and damping of rigid ground.
    pub wall: Wall,
}
