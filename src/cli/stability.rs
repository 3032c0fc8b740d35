//! `stickslip stability`: stability-limit time steps and virtual walls, measured and predicted, and extreme scenes.

mod renderer;
mod z_width;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::page::{self, Row};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{hand_out, say, significant};
use super::{Changes, exit_code, folder, load};
use crate::output::files::{write_file, write_json};
use crate::output::verdict::Verdict;
use crate::pipeline::Simulation;
use crate::scene::Scene;
use crate::verify::extremes::{EXTREMES, Extreme, Measured, Outcome, Variant};
use crate::verify::path_stability::{ModelStability, PathStability};
use crate::verify::stability_map::{Axis, Boundary, MapError, TOLERANCE, Touching, boundaries, points};
use crate::verify::z_width::{WallLimit, ZWidthError};

/// Extreme scenes omitted from a report, as they take long.
const LONG: [&str; 1] = ["rest-24h"];

/// Time after which an extreme scene counts as hung.
const PATIENCE: Duration = Duration::from_secs(300);

/// Contents of `stability.json`.
#[derive(Serialize)]
pub struct StabilityFile {
    version: &'static str,
    scene: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<String>,
    /// Whether the verdict is PASS.
    passes: bool,
    /// The worst of the findings.
    pub verdict: Verdict,
    /// The findings that decide; for a PASS, all of them.
    pub reasons: Vec<String>,
    /// The local models along the scene's path.
    path: PathStability,
    maps: Vec<Boundary>,
    /// Reason why there are no stability limits, if so.
    no_maps: Option<String>,
    z_width: Vec<WallLimit>,
    extremes: Vec<ExtremeEntry>,
    /// Extreme scenes omitted from a report.
    omitted: Vec<String>,
}

/// Extent of the study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Coverage {
    /// Without the extreme scenes that take long, for a report.
    Brief,
    /// All extreme scenes.
    All,
}

#[derive(Serialize)]
struct ExtremeEntry {
    scene: &'static str,
    contact: String,
    variant: Variant,
    expected: String,
    outcome: &'static str,
    detail: String,
    measured: Vec<Measured>,
    as_expected: bool,
}

pub fn stability(
    scene: &Path,
    changes: &Changes,
    out: Option<PathBuf>,
    renderer: &RendererArguments,
) -> miette::Result<u8> {
    let scene = load(scene, changes, renderer)?;
    Simulation::prepare(&scene)?;
    let folder = folder(out, &scene, &["stability.json", "index.html"])?;
    let out = folder.path();
    if scene.renderer().is_some() {
        return renderer::stability(&scene, &folder).map(exit_code);
    }
    let file = look(&scene, Coverage::All)?;
    write_json(&out.join("stability.json"), &file)?;
    let page = page::page(&format!("stickslip: stability of {}", scene.name), &section(&file)?);
    write_file(&out.join("index.html"), page.into_string().as_bytes())?;

    hand_out(&file)?;
    say(models_table(&file.path.models))?;
    say(extremes_table(&file.extremes))?;
    match &file.no_maps {
        Some(reason) => say(format_args!("no stability limits: {reason}"))?,
        None => say(maps_table(&file.maps))?,
    }
    for boundary in file.maps.iter().filter(|boundary| !boundary.agrees) {
        say(disagreement(boundary))?;
    }
    say(z_width::table(&file.z_width))?;
    say(format_args!("{}: {}", file.verdict.name(), file.reasons.join("; ")))?;
    say(format_args!("report: {}", out.join("index.html").display()))?;
    Ok(exit_code(file.verdict))
}

/// Builds the report's section on a scene's stability.
pub fn brief(scene: &Scene) -> miette::Result<(StabilityFile, Markup)> {
    let file = look(scene, Coverage::Brief)?;
    let section = section(&file)?;
    Ok((file, section))
}

