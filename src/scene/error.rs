//! Errors of scenes, with their place in the text.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

use super::change::Change;
use super::keys::accepted;
use super::place::place;
use super::source::{Origin, Source};
use crate::device::coupled::InstrumentError;
use crate::device::path::PathError;
use crate::dynamics::settle::SettleError;
use crate::external::LibraryError;
use crate::local::error::ModelError;
use crate::mesh_file::{MeshFileError, MeshProblem};
use crate::model::material::MaterialError;
use crate::model::network::NetworkError;
use crate::model::topology::SurfaceError;
use crate::surface::disc::DiscError;

/// What is wrong with a scene. Keys are those of scene files, even if the scene was built in Rust.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The library of an external renderer cannot be used.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// A custom part does not fit the scene.
    #[error("{0}")]
    OwnPart(String),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Unreadable {
        /// Path of the scene.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        error: std::io::Error,
    },
    /// The text is not TOML, a key is unknown or missing, or a value has the wrong type; the parser's message.
    #[error("{0}")]
    Syntax(String),
    /// A value is not accepted.
    #[error("`{key}` cannot be {value}")]
    NotAccepted {
        /// Key of the value.
        key: &'static str,
        /// The value given.
        value: String,
    },
    /// A required key is missing.
    #[error("`{0}` is missing")]
    Missing(&'static str),
    /// A key is given that has no effect.
    #[error("`{key}` has no effect with {because}")]
    NoEffect {
        /// Key without effect.
        key: &'static str,
        /// Reason why the key has no effect.
        because: &'static str,
    },
    /// A value needs another setting.
    #[error("`{key} = {value:?}` needs {needs}")]
    Needs {
        /// Key of the value.
        key: &'static str,
        /// The value given.
        value: &'static str,
        /// The setting that it needs.
        needs: &'static str,
    },
    /// Two keys are given that determine the same quantity.
    #[error("`{0}` and `{1}` cannot both be given")]
    Both(&'static str, &'static str),
    /// A list has another length than the number of nodes.
    #[error("`{key}` has {found} values for {nodes} nodes")]
    WrongLength {
        /// Key of the list.
        key: &'static str,
        /// Length of the list.
        found: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A waypoint does not have four numbers.
    #[error("`instrument.waypoints` cannot have {given:?}: four numbers are needed")]
    Waypoint {
        /// Index of the waypoint, from 0.
        index: usize,
        /// The numbers given.
        given: Vec<f64>,
    },
    /// The mesh file is not accepted.
    #[error("`mesh.path`: {0}")]
    MeshFile(#[source] MeshFileError),
    /// The run would not fit into memory.
    #[error(
        "{ticks} ticks over a mesh of {nodes} nodes and {springs} springs need about {needed_mib} MiB; {available_mib} MiB are free"
    )]
    TooLarge {
        /// Key that determines the size.
        key: &'static str,
        /// Number of nodes.
        nodes: u128,
        /// Number of springs.
        springs: u128,
        /// Number of ticks.
        ticks: u64,
        /// Estimated memory of the run, MiB.
        needed_mib: u128,
        /// Available memory, MiB.
        available_mib: u128,
    },
    /// The tip starts inside the body.
    #[error("at t = 0 the tip is {depth_m:.6} m inside the surface")]
    TipInside {
        /// Distance of the tip from the surface, m.
        depth_m: f64,
    },
    /// The waypoints or the recording are not accepted.
    #[error("`{key}`: {error}")]
    Path {
        /// Key of the path.
        key: &'static str,
        /// The path's error.
        #[source]
        error: PathError,
    },
    /// The device, its hand or its coupling is not accepted.
    #[error("`{key}`: {error}")]
    Instrument {
        /// Key of the setting.
        key: &'static str,
        /// The instrument's error.
        #[source]
        error: InstrumentError,
    },
    /// Springs or masses cannot be derived from the material's constants.
    #[error("`{key}`: {error}")]
    Material {
        /// Key of the constant.
        key: &'static str,
        /// The material's error.
        #[source]
        error: MaterialError,
    },
    /// There is no equilibrium under gravity to start from.
    #[error("`settle`: {0}")]
    Settle(#[source] SettleError),
    /// Mesh and material do not fit each other.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The mesh has no proper surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// A contact cannot be spread over a disc of this radius.
    #[error("`contact.radius`: {0}")]
    Disc(#[source] DiscError),
    /// The first local model cannot be built.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Problem {
    /// Returns the key that the problem concerns; `None` if it concerns the whole scene.
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
            Problem::Library(_) => Some("local.library"),
            Problem::TipInside { .. } => Some("instrument"),
            Problem::Settle(_) => Some("settle"),
            Problem::Disc(_) => Some("contact.radius"),
            Problem::Network(_) | Problem::Surface(_) | Problem::Model(_) => Some("mesh"),
            Problem::Unreadable { .. } | Problem::Syntax(_) | Problem::OwnPart(_) => None,
        }
    }

    /// Returns the index of the offending entry in the key's list.
    fn index(&self) -> Option<usize> {
        match self {
            Problem::Waypoint { index, .. }
            | Problem::Path { error: PathError::NotFinite { index } | PathError::NotAscending { index, .. }, .. } => {
                Some(*index)
            }
            _ => None,
        }
    }

    /// Returns advice on how to solve the problem.
    fn advice(&self) -> Option<String> {
        let fixed = match self {
            Problem::Needs { key: "local.integrator", needs, .. } => {
                return Some(format!(
                    "give {needs}, or `local.integrator = \"semi-implicit-euler\"`, which takes every model"
                ));
            }
            Problem::Library(LibraryError::NotBuiltIn { .. }) => return None,
            Problem::Library(LibraryError::NotLoaded { .. } | LibraryError::NoHost { .. }) => {
                "give the path of a shared library for this machine that was linked with everything it needs"
            }
            Problem::Library(_) => {
                "compile the library against `reference/include/stickslip_renderer.h`, with C linkage"
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
                "fix nodes of every piece with `mesh.fixed`, or omit `settle`"
            }
            Problem::Settle(SettleError::NotSettled { .. }) => {
                "give a stiffer material, more fixed nodes or less `material.gravity`, or omit `settle`"
            }
            Problem::Disc(DiscError::TooWide { .. }) => "give a smaller `contact.radius` or a coarser mesh",
            Problem::Disc(DiscError::TooNarrow { .. }) => {
                "give a larger `contact.radius`, 0 for a point, or `contact.surface = \"faceted\"`"
            }
            Problem::Network(_) | Problem::Surface(_) | Problem::Model(_) | Problem::OwnPart(_) => return None,
            _ => return self.key().and_then(accepted).map(|values| format!("accepted: {values}")),
        };
        Some(fixed.to_owned())
    }
}

