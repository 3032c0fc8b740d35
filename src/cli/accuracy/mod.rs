//! `stickslip accuracy`: the force error and the time per tick of local models.

mod clock;
mod section;
mod table;

use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;

use clap::Args;
use maud::Markup;
use miette::IntoDiagnostic;
use rayon::prelude::*;
use serde::Serialize;

use self::clock::{Cost, Stopwatch};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{hand_out, say};
use super::{Changes, FAIL, PASS, folder, load, page};
use crate::local::condensation::CondensationCounts;
use crate::model::work::WorkCounts;
use crate::output::files::{write_csv, write_file, write_json};
use crate::output::summary::Sample;
use crate::scene::{LocalModelName, Scene, SceneError};
use crate::verify::accuracy::{
    self, Assessment, Coverage, Errors, ForceRow, Grid, Method, Names, PAPER, PAPER_RATE_HZ, Reference, Status,
};
use crate::verify::orders::{self, Case, ObservedOrder};

/// Default budget of a tick, µs.
const BUDGET_US: f64 = 10.0;
/// Time for all timed runs together.
const PATIENCE: Duration = Duration::from_secs(40);
/// Time for all timed runs together in a report.
const BRIEF_PATIENCE: Duration = Duration::from_secs(6);

#[derive(Debug, Args)]
pub struct AccuracyArguments {
    /// A scene file or the name of a shipped scene
    scene: PathBuf,
    #[command(flatten)]
    changes: Changes,
    /// Output folder (default: reports/SCENE)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Budget of a tick, µs; 99 of 100 ticks have to be within it
    #[arg(long, value_name = "N", default_value_t = BUDGET_US, value_parser = positive)]
    budget_us: f64,
    /// Budget of a global cycle, ms (default and upper bound: the cycle's duration)
    #[arg(long, value_name = "N", value_parser = positive)]
    cycle_ms: Option<f64>,
    /// Also compare four rings, coarse far fields, updates at 20 and 100 Hz and more contacts (many minutes over a deep
    /// drag)
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    renderer: RendererArguments,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("give a number above 0".to_owned()),
    }
}

/// Time budget of a method.
#[derive(Debug, Clone, Copy, Serialize)]
struct Budget {
    tick_us: f64,
    /// Largest time of a global cycle, ms; absent if it is the cycle's duration.
    cycle_ms: Option<f64>,
}

impl Budget {
    fn admits(&self, cost: &Cost, global_rate: f64) -> bool {
        let cycle_ms = self.cycle_ms.unwrap_or(f64::INFINITY).min(1e3 / global_rate);
        cost.tick_ns_p99 <= 1e3 * self.tick_us && cost.cycle_ms_max.is_none_or(|longest| longest <= cycle_ms)
    }
}

/// Contents of `accuracy.json`.
#[derive(Serialize)]
pub struct AccuracyFile {
    pub scene: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<String>,
    version: &'static str,
    /// Rate of the scene's model updates, Hz.
    cycle_rate: f64,
    budget: Budget,
    points: Vec<Point>,
    references: Vec<ReferenceEntry>,
    best: Option<Best>,
    /// Convergence orders of the integrators, observed on a small block for every scene.
    orders: Vec<ObservedOrder>,
    omitted: Vec<String>,
}

/// A method in `accuracy.json`.
#[derive(Serialize)]
struct Point {
    name: String,
    /// Index of its reference.
    reference: usize,
    #[serde(flatten)]
    names: Names,
    status: Status,
    fault: Option<String>,
    /// Whether its error is at or below the difference between the references, whatever its status.
    below_floor: bool,
    is_paper: bool,
    is_own: bool,
    /// Whether it is on the Pareto front of median tick and error, among methods with this contact.
    on_front: bool,
    #[serde(flatten)]
    errors: Errors,
    #[serde(flatten)]
    cost: Cost,
    work: WorkCounts,
    condensation: Option<CondensationCounts>,
    #[serde(skip)]
    samples: Vec<Sample>,
}

impl Point {
    /// Returns the known bound of its error: the error itself above the floor, the floor below it.
    fn known_error(&self, references: &[ReferenceEntry]) -> f64 {
        self.errors.force_error_rms_rel.max(references[self.reference].floor_rms_rel)
    }
}