/// Collects the findings of a study: each with its verdict and its number.
fn findings(
    path: &PathStability,
    extremes: &[ExtremeEntry],
    maps: &Result<Vec<Boundary>, String>,
    walls: &[WallLimit],
) -> Vec<(Verdict, String)> {
    let pass_if = |holds: bool, otherwise: Verdict| if holds { Verdict::Pass } else { otherwise };
    let as_expected = extremes.iter().filter(|entry| entry.as_expected).count();
    let respected = walls.iter().filter(|limit| limit.agrees).count();
    let maps = match maps {
        Err(reason) => (Verdict::Inconclusive, format!("stability limits were not swept: {reason}")),
        Ok(maps) => {
            let explained = maps.iter().filter(|boundary| is_explained(boundary)).count();
            let first = maps.iter().find(|boundary| !is_explained(boundary));
            let open = first.map_or(String::new(), |boundary| format!(": {}", disagreement(boundary)));
            let found = format!(
                "{explained} of {} stability-limit time steps agree with the prediction or differ for a known reason{open}",
                maps.len()
            );
            (pass_if(first.is_none(), Verdict::Inconclusive), found)
        }
    };
    vec![
        (path.verdict, format!("along the path, {}", path.reason)),
        (
            pass_if(as_expected == extremes.len(), Verdict::Fail),
            format!("{as_expected} of {} extreme scenes end as expected", extremes.len()),
        ),
        maps,
        (
            pass_if(respected == walls.len(), Verdict::Fail),
            format!("{respected} of {} virtual-wall limits respect the passivity bounds", walls.len()),
        ),
    ]
}

/// Returns whether a limit agrees with its prediction or differs for a known reason.
fn is_explained(boundary: &Boundary) -> bool {
    boundary.agrees || boundary.reason.is_some()
}

fn look(scene: &Scene, coverage: Coverage) -> miette::Result<StabilityFile> {
    let (points, walls) = (points(), z_width::points());
    let is_covered = |extreme: &&Extreme| coverage == Coverage::All || !LONG.contains(&extreme.name);
    let omitted = EXTREMES.iter().filter(|extreme| !is_covered(extreme)).map(|extreme| extreme.name.to_owned());
    let omitted: Vec<String> = omitted.collect();
    let covered = EXTREMES.iter().filter(is_covered);
    let extremes: Vec<(&Extreme, Variant)> =
        covered.flat_map(|extreme| extreme.variants().into_iter().map(move |variant| (extreme, variant))).collect();
    let mut progress = Progress::new(scene.tick_count(), "ticks");
    progress.begin("local models along the path");
    let path = PathStability::of(scene, &mut |tick| progress.set(tick))?;
    drop(progress);
    let mut progress = Progress::new((points.len() + extremes.len() + walls.len()) as u64, "cases");
    progress.begin("extreme scenes");
    let extremes = in_parallel(&extremes, &mut progress, |&(extreme, variant)| entry(extreme, variant));
    progress.end(extremes.len() as u64);
    progress.begin("stability limits");
    let maps = in_parallel(&points, &mut progress, |point| boundaries(scene, point));
    progress.end(points.len() as u64);
    progress.begin("virtual walls");
    let walls = in_parallel(&walls, &mut progress, z_width::limit);
    drop(progress);
    let walls: Result<Vec<WallLimit>, ZWidthError> = walls.into_iter().collect();
    let walls = walls.map_err(|error| miette::miette!("cannot measure virtual walls: {error}"))?;
    let maps: Result<Vec<[Boundary; 2]>, MapError> = maps.into_iter().collect();
    let maps = maps.map(|maps| maps.into_iter().flatten().collect()).map_err(|error| error.to_string());
    let findings = findings(&path, &extremes, &maps, &walls);
    let verdict = findings.iter().map(|(verdict, _)| *verdict).min().unwrap_or(Verdict::Inconclusive);
    let decides = findings.into_iter().filter(|(found, _)| *found == verdict);
    let (reasons, no_maps) = (decides.map(|(_, reason)| reason).collect(), maps.as_ref().err().cloned());
    Ok(StabilityFile {
        version: env!("CARGO_PKG_VERSION"),
        scene: scene.name.clone(),
        changes: scene.changes(),
        passes: verdict == Verdict::Pass,
        verdict,
        reasons,
        path,
        maps: maps.unwrap_or_default(),
        no_maps,
        z_width: walls,
        extremes,
        omitted,
    })
}

