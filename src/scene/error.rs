//! What can be wrong with a scene, and where.

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

use super::keys::accepted;
use crate::device::coupled::InstrumentError;
use crate::device::path::PathError;
use crate::dynamics::settle::SettleError;
use crate::local::error::ModelError;
use crate::mesh_file::MeshFileError;
use crate::model::material::MaterialError;
use crate::model::network::NetworkError;
use crate::model::topology::SurfaceError;

/// What is wrong.
#[derive(Debug, Error)]
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
    /// The mesh's file.
    #[error("`mesh.path`: {0}")]
    MeshFile(MeshFileError),
    /// The mesh would not fit.
    #[error(
        "{ticks} ticks over a mesh of {nodes} nodes and {springs} springs need about {needed_mib} MiB; {available_mib} MiB are free"
    )]
    TooLarge {
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
        error: PathError,
    },
    /// The device, its hand or its coupling.
    #[error("`{key}`: {error}")]
    Instrument {
        /// The key.
        key: &'static str,
        /// What is wrong.
        error: InstrumentError,
    },
    /// Springs or masses from the constants of a material.
    #[error("`{key}`: {error}")]
    Material {
        /// The key.
        key: &'static str,
        /// What is wrong.
        error: MaterialError,
    },
    /// There is no equilibrium to start from.
    #[error("`settle`: {0}")]
    Settle(SettleError),
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
    /// The key it is about.
    fn key(&self) -> Option<&'static str> {
        match self {
            Problem::NotAccepted { key, .. }
            | Problem::Missing(key)
            | Problem::NoEffect { key, .. }
            | Problem::Needs { key, .. }
            | Problem::Both(key, _)
            | Problem::WrongLength { key, .. }
            | Problem::Path { key, .. }
            | Problem::Material { key, .. }
            | Problem::Instrument { key, .. } => Some(key),
            Problem::Unreadable { .. }
            | Problem::OwnPart(_)
            | Problem::Syntax(_)
            | Problem::MeshFile(_)
            | Problem::TooLarge { .. }
            | Problem::TipInside { .. }
            | Problem::Settle(_)
            | Problem::Network(_)
            | Problem::Surface(_)
            | Problem::Model(_) => None,
        }
    }
}

/// A problem with its place in the scene's text.
///
/// ```
/// use stickslip::scene::{Problem, Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let inside = scene.text().replace("0.002]", "-0.002]"); // where the tip starts, under the block's top
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
    pub(super) fn unplaced(problem: Problem, help: &str) -> Self {
        let detail = Detail { problem, source: None, span: None, help: Some(help.to_owned()) };
        Self { detail: Box::new(detail) }
    }

    pub(super) fn at(problem: Problem, source: NamedSource<String>, span: Option<Range<usize>>) -> Self {
        let help = problem.key().and_then(accepted).map(|values| format!("accepted: {values}"));
        Self { detail: Box::new(Detail { problem, source: Some(source), span, help }) }
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
