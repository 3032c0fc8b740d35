//! What can be wrong with a scene, and where.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

use super::keys::accepted;
use super::place::place;
use crate::device::coupled::InstrumentError;
use crate::device::path::PathError;
use crate::dynamics::settle::SettleError;
use crate::local::error::ModelError;
use crate::mesh_file::{MeshFileError, MeshProblem};
use crate::model::material::MaterialError;
use crate::model::network::NetworkError;
use crate::model::topology::SurfaceError;

/// What is wrong with a scene. Keys are those of scene files, also where a scene was built in Rust.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// A part of one's own does not fit the scene.
    #[error("{0}")]
    OwnPart(String),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Unreadable {
        /// The scene.
        path: PathBuf,
        /// Why.
        #[source]
        error: std::io::Error,
    },
    /// Not TOML, an unknown or missing key, or a value of the wrong type: the parser's words.
    #[error("{0}")]
    Syntax(String),
    /// A value that is not accepted.
    #[error("`{key}` cannot be {value}")]
    NotAccepted {
        /// The key.
        key: &'static str,
        /// The value.
        value: String,
    },
    /// A key is missing that the scene needs.
    #[error("`{0}` is missing")]
    Missing(&'static str),
    /// A key is there that can have no effect.
    #[error("`{key}` has no effect with {because}")]
    NoEffect {
        /// The key.
        key: &'static str,
        /// What makes it so.
        because: &'static str,
    },
    /// A value that another key does not allow.
    #[error("`{key} = {value:?}` needs {needs}")]
    Needs {
        /// The key.
        key: &'static str,
        /// Its value.
        value: &'static str,
        /// What is missing.
        needs: &'static str,
    },
    /// Two keys say the same thing.
    #[error("`{0}` and `{1}` cannot both be given")]
    Both(&'static str, &'static str),
    /// One value per node is needed.
    #[error("`{key}` has {found} values for {nodes} nodes")]
    WrongLength {
        /// The key.
        key: &'static str,
        /// Its length.
        found: usize,
        /// The number of nodes.
        nodes: usize,
    },
    /// A waypoint is not four numbers.
    #[error("`instrument.waypoints` cannot have {given:?}: four numbers are needed")]
    Waypoint {
        /// Counted from 0.
        index: usize,
        /// The numbers that it is.
        given: Vec<f64>,
    },
    /// The mesh's file.
    #[error("`mesh.path`: {0}")]
    MeshFile(#[source] MeshFileError),
    /// The mesh would not fit.
    #[error(
        "{ticks} ticks over a mesh of {nodes} nodes and {springs} springs need about {needed_mib} MiB; {available_mib} MiB are free"
    )]
    TooLarge {
        /// The key that decides.
        key: &'static str,
        /// Nodes.
        nodes: u128,
        /// Springs.
        springs: u128,
        /// Ticks.
        ticks: u64,
        /// What a run of it would take.
        needed_mib: u128,
        /// What there is.
        available_mib: u128,
    },
    /// The tip starts inside.
    #[error("at t = 0 the tip is {depth_m:.6} m inside the surface")]
    TipInside {
        /// Distance from the surface, m.
        depth_m: f64,
    },
    /// The waypoints or the recording.
    #[error("`{key}`: {error}")]
    Path {
        /// The key.
        key: &'static str,
        /// What is wrong.
        #[source]
        error: PathError,
    },
    /// The device, its hand or its coupling.
    #[error("`{key}`: {error}")]
    Instrument {
        /// The key.
        key: &'static str,
        /// What is wrong.
        #[source]
        error: InstrumentError,
    },
    /// Springs or masses from the constants of a material.
    #[error("`{key}`: {error}")]
    Material {
        /// The key.
        key: &'static str,
        /// What is wrong.
        #[source]
        error: MaterialError,
    },
    /// There is no equilibrium to start from.
    #[error("`settle`: {0}")]
    Settle(#[source] SettleError),
    /// Mesh and material do not go together.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The mesh has no proper surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The first local model cannot be built.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Problem {
    /// The key that it is about; none if that is all of the scene.
    pub fn key(&self) -> Option<&'static str> {
        match self {
            Problem::NotAccepted { key, .. }
            | Problem::Missing(key)
            | Problem::NoEffect { key, .. }
            | Problem::Needs { key, .. }
            | Problem::Both(key, _)
            | Problem::WrongLength { key, .. }
            | Problem::TooLarge { key, .. }
            | Problem::Path { key, .. }
            | Problem::Material { key, .. }
            | Problem::Instrument { key, .. } => Some(key),
            Problem::Waypoint { .. } => Some("instrument.waypoints"),
            Problem::MeshFile(error) => match error.problem() {
                MeshProblem::Folds { .. } => Some("mesh.layer_depth"),
                _ => Some("mesh.path"),
            },
            Problem::TipInside { .. } => Some("instrument"),
            Problem::Settle(_) => Some("settle"),
            Problem::Network(_) | Problem::Surface(_) | Problem::Model(_) => Some("mesh"),
            Problem::Unreadable { .. } | Problem::Syntax(_) | Problem::OwnPart(_) => None,
        }
    }

    /// The entry of the key's list that it is about.
    fn index(&self) -> Option<usize> {
        match self {
            Problem::Waypoint { index, .. }
            | Problem::Path { error: PathError::NotFinite { index } | PathError::NotAscending { index, .. }, .. } => {
                Some(*index)
            }
            _ => None,
        }
    }

    /// What to do about it.
    fn advice(&self) -> Option<String> {
        let fixed = match self {
            Problem::Needs { key: "local.integrator", needs, .. } => {
                return Some(format!(
                    "give {needs}, or `local.integrator = \"semi-implicit-euler\"`, which takes every model"
                ));
            }
            Problem::MeshFile(error) => return Some(error.problem().advice().to_string()),
            Problem::TooLarge { .. } => "give fewer nodes (at most 2³² − 2), fewer rings or a shorter duration",
            Problem::TipInside { .. } => "start the tip outside: the first waypoint decides where it is at t = 0",
            Problem::Material { error, .. } => match error {
                MaterialError::NoShear => "give another `mesh.stencil`, or `material.stiffness`",
                MaterialError::NoVolume => "give a mesh of tetrahedra, or `material.stiffness` instead",
                MaterialError::Flat { .. } | MaterialError::Loose { .. } => "repair the mesh",
            },
            Problem::Settle(SettleError::Floating { .. }) => {
                "fix nodes of every piece with `mesh.fixed`, or leave out `settle`"
            }
            Problem::Settle(SettleError::NotSettled { .. }) => {
                "give a stiffer material, more fixed nodes or less `material.gravity`, or leave out `settle`"
            }
            Problem::Network(_) | Problem::Surface(_) | Problem::Model(_) | Problem::OwnPart(_) => return None,
            _ => return self.key().and_then(accepted).map(|values| format!("accepted: {values}")),
        };
        Some(fixed.to_owned())
    }
}

