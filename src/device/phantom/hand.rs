//! The hand that holds the stylus, in each axis by itself: stylus –(k₁ ‖ b₁)– mass –(k₂ ‖ b₂)– set-point.
//!
//! M. J. Fu, M. C. Çavuşoğlu, *Human-arm-and-hand-dynamic model with variability analyses for a stylus-based haptic
//! interface*, IEEE Transactions on Systems, Man, and Cybernetics B 42(6), 2012; measured on this device, pen grip.

use crate::Vec3;

/// Parameters of the hand in device axes: x left to right, y up, z fore and aft.
///
/// ```
/// use stickslip::{Vec3, device::phantom::hand::{HandSettings, Moving}};
///
/// let hand = HandSettings::default();
/// let at = |x, speed| Moving { position: Vec3::x() * x, velocity: Vec3::x() * speed };
/// let (target, holds, stylus) = (at(0.003, 0.0), at(0.002, 0.0), at(0.0, 0.0));
/// // The grip is stretched by 2 mm and the arm by 1 mm.
/// assert_eq!(hand.grip_force(&holds, &stylus).x, hand.stylus_stiffness.x * 0.002);
/// assert!((hand.arm_force(&target, &holds).x - hand.arm_stiffness.x * 0.001).abs() < 1e-12);
/// assert_eq!(hand.dissipation(&target, &holds, &stylus), 0.0); // at rest
/// // Moving as one takes ½mv²: the grip and arm are not stretched.
/// let moving = at(0.0, 0.1);
/// assert_eq!(hand.energy(&moving, &moving, &moving), 0.5 * (hand.mass.x * (0.1 * 0.1)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandSettings {
    /// Mass, kg.
    pub mass: Vec3,
    /// Stiffness k₁ of the grip, N/m.
    pub stylus_stiffness: Vec3,
    /// Damping b₁ of the grip, N·s/m.
    pub stylus_damping: Vec3,
    /// Stiffness k₂ of the arm, N/m.
    pub arm_stiffness: Vec3,
    /// Damping b₂ of the arm, N·s/m.
    pub arm_damping: Vec3,
}

impl Default for HandSettings {
    fn default() -> Self {
        Self {
            mass: Vec3::new(0.218, 0.269, 0.204),
            stylus_stiffness: Vec3::new(379.5, 552.4, 769.9),
            stylus_damping: Vec3::new(1.839, 3.609, 0.776),
            arm_stiffness: Vec3::new(78.75, 105.3, 271.7),
            arm_damping: Vec3::new(4.645, 6.430, 18.06),
        }
    }
}

/// A moving point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// Position, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
}

impl HandSettings {
    /// Returns the force of the hand on the stylus, k₁(X − p) + b₁(Ẋ − ṗ), N.
    pub fn grip_force(&self, hand: &Moving, stylus: &Moving) -> Vec3 {
        pull(&self.stylus_stiffness, &self.stylus_damping, hand, stylus)
    }

    /// Returns the force of the arm on the hand's mass, k₂(X_t − X) + b₂(Ẋ_t − Ẋ), N.
    pub fn arm_force(&self, target: &Moving, hand: &Moving) -> Vec3 {
        pull(&self.arm_stiffness, &self.arm_damping, target, hand)
    }

    /// Returns the energy of mass and springs, J.
    pub fn energy(&self, target: &Moving, hand: &Moving, stylus: &Moving) -> f64 {
        let twice = |weights: &Vec3, v: Vec3| weights.dot(&v.component_mul(&v));
        0.5 * (twice(&self.mass, hand.velocity)
            + twice(&self.stylus_stiffness, hand.position - stylus.position)
            + twice(&self.arm_stiffness, target.position - hand.position))
    }

    /// Returns the power dissipated by both dampers, W.
    pub fn dissipation(&self, target: &Moving, hand: &Moving, stylus: &Moving) -> f64 {
        let power = |damping: &Vec3, v: Vec3| damping.dot(&v.component_mul(&v));
        power(&self.stylus_damping, hand.velocity - stylus.velocity)
            + power(&self.arm_damping, target.velocity - hand.velocity)
    }
}

fn pull(stiffness: &Vec3, damping: &Vec3, to: &Moving, from: &Moving) -> Vec3 {
    stiffness.component_mul(&(to.position - from.position)) + damping.component_mul(&(to.velocity - from.velocity))
}
