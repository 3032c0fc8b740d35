//! Forward and inverse kinematics of a PHANTOM Premium 1.5.
//!
//! Geometry, home position and Jacobian: M. C. Çavuşoğlu, D. Feygin, F. Tendick, *A critical study of the mechanical
//! and electrical properties of the PHANToM haptic interface and improvements for high performance control*, Presence
//! 11(6), 2002. In device axes (x right, y up, z towards the user) the tip is at the origin where θ = 0. θ₁ turns the
//! device about y; θ₂ and θ₃ are *absolute* angles of the upper link to the horizontal and of the fore link to the
//! vertical, since both motors sit on the base. ρ = l₁c₂ + l₂s₃ is how far the tip reaches out from the axis of θ₁.

use std::fmt::{self, Display};

use thiserror::Error;

use crate::{Mat3, Vec3};

/// Length l₁ of the upper link, m.
pub const UPPER_LINK: f64 = 0.215;
/// Length l₂ of the fore link, m.
pub const FORE_LINK: f64 = 0.170;
/// Least ρ accepted in a pose, m: on the axis θ₁ is undefined, and no torque of joint 1 pushes the tip. At 1 mm
/// one encoder count of joint 1 is 0.1 µm and one step of its current 0.05 N.
pub const LEAST_REACH: f64 = 1e-3;

/// Joint angles that have limits.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::kinematics::{Joint, PoseError, check};
///
/// let angles = Vec3::new(0.0, 0.2, 0.5);
/// assert!((Joint::Elbow.angle(&angles) - 0.3).abs() < 1e-15); // θ₃ − θ₂: both motors sit on the base
/// let (_, limit_deg) = Joint::Elbow.limits_deg();
/// let beyond = Vec3::new(0.0, 0.0, (limit_deg + 1.0).to_radians());
/// assert!(matches!(check(&beyond), Err(PoseError::JointLimit { joint: Joint::Elbow, .. })));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// θ₁, the turn about the vertical.
    Turn,
    /// θ₂, the upper link.
    Upper,
    /// θ₃, the fore link.
    Fore,
    /// θ₃ − θ₂, the angle between the links.
    Elbow,
}

impl Joint {
    /// All joints.
    pub const ALL: [Joint; 4] = [Joint::Turn, Joint::Upper, Joint::Fore, Joint::Elbow];

    /// Returns least and largest angle, degrees. Published limits differ; these are what two sets of them have in
    /// common.
    pub fn limits_deg(self) -> (f64, f64) {
        match self {
            Joint::Turn => (-90.0, 90.0),
            Joint::Upper => (-61.0, 113.0),
            Joint::Fore => (-23.0, 167.0),
            Joint::Elbow => (-53.0, 54.0),
        }
    }

    /// Returns the joint's angle, rad, among these joint angles.
    pub fn angle(self, angles: &Vec3) -> f64 {
        match self {
            Joint::Turn => angles.x,
            Joint::Upper => angles.y,
            Joint::Fore => angles.z,
            Joint::Elbow => angles.z - angles.y,
        }
    }
}

impl Display for Joint {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Joint::Turn => "the turning joint (θ₁)",
            Joint::Upper => "the upper link (θ₂)",
            Joint::Fore => "the fore link (θ₃)",
            Joint::Elbow => "the elbow (θ₃ − θ₂)",
        })
    }
}

