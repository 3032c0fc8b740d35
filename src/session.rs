//! Recorded real-time runs, which can be replayed bit for bit: the arrival times of models and the set of late ticks
//! are all that a scene leaves open.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::Vec3;
use crate::multirate::failsafe::Fault;
use crate::multirate::global::Moment;
use crate::multirate::timeline::{OverrunPolicy, RecordedTimes, Timeline};
use crate::pipeline::{Lockstep, Simulation, TickView};
use crate::scene::{MOST_REAL_TIME_HZ, Scene, SceneError};

/// The version of the session file's format.
const FORMAT: &str = "stickslip-session-1";

/// The recorded result of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordedTick {
    /// Tip position at the end of the tick, m.
    pub tip: [f64; 3],
    /// Commanded force, N.
    pub force: [f64; 3],
}

impl RecordedTick {
    /// Records the tip position and commanded force of a tick.
    pub fn new(tip: Vec3, force: Vec3) -> Self {
        Self { tip: tip.into(), force: force.into() }
    }

    fn is_same(&self, other: &Self) -> bool {
        let bits = |taped: &Self| [taped.tip, taped.force].map(|vector| vector.map(f64::to_bits));
        bits(self) == bits(other)
    }
}

/// A checksum that shows whether two runs commanded the same forces to the bit (FNV-1a over their 64-bit patterns).
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
    /// Adds a force, N, to the checksum.
    pub fn add(&mut self, force: Vec3) {
        for component in force.iter() {
            self.0 = (self.0 ^ component.to_bits()).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// Returns the checksum as sixteen hexadecimal digits.
    pub fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// A recorded pass: one run along a scene's path.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RecordedPass {
    /// Number of the pass in its session, from 0.
    pub pass: u32,
    /// Number of ticks completed, skipped ones included.
    pub ticks: u64,
    /// Arrival times of models, and late and skipped ticks.
    pub times: RecordedTimes,
    /// Checksum of all commanded forces.
    pub checksum: String,
    /// The fault that ended the pass in the tick after these, if one did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
    /// Tip and force of every tick, if they were recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tape: Vec<RecordedTick>,
}

/// A tick worth replaying.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickToReplay {
    /// Number of the pass.
    pub pass: u32,
    /// Number of the tick in its pass, from 0.
    pub tick: u64,
    /// Why the tick is worth replaying.
    pub why: ReplayReason,
}

/// A reason to replay a tick.
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
    /// The longest time from the tick's release to its command.
    #[serde(rename = "longest response")]
    LongestResponse,
    /// The most CPU time used by the servo thread.
    #[serde(rename = "most CPU time")]
    MostCpuTime,
    /// The tip meets the surface.
    #[serde(rename = "contact onset")]
    ContactOnset,
    /// The contact point moves to another triangle.
    #[serde(rename = "edge crossed")]
    EdgeCrossed,
    /// The first tick of a new model, in contact.
    #[serde(rename = "model handed over")]
    HandOver,
    /// A tick long after all motion has decayed, where subnormal numbers would slow it down.
    #[serde(rename = "rest after long decay")]
    Rest,
}

impl ReplayReason {
    /// Returns the name used in files and tables.
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

/// A file that a session's scene names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SessionFile {
    /// Path as the scene writes it.
    pub path: PathBuf,
    /// SHA-256 of its content, in hexadecimal.
    pub sha256: String,
}

/// Returns the SHA-256 of bytes, in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the SHA-256 of a file's content; `None` if it cannot be read.
pub fn sha256_of_file(path: &Path) -> Option<String> {
    crate::output::folder::sha256(path).ok()
}

/// A recorded session: the scene, what decides the course of its runs, and their results.
///
/// ```
/// use stickslip::session::{Checksum, RecordedPass, ReplayOutcome, Session, replay};
/// use stickslip::multirate::timeline::{Arrival, OverrunPolicy, RecordedTimes};
/// use stickslip::scene::Scene;
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let mut session = Session::new(&scene, OverrunPolicy::Hold);
/// // 200 ticks, one of them late, and a model that arrived after 30 ticks.
/// let arrivals = vec![Arrival { from: 100, at: 130 }];
/// let times = RecordedTimes { arrivals, late: vec![150], skipped: vec![] };
/// let checksum = Checksum::default().text();
/// let mut pass = RecordedPass { pass: 0, ticks: 200, times, checksum, fault: None, tape: vec![] };
///
/// // With the checksum of no force at all the replay differs; with its own it is the same.
/// let mut commanded = Checksum::default();
/// let replayed = replay(session.prepare(&scene, &pass)?, &pass, |tick| commanded.add(tick.force));
/// assert_eq!(replayed, ReplayOutcome::Differs { tick: None });
/// pass.checksum = commanded.text();
/// session.passes.push(pass);
///
/// // It is still the same after writing the session to a file and reading it.
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
    /// Version of the program that recorded the session.
    pub version: String,
    /// Path of the scene; files that the scene names are relative to it, or else to the session's own file.
    pub scene_path: PathBuf,
    /// The scene's TOML, with all changes.
    pub scene: String,
    /// Changes of single keys that the scene was read with, in their order; the TOML holds them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
    /// Mesh and recording that the scene names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<SessionFile>,
    /// Rate of the local loop, Hz; it may override the scene's.
    pub rate_hz: f64,
    /// Policy for missed deadlines.
    pub overrun: OverrunPolicy,
    /// Recorded passes, in ascending order; some may be absent.
    pub passes: Vec<RecordedPass>,
    /// Ticks worth replaying.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worst: Vec<TickToReplay>,
    /// Folder that the session was read from.
    #[serde(skip)]
    folder: Option<PathBuf>,
}