/// A reference in `accuracy.json`.
#[derive(Serialize)]
struct ReferenceEntry {
    contact: String,
    scheme: &'static str,
    surface: &'static str,
    deformation: Option<&'static str>,
    metric: Option<&'static str>,
    /// Steps of the fine reference per tick.
    refinement: u32,
    /// RMS of the force difference between the two references over RMS of the force.
    floor_rms_rel: f64,
    force_rms_n: f64,
    energy_residual_rel: f64,
    energy_residual_rel_fine: f64,
    fault: Option<String>,
    fault_fine: Option<String>,
    #[serde(flatten)]
    cost: Cost,
    work: WorkCounts,
    /// Its ticks, for the file of its forces.
    #[serde(skip)]
    rows: Vec<ForceRow>,
    /// Samples for the figure of forces.
    #[cfg_attr(not(feature = "plots"), expect(dead_code))]
    #[serde(skip)]
    samples: Vec<Sample>,
}

impl ReferenceEntry {
    /// Returns the name of the file with its forces: `reference-` and its contact.
    fn file_name(&self) -> String {
        let words = [Some(self.scheme), Some(self.surface), self.deformation, self.metric];
        format!("reference-{}.csv", words.into_iter().flatten().collect::<Vec<_>>().join("-"))
    }
}

/// The best method within the budget, with the scene's own contact.
#[derive(Serialize)]
struct Best {
    /// Index of the point.
    point: usize,
    name: String,
    force_error_rms_rel: f64,
    handover_jump_rel: f64,
    tick_ns_p99: f64,
    build_ms: Option<f64>,
    sentence: String,
}

pub fn accuracy(arguments: &AccuracyArguments) -> miette::Result<u8> {
    let scene = load(&arguments.scene, &arguments.changes, &arguments.renderer)?;
    let coverage = if arguments.all { Coverage::All } else { Coverage::Default };
    let grid = accuracy::grid(&scene, coverage)?;
    let folder = folder(arguments.out.clone(), &scene, &["accuracy.json", "index.html"])?;
    let out = folder.path();

    let budget = Budget { tick_us: arguments.budget_us, cycle_ms: arguments.cycle_ms };
    let file = compare(&scene, grid, budget, PATIENCE)?;
    for reference in &file.references {
        write_csv(&out.join(reference.file_name()), &reference.rows)?;
    }
    write_json(&out.join("accuracy.json"), &file)?;
    let title = format!("{}: accuracy of local models", file.scene);
    write_file(&out.join("index.html"), page::page(&title, &section::section(&file)?).into_string().as_bytes())?;

    hand_out(&file)?;
    say(table::points(&file))?;
    say(table::orders(&file))?;
    for line in sentences(&file) {
        say(line)?;
    }
    say(format_args!("report on all {} methods: {}", file.points.len(), out.join("index.html").display()))?;
    Ok(if file.best.is_some() { PASS } else { FAIL })
}

/// Builds the report's section on a scene: few methods, and little time for each.
pub fn brief(scene: &Scene) -> miette::Result<(AccuracyFile, Markup)> {
    let grid = accuracy::grid(scene, Coverage::Brief)?;
    let file = compare(scene, grid, Budget { tick_us: BUDGET_US, cycle_ms: None }, BRIEF_PATIENCE)?;
    let section = section::section(&file)?;
    Ok((file, section))
}

impl AccuracyFile {
    /// Returns why errors cannot be judged, if so: a reference ended in a fault, or every local model is worse than no
    /// force. The finding does not depend on the machine.
    pub fn failure(&self) -> Option<String> {
        if let Some(fault) = self.references.iter().find_map(|r| r.fault.as_ref().or(r.fault_fine.as_ref())) {
            return Some(format!("a reference ended in a fault: {fault}"));
        }
        let all_diverged = self.points.iter().all(|point| point.status == Status::Diverged);
        all_diverged.then(|| "all local models diverged".to_owned())
    }

    /// Returns whether a method is within the budget on this machine, and the sentence about it.
    pub fn best_in_words(&self) -> (bool, String) {
        (self.best.is_some(), sentences(self).swap_remove(0))
    }
}

