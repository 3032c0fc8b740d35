//! A modelled PHANTOM Premium 1.5 in a user's hand. A commanded force goes through limits, quantised currents and
//! amplifiers to the joints; joints and hand move each other; encoders measure the joints. A structure between the links
//! and the tip in the hand is optional.
//!
//! Tick k runs from kh to (k + 1)h: the plant moves under the command of the tick before, held constant
//! ([`Phantom::advance`]), the tip is measured at the tick's end, and the simulation commands the next force
//! ([`Phantom::command`]). Gravity of the links is not compensated by the motors.

pub mod actuation;
pub mod dynamics;
pub mod hand;
pub mod kinematics;
pub mod observer;
pub mod plant;
pub mod structure;
pub mod wall;

use std::fmt;

use thiserror::Error;

use self::actuation::ActuationSettings;
use self::dynamics::{JointSettings, LEAST_INERTIA};
use self::hand::HandSettings;
use self::kinematics::{FORE_LINK, PoseError, UPPER_LINK};
use self::observer::EncoderObserver;
use self::plant::{Plant, PlantState};
use self::structure::StructureSettings;
use super::path::TipPath;
use crate::word::words;
use crate::{Mat3, Vec3};

/// Largest product of rate and substep. RK4 is stable up to 2.78 on the real axis and 2.82 on the imaginary one.
const STEP_LIMIT: f64 = 2.5;
/// Tolerance of a rotation's orthogonality: numbers written with ten digits are accepted.
const ROTATION_TOLERANCE: f64 = 1e-9;

/// Placement of the scene in the device: device = rotation · scene + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Scene directions in device axes. By default the scene's z is up, which is the device's y.
    pub rotation: Mat3,
    /// The scene's origin in device axes, m.
    pub offset: Vec3,
}

impl Default for Axes {
    fn default() -> Self {
        Self { rotation: Mat3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0), offset: Vec3::zeros() }
    }
}

impl Axes {
    fn point_to_device(&self, point: &Vec3) -> Vec3 {
        self.rotation * point + self.offset
    }

    fn point_to_scene(&self, point: &Vec3) -> Vec3 {
        self.rotation.tr_mul(&(point - self.offset))
    }
}

/// The tip that contact sees.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TipSensing {
    /// The encoders' reading.
    #[default]
    Quantised,
    /// The estimate of an [`EncoderObserver`], with its velocity.
    Observed,
}

words!(TipSensing { Quantised = "quantised", Observed = "observed" });

/// All settings of the device and the hand.
///
/// ```
/// use stickslip::device::phantom::{DeviceError, PhantomSettings};
///
/// let settings = PhantomSettings::default();
/// settings.check(1e-3)?;
/// // Ten substeps suffice for a millisecond, one does not: the amplifiers' lag alone has a rate of 2π·1 kHz.
/// let coarse = PhantomSettings { substeps: 1, ..settings };
/// assert!(matches!(coarse.check(1e-3), Err(DeviceError::Substeps { substeps: 1, .. })));
/// coarse.check(1e-5)?;
/// # Ok::<(), DeviceError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhantomSettings {
    /// Placement of the scene in the device.
    pub axes: Axes,
    /// Settings of friction, damping and rotors.
    pub joints: JointSettings,
    /// Settings of motors, encoders and limits.
    pub actuation: ActuationSettings,
    /// Compliant structure between the links and the tip that the hand holds; rigid if absent.
    pub structure: Option<StructureSettings>,
    /// Settings of the user's hand.
    pub hand: HandSettings,
    /// The tip that contact sees; a scene decides by its scheme where this is `None`, and a device alone is quantised.
    pub sensing: Option<TipSensing>,
    /// Number of integration steps per tick.
    pub substeps: u32,
}

impl Default for PhantomSettings {
    fn default() -> Self {
        Self {
            axes: Axes::default(),
            joints: JointSettings::default(),
            actuation: ActuationSettings::default(),
            structure: None,
            hand: HandSettings::default(),
            sensing: None,
            substeps: 10,
        }
    }
}

