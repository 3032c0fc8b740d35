//! The report of a tick.

use super::law::Mode;
use super::renderer::Rendered;
use super::shape::Touch;
use crate::Vec3;

/// Result of one tick.
///
/// ```
/// use stickslip::{pipeline, contact::law::Mode, contact::report::TickReport, scene::Scene};
///
/// assert_eq!(TickReport::none().mode, Mode::Free);
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program"); // μ = 1
/// let mut excess_n = 0.0_f64;
/// pipeline::run(&scene, |tick| {
///     let report = tick.report;
///     excess_n = excess_n.max(report.tangential_force() - report.normal_force);
/// })?;
/// assert!(excess_n < 1e-12); // Coulomb's bound, F_T ≤ μF_N
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickReport {
    /// Mode of the contact; free without one.
    pub mode: Mode,
    /// Force commanded to the instrument, before device limits, N.
    pub force: Vec3,
    /// Normal contact force f·n̂, N; 0 when free.
    pub normal_force: f64,
    /// Location of the contact; `None` when free.
    pub touch: Option<Touch>,
    /// Time of collision τ, a fraction of the tick, if the contact began in this tick.
    pub collision_time: Option<f64>,
    /// Whether a contact ended in this tick.
    pub released: bool,
    /// Whether the contact was rigid.
    pub rigid: bool,
    /// Whether the law had no solution for the contact's response, and sliding was solved in its place.
    pub fell_back: bool,
}

impl TickReport {
    /// Returns the report that stands before the first tick.
    pub fn none() -> Self {
        Self::free(false)
    }

    pub(super) fn free(released: bool) -> Self {
        Self {
            mode: Mode::Free,
            force: Vec3::zeros(),
            normal_force: 0.0,
            touch: None,
            collision_time: None,
            released,
            rigid: false,
            fell_back: false,
        }
    }

    pub(super) fn touching(mode: Mode, force: Vec3, touch: Touch) -> Self {
        let normal_force = force.dot(&touch.normal);
        Self { mode, force, normal_force, touch: Some(touch), ..Self::free(false) }
    }

    /// Returns what a renderer's tick would have returned.
    pub fn rendered(&self) -> Rendered {
        let contact = self.touch.map(|touch| (touch.point, touch.normal));
        Rendered { force: self.force, mode: self.mode, contact }
    }

    /// Magnitude of the tangential force |f − (f·n̂) n̂|, N; 0 when free.
    pub fn tangential_force(&self) -> f64 {
        self.touch.map_or(0.0, |touch| (self.force - touch.normal * self.normal_force).norm())
    }
}
