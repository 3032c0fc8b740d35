//! Scenes: what is simulated, read from TOML and checked before anything is built.

mod error;
mod file;
mod keys;
mod mesh;
mod parts;
mod shipped;
mod validate;

use std::ops::Range;
use std::path::Path;

use miette::NamedSource;

pub use error::{Problem, SceneError};
pub use keys::KEYS;
pub use mesh::MeshSource;
pub use parts::Part;
pub use shipped::{Expectation, SHIPPED, Shipped};

use crate::contact::rules::ContactRules;
use crate::device::coupled::InstrumentError;
use crate::device::instrument::InstrumentKind;
use crate::device::path::TipPath;
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::dynamics::settle::SettleError;
use crate::local::model::LocalSettings;
use crate::local::step::LocalIntegrator;
use crate::model::network::Material;
use crate::multirate::global::SyncMode;
use crate::multirate::timeline::{Costs, Deadline, DrawnTimes, Timeline};
use crate::surface::geometry::ContactSurface;

/// A checked scene: every value is finite and in range, and every key has an effect.
///
/// ```
/// use stickslip::scene::Scene;
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// assert_eq!((scene.tick_count, scene.ticks_per_cycle), (1200, 100));
/// let error = Scene::parse("name = 'x'\nduraton = 1.0", "x.toml".as_ref()).unwrap_err();
/// assert!(error.to_string().contains("unknown field `duraton`"));
/// ```
#[derive(Debug, Clone)]
pub struct Scene {
    /// Names the output folder.
    pub name: String,
    /// s.
    pub duration: f64,
    /// Ticks of the local loop in the duration.
    pub tick_count: u64,
    /// h, s.
    pub tick: f64,
    /// Local rate / global rate.
    pub ticks_per_cycle: u32,
    /// Where the mesh comes from.
    pub mesh: MeshSource,
    /// Which nodes never move.
    pub fixed: Vec<bool>,
    /// Masses, springs, gravity and drag.
    pub material: Material,
    /// Whether the network is brought into equilibrium under gravity before t = 0.
    pub settle: bool,
    /// The global cycle.
    pub global: GlobalSettings,
    /// `model = "full"`: the whole network runs at the local rate.
    pub is_full: bool,
    /// The local model.
    pub local: LocalSettings,
    /// How the local model is integrated.
    pub integrator: LocalIntegrator,
    /// Which surface the tip feels.
    pub surface: ContactSurface,
    /// The contact.
    pub contact: ContactRules,
    /// What kind of instrument there is.
    pub instrument: InstrumentKind,
    /// What leads it: the tip, or what the hand of a device aims at.
    pub path: TipPath,
    /// Ticks over which the force's jump at a hand-over fades.
    pub smoothing_ticks: u32,
    /// Whether it runs in virtual or in real time.
    pub schedule: Schedule,
    /// Of every tick.
    pub deadline: Deadline,
    /// What computing takes in virtual time; nothing if absent.
    pub costs: Option<Costs>,
    /// What is accepted but may not be meant.
    pub warnings: Vec<String>,
    source: Source,
}

/// Who waits for whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schedule {
    /// The two sides take turns in virtual time.
    Lockstep,
    /// Real time, a thread each; the servo thread never waits.
    Threads,
}

/// The global side of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalSettings {
    /// Hz.
    pub rate: f64,
    /// How the full model is integrated.
    pub integrator: GlobalIntegrator,
    /// Equal steps per cycle.
    pub substeps: u32,
    /// Threads that share them.
    pub threads: Threads,
    /// How it takes in the local model's cycle.
    pub sync: SyncMode,
    /// Ticks from the state a model is built from to its first use.
    pub latency_ticks: u32,
}

/// Where a scene came from, kept for errors that only show when it is put together.
#[derive(Debug, Clone)]
struct Source {
    text: NamedSource<String>,
    instrument: Range<usize>,
    mesh: Range<usize>,
    settle: Option<Range<usize>>,
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// If the file is missing or not a scene; with file, line, column and what is accepted.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path).map_err(|error| {
            let names: Vec<&str> = SHIPPED.iter().map(|shipped| shipped.name).collect();
            SceneError::unplaced(
                Problem::Unreadable { path: path.to_owned(), error },
                &format!("give the path of a scene file, or the name of a shipped scene: {}", names.join(", ")),
            )
        })?;
        Self::parse(&text, path)
    }

    /// Reads a scene from text. `path` names it in errors, and files it mentions are relative to it.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(text: &str, path: &Path) -> Result<Self, SceneError> {
        validate::scene(text, path)
    }

    /// A scene that comes with the program, by name.
    pub fn shipped(name: &str) -> Option<Self> {
        let shipped = SHIPPED.iter().find(|shipped| shipped.name == name)?;
        Self::parse(shipped.text, Path::new(name)).ok()
    }

    /// Where it was read from; of a shipped one, its name.
    pub fn path_name(&self) -> &Path {
        Path::new(self.source.text.name())
    }

    /// The same with another rate of the local loop, Hz. A deadline of a whole tick stays one.
    ///
    /// # Errors
    /// If the duration is no whole number of its ticks, the global rate does not divide it, or the scene's deadline is
    /// longer than its tick.
    pub fn at_rate(self, rate_hz: f64) -> Result<Self, SceneError> {
        validate::at_rate(self, rate_hz)
    }

    /// When its models arrive and which of its ticks are late, in virtual time.
    pub fn timeline(&self) -> Timeline {
        let latency = u64::from(self.global.latency_ticks);
        match &self.costs {
            None => Timeline::Ideal { latency },
            Some(costs) => {
                let cycle_ticks = u64::from(self.ticks_per_cycle);
                Timeline::Drawn(Box::new(DrawnTimes::new(
                    costs.clone(),
                    self.deadline,
                    self.tick,
                    cycle_ticks,
                    latency,
                )))
            }
        }
    }

    /// Its TOML.
    pub fn text(&self) -> &str {
        self.source.text.inner()
    }

    pub(crate) fn mesh_error(&self, problem: Problem) -> SceneError {
        SceneError::at(problem, self.source.text.clone(), Some(self.source.mesh.clone()))
    }

    pub(crate) fn settle_error(&self, error: SettleError) -> SceneError {
        let help = match error {
            SettleError::Floating { .. } => "fix nodes of every piece with `mesh.fixed`, or leave out `settle`",
            SettleError::NotSettled { .. } => {
                "give a stiffer material, more fixed nodes or less `material.gravity`, or leave out `settle`"
            }
        };
        SceneError::at(Problem::Settle(error), self.source.text.clone(), self.source.settle.clone()).with_help(help)
    }

    pub(crate) fn instrument_error(&self, error: InstrumentError) -> SceneError {
        let (problem, span) = (Problem::Instrument { key: "instrument", error }, self.source.instrument.clone());
        SceneError::at(problem, self.source.text.clone(), Some(span))
    }

    pub(crate) fn tip_inside(&self, depth_m: f64) -> SceneError {
        let span = self.source.instrument.clone();
        SceneError::at(Problem::TipInside { depth_m }, self.source.text.clone(), Some(span))
            .with_help("start the tip outside: the first waypoint decides where it is at t = 0")
    }
}