/// The accepted range of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Finite and above 0.
    Positive,
    /// Finite and at least 0.
    NotNegative,
    /// Neither NaN nor infinite.
    Finite,
    /// At most 32: with more bits, quantisation is negligible.
    AtMost32,
}

impl fmt::Display for Needs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Needs::Positive => "positive and finite",
            Needs::NotNegative => "finite and not negative",
            Needs::Finite => "finite",
            Needs::AtMost32 => "at most 32",
        })
    }
}

/// What is wrong with a device's settings, or went wrong in its motion.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum DeviceError {
    /// A parameter is out of range.
    #[error("{name} = {value} must be {needs}")]
    Setting {
        /// Name of the parameter.
        name: &'static str,
        /// The value given.
        value: f64,
        /// Accepted range.
        needs: Needs,
    },
    /// The axes are not a rotation.
    #[error("the axes' rotation is no rotation: its columns are not orthonormal, or it mirrors (off by {deviation:e})")]
    Rotation {
        /// Largest magnitude among the entries of RᵀR − 1 and det R − 1.
        deviation: f64,
    },
    /// A tick has too few substeps for the fastest motion.
    #[error("{substeps} substeps of a tick of {tick_s} s are too few for rates of up to {rate:.0} 1/s: take {least}")]
    Substeps {
        /// The number of substeps given.
        substeps: u32,
        /// Tick h, s.
        tick_s: f64,
        /// Upper bound of all rates, 1/s.
        rate: f64,
        /// Least number of substeps accepted.
        least: f64,
    },
    /// The device cannot take the pose that it is led to.
    #[error("at {time_s} s: {cause}; keep the hand's path inside the device's workspace, or move it with an offset")]
    Pose {
        /// Time of the pose, s.
        time_s: f64,
        /// Reason why there is no pose.
        cause: PoseError,
    },
    /// The motion diverged.
    #[error("at {time_s} s: the state of the device is not finite")]
    NotFinite {
        /// Time at the start of the tick, s.
        time_s: f64,
    },
}

impl PhantomSettings {
    /// Checks that every parameter is in range, and that a tick, s, has enough substeps.
    ///
    /// # Errors
    /// If a parameter is out of range, with the first one, or there are too few substeps.
    pub fn check(&self, tick_s: f64) -> Result<(), DeviceError> {
        let Self { axes, joints, actuation, structure, hand, substeps, sensing: _ } = self;
        let positive = [
            ("the tick (s)", Vec3::repeat(tick_s)),
            ("the friction speed (rad/s)", Vec3::repeat(joints.friction_speed)),
            ("the torque constant (N·m/A)", Vec3::repeat(actuation.torque_constant)),
            ("a capstan ratio", actuation.capstan_ratio),
            ("the current limit (A)", Vec3::repeat(actuation.largest_current)),
            ("the amplifier bandwidth (Hz)", Vec3::repeat(actuation.amplifier_bandwidth)),
            ("the force limit (N)", Vec3::repeat(actuation.largest_force)),
            ("the continuous force (N)", Vec3::repeat(actuation.continuous_force)),
            ("the thermal time (s)", Vec3::repeat(actuation.thermal_time)),
            ("the hand's mass (kg)", hand.mass),
        ];
        let not_negative = [
            ("a joint's damping (N·m·s/rad)", joints.damping),
            ("a joint's friction (N·m)", joints.friction),
            ("the encoder counts", Vec3::repeat(actuation.encoder_counts)),
            ("a rotor's inertia (kg·m²)", joints.rotor_inertia),
            ("the grip's stiffness (N/m)", hand.stylus_stiffness),
            ("the grip's damping (N·s/m)", hand.stylus_damping),
            ("the arm's stiffness (N/m)", hand.arm_stiffness),
            ("the arm's damping (N·s/m)", hand.arm_damping),
        ];
        for (name, values) in positive {
            require(name, &values, Needs::Positive)?;
        }
        for (name, values) in not_negative {
            require(name, &values, Needs::NotNegative)?;
        }
        if let Some(StructureSettings { stiffness, tip_mass, damping_ratio }) = *structure {
            require("the structure's stiffness (N/m)", &Vec3::repeat(stiffness), Needs::Positive)?;
            require("the tip's mass (kg)", &Vec3::repeat(tip_mass), Needs::Positive)?;
            require("the structure's damping ratio", &Vec3::repeat(damping_ratio), Needs::NotNegative)?;
        }
        require("the scene's offset (m)", &axes.offset, Needs::Finite)?;
        let determinant_off = (axes.rotation.determinant() - 1.0).abs();
        let deviation = (axes.rotation.tr_mul(&axes.rotation) - Mat3::identity()).amax().max(determinant_off);
        if !(deviation <= ROTATION_TOLERANCE && axes.rotation.iter().all(|entry| entry.is_finite())) {
            return Err(DeviceError::Rotation { deviation });
        }
        require("the torque bits", &Vec3::repeat(f64::from(actuation.torque_bits)), Needs::AtMost32)?;
        let rate = self.rate_bound();
        let least = (rate * tick_s / STEP_LIMIT).ceil();
        if !(f64::from(*substeps) >= least && *substeps > 0) {
            return Err(DeviceError::Substeps { substeps: *substeps, tick_s, rate, least });
        }
        Ok(())
    }