/// A reason why a session cannot be replayed.
#[derive(Debug, Error, Diagnostic)]
pub enum SessionError {
    /// The file cannot be read.
    #[error("cannot read {path}")]
    #[diagnostic(help("give the session.json that a run with `schedule = \"threads\"` or a certificate wrote"))]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The file is not a recorded session.
    #[error("{path} is not a recorded session")]
    #[diagnostic(help("give the session.json that a run with `schedule = \"threads\"` or a certificate wrote"))]
    NotASession {
        /// Path of the file.
        path: PathBuf,
        /// The parser's message, with line and column.
        source: serde_json::Error,
    },
    /// The file has another format version.
    #[error("{path} has the format `{found}`; this program reads `{FORMAT}`")]
    #[diagnostic(help("replay it with the version of the program that recorded it"))]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Format named in the file.
        found: String,
    },
    /// There is no tick to replay.
    #[error("there is nothing to replay: no pass has a tick")]
    #[diagnostic(help("record a run that is not stopped before its first tick"))]
    Nothing,
    /// Parts of the session contradict each other.
    #[error("the session cannot be replayed: {0}")]
    #[diagnostic(help("it was changed or damaged: record it again"))]
    Damaged(String),
    /// A file that the scene names is missing or has changed.
    #[error("{path} is missing or has changed since the session was recorded")]
    #[diagnostic(help(
        "put the file with the SHA-256 {sha256} there, or beside the session at the same relative path"
    ))]
    OtherFile {
        /// Path of the file, from the recorded path of the scene.
        path: PathBuf,
        /// SHA-256 of the file that was recorded.
        sha256: String,
    },
    /// The session's scene is not accepted.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
}

/// The result of replaying a pass.
#[derive(Debug, Clone, PartialEq)]
pub enum ReplayOutcome {
    /// The replay is the same to the bit, including the fault that ended both, if one did.
    Same {
        /// The fault that ended both runs, if one did.
        fault: Option<Box<Fault>>,
    },
    /// The replay has another tip or force.
    Differs {
        /// First tick that differs; `None` if only the checksum was recorded.
        tick: Option<u64>,
    },
    /// The replay ended with a fault that the recording does not have, or without the one that it has.
    Ended {
        /// Number of ticks completed by the replay.
        ticks: u64,
        /// The fault that ended the replay, if one did.
        fault: Option<Box<Fault>>,
    },
}

