//! Runs in real time, recorded so that they can be run again bit for bit: when models arrived and which ticks
//! were late decide everything that a scene leaves open.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Vec3;
use crate::multirate::failsafe::Fault;
use crate::multirate::timeline::{OverrunPolicy, RecordedTimes, Timeline};
use crate::pipeline::{Lockstep, Simulation, TickView};
use crate::scene::{Scene, SceneError};

/// The version of the file's format.
const FORMAT: &str = "stickslip-session-1";

/// What a tick left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordedTick {
    /// The tip at its end, m.
    pub tip: [f64; 3],
    /// Commanded, N.
    pub force: [f64; 3],
}

impl RecordedTick {
    /// Tip and commanded force of a tick.
    pub fn new(tip: Vec3, force: Vec3) -> Self {
        Self { tip: tip.into(), force: force.into() }
    }

    fn is_same(&self, other: &Self) -> bool {
        let bits = |taped: &Self| [taped.tip, taped.force].map(|vector| vector.map(f64::to_bits));
        bits(self) == bits(other)
    }
}

/// Tells whether two runs commanded the same forces to the bit (FNV-1a over their 64-bit patterns).
///
/// ```
/// use stickslip::{Vec3, session::{Checksum, RecordedTick}};
///
/// let of = |forces: &[Vec3]| {
///     let mut checksum = Checksum::default();
///     forces.iter().for_each(|&force| checksum.add(force));
///     checksum.text()
/// };
/// assert_eq!(of(&[Vec3::x(), Vec3::y()]), of(&[Vec3::x(), Vec3::y()]));
/// assert_ne!(of(&[Vec3::x(), Vec3::y()]), of(&[Vec3::y(), Vec3::x()])); // the order counts,
/// assert_ne!(of(&[Vec3::zeros()]), of(&[-Vec3::zeros()])); // and every bit
/// assert_eq!(RecordedTick::new(Vec3::x(), Vec3::z()).force, [0.0, 0.0, 1.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Checksum(u64);

impl Default for Checksum {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Checksum {
    /// Takes in a force, N.
    pub fn add(&mut self, force: Vec3) {
        for component in force.iter() {
            self.0 = (self.0 ^ component.to_bits()).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// Sixteen hexadecimal digits.
    pub fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// One run of a scene's path.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RecordedPass {
    /// Counted from 0 in its session.
    pub pass: u32,
    /// Ticks that were done, and left out.
    pub ticks: u64,
    /// What happened.
    pub times: RecordedTimes,
    /// Of all commanded forces.
    pub checksum: String,
    /// The fault that ended it in the tick after these, if one did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
    /// Tick by tick, if that was kept.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tape: Vec<RecordedTick>,
}

/// A tick to look at again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickToReplay {
    /// Its pass.
    pub pass: u32,
    /// Counted from 0 in its pass.
    pub tick: u64,
    /// Why it is here.
    pub why: ReplayReason,
}

/// What makes a tick worth another look.
///
/// ```
/// use stickslip::session::ReplayReason;
///
/// let written = serde_json::to_value(ReplayReason::HandOver)?;
/// assert_eq!(written, ReplayReason::HandOver.name());
/// assert_eq!(serde_json::from_value::<ReplayReason>(written)?, ReplayReason::HandOver);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ReplayReason {
    /// From the start of its tick to its command.
    #[serde(rename = "longest response")]
    LongestResponse,
    /// Of the servo thread.
    #[serde(rename = "most CPU time")]
    MostCpuTime,
    /// The tip meets the surface.
    #[serde(rename = "contact onset")]
    ContactOnset,
    /// The contact point goes to another triangle.
    #[serde(rename = "edge crossed")]
    EdgeCrossed,
    /// The first tick of a model, in contact.
    #[serde(rename = "model handed over")]
    HandOver,
    /// Long after everything has decayed, where subnormal numbers would show.
    #[serde(rename = "rest after long decay")]
    Rest,
}

impl ReplayReason {
    /// As it is said in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            ReplayReason::LongestResponse => "longest response",
            ReplayReason::MostCpuTime => "most CPU time",
            ReplayReason::ContactOnset => "contact onset",
            ReplayReason::EdgeCrossed => "edge crossed",
            ReplayReason::HandOver => "model handed over",
            ReplayReason::Rest => "rest after long decay",
        }
    }
}

/// A recorded session: the scene, what decides how it went, and what came out.
///
/// ```
/// use stickslip::session::{Checksum, RecordedPass, ReplayOutcome, Session, replay};
/// use stickslip::multirate::timeline::{Arrival, OverrunPolicy, RecordedTimes};
/// use stickslip::scene::Scene;
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let mut session = Session::new(&scene, OverrunPolicy::Hold);
/// // 200 ticks, of which one was late, with a model that took 30 ticks to come.
/// let arrivals = vec![Arrival { from: 100, at: 130 }];
/// let times = RecordedTimes { arrivals, late: vec![150], skipped: vec![] };
/// let checksum = Checksum::default().text();
/// let mut pass = RecordedPass { pass: 0, ticks: 200, times, checksum, fault: None, tape: vec![] };
///
/// // With the checksum of no force at all it is another run; with its own it is the same.
/// let mut commanded = Checksum::default();
/// let replayed = replay(session.prepare(&scene, &pass)?, &pass, |tick| commanded.add(tick.force));
/// assert_eq!(replayed, ReplayOutcome::Differs { tick: None });
/// pass.checksum = commanded.text();
/// session.passes.push(pass);
///
/// // So it is after a way through a file.
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("session.json");
/// std::fs::write(&file, serde_json::to_string(&session)?)?;
/// let session = Session::load(&file)?;
/// let again = session.prepare(&session.scene()?, &session.passes[0])?;
/// assert_eq!(replay(again, &session.passes[0], |_| ()), ReplayOutcome::Same { fault: None });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Session {
    format: String,
    /// Of the program that recorded it.
    pub version: String,
    /// Where the scene came from; files that it names are relative to it.
    pub scene_path: PathBuf,
    /// The scene's TOML.
    pub scene: String,
    /// Of its local loop, Hz: another one than the scene's if that was asked for.
    pub rate_hz: f64,
    /// What a missed deadline did.
    pub overrun: OverrunPolicy,
    /// Its passes, ascending; not every one need be here.
    pub passes: Vec<RecordedPass>,
    /// Ticks to look at again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worst: Vec<TickToReplay>,
}

