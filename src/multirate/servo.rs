//! The servo side of every schedule: it senses the instrument, computes a tick of the local model, applies the
//! fail-safe and commands the force. It allocates nothing, locks nothing and does no I/O.

use crate::Vec3;
use crate::contact::report::TickReport;
use crate::contact::simulation::LocalSimulation;
use crate::device::coupled::{CoupledPhantom, DeviceView};
use crate::device::coupling::HandOverSmoothing;
use crate::device::instrument::{InstrumentInUse, SenseError};
use crate::multirate::failsafe::{FailSafe, Fault, FaultCause};
use crate::multirate::messages::ModelMessage;
use crate::multirate::timeline::{DeadlineOutcome, OverrunPolicy};

/// The local side with its instrument.
///
/// ```
/// use stickslip::multirate::failsafe::FaultCause;
/// use stickslip::multirate::timeline::{DeadlineOutcome, OverrunPolicy};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let mut servo = Simulation::prepare(&scene)?.into_sides().servo;
/// for _ in 0..149 {
///     servo.tick(DeadlineOutcome::OnTime)?;
/// }
/// let pressing = servo.tick(DeadlineOutcome::OnTime)?;
/// assert!(pressing.force.z > 0.0 && pressing.tip == servo.tip());
/// // A late force is discarded under `hold`; under `zero` the command is zero.
/// let held = servo.tick(DeadlineOutcome::Late(OverrunPolicy::Hold))?;
/// assert!(held.force == pressing.force && held.report.force != held.force);
/// assert_eq!(servo.tick(DeadlineOutcome::Late(OverrunPolicy::Zero))?.force, Vec3::zeros());
/// // In a skipped tick the tip moves on, but the mesh has not seen it.
/// let skipped = servo.tick(DeadlineOutcome::Skipped)?;
/// assert!(skipped.tip.z < servo.tip().z && servo.next_tick() == 153);
///
/// // The three parts of a tick, for a loop that sleeps between the first and the second.
/// let tip = servo.sense()?;
/// let report = servo.compute(tip)?;
/// assert_eq!(servo.conclude(tip, report, DeadlineOutcome::OnTime).force, report.force);
///
/// let fault = servo.latch(FaultCause::StateNotFinite { node: 0 });
/// assert_eq!(servo.tick(DeadlineOutcome::OnTime).map(|done| done.force), Err(fault)); // for good
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Servo {
    local: LocalSimulation,
    instrument: InstrumentInUse,
    smoothing: HandOverSmoothing,
    failsafe: FailSafe,
    /// Local tick h, s.
    tick_s: f64,
    /// Number of the next tick, from 0.
    tick: u64,
    /// Tip position at the end of the last computed tick, m.
    tip: Vec3,
    /// Report of the last computed tick.
    report: TickReport,
    /// Contact force of the last computed tick, smoothed, N.
    contact_force: Vec3,
    /// Force last commanded to the instrument, N.
    commanded: Vec3,
    /// Contact force that missed its tick's deadline, to be commanded before the next computed tick, N.
    overdue: Option<Vec3>,
    /// First tick of the model in use.
    model_since: u64,
    /// Whether no tick has been computed with the model in use.
    is_new_model: bool,
}

/// The result of one servo tick.
#[derive(Debug, Clone, Copy)]
pub struct ServoTick {
    /// Number of the tick, from 0.
    pub tick: u64,
    /// Time at the end of the tick, s.
    pub time: f64,
    /// Tip position from which the tick starts, m: that at the end of the last computed tick.
    pub tip_before: Vec3,
    /// Tip position at the end of the tick, m.
    pub tip: Vec3,
    /// Force commanded to the instrument at the end of the tick, before device limits, N.
    pub force: Vec3,
    /// Report of the tick, or of the last computed tick if this one was skipped.
    pub report: TickReport,
    /// Age of the model used, ticks.
    pub model_age: u64,
    /// Deadline outcome of the tick.
    pub deadline_outcome: DeadlineOutcome,
    /// State of the device at the end of the tick, if there is one.
    pub device: Option<DeviceView>,
}

impl Servo {
    /// Creates the servo side at the start of tick 0.
    pub fn new(
        local: LocalSimulation,
        instrument: InstrumentInUse,
        smoothing: HandOverSmoothing,
        failsafe: FailSafe,
        tick_s: f64,
    ) -> Self {
        Self {
            tip: instrument.start(),
            local,
            instrument,
            smoothing,
            failsafe,
            tick_s,
            tick: 0,
            report: TickReport::none(),
            contact_force: Vec3::zeros(),
            commanded: Vec3::zeros(),
            overdue: None,
            model_since: 0,
            is_new_model: false,
        }
    }

    /// Returns the local model in use, its state, and the contact.
    pub fn local(&self) -> &LocalSimulation {
        &self.local
    }

