//! A set of problems as files, for programs that know nothing of this one: body, network, motion of the tip, and the force of
//! the whole network at the haptic rate, with what is needed to compare with it.

mod guide;
mod motion;
mod problems;

use std::collections::BTreeMap;
use std::path::Path;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

pub use guide::guide;
pub use motion::Motion;
pub use problems::{Body, ContactLaw, PROBLEMS, ProblemSpec};

use super::accuracy::{Method, PERCEPTION, REFINEMENT, Reference};
use crate::contact::law::Mode;
use crate::mesh_file::{MeshFile, MeshFileError};
use crate::output::files::{WriteError, write_csv, write_file, write_json, write_network};
use crate::output::folder::{ResultFolder, sha256};
use crate::output::vtk::{body, solid};
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};

/// Version of the set. It rises with every change that changes a result.
pub const VERSION: u32 = 1;
/// A program in Python that solves `drag-sticking-faceted` from its files alone.
pub const EXAMPLE: &str = include_str!("../../../fixtures/suite/example.py");
/// Rate of the ticks, Hz.
const RATE_HZ: f64 = 1000.0;
/// Mesh of the organ.
const LIVER: &[u8] = include_bytes!("../../../fixtures/meshes/liver-500.msh");
/// Memory that reading it may take, bytes.
const LIVER_BUDGET: u64 = 1 << 28;

/// Files of a problem besides `problem.json`, which is written last and has their hashes.
const FILES: [&str; 5] = ["body.vtu", "network.json", "tip.csv", "reference.csv", "problem.toml"];

/// Why a problem cannot be written.
#[derive(Debug, Error, Diagnostic)]
#[non_exhaustive]
pub enum SuiteError {
    /// The problem's scene cannot start.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// A file or the output folder cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// The mesh of the organ cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}

/// Contents of `problem.json`.
#[derive(Debug, Clone, Serialize)]
pub struct ProblemFile {
    /// Version of the set, [`VERSION`].
    pub suite: u32,
    /// Version of the program that wrote it.
    pub program: &'static str,
    /// Name of the problem.
    pub name: &'static str,
    /// What it tries.
    pub tries: &'static str,
    /// Rate of the ticks, Hz: that of the rows of `tip.csv` and `reference.csv`.
    pub rate_hz: f64,
    /// Number of ticks.
    pub ticks: usize,
    /// Duration, s.
    pub duration_s: f64,
    /// Contact between tip and surface.
    pub contact: ContactEntry,
    /// Number of nodes and springs.
    pub body: BodyEntry,
    /// The reference, in figures.
    pub reference: ReferenceEntry,
    /// What a solution has to keep.
    pub tolerances: Vec<Tolerance>,
    /// SHA-256 of every other file.
    pub files: BTreeMap<&'static str, String>,
}

/// Contact of a problem.
#[derive(Debug, Clone, Serialize)]
pub struct ContactEntry {
    /// "sliding", "sticking" or "stick-slip".
    pub law: &'static str,
    /// Coefficients of Coulomb friction; absent without it.
    pub friction: Option<FrictionEntry>,
    /// Pull that the contact bears, N.
    pub adhesion_n: f64,
    /// Radius of the disc over which the contact is spread, m; 0 for a point.
    pub radius_m: f64,
    /// "faceted" (the triangles) or "subdivision" (their Loop limit surface).
    pub surface: &'static str,
    /// "massless": the instrument does not feel the inertia of the contact point.
    pub scheme: &'static str,
}

/// Coefficients of friction.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct FrictionEntry {
    /// Static coefficient.
    #[serde(rename = "static")]
    pub static_coefficient: f64,
    /// Kinetic coefficient.
    #[serde(rename = "kinetic")]
    pub kinetic_coefficient: f64,
}

/// Size of a body.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct BodyEntry {
    /// Number of nodes.
    pub nodes: usize,
    /// Number of springs.
    pub springs: usize,
    /// Number of triangles of the surface.
    pub triangles: usize,
}

