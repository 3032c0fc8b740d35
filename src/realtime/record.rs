//! Recording of a real-time run: `stickslip run` of a scene with `schedule = "threads"`.

use std::sync::atomic::AtomicBool;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

use super::meter::{Meter, Times};
use super::threads::{LoopSettings, NotServed, Obtained, Pass, Served, Window, serve};
use crate::multirate::timeline::OverrunPolicy;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};
use crate::session::Session;

/// Quantiles of a time, ns.
///
/// ```
/// use stickslip::realtime::{meter::{Meter, TickTimes}, record::Quantiles};
///
/// let mut meter = Meter::new(100, 1_000_000);
/// for tick in 1..=100 {
///     meter.tick(TickTimes { tick, response_ns: tick, ..TickTimes::default() }, 0);
/// }
/// let quantiles = Quantiles::of(&meter.response); // 1, 2, … 100 ns
/// assert_eq!((quantiles.p50, quantiles.p90, quantiles.p99, quantiles.max), (50, 90, 99, 100));
/// assert_eq!((quantiles.p999, quantiles.p9999), (None, None)); // no time lies beyond them
/// ```
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Quantiles {
    /// 50 % quantile, ns.
    pub p50: u64,
    /// 90 % quantile, ns.
    pub p90: u64,
    /// 99 % quantile, ns.
    pub p99: u64,
    /// 99.9 % quantile, ns; absent for fewer than 1000 times, of which none lies beyond it.
    pub p999: Option<u64>,
    /// 99.99 % quantile, ns; absent for fewer than 10,000 times.
    pub p9999: Option<u64>,
    /// Exact maximum, ns; quantiles have three digits.
    pub max: u64,
}

impl Quantiles {
    /// Computes the quantiles of recorded times.
    pub fn of(times: &Times) -> Self {
        let at = |share| times.quantile_ns(share);
        let rare = |share, least| (times.count() >= least).then(|| at(share));
        let (p999, p9999) = (rare(0.999, 1000), rare(0.9999, 10_000));
        Self { p50: at(0.5), p90: at(0.9), p99: at(0.99), p999, p9999, max: times.max_ns() }
    }
}

/// Timing of a real-time run.
#[derive(Debug, Clone, Serialize)]
pub struct RealTimeSummary {
    /// Deadline after a tick's release, µs.
    pub deadline_us: f64,
    /// Policy for a deadline miss.
    pub overrun: OverrunPolicy,
    /// Time from a scheduled release to the tick's begin.
    pub release_ns: Quantiles,
    /// Time from a scheduled release to the command.
    pub response_ns: Quantiles,
    /// Time from begin to command.
    pub compute_ns: Quantiles,
    /// Number of ticks that missed their deadline.
    pub misses: u64,
    /// Number of ticks that were skipped.
    pub skipped: u64,
    /// The servo thread's own counters.
    pub window: Window,
    /// Scheduling settings actually granted.
    pub settings: Obtained,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
    /// Whether a replay in virtual time commanded the same forces to the bit.
    pub replayed: bool,
}

impl RealTimeSummary {
    fn new(scene: &Scene, meter: &Meter, served: &Served) -> Self {
        Self {
            deadline_us: scene.deadline.after * 1e6,
            overrun: scene.deadline.overrun,
            release_ns: Quantiles::of(&meter.release),
            response_ns: Quantiles::of(&meter.response),
            compute_ns: Quantiles::of(&meter.compute),
            misses: meter.missed(),
            skipped: meter.skipped(),
            window: served.window,
            settings: served.obtained.clone(),
            stopped: served.stopped,
            replayed: false,
        }
    }
}

/// A recorded real-time run.
#[derive(Debug)]
pub struct Recorded {
    /// The session to replay.
    pub session: Session,
    /// Timing of the run.
    pub summary: RealTimeSummary,
}

/// Returns the loop settings of a scene, with or without the control loop.
pub fn loop_settings(scene: &Scene, simulation: &Simulation, control: bool) -> LoopSettings {
    LoopSettings {
        tick_s: scene.tick_s(),
        ticks_per_cycle: u64::from(scene.ticks_per_cycle()),
        recording: simulation.recording(),
        deadline: scene.deadline,
        control,
    }
}

/// A reason why there is no recording.
#[derive(Debug, Error, Diagnostic)]
pub enum RecordError {
    /// The scene is not accepted.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// The loop could not be run.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Loop(#[from] NotServed),
}

/// Runs a scene in real time and records it; `stop` ends it at the next tick.
///
/// # Errors
/// If the scene cannot be prepared, or the loop could not be run.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use stickslip::{realtime::record::record, scene::Scene, session::{ReplayOutcome, replay}};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(40); // 40 ms
/// let recorded = record(&scene, &AtomicBool::new(false))?;
/// let (session, pass) = (&recorded.session, &recorded.session.passes[0]);
/// assert_eq!((pass.ticks, recorded.summary.stopped), (40, false));
/// // Whatever the timing on this machine, the replay gives the same forces.
/// assert_eq!(replay(session.prepare(&scene, pass)?, pass, |_| ()), ReplayOutcome::Same { fault: None });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn record(scene: &Scene, stop: &AtomicBool) -> Result<Recorded, RecordError> {
    let simulation = Simulation::prepare(scene)?;
    // A copy would do, but a renderer in a library has none.
    let warm_up = Simulation::prepare(scene)?.into_sides().servo;
    let settings = loop_settings(scene, &simulation, false);
    let pass = Pass::new(simulation, scene.tick_count(), true);
    let mut served = serve([pass], scene.tick_count(), warm_up, settings, stop)?;
    let mut session = Session::new(scene, scene.deadline.overrun);
    session.passes = std::mem::take(&mut served.passes);
    Ok(Recorded { session, summary: RealTimeSummary::new(scene, &served.meter, &served) })
}
