//! The device's structural mode: the links bend, so that the tip in the hand moves against the joints, where the motors
//! and the encoders are. A spring and a damper, equal in all directions, connect the links to a mass at the tip.

use super::hand::Moving;
use crate::Vec3;

/// Settings of the spring between the links and the tip that the hand holds.
///
/// ```
/// use stickslip::{Vec3, device::phantom::{hand::Moving, structure::StructureSettings}};
///
/// let structure = StructureSettings::default();
/// let at = |x, speed| Moving { position: Vec3::x() * x, velocity: Vec3::x() * speed };
/// // 3.5 N bend it by a millimetre.
/// assert!((structure.force_on_links(&at(0.0, 0.0), &at(1e-3, 0.0)).x - 3.5).abs() < 1e-12);
/// assert!((structure.energy(&at(0.0, 0.0), &at(1e-3, 0.0)) - 0.5 * 3.5e-3).abs() < 1e-15);
/// // A tip that moves as the links do loses nothing.
/// assert_eq!(structure.dissipation(&at(0.0, 0.1), &at(1e-3, 0.1)), 0.0);
/// // Against links that are held, the tip swings at √(k/m); against light ones, faster.
/// let held = structure.frequency_hz(f64::INFINITY);
/// assert!((held - (3500.0_f64 / 0.01).sqrt() / std::f64::consts::TAU).abs() < 1e-12);
/// assert!(structure.frequency_hz(0.05) > held);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructureSettings {
    /// Stiffness k, N/m. The default is the published stiffness of the device, 3.5 N/mm.
    pub stiffness: f64,
    /// Mass m of the tip, kg, in addition to the identified inertia of the links. Assumed.
    pub tip_mass: f64,
    /// Damping ratio ζ of the tip while the links are held: c = 2ζ√(km). Assumed.
    pub damping_ratio: f64,
}

impl Default for StructureSettings {
    fn default() -> Self {
        Self { stiffness: 3500.0, tip_mass: 0.01, damping_ratio: 0.05 }
    }
}

impl StructureSettings {
    /// Returns the damping c, N·s/m.
    pub fn damping(&self) -> f64 {
        2.0 * self.damping_ratio * (self.stiffness * self.tip_mass).sqrt()
    }

    /// Returns the force of the tip on the links, k(y − p) + c(ẏ − ṗ), N.
    pub fn force_on_links(&self, links: &Moving, tip: &Moving) -> Vec3 {
        (tip.position - links.position) * self.stiffness + (tip.velocity - links.velocity) * self.damping()
    }

    /// Returns the energy of spring and tip, J.
    pub fn energy(&self, links: &Moving, tip: &Moving) -> f64 {
        0.5 * (self.stiffness * (tip.position - links.position).norm_squared()
            + self.tip_mass * tip.velocity.norm_squared())
    }

    /// Returns the power dissipated by the damper, W.
    pub fn dissipation(&self, links: &Moving, tip: &Moving) -> f64 {
        self.damping() * (tip.velocity - links.velocity).norm_squared()
    }

    /// Returns the frequency of the undamped mode along a direction in which the links have this apparent mass M, kg, and
    /// nobody holds the tip: √(k(1/M + 1/m))/2π, Hz.
    pub fn frequency_hz(&self, apparent_mass: f64) -> f64 {
        (self.stiffness * (1.0 / apparent_mass + 1.0 / self.tip_mass)).sqrt() / std::f64::consts::TAU
    }
}
