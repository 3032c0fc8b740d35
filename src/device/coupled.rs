//! The modelled device with what lies between it and contact: the device moves, is measured, a virtual coupling leads
//! the tip that contact sees; on the way back the coupling's force or contact's own, passivity control, motors.

use thiserror::Error;

use super::coupling::{CouplingError, CouplingSettings, PassivityController, VirtualCoupling};
use super::path::TipPath;
use super::phantom::{DeviceError, Phantom, PhantomSettings};
use crate::Vec3;

/// What a scene says about its device.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CoupledSettings {
    /// Device and hand.
    pub phantom: PhantomSettings,
    /// The virtual coupling; without one, contact sees the measured tip, and the device contact's force.
    pub coupling: Option<CouplingSettings>,
    /// Whether commands go through passivity control.
    pub passivity_control: bool,
}

/// What there is to see of a device after a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceView {
    /// Where its tip truly is, m, scene axes.
    pub tip: Vec3,
    /// Energy delivered to the hand at the stylus since the start, J.
    pub energy_to_hand_j: f64,
    /// Whether a limit of force or current has changed the command that it now has.
    pub is_saturated: bool,
    /// Whether it is commanded more than it can sustain, on average.
    pub overheats: bool,
    /// Whether passivity control has changed the command that it now has.
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
/// assert!(device.start().norm() < 1e-4); // where the hand aims, to within the encoders' resolution
///
/// assert_eq!(device.command(&Vec3::z()), Vec3::z());
/// // Until something has moved, a force costs nothing. One that pushes the hand away gives what was never taken in.
/// let mut is_damped = false;
/// for tick in 0..100 {
///     device.sense(f64::from(tick) * 1e-3, &Vec3::zeros())?;
///     device.command(&Vec3::z());
///     is_damped |= device.view().is_damped;
/// }
/// assert!(is_damped);
/// assert_eq!(device.command(&Vec3::repeat(f64::NAN)), Vec3::zeros()); // nothing not finite goes out
/// device.release();
/// assert!(!device.view().is_damped && !device.phantom().saturated());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct CoupledPhantom {
    phantom: Phantom,
    coupling: Option<VirtualCoupling>,
    passivity: Option<PassivityController>,
    /// Where the tip was measured when the last command went out, m.
    answered: Vec3,
    is_damped: bool,
}

impl CoupledPhantom {
    /// At rest where the hand's target is at 0 s. Ticks are h long, s.
    ///
    /// # Errors
    /// If a setting is out of range, or the device cannot be there.
    pub fn new(settings: &CoupledSettings, target: &TipPath, tick: f64) -> Result<Self, InstrumentError> {
        let phantom = Phantom::new(settings.phantom, target, tick)?;
        let tip = phantom.measured_tip();
        let coupling = settings.coupling.map(|coupling| VirtualCoupling::new(coupling, tick, tip)).transpose()?;
        let passivity = settings.passivity_control.then(PassivityController::default);
        Ok(Self { phantom, coupling, passivity, answered: tip, is_damped: false })
    }

    /// The tip that contact sees at t = 0, m: the measured one.
    pub fn start(&self) -> Vec3 {
        self.answered
    }

    /// A tick from a time on, s, under the last command; with a coupling, its tip moves under the contact force of the
    /// last computed tick, N. Where contact is to look for the tip, m.
    ///
    /// # Errors
    /// If the device comes to where it cannot be, or the coupling's tip runs away.
    pub fn sense(&mut self, start_time: f64, contact_force: &Vec3) -> Result<Vec3, DeviceError> {
        let measured = self.phantom.advance(start_time)?;
        let Some(coupling) = &mut self.coupling else { return Ok(measured) };
        let tip = coupling.advance(&measured, contact_force);
        if !tip.norm().is_finite() {
            return Err(DeviceError::NotFinite { time_s: start_time });
        }
        Ok(tip)
    }

    /// Answers a contact force, N: what is commanded, before the device's limits. A coupling answers with its own, and
    /// passivity control with less, along the way since the command before. One beyond all numbers becomes none.
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

    /// Commands no force, past whatever lies between.
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

    /// What there is to see.
    pub fn view(&self) -> DeviceView {
        DeviceView {
            tip: self.phantom.tip(),
            energy_to_hand_j: self.phantom.energy_to_hand_j(),
            is_saturated: self.phantom.saturated(),
            overheats: self.phantom.overheats(),
            is_damped: self.is_damped,
        }
    }

    /// The device itself.
    pub fn phantom(&self) -> &Phantom {
        &self.phantom
    }
}

/// Why there is no such instrument.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum InstrumentError {
    /// The device.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The virtual coupling.
    #[error(transparent)]
    Coupling(#[from] CouplingError),
}
