//! Actuation: motor currents from a commanded force, and encoder readings from joint angles.

use std::f64::consts::TAU;

use super::kinematics::jacobian;
use crate::Vec3;

/// Settings of motors, gears, encoders and limits.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::{actuation::ActuationSettings, kinematics::tip_force};
///
/// let motors = ActuationSettings::default();
/// let home = Vec3::zeros();
/// // Currents for 1 N up (the device's y), turned back into a force at the tip.
/// let command = motors.command(&home, &Vec3::y());
/// let felt = tip_force(&home, &motors.torque(&command.current));
/// assert!(!command.is_limited && (felt - Vec3::y()).norm() < 1e-3); // 16 bits are fine enough
/// assert_eq!(motors.current_step(), Some(5.5 / 32768.0));
///
/// // Beyond the published 8.5 N the force is scaled down; one that is not finite becomes zero.
/// let strong = motors.command(&home, &(Vec3::y() * 20.0));
/// assert!(strong.is_limited);
/// assert!(tip_force(&home, &motors.torque(&strong.current)).norm() <= 8.5);
/// assert_eq!(motors.command(&home, &Vec3::repeat(f64::NAN)).current, Vec3::zeros());
///
/// // Encoder readings are off by half a count at most.
/// let angles = Vec3::new(0.1, 0.2, 0.3);
/// let off = (motors.encode(&angles) - angles).abs();
/// assert!((0..3).all(|joint| off[joint] <= 0.5 * motors.angle_step()[joint] + 1e-15));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuationSettings {
    /// Torque constant of a motor, N·m/A: Maxon RE 25, 118743.
    pub torque_constant: f64,
    /// Capstan ratio: turns of a motor per turn of its joint.
    pub capstan_ratio: Vec3,
    /// Largest current of a motor, A: its stall current at 24 V.
    pub largest_current: f64,
    /// Number of bits of a current command from −limit to +limit; 0 if it is not quantised. Assumed.
    pub torque_bits: u32,
    /// Bandwidth of the amplifiers, modelled as a first-order lag, Hz. Assumed.
    pub amplifier_bandwidth: f64,
    /// Encoder counts per turn of a motor: 1024 lines, four edges each; 0 if angles are not quantised.
    pub encoder_counts: f64,
    /// Largest force commanded, N: the device's published maximum.
    pub largest_force: f64,
    /// Published continuous force of the device, N.
    pub continuous_force: f64,
    /// Time constant of the mean force that is compared with `continuous_force`, s. Assumed.
    pub thermal_time: f64,
}

impl Default for ActuationSettings {
    fn default() -> Self {
        Self {
            torque_constant: 0.0234,
            capstan_ratio: Vec3::new(13.3, 11.2, 11.2),
            largest_current: 5.5,
            torque_bits: 16,
            amplifier_bandwidth: 1000.0,
            encoder_counts: 4096.0,
            largest_force: 8.5,
            continuous_force: 1.4,
            thermal_time: 10.0,
        }
    }
}

/// A current command for a force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurrentCommand {
    /// Currents commanded to the amplifiers, A.
    pub current: Vec3,
    /// Whether a limit changed the command by more than its last step, or the force was not finite.
    pub is_limited: bool,
}

impl ActuationSettings {
    /// Returns the motor torques at the joints, N·m, for currents in A.
    pub fn torque(&self, current: &Vec3) -> Vec3 {
        self.capstan_ratio.component_mul(current) * self.torque_constant
    }

    /// Returns the step between neighbouring current commands, A; `None` if they are not quantised.
    pub fn current_step(&self) -> Option<f64> {
        (self.torque_bits > 0).then(|| self.largest_current / self.half_steps())
    }

    /// Returns the number of steps from zero current to the limit.
    fn half_steps(&self) -> f64 {
        0.5 * f64::from(self.torque_bits).exp2()
    }

    /// Returns the command for a force at the tip (device axes, N): scaled to the force limit, mapped to torques by Jᵀ,
    /// clamped to the current limit, rounded to a step. A force that is not finite becomes zero current.
    pub fn command(&self, angles: &Vec3, force: &Vec3) -> CurrentCommand {
        let magnitude = force.norm();
        if !magnitude.is_finite() {
            return CurrentCommand { current: Vec3::zeros(), is_limited: true };
        }
        let is_too_strong = magnitude > self.largest_force;
        let force = if is_too_strong { force * (self.largest_force / magnitude) } else { *force };
        let wanted = (jacobian(angles).tr_mul(&force) / self.torque_constant).component_div(&self.capstan_ratio);
        let (limit, half) = (self.largest_current, self.half_steps());
        let current = match self.current_step() {
            // The largest positive command is one step below the limit, as in two's complement.
            Some(step) => wanted.map(|current| (current / step).round().clamp(-half, half - 1.0) * step),
            None => wanted.map(|current| current.clamp(-limit, limit)),
        };
        CurrentCommand { current, is_limited: is_too_strong || wanted.amax() > self.largest_current }
    }

    /// Returns the joint angles read by the encoders, rad: the nearest whole counts.
    pub fn encode(&self, angles: &Vec3) -> Vec3 {
        if self.encoder_counts == 0.0 {
            return *angles;
        }
        let counts_per_rad = self.capstan_ratio * (self.encoder_counts / TAU);
        angles.zip_map(&counts_per_rad, |angle, counts| (angle * counts).round() / counts)
    }

    /// Returns the angles between neighbouring counts, rad; 0 if they are not quantised.
    pub fn angle_step(&self) -> Vec3 {
        if self.encoder_counts == 0.0 {
            return Vec3::zeros();
        }
        self.capstan_ratio.map(|ratio| TAU / (ratio * self.encoder_counts))
    }

    /// Returns ω of the amplifiers' lag i̇ = ω(i_commanded − i), 1/s.
    pub(super) fn amplifier_rate(&self) -> f64 {
        TAU * self.amplifier_bandwidth
    }
}
