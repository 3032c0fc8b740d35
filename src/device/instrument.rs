//! Instruments: where the tip is.

use super::coupled::{CoupledPhantom, CoupledSettings, InstrumentError};
use super::path::TipPath;
use super::phantom::DeviceError;
use crate::Vec3;

/// What kind of instrument a scene has.
#[derive(Debug, Clone, PartialEq)]
pub enum InstrumentKind {
    /// Its path is the tip's.
    Path,
    /// Its path is what the hand that holds a modelled device aims at.
    Phantom(Box<CoupledSettings>),
}

/// What holds the tip.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::{device::instrument::{Instrument, InstrumentKind}, device::path::{TipPath, Waypoint}};
///
/// let path = TipPath::new(vec![
///     Waypoint { time: 0.0, position: Vec3::zeros() },
///     Waypoint { time: 1.0, position: Vec3::x() * 0.01 },
/// ])?;
/// let mut instrument = Instrument::new(&InstrumentKind::Path, &path, 1e-3)?;
/// assert_eq!(instrument.start(), Vec3::zeros());
/// let force = Vec3::z();
/// assert_eq!(instrument.command(&force), force);
/// // A path is followed whatever the force. A device in a hand would be pushed back.
/// assert_eq!(instrument.sense(0.499, 0.5, &force)?, Vec3::x() * 0.005);
/// instrument.release();
/// assert!(instrument.device().is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub enum Instrument {
    /// A tip that goes its way whatever the force.
    Path(TipPath),
    /// A modelled device in a hand.
    Phantom(Box<CoupledPhantom>),
}

impl Instrument {
    /// At t = 0. Ticks are h long, s.
    ///
    /// # Errors
    /// If a device cannot be there, or is made of what cannot be.
    pub fn new(kind: &InstrumentKind, path: &TipPath, tick: f64) -> Result<Self, InstrumentError> {
        Ok(match kind {
            InstrumentKind::Path => Instrument::Path(path.clone()),
            InstrumentKind::Phantom(settings) => {
                Instrument::Phantom(Box::new(CoupledPhantom::new(settings, path, tick)?))
            }
        })
    }

    /// Where contact sees the tip at t = 0, m.
    pub fn start(&self) -> Vec3 {
        match self {
            Instrument::Path(path) => path.at(0.0),
            Instrument::Phantom(phantom) => phantom.start(),
        }
    }

    /// Moves on over a tick, from one time to another, s, under the force commanded last, while the contact force of the
    /// last computed tick, N, acts on what is simulated of it: where contact sees the tip then, m.
    ///
    /// # Errors
    /// If it leaves the range in which it can be simulated.
    pub fn sense(&mut self, begin: f64, end: f64, contact_force: &Vec3) -> Result<Vec3, DeviceError> {
        match self {
            Instrument::Path(path) => Ok(path.at(end)),
            Instrument::Phantom(phantom) => phantom.sense(begin, contact_force),
        }
    }

    /// Takes the force of a contact, N: the force that is commanded, before device limits.
    pub fn command(&mut self, contact_force: &Vec3) -> Vec3 {
        match self {
            Instrument::Path(_) => *contact_force,
            Instrument::Phantom(phantom) => phantom.command(contact_force),
        }
    }

    /// Commands no force.
    pub fn release(&mut self) {
        match self {
            Instrument::Path(_) => {}
            Instrument::Phantom(phantom) => phantom.release(),
        }
    }

    /// The device, if it is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        match self {
            Instrument::Path(_) => None,
            Instrument::Phantom(phantom) => Some(phantom),
        }
    }
}