/// A reason why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PoseError {
    /// An angle or a coordinate is NaN or infinite.
    #[error("the pose is not finite")]
    NotFinite,
    /// The tip is too near to the shoulder, or too far.
    #[error(
        "the tip would be {distance_m:.4} m from the shoulder, but the links reach from {:.3} m to {:.3} m only",
        UPPER_LINK - FORE_LINK, UPPER_LINK + FORE_LINK
    )]
    Unreachable {
        /// Distance from the fixed end of the upper link, m.
        distance_m: f64,
    },
    /// The tip is on the axis of the turning joint, or beyond it.
    #[error(
        "the tip is {reach_m:.4} m in front of the axis of the turning joint (θ₁), where its angle is undefined; \
         it needs {LEAST_REACH} m"
    )]
    Singular {
        /// Distance ρ from the axis of the turning joint, m.
        reach_m: f64,
    },
    /// A joint is beyond its limits.
    #[error(
        "{joint} would be at {angle_deg:.2}°, beyond its limits of {}° and {}°",
        joint.limits_deg().0, joint.limits_deg().1
    )]
    JointLimit {
        /// The joint.
        joint: Joint,
        /// Angle of the joint, degrees.
        angle_deg: f64,
    },
}

/// Returns the distance ρ of the tip from the axis of θ₁, m.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::kinematics::{FORE_LINK, UPPER_LINK, reach};
///
/// assert_eq!(reach(&Vec3::zeros()), UPPER_LINK); // fore link straight down
/// let stretched = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
/// assert_eq!(reach(&stretched), UPPER_LINK + FORE_LINK);
/// ```
pub fn reach(angles: &Vec3) -> f64 {
    UPPER_LINK * angles.y.cos() + FORE_LINK * angles.z.sin()
}

/// Returns the tip in device axes, m: (s₁ρ, l₂ − l₂c₃ + l₁s₂, c₁ρ − l₁).
///
/// ```
/// use stickslip::{Vec3, device::phantom::kinematics::{forward, reach}};
///
/// assert_eq!(forward(&Vec3::zeros()), Vec3::zeros()); // home
/// let angles = Vec3::new(0.3, 0.2, 0.1);
/// let turned = Vec3::new(0.0, 0.2, 0.1);
/// assert_eq!(forward(&angles).y, forward(&turned).y); // the first joint turns about the vertical,
/// assert!((forward(&angles).x - reach(&turned) * 0.3_f64.sin()).abs() < 1e-15); // at the distance ρ
/// ```
pub fn forward(angles: &Vec3) -> Vec3 {
    let (s1, c1) = angles.x.sin_cos();
    let reach = reach(angles);
    let height = FORE_LINK * (1.0 - angles.z.cos()) + UPPER_LINK * angles.y.sin();
    Vec3::new(s1 * reach, height, c1 * reach - UPPER_LINK)
}

/// Returns the Jacobian J = ∂tip/∂θ, m/rad.
///
/// ```
/// use stickslip::{Vec3, device::phantom::kinematics::{forward, jacobian}};
///
/// let (angles, rates, h) = (Vec3::new(0.3, 0.2, 0.1), Vec3::new(1.0, -2.0, 3.0), 1e-5);
/// let central = (forward(&(angles + rates * h)) - forward(&(angles - rates * h))) / (2.0 * h);
/// assert!((jacobian(&angles) * rates - central).norm() < 1e-9); // ṗ = Jθ̇
/// ```
pub fn jacobian(angles: &Vec3) -> Mat3 {
    let [(s1, c1), (s2, c2), (s3, c3)] = [angles.x, angles.y, angles.z].map(f64::sin_cos);
    let reach = reach(angles);
    Mat3::new(
        c1 * reach,
        -UPPER_LINK * s1 * s2,
        FORE_LINK * s1 * c3,
        0.0,
        UPPER_LINK * c2,
        FORE_LINK * s3,
        -s1 * reach,
        -UPPER_LINK * c1 * s2,
        FORE_LINK * c1 * c3,
    )
}