/// A problem of a scene, with its place in the text.
///
/// ```
/// use stickslip::scene::{Problem, Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let text = scene.text().expect("it was read");
/// let inside = text.replace("0.002]", "-0.002]"); // starts the tip below the block's top
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
    /// The change that the error is in; it is then the source.
    pub change: Option<Change>,
    pub help: Option<String>,
}

impl SceneError {
    /// Builds the error of a scene that was read from `source`, or of one that was built in Rust (`None`).
    pub(super) fn new(problem: Problem, source: Option<&Source>) -> Self {
        let help = problem.advice();
        let error = match source {
            Some(source) => {
                let span = problem.key().and_then(|key| place(source.text(), key, problem.index()));
                Self::at(problem, source, span)
            }
            None => Self { detail: Box::new(Detail { problem, source: None, span: None, change: None, help: None }) },
        };
        Self { detail: Box::new(Detail { help, ..*error.detail }) }
    }

    /// Builds the error of a place in a scene's text with all changes.
    pub(super) fn at(problem: Problem, source: &Source, span: Option<Range<usize>>) -> Self {
        let (source, span, change) = match span.map(|span| source.origin(span)) {
            Some(Origin { source, span, change }) => (source, Some(span), change),
            None => (source.file().clone(), None, None),
        };
        Self { detail: Box::new(Detail { problem, source: Some(source), span, change, help: None }) }
    }

    pub(super) fn with_help(mut self, help: impl Into<String>) -> Self {
        self.detail.help = Some(help.into());
        self
    }

    /// Returns the problem.
    pub fn problem(&self) -> &Problem {
        &self.detail.problem
    }

    /// Returns the change of the scene that the error is in; `None` for an error in the scene's file.
    pub fn change(&self) -> Option<&Change> {
        self.detail.change.as_ref()
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.detail.problem.fmt(f)
    }
}

impl std::error::Error for SceneError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        // The problem is what the message says, and is no cause of it.
        self.detail.problem.source()
    }
}

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