    /// Returns an upper bound of the rates of motion near rest, 1/s: for ẍ = −(K/m)x − (D/m)ẋ it is √(K/m) + D/m. The
    /// bound is generous: it takes the least inertia of any pose, and the stretched links for the lever of the grip. With a
    /// structure both of its ends move, and their rates add up.
    fn rate_bound(&self) -> f64 {
        let Self { joints, actuation, structure, hand, .. } = self;
        let rate = |stiffness: f64, damping: f64, mass: f64| (stiffness / mass).sqrt() + damping / mass;
        let lever = (UPPER_LINK + FORE_LINK).powi(2);
        let joint_damping = (joints.damping + joints.friction / joints.friction_speed).amax();
        let grip = (hand.stylus_stiffness.amax(), hand.stylus_damping.amax());
        let (at_links, of_tip) = structure.map_or((grip, 0.0), |structure| {
            let (stiffness, damping) = (structure.stiffness, structure.damping());
            ((stiffness, damping), rate(stiffness + grip.0, damping + grip.1, structure.tip_mass))
        });
        let of_joints = rate(lever * at_links.0, joint_damping + lever * at_links.1, LEAST_INERTIA) + of_tip;
        let stiffness = hand.stylus_stiffness + hand.arm_stiffness;
        let damping = hand.stylus_damping + hand.arm_damping;
        let of_hand = rate(stiffness.amax(), damping.amax(), hand.mass.amin());
        actuation.amplifier_rate().max(of_joints).max(of_hand)
    }
}

fn require(name: &'static str, values: &Vec3, needs: Needs) -> Result<(), DeviceError> {
    let holds = |value: f64| match needs {
        Needs::Positive => value > 0.0,
        Needs::NotNegative => value >= 0.0,
        Needs::Finite => true,
        Needs::AtMost32 => value <= 32.0,
    };
    match values.iter().find(|value| !(value.is_finite() && holds(**value))) {
        None => Ok(()),
        Some(&value) => Err(DeviceError::Setting { name, value, needs }),
    }
}

