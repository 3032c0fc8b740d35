//! Scenes: the settings of a simulation, read from TOML or built in Rust, and checked before anything else is built.

mod build;
mod change;
mod check;
mod error;
mod file;
mod keys;
#[cfg(feature = "files")]
mod meaning;
mod memory;
mod mesh;
mod parts;
mod place;
mod read;
mod shipped;
mod source;
mod warning;
mod words;

use std::path::Path;

pub use change::{Change, ChangeError};
#[cfg(feature = "files")]
pub(crate) use check::MOST_REAL_TIME_HZ;
pub use error::{Problem, SceneError};
#[cfg(feature = "cli")]
pub(crate) use keys::accepted;
#[cfg(feature = "cli")]
pub(crate) use memory::available_memory;
pub use mesh::MeshSource;
pub use parts::Part;
pub use shipped::{Expectation, SHIPPED, Shipped};
pub use warning::Warning;
pub use words::{ExteriorName, LawName, LinearizationName, LocalModelName, Rings, SchemeName};

use place::nearest;
use source::Source;

use crate::contact::rules::ContactRules;
use crate::device::instrument::InstrumentKind;
use crate::device::path::TipPath;
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::external::RendererLibrary;
use crate::local::model::LocalSettings;
use crate::local::step::LocalIntegrator;
use crate::model::network::Material;
use crate::multirate::global::SyncMode;
use crate::multirate::timeline::{Costs, Deadline, DrawnTimes, Timeline};
use crate::surface::geometry::ContactSurface;
use crate::word::words;

/// Default of `local.rate`, Hz.
const DEFAULT_LOCAL_RATE_HZ: f64 = 1000.0;
/// Default of `global.rate`, Hz.
const DEFAULT_GLOBAL_RATE_HZ: f64 = 10.0;

/// Contact force that ends a run, as a multiple of the device's largest force: 850 N for a PHANTOM 1.5 is beyond any force
/// of a haptic scene, and far below what a diverging scene commands.
const FORCE_MARGIN: f64 = 100.0;

/// A scene. Independent settings are public fields; derived quantities are methods, so that no two values can
/// contradict each other. [`check`](Self::check) finds settings that do not go together; reading, building and
/// [`Simulation::prepare`](crate::pipeline::Simulation::prepare) all call it.
///
/// ```
/// use stickslip::scene::Scene;
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// assert_eq!((scene.tick_count(), scene.ticks_per_cycle(), scene.duration_s()), (1200, 100, 1.2));
/// let error = Scene::parse("name = 'x'\nduraton = 1.0", "x.toml".as_ref()).unwrap_err();
/// assert!(error.to_string().contains("unknown field `duraton`"));
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Scene {
    /// Name of the scene and its output folder: letters, digits, `-`, `_` and `.`, starting with a letter or digit.
    pub name: String,
    /// Source of the mesh.
    pub mesh: MeshSource,
    /// Whether each node is fixed.
    pub fixed: Vec<bool>,
    /// Masses, springs, gravity and drag.
    pub material: Material,
    /// Whether the network is brought into equilibrium under gravity before t = 0.
    pub settle: bool,
    /// Integration of the network, and its coupling to the local model.
    pub global: GlobalSettings,
    /// Integrator of the local model.
    pub integrator: LocalIntegrator,
    /// The surface that the tip touches.
    pub surface: ContactSurface,
    /// Radius of the disc over which a contact is spread, m; 0 for the paper's point.
    pub contact_radius: f64,
    /// Law, scheme and rigid wall of the contact.
    pub contact: ContactRules,
    /// Kind of instrument.
    pub instrument: InstrumentKind,
    /// Path of the tip, or the set-point of the hand that holds a device.
    pub path: TipPath,
    /// Contact force along a path above which the fail-safe ends the run, N. A modelled device has its own limit.
    pub force_limit_n: f64,
    /// Number of ticks over which the force's jump at a hand-over fades.
    pub smoothing_ticks: u32,
    /// Lockstep in virtual time, or threads in real time.
    pub schedule: Schedule,
    /// Deadline of every tick.
    pub deadline: Deadline,
    /// Computing times in virtual time; `None` if computing takes no time.
    pub costs: Option<Costs>,
    local_rate_hz: f64,
    ticks_per_cycle: u32,
    tick_count: u64,
    /// Whether `local.model = "full"`; `local` is then [`LocalSettings::FULL`].
    is_full: bool,
    local: LocalSettings,
    /// A renderer in a library, in place of the local model, scheme and law.
    renderer: Option<RendererLibrary>,
    /// The text that the scene was read from, for errors that only show when the simulation is prepared.
    source: Option<Source>,
}

