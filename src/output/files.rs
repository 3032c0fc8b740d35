//! Writers of a run's files. A file appears under its name only when it is complete.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

use super::folder::{ResultFolder, WholeFile, sha256};
use super::summary::{Recorder, Sample, Summary};
use super::time_steps::TimeSteps;
use super::trace::TraceRow;
use super::warnings::{after_run, before_run};
use crate::model::network::Network;
use crate::model::topology::Surface;
use crate::multirate::failsafe::Fault;
use crate::pipeline::{Simulation, TickView};
use crate::scene::{Scene, SceneError, Warning};

/// A file or folder that cannot be written.
#[derive(Debug, Error, Diagnostic)]
#[error("cannot write {path}")]
#[diagnostic(help("give a folder that can be written"))]
pub struct WriteError {
    /// Path of the file or folder.
    pub path: PathBuf,
    /// Cause.
    pub source: io::Error,
}

/// Error of a run that writes files.
#[derive(Debug, Error, Diagnostic)]
#[non_exhaustive]
pub enum RunFilesError {
    /// The scene cannot start.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// A file or the output folder cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}

/// Files of an earlier run that a new run removes: first the summary, which marks a result as complete, then the files that
/// the new run may not replace.
const OF_A_RUN: [&str; 6] = ["summary.json", "trace.csv", "network.json", "forces.svg", "session.json", "timing.json"];

/// A run whose files are written.
#[derive(Debug)]
#[non_exhaustive]
pub struct FinishedRun {
    /// Summary of the run, as in `summary.json`.
    pub summary: Summary,
    /// Samples of all ticks.
    pub samples: Vec<Sample>,
    /// The fault that ended it, if one did.
    pub fault: Option<Fault>,
}

/// Runs a scene in virtual time and writes `trace.csv`, `network.json`, `summary.json` and, with plots, `forces.svg`
/// into a folder. A fault ends the run; the rows before it are kept. `watch` is called after every tick.
///
/// # Errors
/// If the scene cannot start, in which case nothing is written, or if a file cannot be written.
///
/// ```
/// use stickslip::{output::{files::run_into, verdict::Verdict}, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let mut scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let folder = tempfile::tempdir()?;
/// let run = run_into(&scene, folder.path(), |_| ())?;
/// assert!(run.summary.verdict.verdict == Verdict::Pass && run.fault.is_none());
/// let trace = std::fs::read_to_string(folder.path().join("trace.csv"))?;
/// assert_eq!((run.samples.len(), trace.lines().count()), (150, 1 + 150));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn run_into(scene: &Scene, out: &Path, watch: impl FnMut(&TickView)) -> Result<FinishedRun, RunFilesError> {
    let simulation = Simulation::prepare(scene)?;
    let foreseen = before_run(scene, &simulation, &TimeSteps::where_in_doubt(scene, &simulation));
    let folder = ResultFolder::take(out)?;
    folder.clear_frames()?;
    let drive = |simulation: Simulation, observe: &mut dyn FnMut(&TickView)| simulation.run(observe).err();
    Ok(write_run(scene, simulation, &foreseen, &folder, watch, drive, |_| Ok(()))?)
}