fn compare(scene: &Scene, grid: Grid, budget: Budget, patience: Duration) -> miette::Result<AccuracyFile> {
    let (cases, runs) = (Case::all(), grid.methods.len() + grid.contacts.len());
    let progress = Mutex::new(Progress::new((cases.len() + 2 * runs) as u64, "runs"));
    with(&progress, |progress| progress.begin("orders"));
    let observed = cases.into_par_iter().map(|case| orders::observe(case).inspect(|_| done(&progress)));
    let orders: Vec<ObservedOrder> = observed.collect::<Result<_, _>>().into_diagnostic()?;
    let (points, references) = measure(scene, &grid, budget, patience, &progress)?;
    Ok(AccuracyFile {
        scene: scene.name.clone(),
        changes: scene.changes(),
        version: env!("CARGO_PKG_VERSION"),
        cycle_rate: scene.global_rate_hz(),
        budget,
        best: best(&points, &references, budget),
        points,
        references,
        orders,
        omitted: grid.omitted,
    })
}

/// Measures errors in parallel, then times one run after the other, all within `patience`.
fn measure(
    scene: &Scene,
    grid: &Grid,
    budget: Budget,
    patience: Duration,
    progress: &Mutex<Progress>,
) -> Result<(Vec<Point>, Vec<ReferenceEntry>), SceneError> {
    let begin = |name: &str| with(progress, |progress| progress.begin(name));
    let done = || done(progress);

    begin("references");
    let references: Vec<Reference> = grid
        .contacts
        .par_iter()
        .map(|&touching| Reference::of(scene, touching).inspect(|_| done()))
        .collect::<Result<_, _>>()?;
    begin("errors");
    let assessed: Vec<(usize, Assessment)> = grid
        .methods
        .par_iter()
        .map(|method| {
            // The grid has a contact for each of its methods.
            let reference = grid.contacts.iter().position(|touching| *touching == method.touching).unwrap_or(0);
            Assessment::of(scene, method, &references[reference]).inspect(|_| done()).map(|found| (reference, found))
        })
        .collect::<Result<_, _>>()?;

    begin("times");
    let mut stopwatch = Stopwatch::new(patience, grid.methods.len() + grid.contacts.len());
    let mut entries = Vec::with_capacity(references.len());
    for reference in references {
        let cost = stopwatch.cost(&Reference::scene(scene, reference.touching))?;
        done();
        entries.push(entry(reference, cost));
    }
    let own = Method::of(scene);
    let mut points = Vec::with_capacity(assessed.len());
    for (method, (reference, assessment)) in grid.methods.iter().zip(assessed) {
        let cost = stopwatch.cost(&method.scene(scene))?;
        done();
        let status = assessment.status(budget.admits(&cost, method.global_rate));
        let Assessment { record, errors, is_unresolved, .. } = assessment;
        points.push(Point {
            name: method.name(scene),
            reference,
            names: method.names(),
            status,
            below_floor: is_unresolved,
            is_paper: reference == 0
                && method.model == LocalModelName::Patch
                && method.local == PAPER
                && method.global_rate == PAPER_RATE_HZ,
            is_own: *method == own,
            on_front: false,
            errors,
            cost,
            work: record.work,
            condensation: record.condensation,
            samples: record.samples(),
            fault: record.fault,
        });
    }
    let mark = |reference: usize| front(&points, &entries, reference, |point| Some(point.cost.tick_ns_p50));
    let fastest: Vec<usize> = (0..entries.len()).flat_map(mark).collect();
    fastest.into_iter().for_each(|i| points[i].on_front = true);
    Ok((points, entries))
}

/// Returns the points of a reference that are on the Pareto front of a cost and the error.
fn front(
    points: &[Point],
    references: &[ReferenceEntry],
    reference: usize,
    cost: impl Fn(&Point) -> Option<f64>,
) -> Vec<usize> {
    let stands = |point: &Point| point.reference == reference && point.status != Status::Diverged;
    let (indices, places): (Vec<usize>, Vec<(f64, f64)>) = points
        .iter()
        .enumerate()
        .filter(|(_, point)| stands(point))
        .filter_map(|(i, point)| Some((i, (cost(point)?, point.known_error(references)))))
        .unzip();
    indices.into_iter().zip(accuracy::front(&places)).filter(|(_, on_front)| *on_front).map(|(i, _)| i).collect()
}