/// Runs one extreme scene in a thread of its own, so that neither a panic nor a hang ends the study.
fn entry(extreme: &'static Extreme, variant: Variant) -> ExtremeEntry {
    let expected = extreme.expected(variant);
    let (done, result) = channel();
    thread::spawn(move || done.send(extreme.run(variant, &expected)));
    let outcome = result.recv_timeout(PATIENCE).unwrap_or_else(|error| match error {
        RecvTimeoutError::Timeout => Outcome::Hung,
        RecvTimeoutError::Disconnected => Outcome::Panicked,
    });
    ExtremeEntry {
        scene: extreme.name,
        contact: extreme.contact(variant),
        variant,
        expected: expected.to_string(),
        outcome: outcome.name(),
        detail: outcome.to_string(),
        as_expected: expected.is_met_by(&outcome),
        measured: match outcome {
            Outcome::Completed { measured, .. } => measured,
            _ => Vec::new(),
        },
    }
}

/// Computes every item's result on all processors; results are in the order of the items.
fn in_parallel<T: Sync, R: Send>(items: &[T], progress: &mut Progress, of: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new((Vec::with_capacity(items.len()), progress));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let (index, Some(item)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    (index, items.get(index))
                } {
                    let result = of(item);
                    let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                    done.0.push((index, result));
                    let count = done.0.len() as u64;
                    done.1.set(count);
                }
            });
        }
    });
    let (mut results, _) = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

const MODEL_HEAD: [&str; 5] =
    ["model from tick", "mode", "stability-limit time step", "growth within a cycle", "growth rate (1/s)"];

fn model_row(model: &ModelStability) -> [String; 5] {
    [
        model.tick.to_string(),
        model.mode.to_owned(),
        step(model.limit_s),
        significant(model.growth_per_cycle) + if model.settled { "" } else { ", not settled" },
        significant(model.growth_rate_per_s),
    ]
}

fn models_table(models: &[ModelStability]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(MODEL_HEAD);
    models.iter().for_each(|model| {
        table.add_row(model_row(model));
    });
    table
}

const EXTREME_HEAD: [&str; 5] = ["extreme scene", "contact", "expected result", "result", "detail"];

fn extreme_row(entry: &ExtremeEntry) -> [String; 5] {
    [entry.scene, &entry.contact, &entry.expected, entry.outcome, &entry.detail].map(str::to_owned)
}

fn extremes_table(extremes: &[ExtremeEntry]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(EXTREME_HEAD);
    for entry in extremes {
        let mut row = extreme_row(entry);
        if !entry.as_expected {
            row[3] += ", UNEXPECTED";
        }
        table.add_row(row);
    }
    table
}

fn touching_name(touching: Touching) -> &'static str {
    match touching {
        Touching::Free => "free",
        Touching::Held => "held",
    }
}

fn step(limit_s: Option<f64>) -> String {
    match limit_s {
        Some(0.0) => "no step is stable".to_owned(),
        Some(limit) => format!("{:.4} ms", 1e3 * limit),
        None => "no limit".to_owned(),
    }
}

const MAP_HEAD: [&str; 7] =
    ["varied", "integrator, scheme, exterior", "contact", "value", "predicted", "measured", "ratio"];

fn map_row(b: &Boundary) -> [String; 7] {
    [
        b.axis.name().to_owned(),
        format!("{}, {}, {}", b.integrator, b.scheme, b.exterior),
        touching_name(b.touching).to_owned(),
        significant(b.value),
        step(b.predicted_s),
        step(b.measured_s),
        format!("{:.4}", b.ratio),
    ]
}

fn maps_table(maps: &[Boundary]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(MAP_HEAD);
    maps.iter().for_each(|boundary| {
        table.add_row(map_row(boundary));
    });
    table
}

fn disagreement(boundary: &Boundary) -> String {
    let reason = boundary.reason.as_deref().unwrap_or("UNEXPLAINED");
    let [varied, model, contact, value, predicted, measured, ratio] = map_row(boundary);
    format!(
        "{varied} = {value}, {model}, {contact}: predicted {predicted}, measured {measured}, ratio {ratio}, more than \
         {:.0} % apart: {reason}",
        100.0 * TOLERANCE
    )
}