/// Writes the files of a simulation that `drive` runs. `foreseen` are the warnings before the run. `drive` calls its
/// second argument after every tick, and returns the fault if one ended the run. `conclude` writes what else belongs to
/// the run, and may change the summary, which is written last.
///
/// # Errors
/// If a file cannot be written.
///
/// ```
/// use stickslip::output::{files::write_run, folder::ResultFolder};
/// use stickslip::{pipeline::{Lockstep, Simulation, TickView}, scene::Scene};
///
/// // The first tenth of a run.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let folder = tempfile::tempdir()?;
/// let out = ResultFolder::take(folder.path())?;
/// let first_tenth = |simulation, mut observe: &mut dyn FnMut(&TickView)| {
///     let mut run = Lockstep::new(simulation);
///     (0..120).try_for_each(|_| run.step().map(|view| view.iter().for_each(&mut observe))).err()
/// };
/// let run = write_run(&scene, Simulation::prepare(&scene)?, &[], &out, |_| (), first_tenth, |_| Ok(()))?;
/// assert_eq!((run.samples.len(), run.summary.ticks), (120, 120));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_run(
    scene: &Scene,
    simulation: Simulation,
    foreseen: &[Warning],
    folder: &ResultFolder,
    mut watch: impl FnMut(&TickView),
    drive: impl FnOnce(Simulation, &mut dyn FnMut(&TickView)) -> Option<Fault>,
    conclude: impl FnOnce(&mut Summary) -> Result<(), WriteError>,
) -> Result<FinishedRun, WriteError> {
    let start = Instant::now();
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| WriteError { path, source }
    };
    let out = folder.path();
    folder.clear(&OF_A_RUN)?;
    write_network(&out.join("network.json"), simulation.network(), simulation.surface())?;

    let path = out.join("trace.csv");
    let file = WholeFile::create(&path).map_err(failed(&path))?;
    let mut trace = csv::Writer::from_writer(BufWriter::new(file));
    let mut recorder = Recorder::default();
    let mut trouble = None;
    let fault = drive(simulation, &mut |view: &TickView| {
        recorder.record(view);
        if trouble.is_none()
            && let Err(error) = trace.serialize(TraceRow::new(view))
        {
            trouble = Some(io::Error::other(error));
        }
        watch(view);
    });
    match trouble {
        Some(error) => Err(error),
        None => trace.into_inner().map_err(|error| io::Error::other(error.to_string())),
    }
    .and_then(|writer| writer.into_inner().map_err(|error| error.into_error()))
    .and_then(WholeFile::finish)
    .map_err(failed(&path))?;

    let summary = recorder.summary(scene, fault.as_ref(), start.elapsed().as_secs_f64());
    let warnings = after_run(foreseen, summary.contact_ticks());
    let mut summary = summary.with(|summary| summary.warnings = warnings);
    #[cfg(feature = "plots")]
    {
        let path = out.join("forces.svg");
        let svg = super::figures::forces::forces(&scene.name, recorder.samples()).map_err(failed(&path))?;
        write_file(&path, svg.as_bytes())?;
    }
    conclude(&mut summary)?;
    for name in OF_A_RUN {
        let path = out.join(name);
        if path.exists() {
            summary.files.insert(name, sha256(&path).map_err(failed(&path))?);
        }
    }
    write_json(&out.join("summary.json"), &summary)?;
    Ok(FinishedRun { summary, samples: recorder.samples().to_vec(), fault })
}

/// Writes a file completely or not at all.
///
/// # Errors
/// If the folder cannot be written.
///
/// ```
/// use stickslip::output::files::{write_file, write_json};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("forces.json");
/// write_json(&path, &[0.1, 1e-300])?;
/// let forces: Vec<f64> = serde_json::from_slice(&std::fs::read(&path)?)?;
/// assert_eq!(forces, [0.1, 1e-300]); // to the last bit
/// write_file(&path, b"[]")?;
/// assert_eq!(std::fs::read(&path)?, b"[]");
/// let error = write_file(&folder.path().join("absent/forces.json"), b"").expect_err("there is no such folder");
/// assert!(error.path.ends_with("absent/forces.json"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), WriteError> {
    let write = || {
        let mut file = WholeFile::create(path)?;
        file.write_all(content)?;
        file.finish()
    };
    write().map_err(|source| WriteError { path: path.to_owned(), source })
}

/// Writes `network.json`: a full network at rest and its surface, from which another program can repeat a run.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_network(path: &Path, network: &Network, surface: &Surface) -> Result<(), WriteError> {
    write_json(path, &NetworkFile::new(network, surface))
}

/// Writes rows as CSV, with a header from the names of their fields.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_csv(path: &Path, rows: impl IntoIterator<Item = impl Serialize>) -> Result<(), WriteError> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let text = rows.into_iter().try_for_each(|row| table.serialize(row)).map_err(io::Error::other);
    let text = text.and_then(|()| table.into_inner().map_err(|error| io::Error::other(error.to_string())));
    write_file(path, &text.map_err(|source| WriteError { path: path.to_owned(), source })?)
}

/// Writes a value as indented JSON.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), WriteError> {
    let mut json = serde_json::to_vec_pretty(value)
        .map_err(|error| WriteError { path: path.to_owned(), source: io::Error::other(error) })?;
    json.push(b'\n');
    write_file(path, &json)
}

/// Contents of `network.json`.
#[derive(Debug, Serialize)]
struct NetworkFile {
    nodes: Vec<[f64; 3]>,
    mass: Vec<f64>,
    fixed: Vec<bool>,
    /// Springs as (i, j, k, c, L): nodes, stiffness N/m, damping N·s/m, rest length m.
    springs: Vec<(u32, u32, f64, f64, f64)>,
    triangles: Vec<[u32; 3]>,
}

impl NetworkFile {
    fn new(network: &Network, surface: &Surface) -> Self {
        Self {
            nodes: network.rest.iter().map(|&x| x.into()).collect(),
            mass: network.mass.clone(),
            fixed: network.fixed.clone(),
            springs: network
                .springs
                .iter()
                .map(|s| (s.nodes[0], s.nodes[1], s.stiffness, s.damping, s.rest_length))
                .collect(),
            triangles: (0..surface.triangles.len() as u32).map(|t| surface.triangle_nodes(t)).collect(),
        }
    }
}