/// Lockstep in virtual time, or threads in real time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Schedule {
    /// The two sides take turns in virtual time.
    #[default]
    Lockstep,
    /// Real time, with one thread for each side; the servo thread never waits.
    Threads,
}

words!(Schedule { Lockstep = "lockstep", Threads = "threads" });

/// Settings of the global side.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct GlobalSettings {
    /// Integrator of the full network.
    pub integrator: GlobalIntegrator,
    /// Number of equal steps per cycle.
    pub substeps: u32,
    /// Number of threads that share the steps.
    pub threads: Threads,
    /// How the network takes over the local model's motion in a cycle.
    pub sync: SyncMode,
    /// Number of ticks from the state that a model is built from to its first use.
    pub latency_ticks: u32,
}

impl Default for GlobalSettings {
    /// Settings of a scene file without `[global]` and `[sync]`.
    fn default() -> Self {
        Self {
            integrator: GlobalIntegrator::default(),
            substeps: 100,
            threads: Threads::One,
            sync: SyncMode::default(),
            latency_ticks: 0,
        }
    }
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// If the file is missing or is not a scene, with file, line, column and accepted values.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::load_with(path, &[])
    }

    /// Reads a scene file with changes of its keys, as [`parse_with`](Self::parse_with) does.
    ///
    /// # Errors
    /// Those of [`load`](Self::load); an error in a change has the change in the place of file, line and column.
    pub fn load_with(path: &Path, changes: &[Change]) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path).map_err(|error| {
            let names = SHIPPED.iter().map(|shipped| shipped.name);
            let meant = path.to_str().and_then(|name| nearest(name, names.clone()));
            let meant = meant.map_or(String::new(), |name| format!("did you mean `{name}`? "));
            let help = format!(
                "{meant}give the path of a scene file, or the name of a shipped scene: {}",
                names.collect::<Vec<_>>().join(", ")
            );
            SceneError::new(Problem::Unreadable { path: path.to_owned(), error }, None).with_help(help)
        })?;
        Self::parse_with(&text, path, changes)
    }

    /// Reads a scene from text. `path` names it in errors; files that it mentions are relative to `path`.
    ///
    /// # Errors
    /// If the text is not a scene, with file, line, column and accepted values.
    pub fn parse(text: &str, path: &Path) -> Result<Self, SceneError> {
        Self::parse_with(text, path, &[])
    }

    /// Reads a scene from text in which changes are made first, in their order. [`text`](Self::text) is the changed text, and
    /// so is what hashes and recorded sessions hold.
    ///
    /// # Errors
    /// Those of [`parse`](Self::parse); an error in a change has the change in the place of file, line and column.
    pub fn parse_with(text: &str, path: &Path, changes: &[Change]) -> Result<Self, SceneError> {
        read::scene(Source::new(text, path, changes)?, path)
    }

    /// Returns a scene that is shipped with the program, by its name.
    pub fn shipped(name: &str) -> Option<Self> {
        let shipped = SHIPPED.iter().find(|shipped| shipped.name == name)?;
        Self::parse(shipped.text, Path::new(name)).ok()
    }

    /// Checks that every setting is in range and goes together with the others.
    ///
    /// # Errors
    /// If a setting is not accepted, with the first such key of scene files.
    pub fn check(&self) -> Result<(), SceneError> {
        check::check(self).map_err(|problem| SceneError::new(problem, None))
    }

    /// Returns the contact force above which the fail-safe ends a run, N: that of the path, or a hundred times the largest
    /// force of a modelled device.
    pub fn largest_contact_force_n(&self) -> f64 {
        match &self.instrument {
            InstrumentKind::Path => self.force_limit_n,
            InstrumentKind::Phantom(settings) => FORCE_MARGIN * settings.phantom.actuation.largest_force,
        }
    }

    /// Checks that a loop in real time can have the scene's rate, whatever its schedule.
    ///
    /// # Errors
    /// If the rate is too high.
    #[cfg(all(feature = "cli", feature = "realtime", target_os = "linux"))]
    pub(crate) fn check_real_time(&self) -> Result<(), SceneError> {
        check::real_time_rate(self).map_err(|problem| self.error(problem))
    }

    /// Returns the local tick h, s.
    pub fn tick_s(&self) -> f64 {
        1.0 / self.local_rate_hz
    }

    /// Returns the number of ticks of the run.
    pub fn tick_count(&self) -> u64 {
        self.tick_count
    }

    /// Returns the duration of the run, s.
    pub fn duration_s(&self) -> f64 {
        self.tick_count as f64 / self.local_rate_hz
    }

    /// Returns the rate of the local loop, Hz.
    pub fn local_rate_hz(&self) -> f64 {
        self.local_rate_hz
    }

    /// Returns the rate of global cycles, Hz.
    pub fn global_rate_hz(&self) -> f64 {
        self.local_rate_hz / f64::from(self.ticks_per_cycle)
    }

    /// Returns the number of ticks of the local loop in a global cycle.
    pub fn ticks_per_cycle(&self) -> u32 {
        self.ticks_per_cycle
    }

    /// Returns the settings of the local model; [`LocalSettings::FULL`] if there is none.
    pub fn local(&self) -> LocalSettings {
        self.local
    }

    /// Returns whether the whole network runs at the local rate, without cycles or local models.
    pub fn is_full(&self) -> bool {
        self.is_full
    }

    /// Returns the library whose renderer takes the place of local model, contact scheme and law, if there is one.
    pub fn renderer(&self) -> Option<&RendererLibrary> {
        self.renderer.as_ref()
    }

    /// Returns the word of `local.model` for this scene.
    pub fn model_name(&self) -> LocalModelName {
        match &self.renderer {
            Some(_) => LocalModelName::External,
            None if self.is_full => LocalModelName::Full,
            None => LocalModelName::Patch,
        }
    }

    /// Estimates the memory of a run, bytes: network, local model, factors, and what is recorded of its ticks.
    pub fn memory_estimate(&self) -> u128 {
        memory::estimate(self)
    }

    /// Returns warnings about settings that are accepted but may be unintended.
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = self.mesh.warnings(&self.fixed);
        warnings.extend(warning::of_motion(self));
        warnings
    }

    /// Returns the path that the scene was read from, or the name of a scene that was shipped or built.
    pub fn path_name(&self) -> &Path {
        Path::new(self.source.as_ref().map_or(&*self.name, |source| source.name()))
    }

    /// Returns the TOML that the scene was read from, with all changes; `None` if it was built.
    pub fn text(&self) -> Option<&str> {
        self.source.as_ref().map(Source::text)
    }

    /// Returns the changes that were made in the scene's text before it was read, as they were asked for.
    pub fn changes(&self) -> Vec<String> {
        self.source.iter().flat_map(Source::changes).map(ToString::to_string).collect()
    }

    /// Returns the timeline in virtual time: when models arrive and which ticks are late.
    pub fn timeline(&self) -> Timeline {
        let latency = u64::from(self.global.latency_ticks);
        match &self.costs {
            None => Timeline::Ideal { latency },
            Some(costs) => {
                let ticks_per_cycle = u64::from(self.ticks_per_cycle);
                Timeline::Drawn(Box::new(DrawnTimes::new(
                    costs.clone(),
                    self.deadline,
                    self.tick_s(),
                    ticks_per_cycle,
                    latency,
                )))
            }
        }
    }

    /// Builds the error of a problem that only shows when the simulation is prepared, with its place in the text.
    pub(crate) fn error(&self, problem: Problem) -> SceneError {
        SceneError::new(problem, self.source.as_ref())
    }
}
