//! Device, motors and hand as one system of differential equations, integrated tick by tick.

use super::PhantomSettings;
use super::hand::Moving;
use super::kinematics::{forward, jacobian};
use crate::Vec3;
use crate::device::path::TipPath;

/// State of the plant, in device axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantState {
    /// Joint angles θ, rad.
    pub angles: Vec3,
    /// Joint rates θ̇, rad/s.
    pub rates: Vec3,
    /// Motor currents, A.
    pub current: Vec3,
    /// Position X of the hand, m.
    pub hand: Vec3,
    /// Velocity Ẋ of the hand, m/s.
    pub hand_velocity: Vec3,
    /// Tip y that the hand holds; `None` without a structure between the links and it.
    pub tip: Option<Moving>,
    /// Energy flows since the start.
    pub flows: EnergyFlows,
}

/// Energies exchanged since the start, J.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EnergyFlows {
    /// Work of the device on the hand at the stylus, J.
    pub to_hand: f64,
    /// Work of the motors on the joints, J.
    pub from_motors: f64,
    /// Work of the hand's moving target, J.
    pub from_target: f64,
    /// Energy dissipated in joints, structure, grip and arm, J.
    pub dissipated: f64,
}

/// Parameters of the system, and the path of the hand's target in device axes.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::path::{TipPath, Waypoint};
/// use stickslip::device::phantom::{PhantomSettings, plant::Plant};
///
/// // A hand leads the device by 20 mm within 0.1 s, against a motor.
/// let target = TipPath::new(vec![
///     Waypoint { time: 0.0, position: Vec3::zeros() },
///     Waypoint { time: 0.1, position: Vec3::x() * 0.02 },
/// ])?;
/// let plant = Plant { settings: PhantomSettings::default(), target };
/// let start = plant.at_rest(Vec3::zeros());
/// let current = Vec3::new(-0.1, 0.0, 0.0);
/// let end = (0..100).fold(start, |state, tick| plant.advance(&state, f64::from(tick) * 1e-3, 1e-3, &current));
/// assert!(end.is_finite() && end.stylus().position.x > 0.0);
/// // The energy balance closes.
/// let stored = plant.stored_energy(&end, 0.1) - plant.stored_energy(&start, 0.0);
/// let flows = end.flows;
/// assert!((stored - (flows.from_motors + flows.from_target - flows.dissipated)).abs() < 1e-6 * flows.dissipated);
/// # Ok::<(), stickslip::device::path::PathError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Plant {
    /// Settings of device and hand.
    pub settings: PhantomSettings,
    /// Path X_t of the hand's target.
    pub target: TipPath,
}

impl PlantState {
    /// Returns the state at rest in this pose, with the hand at the tip, of a device without a structure.
    pub fn at_rest(angles: Vec3) -> Self {
        let zero = Vec3::zeros();
        let hand = forward(&angles);
        Self { angles, rates: zero, current: zero, hand, hand_velocity: zero, tip: None, flows: EnergyFlows::default() }
    }

    /// Returns position p and velocity ṗ = Jθ̇ of the links' end, which the encoders measure.
    pub fn links(&self) -> Moving {
        Moving { position: forward(&self.angles), velocity: jacobian(&self.angles) * self.rates }
    }

    /// Returns position and velocity of the stylus that the hand holds: the links' end, or the tip beyond a structure.
    pub fn stylus(&self) -> Moving {
        self.tip.unwrap_or_else(|| self.links())
    }

    /// Returns whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [self.angles, self.rates, self.current, self.hand, self.hand_velocity];
        let EnergyFlows { to_hand, from_motors, from_target, dissipated } = self.flows;
        vectors.iter().all(|v| v.iter().all(|c| c.is_finite()))
            && self.tip.iter().all(|tip| tip.position.iter().chain(tip.velocity.iter()).all(|c| c.is_finite()))
            && [to_hand, from_motors, from_target, dissipated].iter().all(|c| c.is_finite())
    }

    fn hand(&self) -> Moving {
        Moving { position: self.hand, velocity: self.hand_velocity }
    }

    /// Returns self + h · rate, where `rate` holds time derivatives.
    fn plus(&self, rate: &Self, h: f64) -> Self {
        Self {
            angles: self.angles + rate.angles * h,
            rates: self.rates + rate.rates * h,
            current: self.current + rate.current * h,
            hand: self.hand + rate.hand * h,
            hand_velocity: self.hand_velocity + rate.hand_velocity * h,
            tip: self.tip.zip(rate.tip).map(|(tip, rate)| Moving {
                position: tip.position + rate.position * h,
                velocity: tip.velocity + rate.velocity * h,
            }),
            flows: EnergyFlows {
                to_hand: self.flows.to_hand + rate.flows.to_hand * h,
                from_motors: self.flows.from_motors + rate.flows.from_motors * h,
                from_target: self.flows.from_target + rate.flows.from_target * h,
                dissipated: self.flows.dissipated + rate.flows.dissipated * h,
            },
        }
    }
}

