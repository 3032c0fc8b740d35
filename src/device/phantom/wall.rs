//! Passivity bounds of a virtual wall: the stiffness up to which the sampled loop gives out no energy.

use super::Phantom;
use super::kinematics::{jacobian, tip_force};
use crate::Vec3;

/// Two bounds of a wall's stiffness in one direction, for the device alone; the user's hand only raises them.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::path::{TipPath, Waypoint};
/// use stickslip::device::phantom::{Phantom, PhantomSettings};
///
/// let still = TipPath::new(vec![Waypoint { time: 0.0, position: Vec3::zeros() }])?;
/// let settings = PhantomSettings::default();
/// let bounds = |tick| Ok::<_, Box<dyn std::error::Error>>(
///     Phantom::new(settings, &still, tick)?.wall_bounds(&Vec3::z(), 0.0)
/// );
/// let (slow, fast) = (bounds(1e-3)?, bounds(1e-4)?);
/// // Ten times the rate, ten times the stiffness that damping makes passive; the bound by resolution ignores the rate.
/// assert!((fast.by_damping_n_per_m / slow.by_damping_n_per_m - 10.0).abs() < 1e-12);
/// assert_eq!(fast.by_friction_n_per_m, slow.by_friction_n_per_m);
/// assert_eq!(slow.passive_n_per_m(), slow.by_damping_n_per_m.min(slow.by_friction_n_per_m));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallBounds {
    /// Bound by damping, N/m, 2(b − |B|)/h, at least 0: J. E. Colgate, G. Schenkel, *Passivity of a class of
    /// sampled-data systems*, American Control Conference 1994, solved for the stiffness. b is the device's viscous
    /// damping at the tip, B the wall's, h the tick.
    pub by_damping_n_per_m: f64,
    /// Bound by friction, N/m, 2f_c/Δ; infinite if nothing is quantised: J. J. Abbott, A. M. Okamura, *Effects of
    /// position quantization and sampling rate on virtual-wall passivity*, IEEE Transactions on Robotics 21(5), 2005.
    /// f_c is the device's Coulomb friction at the tip, Δ its resolution.
    pub by_friction_n_per_m: f64,
}

impl WallBounds {
    /// Returns the stiffness below which the wall is passive at all speeds and positions, N/m: the smaller bound
    /// (Abbott, Okamura).
    pub fn passive_n_per_m(&self) -> f64 {
        self.by_damping_n_per_m.min(self.by_friction_n_per_m)
    }
}

impl Phantom {
    /// Returns the bounds for a wall with this normal (scene axes, of length 1) and damping, N·s/m, in the pose
    /// measured last. Joints' friction and damping act through θ̇ = J⁻¹n̂; Δ is the largest step along n̂ that one
    /// count makes.
    pub fn wall_bounds(&self, normal: &Vec3, wall_damping: f64) -> WallBounds {
        let settings = self.settings();
        let normal = settings.axes.rotation * normal;
        let angles = &self.measured;
        // n̂ · J⁻ᵀe for each joint.
        let rates = Vec3::from_fn(|joint, _| normal.dot(&tip_force(angles, &Vec3::ith(joint, 1.0))));
        let damping = settings.joints.damping.dot(&rates.component_mul(&rates));
        let friction = settings.joints.friction.dot(&rates.abs());
        let step = jacobian(angles).tr_mul(&normal).component_mul(&settings.actuation.angle_step()).amax();
        WallBounds {
            by_damping_n_per_m: (2.0 * (damping - wall_damping.abs()) / self.tick_s).max(0.0),
            by_friction_n_per_m: if step > 0.0 { 2.0 * friction / step } else { f64::INFINITY },
        }
    }
}