fn with(progress: &Mutex<Progress>, change: impl FnOnce(&mut Progress)) {
    // If a thread panicked while it counted, the lock is poisoned and the count no longer matters.
    if let Ok(mut progress) = progress.lock() {
        change(&mut progress);
    }
}

/// Counts one run as done.
fn done(progress: &Mutex<Progress>) {
    with(progress, |progress| progress.end(1));
}

fn entry(reference: Reference, cost: Cost) -> ReferenceEntry {
    let Reference { touching, coarse, fine, floor } = reference;
    let names = touching.names();
    ReferenceEntry {
        contact: touching.to_string(),
        scheme: names.scheme,
        surface: names.surface,
        deformation: names.deformation,
        metric: names.metric,
        refinement: accuracy::REFINEMENT,
        floor_rms_rel: floor,
        force_rms_n: coarse.force_rms_n(),
        energy_residual_rel: coarse.energy_residual_rel,
        energy_residual_rel_fine: fine.energy_residual_rel,
        cost,
        work: coarse.work,
        rows: coarse.rows().collect(),
        samples: coarse.samples(),
        fault: coarse.fault,
        fault_fine: fine.fault,
    }
}

/// Returns the most accurate local model within the budget with the scene's own contact; of several below the floor,
/// which cannot be distinguished, the fastest.
fn best(points: &[Point], references: &[ReferenceEntry], budget: Budget) -> Option<Best> {
    let rank = |point: &Point| (point.known_error(references), point.cost.tick_ns_p99);
    let within = |point: &Point| match point.status {
        Status::Ok | Status::Unresolved => point.reference == 0,
        Status::Overrun | Status::Diverged => false,
    };
    let (i, point) = points
        .iter()
        .enumerate()
        .filter(|(_, point)| within(point))
        .min_by(|(_, a), (_, b)| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal))?;
    let Errors { force_error_rms_rel, handover_jump_rel, .. } = point.errors;
    let below = if point.below_floor { ", below the difference between the references" } else { "" };
    let sentence = format!(
        "Most accurate local model within {} µs per tick (rings, linearisation, exterior, updates): {}. Force error: \
         {:.2} % of the full network's{below}; largest jump at hand-overs: {:.1} %. Time per tick: median {:.2} µs, \
         99th percentile {:.2} µs{}.",
        budget.tick_us,
        point.name,
        100.0 * force_error_rms_rel,
        100.0 * handover_jump_rel,
        1e-3 * point.cost.tick_ns_p50,
        1e-3 * point.cost.tick_ns_p99,
        point.cost.build_ms.map_or(String::new(), |ms| format!("; building a model: {ms:.2} ms")),
    );
    let Cost { tick_ns_p99, build_ms, .. } = point.cost;
    Some(Best {
        point: i,
        name: point.name.clone(),
        force_error_rms_rel,
        handover_jump_rel,
        tick_ns_p99,
        build_ms,
        sentence,
    })
}

/// Returns the findings as sentences, the best method first.
fn sentences(file: &AccuracyFile) -> Vec<String> {
    let mut lines = vec![match &file.best {
        Some(best) => best.sentence.clone(),
        None => {
            let cycle = file.budget.cycle_ms.map_or(String::new(), |ms| format!(" and {ms} ms per cycle"));
            format!("No local model is within {} µs per tick{cycle}.", file.budget.tick_us)
        }
    }];
    let failed = file.points.iter().filter(|point| point.status == Status::Diverged).count();
    lines.push(format!(
        "{failed} of {} local models diverged. Each is named by its rings around the contact (all: the whole network), \
         its linearisation (none: nonlinear springs), its exterior and tangent where it has them, and the rate of its \
         updates.",
        file.points.len()
    ));
    lines.extend(file.references.iter().map(|reference| {
        let floor = 100.0 * reference.floor_rms_rel;
        let faults = [&reference.fault, &reference.fault_fine].into_iter().flatten();
        let faults: String = faults.map(|fault| format!(" It ended in a fault: {fault}.")).collect();
        format!(
            "{}: the references with steps of h and h/{} differ by {floor:.2} % in force.{faults}",
            reference.contact, reference.refinement
        )
    }));
    lines.extend(file.omitted.iter().map(|what| format!("Omitted: {what}.")));
    lines
}