/// Why a session cannot be run again.
#[derive(Debug, Error, Diagnostic)]
pub enum SessionError {
    /// The file cannot be read.
    #[error("cannot read {path}")]
    #[diagnostic(help("give the session.json that a run with `schedule = \"threads\"` or a certificate left"))]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is something else.
    #[error("{path} is not a recorded session")]
    #[diagnostic(help("give the session.json that a run with `schedule = \"threads\"` or a certificate left"))]
    NotASession {
        /// Which.
        path: PathBuf,
        /// The parser's words, with line and column.
        source: serde_json::Error,
    },
    /// Of another format.
    #[error("{path} has the format `{found}`; this program reads `{FORMAT}`")]
    #[diagnostic(help("replay it with the version of the program that recorded it"))]
    Format {
        /// Which.
        path: PathBuf,
        /// Its format.
        found: String,
    },
    /// Its scene.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
}

/// How a pass went the second time.
#[derive(Debug, Clone, PartialEq)]
pub enum ReplayOutcome {
    /// The same, to the bit; with the fault that ended both, if one did.
    Same {
        /// What ended it.
        fault: Option<Box<Fault>>,
    },
    /// Another tip or force.
    Differs {
        /// The first tick that differs; `None` if only the checksum was kept.
        tick: Option<u64>,
    },
    /// A fault, where there was none, or none where there was one.
    Ended {
        /// Ticks that were done.
        ticks: u64,
        /// What ended it.
        fault: Option<Box<Fault>>,
    },
}

impl Session {
    /// A session without passes yet.
    pub fn new(scene: &Scene, overrun: OverrunPolicy) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_path: std::path::absolute(scene.path_name()).unwrap_or_else(|_| scene.path_name().to_owned()),
            scene: scene.text().unwrap_or_default().to_owned(),
            rate_hz: scene.local_rate_hz(),
            overrun,
            passes: Vec::new(),
            worst: Vec::new(),
        }
    }

    /// Reads one.
    ///
    /// # Errors
    /// If the file cannot be read, or is something else.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        let text =
            fs::read_to_string(path).map_err(|source| SessionError::Unreadable { path: path.to_owned(), source })?;
        let session: Self = serde_json::from_str(&text)
            .map_err(|source| SessionError::NotASession { path: path.to_owned(), source })?;
        if session.format != FORMAT {
            return Err(SessionError::Format { path: path.to_owned(), found: session.format });
        }
        Ok(session)
    }

    /// Its scene, at its rate.
    ///
    /// # Errors
    /// If it is none, names a file that is gone, or was built in Rust.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        let scene = Scene::parse(&self.scene, &self.scene_path)?;
        let is_own_rate = scene.local_rate_hz().to_bits() == self.rate_hz.to_bits();
        let mut scene = if is_own_rate { scene } else { scene.with_local_rate_hz(self.rate_hz)? };
        scene.deadline.overrun = self.overrun;
        Ok(scene)
    }

    /// A pass, ready to run as it went.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn prepare(&self, scene: &Scene, pass: &RecordedPass) -> Result<Simulation, SceneError> {
        let timeline = Timeline::Recorded { times: pass.times.clone(), overrun: self.overrun };
        Ok(Simulation::prepare(scene)?.with_timeline(timeline))
    }
}

/// Runs a pass again and compares; `observe` is called after every tick.
pub fn replay(simulation: Simulation, recorded: &RecordedPass, mut observe: impl FnMut(&TickView)) -> ReplayOutcome {
    let mut run = Lockstep::new(simulation);
    let (mut ticks, mut checksum, mut differs) = (0, Checksum::default(), None);
    let mut fault = None;
    // A recorded fault comes in the tick after the last that was done.
    let last = recorded.ticks + u64::from(recorded.fault.is_some());
    while ticks < last && fault.is_none() {
        match run.step() {
            Ok(Some(view)) => {
                checksum.add(view.force);
                let taped = RecordedTick::new(view.tip, view.force);
                let was = recorded.tape.get(view.tick as usize);
                if differs.is_none() && was.is_some_and(|was| !was.is_same(&taped)) {
                    differs = Some(view.tick);
                }
                observe(&view);
                ticks += 1;
            }
            Ok(None) => break,
            Err(error) => fault = Some(Box::new(error)),
        }
    }
    if differs.is_some() || (ticks == recorded.ticks && checksum.text() != recorded.checksum) {
        ReplayOutcome::Differs { tick: differs }
    } else if ticks == recorded.ticks && fault.as_ref().map(ToString::to_string) == recorded.fault {
        ReplayOutcome::Same { fault }
    } else {
        ReplayOutcome::Ended { ticks, fault }
    }
}