impl Session {
    /// Creates a session without passes.
    pub fn new(scene: &Scene, overrun: OverrunPolicy) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_path: std::path::absolute(scene.path_name()).unwrap_or_else(|_| scene.path_name().to_owned()),
            scene: scene.text().unwrap_or_default().to_owned(),
            changes: scene.changes(),
            files: scene
                .named_files()
                .into_iter()
                .map(|path| {
                    let sha256 = sha256_of_file(&scene.folder().join(&path)).unwrap_or_default();
                    SessionFile { path, sha256 }
                })
                .collect(),
            rate_hz: scene.local_rate_hz(),
            overrun,
            passes: Vec::new(),
            worst: Vec::new(),
            folder: None,
        }
    }

    /// Reads a session from a file.
    ///
    /// # Errors
    /// If the file cannot be read or is not a session of this format.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        let text =
            fs::read_to_string(path).map_err(|source| SessionError::Unreadable { path: path.to_owned(), source })?;
        let mut session: Self = serde_json::from_str(&text)
            .map_err(|source| SessionError::NotASession { path: path.to_owned(), source })?;
        if session.format != FORMAT {
            return Err(SessionError::Format { path: path.to_owned(), found: session.format });
        }
        session.folder = path.parent().map(Path::to_owned);
        Ok(session)
    }

    /// Builds the session's scene at its recorded rate, with the files that it was recorded with.
    ///
    /// # Errors
    /// If the text is not a valid scene, which a scene built in Rust does not have; if a file that it names is neither
    /// at its recorded place nor beside the session; or if no loop in real time can have the session's rate.
    pub fn scene(&self) -> Result<Scene, SessionError> {
        if !(self.rate_hz <= MOST_REAL_TIME_HZ) {
            let most = MOST_REAL_TIME_HZ;
            return Err(SessionError::Damaged(format!(
                "`rate_hz` is {}, and a loop in real time has at most {most} Hz",
                self.rate_hz
            )));
        }
        let scene = Scene::parse(&self.scene, &self.path_with_files()?)?;
        let is_own_rate = scene.local_rate_hz().to_bits() == self.rate_hz.to_bits();
        let mut scene = if is_own_rate { scene } else { scene.with_local_rate_hz(self.rate_hz)? };
        scene.deadline.overrun = self.overrun;
        Ok(scene)
    }

    /// Returns a path for the scene relative to which all files that it names are those of the recording: the recorded
    /// path, or else one beside the session, as on another machine.
    fn path_with_files(&self) -> Result<PathBuf, SessionError> {
        let name = self.scene_path.file_name().unwrap_or_default();
        let beside = self.folder.as_ref().map(|folder| folder.join(name));
        let other = |path: &Path| {
            let folder = path.parent().unwrap_or(Path::new(""));
            self.files.iter().find(|file| sha256_of_file(&folder.join(&file.path)).as_ref() != Some(&file.sha256))
        };
        let Some(missing) = other(&self.scene_path) else { return Ok(self.scene_path.clone()) };
        match beside.filter(|path| other(path).is_none()) {
            Some(path) => Ok(path),
            None => Err(SessionError::OtherFile {
                path: self.scene_path.parent().unwrap_or(Path::new("")).join(&missing.path),
                sha256: missing.sha256.clone(),
            }),
        }
    }

    /// Checks that there is something to replay and that the recording fits the scene and itself.
    ///
    /// # Errors
    /// If there is nothing to replay, or a part contradicts another one.
    pub fn check(&self, scene: &Scene) -> Result<(), SessionError> {
        let damaged = |what: String| Err(SessionError::Damaged(what));
        if self.passes.iter().all(|pass| pass.ticks == 0 && pass.fault.is_none()) {
            return Err(SessionError::Nothing);
        }
        for RecordedPass { pass, ticks, times, tape, .. } in &self.passes {
            let path = scene.tick_count();
            if *ticks > path {
                return damaged(format!("pass {pass} has {ticks} ticks, and the scene's path {path}"));
            }
            if !tape.is_empty() && tape.len() as u64 != *ticks {
                return damaged(format!("pass {pass} has {ticks} ticks, and forces of {}", tape.len()));
            }
            for (what, list) in [("late", &times.late), ("skipped", &times.skipped)] {
                if !list.is_sorted_by(|a, b| a < b) || list.last().is_some_and(|tick| tick >= ticks) {
                    return damaged(format!("the {what} ticks of pass {pass} are not ascending numbers below {ticks}"));
                }
            }
        }
        for TickToReplay { pass, tick, .. } in &self.worst {
            let of = self.passes.iter().find(|recorded| recorded.pass == *pass);
            if of.is_none_or(|recorded| *tick >= recorded.ticks + u64::from(recorded.fault.is_some())) {
                return damaged(format!("tick {tick} of pass {pass} is to be timed, but was not recorded"));
            }
        }
        Ok(())
    }

    /// Prepares a run with the recorded times of a pass.
    ///
    /// # Errors
    /// If the scene cannot be prepared.
    pub fn prepare(&self, scene: &Scene, pass: &RecordedPass) -> Result<Simulation, SceneError> {
        let timeline = Timeline::Recorded { times: pass.times.clone(), overrun: self.overrun };
        Ok(Simulation::prepare(scene)?.with_timeline(timeline))
    }
}

/// Replays a pass and compares it with the recording; `observe` is called after every tick.
pub fn replay(simulation: Simulation, recorded: &RecordedPass, observe: impl FnMut(&TickView)) -> ReplayOutcome {
    replay_timed(simulation, recorded, |_| (), observe)
}

/// Replays a pass as [`replay`] does; `mark` is called at every moment of the schedule.
pub fn replay_timed(
    simulation: Simulation,
    recorded: &RecordedPass,
    mut mark: impl FnMut(Moment),
    mut observe: impl FnMut(&TickView),
) -> ReplayOutcome {
    let mut run = Lockstep::new(simulation);
    let (mut ticks, mut checksum, mut differs) = (0, Checksum::default(), None);
    let mut fault = None;
    // A recorded fault comes in the tick after the last completed one.
    let last = recorded.ticks + u64::from(recorded.fault.is_some());
    while ticks < last && fault.is_none() {
        match run.step_timed(&mut mark) {
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
