//! M(θ)θ̈ + C(θ, θ̇)θ̇ + N(θ) = τ: the joint dynamics of a PHANTOM Premium 1.5.
//!
//! M and N with the identified π₁…π₈: Çavuşoğlu, Feygin, Tendick 2002 (see [`kinematics`](super::kinematics)). C is
//! made of the Christoffel symbols of M, so that Ṁ − 2C is skew-symmetric and the motion without friction conserves
//! energy. This makes C₃₂ = ∂M₂₃/∂θ₂ θ̇₂ = −½π₄cos(θ₂ − θ₃)θ̇₂, which some printings give with a +.

use crate::{Mat3, Vec3};

/// Identified inertia parameters π₁…π₆, kg·m².
const INERTIA: [f64; 6] = [2.8328e-3, 1.1319e-3, -0.3912e-3, 0.9123e-3, 2.4264e-3, 0.9319e-3];
/// Identified gravity parameters π₇ and π₈, N·m.
const GRAVITY: [f64; 2] = [-0.01630, -0.07376];
/// Lower bound of the eigenvalues of M in any pose, kg·m²: M₁₁ is at least π₁ − π₂ − |π₃| − π₄, and the block of θ₂ and
/// θ₃ with |M₂₃| = ½π₄ has 0.80e-3.
pub(super) const LEAST_INERTIA: f64 = INERTIA[0] - INERTIA[1] + INERTIA[2] - INERTIA[3];

/// Assumed settings of the joints beyond the identified model.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::dynamics::{JointSettings, gravity};
///
/// let joints = JointSettings::default();
/// let (angles, rest) = (Vec3::new(0.3, 0.2, 0.1), Vec3::zeros());
/// // Motor torques that carry the weight keep it at rest; M θ̈ is the torque beyond that.
/// assert!(joints.acceleration(&angles, &rest, &gravity(&angles)).norm() < 1e-12);
/// let torque = Vec3::new(1e-3, -2e-3, 3e-3);
/// let acceleration = joints.acceleration(&angles, &rest, &(gravity(&angles) + torque));
/// assert!((joints.inertia(&angles) * acceleration - torque).norm() < 1e-15);
/// // In motion, friction dissipates energy whichever way the joints turn.
/// let rates = Vec3::new(1.0, -1.0, 0.5);
/// assert!(joints.resistance(&rates).dot(&rates) > 0.0);
/// let kinetic = joints.energy(&angles, &rates) - joints.energy(&angles, &rest);
/// assert!((kinetic - 0.5 * rates.dot(&(joints.inertia(&angles) * rates))).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSettings {
    /// Viscous damping of each joint, N·m·s/rad. Assumed.
    pub damping: Vec3,
    /// Coulomb friction of each joint, N·m. The default is the device's published backdrive friction of 0.04 N at the
    /// tip, at home.
    pub friction: Vec3,
    /// Speed ω over which the friction τ_c tanh(θ̇/ω) changes sign, rad/s. Assumed.
    pub friction_speed: f64,
    /// Inertia of the rotors seen from the joints, kg·m², added to M's diagonal. Zero by default: the identified M is
    /// taken to contain it.
    pub rotor_inertia: Vec3,
}

impl Default for JointSettings {
    fn default() -> Self {
        Self {
            damping: Vec3::repeat(5e-4),
            friction: Vec3::new(8.6e-3, 8.6e-3, 6.8e-3),
            friction_speed: 0.01,
            rotor_inertia: Vec3::zeros(),
        }
    }
}

impl JointSettings {
    /// Returns the inertia matrix M, kg·m².
    pub fn inertia(&self, angles: &Vec3) -> Mat3 {
        let [p1, p2, p3, p4, p5, p6] = INERTIA;
        let (t2, t3) = (angles.y, angles.z);
        let turn = p1 + p2 * (2.0 * t2).cos() + p3 * (2.0 * t3).cos() + p4 * t2.cos() * t3.sin();
        let between = -0.5 * p4 * (t2 - t3).sin();
        Mat3::new(turn, 0.0, 0.0, 0.0, p5, between, 0.0, between, p6) + Mat3::from_diagonal(&self.rotor_inertia)
    }