/// The device in motion. Positions and forces are in scene axes.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::path::{TipPath, Waypoint};
/// use stickslip::device::phantom::{Phantom, PhantomSettings};
///
/// let still = TipPath::new(vec![Waypoint { time: 0.0, position: Vec3::zeros() }])?;
/// let mut device = Phantom::new(PhantomSettings::default(), &still, 1e-3)?;
/// assert!(device.apparent_mass_kg().amax() < 0.2); // published: 75 g
/// assert!(device.resolution_m().amax() < 4e-5); // published: 30 µm
///
/// // 2 N up for half a second push the hand that holds it.
/// let applied = device.command(&(Vec3::z() * 2.0));
/// assert!((applied.norm() - 2.0).abs() < 1e-3 && !device.saturated());
/// for tick in 0..500 {
///     device.advance(f64::from(tick) * 1e-3)?;
///     device.command(&(Vec3::z() * 2.0));
/// }
/// assert!(device.tip().z > 1e-3 && device.energy_to_hand_j() > 0.0);
/// // The measured tip is off by half a count of each of three encoders, at most.
/// assert!((device.tip() - device.measured_tip()).amax() <= 1.5 * device.resolution_m().amax());
/// // In half a second the mean force stays below the continuous 1.4 N.
/// assert!(device.mean_force_n() < 0.1 && !device.overheats());
/// // Forces beyond the limit are reduced.
/// assert!(device.command(&(Vec3::z() * 20.0)).norm() <= 8.5 + 1e-3 && device.saturated());
/// assert_eq!(device.settings().actuation.largest_force, 8.5);
/// assert!(device.state().is_finite());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Phantom {
    plant: Plant,
    state: PlantState,
    tick_s: f64,
    /// Encoder readings at the end of the last tick, rad.
    measured: Vec3,
    /// Estimator of what the encoders do not resolve, if contact sees its tip.
    observer: Option<EncoderObserver>,
    /// Currents commanded to the amplifiers, A.
    command: Vec3,
    is_saturated: bool,
    mean_force: f64,
}

impl Phantom {
    /// Places the device at rest at the hand's target (scene axes) at 0 s, with the hand there and zero current. Ticks
    /// are `tick` seconds long.
    ///
    /// # Errors
    /// If a setting is out of range, or the device cannot reach the target.
    pub fn new(settings: PhantomSettings, target: &TipPath, tick_s: f64) -> Result<Self, DeviceError> {
        settings.check(tick_s)?;
        let target = target.transformed(1.0, |point| settings.axes.point_to_device(&point));
        let angles = kinematics::inverse(&target.at(0.0)).map_err(|cause| DeviceError::Pose { time_s: 0.0, cause })?;
        let measured = settings.actuation.encode(&angles);
        let plant = Plant { settings, target };
        let state = plant.at_rest(angles);
        Ok(Self {
            measured,
            observer: match settings.sensing.unwrap_or_default() {
                TipSensing::Quantised => None,
                TipSensing::Observed => Some(EncoderObserver::new(tick_s, settings.actuation.angle_step(), measured)),
            },
            plant,
            state,
            tick_s,
            command: Vec3::zeros(),
            is_saturated: false,
            mean_force: 0.0,
        })
    }

    /// Advances the device by a tick from a time, s, under the last command. Returns the tip that contact sees at its end, m.
    ///
    /// # Errors
    /// If the device leaves its workspace. It then stays as it was before the tick.
    pub fn advance(&mut self, start_time: f64) -> Result<Vec3, DeviceError> {
        let time_s = start_time + self.tick_s;
        let state = self.plant.advance(&self.state, start_time, self.tick_s, &self.command);
        if !state.is_finite() {
            return Err(DeviceError::NotFinite { time_s });
        }
        kinematics::check(&state.angles).map_err(|cause| DeviceError::Pose { time_s, cause })?;
        self.state = state;
        self.measured = self.settings().actuation.encode(&state.angles);
        if let Some(observer) = &mut self.observer {
            observer.next(self.measured);
        }
        Ok(self.sensed_tip())
    }

