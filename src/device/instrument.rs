//! Instruments: what holds the tip, from a path to a device of one's own.

use std::fmt;

use dyn_clone::DynClone;
use thiserror::Error;

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

/// The door for an instrument of one's own: where the tip goes under the force that is commanded.
///
/// Contract: it is clonable and `Send`, since runs are copied and moved between threads; `sense` and `command` allocate
/// nothing, lock nothing and do no I/O; the same calls give the same tips to the bit. A tip that is not finite ends the
/// run with a fault; a commanded force that is not finite is commanded as zero.
///
/// ```
/// use stickslip::{Instrument, InstrumentFault, OwnParts, Scene, Simulation, Vec3};
///
/// /// A mass of 50 g that falls onto the body.
/// #[derive(Debug, Clone)]
/// struct Falling {
///     position: Vec3,
///     velocity: Vec3,
///     force: Vec3,
/// }
/// impl Instrument for Falling {
///     fn start(&self) -> Vec3 {
///         self.position
///     }
///     fn sense(&mut self, begin_s: f64, end_s: f64, _contact_force: &Vec3) -> Result<Vec3, InstrumentFault> {
///         let h = end_s - begin_s;
///         self.velocity += (self.force / 0.05 - Vec3::z() * 9.81) * h;
///         self.position += self.velocity * h;
///         Ok(self.position)
///     }
///     fn command(&mut self, contact_force: &Vec3) -> Vec3 {
///         self.force = *contact_force;
///         self.force
///     }
///     fn release(&mut self) {
///         self.force = Vec3::zeros();
///     }
/// }
///
/// let scene = Scene::shipped("fig3-sliding-subdivision").expect("shipped with the program");
/// let falling = Falling { position: Vec3::new(0.0, 0.0, 0.001), velocity: Vec3::zeros(), force: Vec3::zeros() };
/// let own = OwnParts { instrument: Some(Box::new(falling)), ..OwnParts::default() };
/// let mut lowest_m = f64::INFINITY;
/// Simulation::prepare_with(&scene, own)?.run(|tick| lowest_m = lowest_m.min(tick.tip.z))?;
/// assert!((-0.02..-0.001).contains(&lowest_m), "it is caught: {lowest_m} m");
/// # Ok::<(), stickslip::RunError>(())
/// ```
pub trait Instrument: DynClone + fmt::Debug + Send {
    /// Where contact sees the tip at t = 0, m.
    fn start(&self) -> Vec3;

    /// Moves on over a tick, from one time to another, s, under the force commanded last. `contact_force` is that of the
    /// last computed tick, N. Returns where contact sees the tip at the end, m.
    ///
    /// # Errors
    /// With a fault, which ends the run.
    fn sense(&mut self, begin_s: f64, end_s: f64, contact_force: &Vec3) -> Result<Vec3, InstrumentFault>;

    /// Takes the force of a contact, N. Returns the force that is commanded, before device limits.
    fn command(&mut self, contact_force: &Vec3) -> Vec3;

    /// Commands no force, after a missed deadline or a fault.
    fn release(&mut self);
}

dyn_clone::clone_trait_object!(Instrument);

/// Why an instrument of one's own cannot go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the instrument failed: {0}")]
pub struct InstrumentFault(pub &'static str);

/// Why there is no tip at the end of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SenseError {
    /// The modelled device left the range in which it can be simulated.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// An instrument of one's own failed.
    #[error(transparent)]
    Own(#[from] InstrumentFault),
}

/// The instrument of a run.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::device::instrument::{InstrumentInUse, InstrumentKind};
/// use stickslip::device::path::{TipPath, Waypoint};
///
/// let path = TipPath::new(vec![
///     Waypoint { time: 0.0, position: Vec3::zeros() },
///     Waypoint { time: 1.0, position: Vec3::x() * 0.01 },
/// ])?;
/// let mut instrument = InstrumentInUse::new(&InstrumentKind::Path, &path, 1e-3)?;
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
pub enum InstrumentInUse {
    /// A tip that follows its path whatever the force.
    Path(TipPath),
    /// The modelled device in a hand.
    Phantom(Box<CoupledPhantom>),
    /// An instrument of one's own.
    Own(Box<dyn Instrument>),
}

impl InstrumentInUse {
    /// The instrument of a scene, for ticks of `tick_s` seconds.
    ///
    /// # Errors
    /// If a device cannot be where the tip starts, or its settings are impossible.
    pub fn new(kind: &InstrumentKind, path: &TipPath, tick_s: f64) -> Result<Self, InstrumentError> {
        Ok(match kind {
            InstrumentKind::Path => Self::Path(path.clone()),
            InstrumentKind::Phantom(settings) => Self::Phantom(Box::new(CoupledPhantom::new(settings, path, tick_s)?)),
        })
    }

    /// Where contact sees the tip at t = 0, m.
    pub fn start(&self) -> Vec3 {
        match self {
            Self::Path(path) => path.at(0.0),
            Self::Phantom(phantom) => phantom.start(),
            Self::Own(instrument) => instrument.start(),
        }
    }

    /// As [`Instrument::sense`]. A tip that is not finite is a fault.
    ///
    /// # Errors
    /// If the instrument cannot go on.
    pub fn sense(&mut self, begin_s: f64, end_s: f64, contact_force: &Vec3) -> Result<Vec3, SenseError> {
        match self {
            Self::Path(path) => Ok(path.at(end_s)),
            Self::Phantom(phantom) => Ok(phantom.sense(begin_s, contact_force)?),
            Self::Own(instrument) => {
                let tip = instrument.sense(begin_s, end_s, contact_force)?;
                if tip.iter().all(|c| c.is_finite()) { Ok(tip) } else { Err(InstrumentFault("its tip is not finite"))? }
            }
        }
    }

    /// As [`Instrument::command`]. A force that is not finite is commanded as zero.
    pub fn command(&mut self, contact_force: &Vec3) -> Vec3 {
        match self {
            Self::Path(_) => *contact_force,
            Self::Phantom(phantom) => phantom.command(contact_force),
            Self::Own(instrument) => {
                let force = instrument.command(contact_force);
                if force.iter().all(|c| c.is_finite()) {
                    force
                } else {
                    instrument.release();
                    Vec3::zeros()
                }
            }
        }
    }

    /// Commands no force.
    pub fn release(&mut self) {
        match self {
            Self::Path(_) => {}
            Self::Phantom(phantom) => phantom.release(),
            Self::Own(instrument) => instrument.release(),
        }
    }

    /// The modelled device, if it is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        match self {
            Self::Path(_) | Self::Own(_) => None,
            Self::Phantom(phantom) => Some(phantom),
        }
    }
}