    /// Returns θ̈, rad/s², under a torque (N·m) in addition to those of motion, gravity and friction.
    pub fn acceleration(&self, angles: &Vec3, rates: &Vec3, torque: &Vec3) -> Vec3 {
        let inertia = self.inertia(angles);
        let sum = torque - coriolis(angles, rates) * rates - gravity(angles) - self.resistance(rates);
        let (upper, fore, between) = (inertia[(1, 1)], inertia[(2, 2)], inertia[(1, 2)]);
        let determinant = upper * fore - between * between;
        Vec3::new(
            sum.x / inertia[(0, 0)],
            (fore * sum.y - between * sum.z) / determinant,
            (upper * sum.z - between * sum.y) / determinant,
        )
    }

    /// Returns the resisting torque of damping and friction, Bθ̇ + τ_c tanh(θ̇/ω), N·m.
    pub fn resistance(&self, rates: &Vec3) -> Vec3 {
        let friction = rates.map(|rate| (rate / self.friction_speed).tanh());
        self.damping.component_mul(rates) + self.friction.component_mul(&friction)
    }

    /// Returns the energy ½θ̇ᵀMθ̇ plus the potential of N, π₇s₂ − π₈c₃, J.
    pub fn energy(&self, angles: &Vec3, rates: &Vec3) -> f64 {
        let potential = GRAVITY[0] * angles.y.sin() - GRAVITY[1] * angles.z.cos();
        0.5 * rates.dot(&(self.inertia(angles) * rates)) + potential
    }
}

/// Returns the Coriolis matrix C, N·m·s/rad.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::dynamics::{JointSettings, coriolis};
///
/// // Ṁ − 2C is skew-symmetric: free motion conserves energy.
/// let (angles, rates, h) = (Vec3::new(0.3, 0.2, 0.1), Vec3::new(1.0, -2.0, 3.0), 1e-5);
/// let inertia = |time: f64| JointSettings::default().inertia(&(angles + rates * time));
/// let rate = (inertia(h) - inertia(-h)) / (2.0 * h);
/// let skew = rate - coriolis(&angles, &rates) * 2.0;
/// assert!((skew + skew.transpose()).amax() < 1e-9);
/// ```
pub fn coriolis(angles: &Vec3, rates: &Vec3) -> Mat3 {
    let [_, p2, p3, p4, _, _] = INERTIA;
    let (t2, t3) = (angles.y, angles.z);
    // ½∂M₁₁/∂θ₂, ½∂M₁₁/∂θ₃ and ∂M₂₃/∂θ₃ = −∂M₂₃/∂θ₂.
    let by_upper = -p2 * (2.0 * t2).sin() - 0.5 * p4 * t2.sin() * t3.sin();
    let by_fore = -p3 * (2.0 * t3).sin() + 0.5 * p4 * t2.cos() * t3.cos();
    let between = 0.5 * p4 * (t2 - t3).cos();
    Mat3::new(
        by_upper * rates.y + by_fore * rates.z,
        by_upper * rates.x,
        by_fore * rates.x,
        -by_upper * rates.x,
        0.0,
        between * rates.z,
        -by_fore * rates.x,
        -between * rates.y,
        0.0,
    )
}

/// Returns the gravity torque N, N·m.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::phantom::dynamics::{JointSettings, gravity};
///
/// // N is the gradient of the potential.
/// let (angles, h) = (Vec3::new(0.3, 0.2, 0.1), 1e-5);
/// let potential = |joint, by: f64| {
///     JointSettings::default().energy(&(angles + Vec3::ith(joint, by)), &Vec3::zeros())
/// };
/// let gradient = Vec3::from_fn(|joint, _| (potential(joint, h) - potential(joint, -h)) / (2.0 * h));
/// assert!((gradient - gravity(&angles)).norm() < 1e-9);
/// ```
pub fn gravity(angles: &Vec3) -> Vec3 {
    Vec3::new(0.0, GRAVITY[0] * angles.y.cos(), GRAVITY[1] * angles.z.sin())
}
