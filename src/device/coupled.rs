//! The modelled device and its coupling to contact. Each tick the device moves and is measured, and the virtual
//! coupling moves the tip that contact sees. The coupling's force, or the contact force, then goes through passivity
//! control to the motors.

use thiserror::Error;

use super::coupling::{CouplingError, CouplingSettings, PassivityController, VirtualCoupling};
use super::path::TipPath;
use super::phantom::{DeviceError, Phantom, PhantomSettings};
use crate::Vec3;

/// Device settings of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CoupledSettings {
    /// Settings of device and hand.
    pub phantom: PhantomSettings,
    /// The virtual coupling; without one, contact sees the measured tip, and the device renders the contact force.
    pub coupling: Option<CouplingSettings>,
    /// Whether commands go through passivity control.
    pub passivity_control: bool,
}

/// Observable state of the device after a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceView {
    /// True tip position, m, scene axes.
    pub tip: Vec3,
    /// Energy delivered to the hand at the stylus since the start, J.
    pub energy_to_hand_j: f64,
    /// Whether a force or current limit changes the present command.
    pub is_saturated: bool,
    /// Whether the mean commanded force is more than the device can sustain.
    pub overheats: bool,
    /// Whether passivity control changes the present command.
    pub is_damped: bool,
}

/// The device in the loop.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::coupled::{CoupledPhantom, CoupledSettings};
/// use stickslip::device::path::{TipPath, Waypoint};
///
/// let still = TipPath::new(vec![Waypoint { time: 0.0, position: Vec3::zeros() }])?;
/// let settings = CoupledSettings { passivity_control: true, ..CoupledSettings::default() };
/// let mut device = CoupledPhantom::new(&settings, &still, 1e-3)?;
/// assert!(device.start().norm() < 1e-4); // the hand's set-point, to within the encoders' resolution
///
/// assert_eq!(device.command(&Vec3::z()), Vec3::z());
/// // Without motion a force does no work. One that pushes the hand away delivers energy that was never taken in.
/// let mut is_damped = false;
/// for tick in 0..100 {
///     device.sense(f64::from(tick) * 1e-3, &Vec3::zeros())?;
///     device.command(&Vec3::z());
///     is_damped |= device.view().is_damped;
/// }
/// assert!(is_damped);
/// assert_eq!(device.command(&Vec3::repeat(f64::NAN)), Vec3::zeros()); // only finite forces are commanded
/// device.release();
/// assert!(!device.view().is_damped && !device.phantom().saturated());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct CoupledPhantom {
    phantom: Phantom,
    coupling: Option<VirtualCoupling>,
    passivity: Option<PassivityController>,
    /// Measured tip position at the last command, m.
    answered: Vec3,
    is_damped: bool,
}

impl CoupledPhantom {
    /// Places the device at rest at the hand's target at 0 s. Ticks are `tick` seconds long.
    ///
    /// # Errors
    /// If a setting is out of range, or the device cannot reach that position.
    pub fn new(settings: &CoupledSettings, target: &TipPath, tick_s: f64) -> Result<Self, InstrumentError> {
        let phantom = Phantom::new(settings.phantom, target, tick_s)?;
        let tip = phantom.measured_tip();
        let coupling = settings.coupling.map(|coupling| VirtualCoupling::new(coupling, tick_s, tip)).transpose()?;
        let passivity = settings.passivity_control.then(PassivityController::default);
        Ok(Self { phantom, coupling, passivity, answered: tip, is_damped: false })
    }

    /// Returns the tip that contact sees at t = 0, m: the measured one.
    pub fn start(&self) -> Vec3 {
        self.answered
    }

    /// Advances the device by a tick from a time, s, under the last command. A coupling's tip moves under the contact
    /// force of the last computed tick, N. Returns the tip that contact sees, m.
    ///
    /// # Errors
    /// If the device leaves its workspace, or the coupling's tip diverges.
    pub fn sense(&mut self, start_time: f64, contact_force: &Vec3) -> Result<Vec3, DeviceError> {
        let measured = self.phantom.advance(start_time)?;
        let Some(coupling) = &mut self.coupling else { return Ok(measured) };
        let tip = coupling.advance(&measured, contact_force);
        if !tip.norm().is_finite() {
            return Err(DeviceError::NotFinite { time_s: start_time });
        }
        Ok(tip)
    }

    /// Returns the velocity of the tip that contact sees, m/s: the coupling's own, or the observer's; `None` if contact
    /// sees the encoders' reading.
    pub fn tip_velocity(&self) -> Option<Vec3> {
        match &self.coupling {
            Some(coupling) => Some(coupling.tip_velocity()),
            None => self.phantom.observed_velocity(),
        }
    }

    /// Turns a contact force, N, into a command before the device's limits. A coupling replaces the force by its own;
    /// passivity control damps it along the displacement since the last command. A force that is not finite becomes
    /// zero.
    pub fn command(&mut self, contact_force: &Vec3) -> Vec3 {
        let wanted = self.coupling.as_ref().map_or(*contact_force, VirtualCoupling::force);
        let measured = self.phantom.measured_tip();
        let way = measured - std::mem::replace(&mut self.answered, measured);
        let damped = self.passivity.as_mut().map_or(wanted, |passivity| passivity.command(&wanted, &way));
        self.is_damped = damped != wanted;
        let force = if damped.norm().is_finite() { damped } else { Vec3::zeros() };
        self.apply(&force);
        force
    }

    /// Commands zero force, bypassing the coupling and passivity control.
    pub fn release(&mut self) {
        let measured = self.phantom.measured_tip();
        let way = measured - std::mem::replace(&mut self.answered, measured);
        if let Some(passivity) = &mut self.passivity {
            passivity.command(&Vec3::zeros(), &way);
        }
        self.is_damped = false;
        self.apply(&Vec3::zeros());
    }

    fn apply(&mut self, force: &Vec3) {
        let applied = self.phantom.command(force);
        if let Some(passivity) = &mut self.passivity {
            passivity.hold(applied);
        }
    }

    /// Returns the observable state.
    pub fn view(&self) -> DeviceView {
        DeviceView {
            tip: self.phantom.tip(),
            energy_to_hand_j: self.phantom.energy_to_hand_j(),
            is_saturated: self.phantom.saturated(),
            overheats: self.phantom.overheats(),
            is_damped: self.is_damped,
        }
    }

    /// Returns the device.
    pub fn phantom(&self) -> &Phantom {
        &self.phantom
    }
}

/// What is wrong with an instrument's settings.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum InstrumentError {
    /// A device setting is not accepted.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A setting of the virtual coupling is not accepted.
    #[error(transparent)]
    Coupling(#[from] CouplingError),
}
