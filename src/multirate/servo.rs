//! The servo loop's side of every schedule: where the instrument is, one tick of the local model, the
//! fail-safe, and the command that goes back. Allocates nothing, locks nothing, does no I/O.

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
/// // A late force is thrown away under `hold`; under `zero` there is none.
/// let held = servo.tick(DeadlineOutcome::Late(OverrunPolicy::Hold))?;
/// assert!(held.force == pressing.force && held.report.force != held.force);
/// assert_eq!(servo.tick(DeadlineOutcome::Late(OverrunPolicy::Zero))?.force, Vec3::zeros());
/// // In a tick that is left out the tip moves on, but the mesh has not seen it.
/// let skipped = servo.tick(DeadlineOutcome::Skipped)?;
/// assert!(skipped.tip.z < servo.tip().z && servo.next_tick() == 153);
///
/// // A tick in its three parts, for a loop that sleeps between the first and the second.
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
    /// h, s.
    tick_s: f64,
    /// Counted from 0: the tick that comes next.
    tick: u64,
    /// Where the tip was at the end of the last tick that was computed, m.
    tip: Vec3,
    /// What that tick did.
    report: TickReport,
    /// Its contact force, smoothed, N.
    contact_force: Vec3,
    /// The force that the instrument was last commanded, N.
    commanded: Vec3,
    /// A contact force that was too late for its tick and goes out before the next one that is computed, N.
    overdue: Option<Vec3>,
    /// The first tick of the model in use.
    model_since: u64,
    /// Whether no tick has been computed with it.
    is_new_model: bool,
}

/// What a tick left.
#[derive(Debug, Clone, Copy)]
pub struct ServoTick {
    /// Counted from 0.
    pub tick: u64,
    /// At its end, s.
    pub time: f64,
    /// The tip where the tick began to look at it, m: at the end of the last tick that was computed.
    pub tip_before: Vec3,
    /// The tip at its end, m.
    pub tip: Vec3,
    /// The force commanded to the instrument at its end, before device limits, N.
    pub force: Vec3,
    /// What it did; of the last computed one if this one was skipped.
    pub report: TickReport,
    /// Age of the model that did it, ticks.
    pub model_age: u64,
    /// Whether it met its deadline.
    pub deadline_outcome: DeadlineOutcome,
    /// The device at its end, if there is one.
    pub device: Option<DeviceView>,
}

impl Servo {
    /// At the start of tick 0.
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

    /// The local model in use, its state, and the contact.
    pub fn local(&self) -> &LocalSimulation {
        &self.local
    }

    /// The device, if there is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        self.instrument.device()
    }

    /// The local side alone.
    pub fn into_local(self) -> LocalSimulation {
        self.local
    }

    /// What the last computed tick did.
    pub fn report(&self) -> &TickReport {
        &self.report
    }

    /// The tick that comes next.
    pub fn next_tick(&self) -> u64 {
        self.tick
    }

    /// Where the tip was at the end of the last computed tick, m.
    pub fn tip(&self) -> Vec3 {
        self.tip
    }

    /// Puts a new model to use, built from the state at the start of tick `from`. The old one comes back, so
    /// that whoever built it can dispose of it.
    pub fn hand_over(&mut self, message: ModelMessage, from: u64) -> ModelMessage {
        let ModelMessage { model, state, renderer } = message;
        self.model_since = self.tick;
        self.is_new_model = true;
        let (model, state) = self.local.hand_over(model, state, self.tick.saturating_sub(from), self.tip);
        let renderer = self.local.take_over(renderer);
        ModelMessage { model, state, renderer }
    }

    /// Something went wrong outside of ticks: zero is commanded from here on.
    pub fn latch(&mut self, cause: FaultCause) -> Fault {
        self.instrument.release();
        self.failsafe.latch(self.tick, self.tip, cause)
    }

    /// One tick, whose deadline_outcome is known.
    ///
    /// # Errors
    /// With the fault that the fail-safe found; zero is commanded then.
    pub fn tick(&mut self, deadline_outcome: DeadlineOutcome) -> Result<ServoTick, Fault> {
        if deadline_outcome == DeadlineOutcome::Skipped {
            return self.skip();
        }
        let tip = self.sense()?;
        let report = self.compute(tip)?;
        Ok(self.conclude(tip, report, deadline_outcome))
    }

    /// Moves the instrument to the end of the tick under the last command: the tip there, m.
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

    /// The tick of the local model, with the tip at its end.
    ///
    /// # Errors
    /// With the fault that the fail-safe found; zero is commanded then.
    pub fn compute(&mut self, tip: Vec3) -> Result<TickReport, Fault> {
        let report = self.local.tick(self.tip, tip);
        match self.failsafe.command(self.tick, tip, &self.local, &report) {
            Ok(_) => Ok(report),
            Err(fault) => {
                self.instrument.release();
                Err(fault)
            }
        }
    }

    /// Commands what a computed tick found, smoothed after a hand-over, if it was on time, or what its policy says. What
    /// lies between contact and device works where a command goes out.
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
            // What was commanded last stays.
            DeadlineOutcome::Late(OverrunPolicy::Hold) | DeadlineOutcome::Skipped => {}
        }
        self.end(tip_before, tip, deadline_outcome)
    }

    /// A tick in which nothing is computed: the instrument moves on under the last command, the mesh stands still.
    ///
    /// # Errors
    /// As [`sense`](Self::sense).
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