/// The reference of a problem, in figures.
#[derive(Debug, Clone, Serialize)]
pub struct ReferenceEntry {
    /// Root mean square of the force, N.
    pub force_rms_n: f64,
    /// Largest force, N.
    pub force_max_n: f64,
    /// Number of ticks in contact.
    pub contact_ticks: usize,
    /// Difference of two references, with the ticks of the problem and with an eighth of them, root mean square over that of
    /// the force. An error below it has no meaning.
    pub floor_rms_rel: f64,
    /// Ticks of the second reference in one of the first.
    pub refinement: u32,
    /// Fault that ended a reference, if one did.
    pub fault: Option<String>,
}

/// Bound on a measure of `stickslip judge`.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Tolerance {
    /// Key in `judge.json`.
    pub quantity: &'static str,
    /// Largest value that passes.
    pub value: f64,
    /// Reason for the value.
    pub reason: &'static str,
}

/// Writes what is given in a problem into a folder: motion, body, network, and the scene that is made of them, which is
/// returned with the size of its body.
///
/// # Errors
/// If a file cannot be written, or the problem's scene cannot start.
pub fn write_inputs(problem: &ProblemSpec, folder: &Path) -> Result<(Scene, BodyEntry), SuiteError> {
    let at = |name: &str| folder.join(name);
    write_csv(&at("tip.csv"), tip(problem))?;
    write_file(&at("problem.toml"), scene_text(problem).as_bytes())?;
    if problem.body == Body::Liver {
        write_file(&at("body.vtu"), liver()?.as_bytes())?;
    }
    // The scene is read from the files that others get, so that both start from the same.
    let scene = Scene::load(&at("problem.toml"))?;
    let simulation = Simulation::prepare(&scene)?;
    let (network, surface) = (simulation.network(), simulation.surface());
    if problem.body != Body::Liver {
        write_file(&at("body.vtu"), body(network, surface).as_bytes())?;
    }
    write_network(&at("network.json"), network, surface)?;
    let sizes =
        BodyEntry { nodes: network.node_count(), springs: network.springs.len(), triangles: surface.triangles.len() };
    Ok((scene, sizes))
}

/// Writes a problem into a folder of its name below `out`. `watch` is called with the number of ticks done, of
/// (1 + [`REFINEMENT`]) times the problem's.
///
/// # Errors
/// If a file cannot be written, or the problem's scene cannot start.
pub fn write(problem: &ProblemSpec, out: &Path, watch: impl FnMut(u64)) -> Result<ProblemFile, SuiteError> {
    let folder = ResultFolder::take(&out.join(problem.name))?;
    folder.clear(&["problem.json"])?;
    folder.clear(&FILES)?;
    let at = |name: &str| folder.path().join(name);
    let (scene, body) = write_inputs(problem, folder.path())?;
    let reference = Reference::watched(&scene, Method::of(&scene).touching, watch)?;
    write_csv(&at("reference.csv"), reference.coarse.rows())?;

    let mut files = BTreeMap::new();
    for name in FILES {
        let hash = sha256(&at(name)).map_err(|source| WriteError { path: at(name), source })?;
        files.insert(name, hash);
    }
    let file = ProblemFile {
        suite: VERSION,
        program: env!("CARGO_PKG_VERSION"),
        name: problem.name,
        tries: problem.tries,
        rate_hz: RATE_HZ,
        ticks: scene.tick_count() as usize,
        duration_s: problem.duration_s,
        contact: contact(problem),
        body,
        reference: reference_entry(&reference),
        tolerances: vec![Tolerance {
            quantity: "force_error_rms_rel",
            value: PERCEPTION,
            reason: "A hand cannot tell two forces apart whose difference is below a tenth.",
        }],
        files,
    };
    write_json(&at("problem.json"), &file)?;
    Ok(file)
}

/// Returns the number of ticks of a problem.
pub fn tick_count(problem: &ProblemSpec) -> u64 {
    (problem.duration_s * RATE_HZ).round() as u64
}

