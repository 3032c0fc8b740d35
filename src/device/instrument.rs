//! Instruments: a tip on a path, the modelled device, or a custom one.

use std::fmt;

use dyn_clone::DynClone;
use thiserror::Error;

use super::coupled::{CoupledPhantom, CoupledSettings, InstrumentError};
use super::path::TipPath;
use super::phantom::DeviceError;
use crate::Vec3;

/// The kind of a scene's instrument.
#[derive(Debug, Clone, PartialEq)]
pub enum InstrumentKind {
    /// The tip follows the scene's path.
    Path,
    /// A hand that holds a modelled device has the scene's path as set-point.
    Phantom(Box<CoupledSettings>),
}

/// Interface of a custom instrument: moves the tip under the commanded force.
///
/// Contract: it is clonable and `Send`, since runs are copied and moved between threads; `sense` and `command` allocate
/// nothing, lock nothing and do no I/O; equal calls return equal tips to the bit. A tip that is not finite ends the
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
    /// Returns the tip that contact sees at t = 0, m.
    fn start(&self) -> Vec3;

    /// Moves the instrument from one time to another, s, under the force commanded last. `contact_force` is that of the
    /// last computed tick, N. Returns the tip that contact sees at the end, m.
    ///
    /// # Errors
    /// If the instrument fails; the fault ends the run.
    fn sense(&mut self, begin_s: f64, end_s: f64, contact_force: &Vec3) -> Result<Vec3, InstrumentFault>;

    /// Returns the instrument's estimate of the tip's velocity at the end of the last [`sense`](Self::sense), m/s. By
    /// default there is none, and contact derives it from the tip's displacement over the tick. Encoders quantise that:
    /// the dampers under a tip at rest then feel a count over a tick.
    fn tip_velocity(&self) -> Option<Vec3> {
        None
    }

    /// Takes the contact force, N. Returns the commanded force before device limits, N.
    fn command(&mut self, contact_force: &Vec3) -> Vec3;

    /// Commands zero force, after a missed deadline or a fault.
    fn release(&mut self);
}

dyn_clone::clone_trait_object!(Instrument);

/// The failure of a custom instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the instrument failed: {0}")]
pub struct InstrumentFault(pub &'static str);

/// A reason why there is no tip at the end of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SenseError {
    /// The modelled device left the range in which it can be simulated.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A custom instrument failed.
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
/// // A path is followed whatever the force; a device in a hand would be pushed back.
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
    /// A custom instrument.
    Own(Box<dyn Instrument>),
}

impl InstrumentInUse {
    /// Builds the instrument of a scene, for ticks of `tick_s` seconds.
    ///
    /// # Errors
    /// If a device cannot reach the start of the tip, or its settings are not accepted.
    pub fn new(kind: &InstrumentKind, path: &TipPath, tick_s: f64) -> Result<Self, InstrumentError> {
        Ok(match kind {
            InstrumentKind::Path => Self::Path(path.clone()),
            InstrumentKind::Phantom(settings) => Self::Phantom(Box::new(CoupledPhantom::new(settings, path, tick_s)?)),
        })
    }

    /// Returns the tip that contact sees at t = 0, m.
    pub fn start(&self) -> Vec3 {
        match self {
            Self::Path(path) => path.at(0.0),
            Self::Phantom(phantom) => phantom.start(),
            Self::Own(instrument) => instrument.start(),
        }
    }

    /// Moves the instrument over a tick, as [`Instrument::sense`] does. A tip that is not finite is a fault.
    ///
    /// # Errors
    /// If the instrument fails.
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

    /// Returns the estimate of the tip's velocity, m/s, as [`Instrument::tip_velocity`] does.
    pub fn tip_velocity(&self) -> Option<Vec3> {
        match self {
            Self::Path(_) => None,
            Self::Phantom(phantom) => phantom.tip_velocity(),
            Self::Own(instrument) => instrument.tip_velocity(),
        }
    }

    /// Takes the contact force, as [`Instrument::command`] does. A force that is not finite is commanded as zero.
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

    /// Commands zero force.
    pub fn release(&mut self) {
        match self {
            Self::Path(_) => {}
            Self::Phantom(phantom) => phantom.release(),
            Self::Own(instrument) => instrument.release(),
        }
    }

    /// Returns the modelled device, if the instrument is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        match self {
            Self::Path(_) | Self::Own(_) => None,
            Self::Phantom(phantom) => Some(phantom),
        }
    }
}