    /// Returns the device, if there is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        self.instrument.device()
    }

    /// Returns the local side alone.
    pub fn into_local(self) -> LocalSimulation {
        self.local
    }

    /// Returns the report of the last computed tick.
    pub fn report(&self) -> &TickReport {
        &self.report
    }

    /// Returns the number of the next tick.
    pub fn next_tick(&self) -> u64 {
        self.tick
    }

    /// Returns the tip position at the end of the last computed tick, m.
    pub fn tip(&self) -> Vec3 {
        self.tip
    }

    /// Puts a new model to use, built from the state at the start of tick `from`. Returns the old one, so that the
    /// global side can dispose of it.
    pub fn hand_over(&mut self, message: ModelMessage, from: u64) -> ModelMessage {
        let ModelMessage { model, state, renderer } = message;
        self.model_since = self.tick;
        self.is_new_model = true;
        let (model, state) = self.local.hand_over(model, state, self.tick.saturating_sub(from), self.tip);
        let renderer = self.local.take_over(renderer);
        ModelMessage { model, state, renderer }
    }

    /// Latches a fault that occurred outside of ticks; zero is commanded from here on.
    pub fn latch(&mut self, cause: FaultCause) -> Fault {
        self.instrument.release();
        self.failsafe.latch(self.tick, self.tip, cause)
    }

    /// Does one tick whose deadline outcome is known.
    ///
    /// # Errors
    /// If the fail-safe finds a fault; zero is commanded then.
    pub fn tick(&mut self, deadline_outcome: DeadlineOutcome) -> Result<ServoTick, Fault> {
        if deadline_outcome == DeadlineOutcome::Skipped {
            return self.skip();
        }
        let tip = self.sense()?;
        let report = self.compute(tip)?;
        Ok(self.conclude(tip, report, deadline_outcome))
    }

    /// Moves the instrument to the end of the tick under the last command. Returns the tip there, m.
    ///
    /// # Errors
    /// If the instrument leaves the range in which it can be simulated.
    pub fn sense(&mut self) -> Result<Vec3, Fault> {
        if let Some(force) = self.overdue.take() {
            self.commanded = self.instrument.command(&force);
        }
        self.move_instrument()
    }

    fn move_instrument(&mut self) -> Result<Vec3, Fault> {
        let [begin, end] = [self.tick, self.tick + 1].map(|tick| tick as f64 * self.tick_s);
        self.instrument.sense(begin, end, &self.contact_force).map_err(|error| {
            self.latch(match error {
                SenseError::Device(error) => FaultCause::Device(error),
                SenseError::Own(fault) => FaultCause::Instrument(fault),
            })
        })
    }

    /// Computes the tick of the local model, with the tip at its end.
    ///
    /// # Errors
    /// If the fail-safe finds a fault; zero is commanded then.
    pub fn compute(&mut self, tip: Vec3) -> Result<TickReport, Fault> {
        self.local.set_tip_velocity(self.instrument.tip_velocity());
        let report = self.local.tick(self.tip, tip);
        match self.failsafe.command(self.tick, tip, &self.local, &report) {
            Ok(_) => Ok(report),
            Err(fault) => {
                self.instrument.release();
                Err(fault)
            }
        }
    }

    /// Commands the force of a computed tick, smoothed after a hand-over, or follows the overrun policy if it was late.
    /// The coupling between contact and device acts when a command is issued.
    pub fn conclude(&mut self, tip: Vec3, report: TickReport, deadline_outcome: DeadlineOutcome) -> ServoTick {
        let tip_before = std::mem::replace(&mut self.tip, tip);
        self.report = report;
        self.contact_force = self.smoothing.command(&report.force, std::mem::take(&mut self.is_new_model));
        match deadline_outcome {
            DeadlineOutcome::OnTime => self.commanded = self.instrument.command(&self.contact_force),
            DeadlineOutcome::Late(OverrunPolicy::Zero) => {
                self.instrument.release();
                self.commanded = Vec3::zeros();
            }
            DeadlineOutcome::Late(OverrunPolicy::Skip) => self.overdue = Some(self.contact_force),
            // The last command stays.
            DeadlineOutcome::Late(OverrunPolicy::Hold) | DeadlineOutcome::Skipped => {}
        }
        self.end(tip_before, tip, deadline_outcome)
    }

    /// Skips a tick: the instrument moves on under the last command, the mesh stands still.
    ///
    /// # Errors
    /// If the instrument leaves the range in which it can be simulated.
    pub fn skip(&mut self) -> Result<ServoTick, Fault> {
        let tip = self.move_instrument()?;
        Ok(self.end(self.tip, tip, DeadlineOutcome::Skipped))
    }

    fn end(&mut self, tip_before: Vec3, tip: Vec3, deadline_outcome: DeadlineOutcome) -> ServoTick {
        let tick = self.tick;
        self.tick += 1;
        ServoTick {
            tick,
            time: self.tick as f64 * self.tick_s,
            tip_before,
            tip,
            force: self.commanded,
            report: self.report,
            model_age: tick - self.model_since,
            deadline_outcome,
            device: self.instrument.device().map(CoupledPhantom::view),
        }
    }
}