#[cfg(feature = "plots")]
fn figure(axis: Axis, maps: &[Boundary]) -> miette::Result<String> {
    use crate::output::figures::limits::{Curve, Panel, limits};
    let mut series: Vec<String> = Vec::new();
    let mut panels: Vec<Panel> = Vec::new();
    // The boundaries of one curve are consecutive, in the order of the axis's values.
    for b in maps.iter().filter(|b| b.axis == axis) {
        let title = format!("{}, {}", b.integrator, b.scheme);
        let panel = index_or_push(
            &mut panels,
            |panel| panel.title == title,
            || Panel { title: title.clone(), curves: Vec::new() },
        );
        let name = format!("{}, {}", touching_name(b.touching), b.exterior);
        let series = index_or_push(&mut series, |known| *known == name, || name.clone());
        let curves = &mut panels[panel].curves;
        let curve = index_or_push(curves, |curve| curve.series == series, || Curve { series, steps: Vec::new() });
        curves[curve].steps.push([b.predicted_s, b.measured_s]);
    }
    limits(axis.name(), axis.values(), &series, &panels)
        .map_err(|error| miette::miette!("cannot draw the stability limits: {error}"))
}

/// Returns the index of an item, and appends the item if there is none.
#[cfg(feature = "plots")]
fn index_or_push<T>(items: &mut Vec<T>, is_it: impl Fn(&T) -> bool, make: impl FnOnce() -> T) -> usize {
    items.iter().position(is_it).unwrap_or_else(|| {
        items.push(make());
        items.len() - 1
    })
}

#[cfg(not(feature = "plots"))]
fn figure(_: Axis, _: &[Boundary]) -> miette::Result<String> {
    Ok(String::new())
}

fn section(file: &StabilityFile) -> miette::Result<Markup> {
    let StabilityFile { scene, path, maps, no_maps, z_width: walls, extremes, omitted, .. } = file;
    let figures = Axis::ALL.map(|axis| figure(axis, maps)).into_iter().collect::<miette::Result<Vec<_>>>()?;
    let extreme = |entry: &ExtremeEntry| Row {
        class: (!entry.as_expected).then(|| "unexpected".to_owned()),
        cells: extreme_row(entry),
    };
    Ok(html! {
        h2 #stability { "Stability" }
        h3 { "Local models along the path" }
        p {
            "The table lists every local model that " (scene) " uses along its path, with the stability-limit time step of \
             explicit integration at its state, and the factor by which its fastest-growing mode grows within a cycle while \
             the contact is held. A model with a factor above 1 diverges if it is kept. "
            b { (path.verdict.name()) } ": " (path.reason) "."
        }
        details {
            summary { "Table of all models" }
            (page::table("", MODEL_HEAD, path.models.iter().map(|model| Row { class: None, cells: model_row(model) })))
        }
        h3 { "Stability-limit time steps of the local model" }
        p {
            "Longest stable time step of the local model of " (scene) " at rest, free and with a point held by the tip. \
             Lines, predicted: the spectral radius of the one-step matrix reaches 1, or the contact cannot hold. Marks, \
             measured: a perturbation of the running model begins to grow, or the model loses the tip. Lower panels: \
             measured over predicted, with a grey band of ± 2 %. Parameters that are not varied are the scene's, \
             except the contact scheme of integrators that need the velocity scheme. A drifting exterior has the \
             limits of a fixed one."
        }
        @if let Some(reason) = no_maps {
            p.unexpected { "No stability limits: " (reason) "." }
        } @else {
            @for (axis, figure) in Axis::ALL.iter().zip(&figures) {
                figure { (PreEscaped(figure)) figcaption { "Longest stable time step over " (axis.name()) "." } }
            }
            @for boundary in maps.iter().filter(|boundary| !boundary.agrees) {
                p.unexpected { (disagreement(boundary)) }
            }
            details {
                summary { "Table of all limits" }
                (page::table("", MAP_HEAD, maps.iter().map(map_row)))
            }
        }
        (z_width::section(walls)?)
        h3 { "Extreme scenes" }
        p {
            "Scenes with extreme parameters. Each is expected to end with a correct result, checked by a quantity that \
             is known independently, or with a named error or fault."
        }
        @if !omitted.is_empty() {
            p { "Omitted from this report, as they take long: " (omitted.join(", ")) "." }
        }
        (page::table("words", EXTREME_HEAD, extremes.iter().map(extreme)))
    })
}