/// A row of `tip.csv`.
#[derive(Debug, Serialize)]
struct TipRow {
    t: f64,
    x: f64,
    y: f64,
    z: f64,
}

/// Returns the tip at the begin of the first tick and at the end of every tick.
fn tip(problem: &ProblemSpec) -> impl Iterator<Item = TipRow> {
    let motion = problem.motion;
    (0..=tick_count(problem)).map(move |tick| {
        let t = tick as f64 / RATE_HZ;
        let [x, y, z] = motion.at(t).into();
        TipRow { t, x, y, z }
    })
}

/// Returns the scene of a problem, whose files lie beside it.
fn scene_text(problem: &ProblemSpec) -> String {
    let ProblemSpec { name, tries, duration_s, law, surface, adhesion_n, radius_m, .. } = problem;
    // The fine block has the same material: stiffness proportional to the spacing, masses to its cube, and an unchanged
    // damping ratio.
    let body = match problem.body {
        Body::Block => {
            "[mesh]\nnodes = [9, 9, 4]\nspacing = 0.0125\n\n[material]\nnode_mass = 0.01\nstiffness = 100.0\ndamping = 0.5\n"
        }
        Body::FineBlock => {
            "[mesh]\nnodes = [17, 17, 7]\nspacing = 0.00625\n\n[material]\nnode_mass = 0.00125\nstiffness = 50.0\n\
             damping = 0.125\n"
        }
        Body::Liver => {
            "[mesh]\nkind = \"file\"\npath = \"body.vtu\"\nfixed = { below_z = -0.004 }\n\n[material]\nnode_mass = 0.01\n\
             stiffness = 100.0\ndamping = 0.5\n"
        }
    };
    let friction = match law {
        ContactLaw::Sliding | ContactLaw::Sticking => String::new(),
        ContactLaw::StickSlip { static_coefficient, kinetic_coefficient } => {
            format!("friction = {{ static = {static_coefficient:?}, kinetic = {kinetic_coefficient:?} }}\n")
        }
    };
    format!(
        "# {tries}.\nname = \"{name}\"\nduration = {duration_s:?}\n\n{body}\n[local]\nrate = {RATE_HZ:?}\nmodel = \"full\"\n\n\
         [contact]\nlaw = \"{}\"\n{friction}adhesion = {adhesion_n:?}\nradius = {radius_m:?}\nscheme = \"massless\"\n\
         surface = \"{surface}\"\n\n[instrument]\nkind = \"recording\"\nfile = \"tip.csv\"\n",
        law.name()
    )
}

/// Returns the liver-like body as a `.vtu` file.
fn liver() -> Result<String, MeshFileError> {
    let file = MeshFile::parse(LIVER, Path::new("liver-500.msh"), LIVER_BUDGET)?;
    Ok(solid(&file.solid(1.0)?.mesh))
}

fn contact(problem: &ProblemSpec) -> ContactEntry {
    let friction = match problem.law {
        ContactLaw::Sliding | ContactLaw::Sticking => None,
        ContactLaw::StickSlip { static_coefficient, kinetic_coefficient } => {
            Some(FrictionEntry { static_coefficient, kinetic_coefficient })
        }
    };
    ContactEntry {
        law: problem.law.name(),
        friction,
        adhesion_n: problem.adhesion_n,
        radius_m: problem.radius_m,
        surface: problem.surface,
        scheme: "massless",
    }
}

fn reference_entry(reference: &Reference) -> ReferenceEntry {
    let Reference { coarse, fine, floor, .. } = reference;
    let samples = coarse.samples();
    ReferenceEntry {
        force_rms_n: coarse.force_rms_n(),
        force_max_n: samples.iter().map(|sample| sample.force.norm()).fold(0.0, f64::max),
        contact_ticks: samples.iter().filter(|sample| sample.mode != Mode::Free).count(),
        floor_rms_rel: *floor,
        refinement: REFINEMENT,
        fault: coarse.fault.clone().or_else(|| fine.fault.clone()),
    }
}