/// A problem with its place in the scene's text.
///
/// ```
/// use stickslip::scene::{Problem, Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let text = scene.text().expect("it was read");
/// let inside = text.replace("0.002]", "-0.002]"); // where the tip starts, under the block's top
/// let error = Scene::parse(&inside, "inside.toml".as_ref())
///     .and_then(|scene| stickslip::pipeline::Simulation::prepare(&scene))
///     .expect_err("a tip that starts inside");
/// assert!(matches!(error.problem(), Problem::TipInside { depth_m } if (depth_m - 0.002).abs() < 1e-15));
/// ```
#[derive(Debug)]
pub struct SceneError {
    pub(super) detail: Box<Detail>,
}

#[derive(Debug)]
pub(super) struct Detail {
    pub problem: Problem,
    pub source: Option<NamedSource<String>>,
    pub span: Option<Range<usize>>,
    pub help: Option<String>,
}

impl SceneError {
    /// A problem of a scene that was read from `source`, or of one that was built in Rust.
    pub(super) fn new(problem: Problem, source: Option<&NamedSource<String>>) -> Self {
        let span = source.zip(problem.key()).and_then(|(source, key)| place(source.inner(), key, problem.index()));
        let help = problem.advice();
        Self { detail: Box::new(Detail { problem, source: source.cloned(), span, help }) }
    }

    pub(super) fn at(problem: Problem, source: NamedSource<String>, span: Option<Range<usize>>) -> Self {
        Self { detail: Box::new(Detail { problem, source: Some(source), span, help: None }) }
    }

    pub(super) fn with_help(mut self, help: impl Into<String>) -> Self {
        self.detail.help = Some(help.into());
        self
    }

    /// What is wrong.
    pub fn problem(&self) -> &Problem {
        &self.detail.problem
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.detail.problem.fmt(f)
    }
}

impl std::error::Error for SceneError {}

impl Diagnostic for SceneError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.detail.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.detail.source.as_ref().map(|source| source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.detail.span.clone()?;
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".to_owned()), span.start, span.len().max(1)))))
    }
}