    /// Commands a force on the user, N, for the next tick. Returns the force after limits and quantisation, N. A force
    /// that is not finite is commanded as zero.
    pub fn command(&mut self, force: &Vec3) -> Vec3 {
        let Axes { rotation, .. } = self.settings().axes;
        let actuation = self.settings().actuation;
        let command = actuation.command(&self.measured, &(rotation * force));
        self.command = command.current;
        self.is_saturated = command.is_limited;
        let applied = kinematics::tip_force(&self.measured, &actuation.torque(&command.current));
        self.mean_force += (applied.norm() - self.mean_force) * -(-self.tick_s / actuation.thermal_time).exp_m1();
        rotation.tr_mul(&applied)
    }

    /// Returns the tip measured by the encoders at the end of the last tick, m.
    pub fn measured_tip(&self) -> Vec3 {
        self.settings().axes.point_to_scene(&kinematics::forward(&self.measured))
    }

    /// Returns the tip that contact sees at the end of the last tick, m: the measured one, or the observer's.
    pub fn sensed_tip(&self) -> Vec3 {
        let angles = self.observer.as_ref().map_or(self.measured, EncoderObserver::angles);
        self.settings().axes.point_to_scene(&kinematics::forward(&angles))
    }

    /// Returns the observer's estimate of the tip's velocity at the end of the last tick, m/s, if there is an observer.
    pub fn observed_velocity(&self) -> Option<Vec3> {
        let observer = self.observer.as_ref()?;
        let velocity = kinematics::jacobian(&observer.angles()) * observer.rates();
        Some(self.settings().axes.rotation.tr_mul(&velocity))
    }

    /// Returns the true tip position, m.
    pub fn tip(&self) -> Vec3 {
        self.settings().axes.point_to_scene(&self.state.stylus().position)
    }

    /// Returns the energy that the device has delivered to the hand at the stylus since the start, J.
    pub fn energy_to_hand_j(&self) -> f64 {
        self.state.flows.to_hand
    }

    /// Returns whether a limit changed the last command.
    pub fn saturated(&self) -> bool {
        self.is_saturated
    }

    /// Returns the mean magnitude of the commanded forces, N. Its weights decay exponentially: by a factor of e over
    /// `thermal_time`.
    pub fn mean_force_n(&self) -> f64 {
        self.mean_force
    }

    /// Returns whether the mean force is more than the device can sustain: a warning that limits nothing.
    pub fn overheats(&self) -> bool {
        self.mean_force > self.settings().actuation.continuous_force
    }

    /// Returns the apparent mass of the links at their end along the device's x, y and z, kg: 1/(J M⁻¹ Jᵀ)ᵢᵢ, in the pose
    /// measured last.
    pub fn apparent_mass_kg(&self) -> Vec3 {
        let jacobian = kinematics::jacobian(&self.measured);
        let joints = &self.settings().joints;
        let rest = joints.acceleration(&self.measured, &Vec3::zeros(), &Vec3::zeros());
        Vec3::from_fn(|axis, _| {
            let torque = jacobian.row(axis).transpose();
            let response = joints.acceleration(&self.measured, &Vec3::zeros(), &torque) - rest;
            1.0 / torque.dot(&response)
        })
    }

    /// Returns the frequency of the structural mode along the device's x, y and z, Hz, with a tip that nobody holds and in
    /// the pose measured last; `None` without a structure.
    pub fn structure_frequency_hz(&self) -> Option<Vec3> {
        let structure = self.settings().structure?;
        Some(self.apparent_mass_kg().map(|mass| structure.frequency_hz(mass)))
    }

    /// Returns the largest step of the measured tip along the device's x, y and z that one count makes, m; 0 if nothing
    /// is quantised.
    pub fn resolution_m(&self) -> Vec3 {
        let jacobian = kinematics::jacobian(&self.measured);
        let steps = self.settings().actuation.angle_step();
        Vec3::from_fn(|axis, _| jacobian.row(axis).transpose().component_mul(&steps).amax())
    }

    /// Returns the settings.
    pub fn settings(&self) -> &PhantomSettings {
        &self.plant.settings
    }

    /// Returns the state of joints, currents and hand, in device axes.
    pub fn state(&self) -> &PlantState {
        &self.state
    }
}