/// Returns the joint angles of a tip position (device axes), rad, by the triangle of shoulder, elbow and tip.
///
/// # Errors
/// If there are none, or none that [`check`] accepts.
///
/// ```
/// use stickslip::{Vec3, device::phantom::kinematics::{PoseError, forward, inverse}};
///
/// let angles = Vec3::new(0.3, 0.2, 0.1);
/// assert!((inverse(&forward(&angles))? - angles).norm() < 1e-14);
/// assert!(matches!(inverse(&Vec3::x()), Err(PoseError::Unreachable { .. }))); // 1 m to the right
/// # Ok::<(), PoseError>(())
/// ```
pub fn inverse(tip: &Vec3) -> Result<Vec3, PoseError> {
    let (forward, height) = (tip.z + UPPER_LINK, tip.y - FORE_LINK);
    let reach = forward.hypot(tip.x);
    let distance = reach.hypot(height);
    if !distance.is_finite() {
        return Err(PoseError::NotFinite);
    }
    let (l1, l2) = (UPPER_LINK, FORE_LINK);
    let at_shoulder = (l1 * l1 + distance * distance - l2 * l2) / (2.0 * l1 * distance);
    let at_elbow = (l1 * l1 + l2 * l2 - distance * distance) / (2.0 * l1 * l2);
    if !(at_shoulder.abs() <= 1.0 && at_elbow.abs() <= 1.0) {
        return Err(PoseError::Unreachable { distance_m: distance });
    }
    let upper = at_shoulder.acos() + height.atan2(reach);
    let angles = Vec3::new(tip.x.atan2(forward), upper, upper + at_elbow.acos() - std::f64::consts::FRAC_PI_2);
    check(&angles)?;
    Ok(angles)
}

/// Checks that the device can take this pose.
///
/// # Errors
/// If it is not finite, a joint is beyond a limit, or ρ is less than [`LEAST_REACH`].
///
/// ```
/// use stickslip::{Vec3, device::phantom::kinematics::{PoseError, check}};
///
/// assert_eq!(check(&Vec3::zeros()), Ok(()));
/// assert_eq!(check(&Vec3::new(0.0, f64::NAN, 0.0)), Err(PoseError::NotFinite));
/// let error = check(&Vec3::new(2.0, 0.0, 0.0)).expect_err("114.6°");
/// assert!(error.to_string().starts_with("the turning joint (θ₁) would be at 114.59°, beyond its limits"));
/// ```
pub fn check(angles: &Vec3) -> Result<(), PoseError> {
    if !angles.iter().all(|angle| angle.is_finite()) {
        return Err(PoseError::NotFinite);
    }
    let reach_m = reach(angles);
    if !(reach_m >= LEAST_REACH) {
        return Err(PoseError::Singular { reach_m });
    }
    for joint in Joint::ALL {
        let (lower, upper) = joint.limits_deg();
        let angle_deg = joint.angle(angles).to_degrees();
        if !(angle_deg >= lower && angle_deg <= upper) {
            return Err(PoseError::JointLimit { joint, angle_deg });
        }
    }
    Ok(())
}

/// Returns J⁻ᵀτ, the force at the tip (device axes, N) that joint torques (N·m) exert. In cylindrical coordinates
/// τ₁ = ρF_φ, τ₂ = l₁(c₂F_y − s₂F_ρ), τ₃ = l₂(s₃F_y + c₃F_ρ). Finite for every pose that [`check`] accepts.
///
/// ```
/// use stickslip::{Vec3, device::phantom::kinematics::{jacobian, tip_force}};
///
/// let (angles, torque) = (Vec3::new(0.3, 0.2, 0.1), Vec3::new(0.1, 0.2, -0.1));
/// let force = tip_force(&angles, &torque);
/// assert!((jacobian(&angles).transpose() * force - torque).norm() < 1e-15); // τ = JᵀF
/// ```
pub fn tip_force(angles: &Vec3, torque: &Vec3) -> Vec3 {
    let [(s1, c1), (s2, c2), (s3, c3)] = [angles.x, angles.y, angles.z].map(f64::sin_cos);
    let (upper, fore) = (torque.y / UPPER_LINK, torque.z / FORE_LINK);
    let between = (angles.z - angles.y).cos();
    let around = torque.x / reach(angles);
    let outward = (fore * c2 - upper * s3) / between;
    let upward = (upper * c3 + fore * s2) / between;
    Vec3::new(s1 * outward + c1 * around, upward, c1 * outward - s1 * around)
}