impl Plant {
    /// Returns the state at rest in this pose, with the hand at the tip.
    pub fn at_rest(&self, angles: Vec3) -> PlantState {
        let rest = PlantState::at_rest(angles);
        PlantState { tip: self.settings.structure.map(|_| rest.links()), ..rest }
    }

    /// Integrates a tick under a constant current command (A) by the classical Runge-Kutta method of order 4 in equal
    /// substeps. Where the hand's target changes its velocity within a substep, that in the middle is used.
    pub fn advance(&self, state: &PlantState, start_time: f64, tick_s: f64, command: &Vec3) -> PlantState {
        let h = tick_s / f64::from(self.settings.substeps);
        let mut state = *state;
        for substep in 0..self.settings.substeps {
            let time = start_time + f64::from(substep) * h;
            let velocity = self.target.velocity_at(time + 0.5 * h);
            let [begin, middle, end] =
                [time, time + 0.5 * h, time + h].map(|t| Moving { position: self.target.at(t), velocity });
            let k1 = self.derivative(&state, &begin, command);
            let k2 = self.derivative(&state.plus(&k1, 0.5 * h), &middle, command);
            let k3 = self.derivative(&state.plus(&k2, 0.5 * h), &middle, command);
            let k4 = self.derivative(&state.plus(&k3, h), &end, command);
            state = state.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
        }
        state
    }

    /// Returns the time derivatives of the state:
    /// Mθ̈ = τ − Cθ̇ − N − Bθ̇ − τ_c tanh(θ̇/ω) + JᵀF, F of the grip; M_h Ẍ = F_arm − F; i̇ = ω_a(i_commanded − i).
    /// Beyond a structure the grip acts on the tip, m ÿ = F − S, and the structure's S takes the place of F at the joints.
    fn derivative(&self, state: &PlantState, target: &Moving, command: &Vec3) -> PlantState {
        let PhantomSettings { joints, actuation, structure, hand: arm, .. } = &self.settings;
        let (stylus, hand) = (state.stylus(), state.hand());
        let grip = arm.grip_force(&hand, &stylus);
        let pull = arm.arm_force(target, &hand);
        let motors = actuation.torque(&state.current);
        let (on_links, tip, lost) = match (structure, state.tip) {
            (Some(structure), Some(tip)) => {
                let links = state.links();
                let on_links = structure.force_on_links(&links, &tip);
                let acceleration = (grip - on_links) / structure.tip_mass;
                let rate = Moving { position: tip.velocity, velocity: acceleration };
                (on_links, Some(rate), structure.dissipation(&links, &tip))
            }
            _ => (grip, None, 0.0),
        };
        let torque = motors + jacobian(&state.angles).tr_mul(&on_links);
        let resistance = joints.resistance(&state.rates);
        PlantState {
            angles: state.rates,
            rates: joints.acceleration(&state.angles, &state.rates, &torque),
            current: (command - state.current) * actuation.amplifier_rate(),
            hand: state.hand_velocity,
            hand_velocity: (pull - grip).component_div(&arm.mass),
            tip,
            flows: EnergyFlows {
                to_hand: -grip.dot(&stylus.velocity),
                from_motors: motors.dot(&state.rates),
                from_target: pull.dot(&target.velocity),
                dissipated: resistance.dot(&state.rates) + arm.dissipation(target, &hand, &stylus) + lost,
            },
        }
    }

    /// Returns the energy of joints, gravity, structure, hand and springs, J. Its increase is
    /// `from_motors` + `from_target` − `dissipated`.
    pub fn stored_energy(&self, state: &PlantState, time: f64) -> f64 {
        let target = Moving { position: self.target.at(time), velocity: Vec3::zeros() };
        let PhantomSettings { joints, structure, hand, .. } = &self.settings;
        let of_structure =
            structure.zip(state.tip).map_or(0.0, |(structure, tip)| structure.energy(&state.links(), &tip));
        let of_hand = hand.energy(&target, &state.hand(), &state.stylus());
        joints.energy(&state.angles, &state.rates) + of_structure + of_hand
    }
}
