//! `stickslip report`: the main job.

use std::path::{Path, PathBuf};

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::page::{self, Row};
use super::progress::Progress;
use super::run::execute;
use super::{FAIL, PASS, load, say, table};
use crate::output::files::{FinishedRun, write_file, write_json};
use crate::pipeline::Simulation;
use crate::scene::{Expectation, SHIPPED, Scene, SceneError};
use crate::verify::surfaces::{self, Combination, Felt};

/// How often the deep drags' block is divided for the comparison of contact surfaces.
const REFINEMENTS: [usize; 2] = [1, 2];

/// `report.json`.
#[derive(Serialize)]
struct ReportFile<'a> {
    version: &'static str,
    runs: Vec<RunEntry<'a>>,
    /// Contact surfaces and schemes compared; absent if scenes were named.
    surfaces: Option<&'a [SurfaceEntry]>,
}

/// A row of the comparison of contact surfaces.
#[derive(Serialize)]
struct SurfaceEntry {
    drag: &'static str,
    surface: &'static str,
    scheme: &'static str,
    spacing_m: f64,
    #[serde(flatten)]
    felt: Felt,
}

#[derive(Serialize)]
struct RunEntry<'a> {
    as_expected: bool,
    outcome: &'static str,
    summary: &'a crate::output::summary::Summary,
}

struct Reported {
    run: FinishedRun,
    expectation: Expectation,
    figure: String,
}

impl Reported {
    fn as_expected(&self) -> bool {
        match self.expectation {
            Expectation::Completes => self.run.summary.passes(),
            Expectation::Faults => !self.run.summary.completed && self.run.summary.tunnelling_ticks == 0,
        }
    }

    fn outcome(&self) -> &'static str {
        match (self.run.summary.completed, self.as_expected()) {
            (true, true) => "completed",
            (false, true) => "fault, as expected",
            (true, false) => "completed, UNEXPECTED",
            (false, false) => "fault, UNEXPECTED",
        }
    }
}

pub fn report(scenes: &[PathBuf], out: &Path) -> miette::Result<u8> {
    // Named scenes are reported alone.
    let grid: Vec<Combination> =
        if scenes.is_empty() { REFINEMENTS.into_iter().flat_map(surfaces::grid).collect() } else { Vec::new() };
    let shipped = SHIPPED.iter().map(|shipped| shipped.name.into());
    let scenes: Vec<PathBuf> = if scenes.is_empty() { shipped.collect() } else { scenes.to_vec() };
    // All scenes are checked before the first one runs.
    let scenes: Vec<(Scene, Expectation)> =
        scenes.iter().map(|scene| load(scene)).collect::<Result<_, SceneError>>()?;
    for (i, (scene, _)) in scenes.iter().enumerate() {
        Simulation::prepare(scene)?;
        if scenes[..i].iter().any(|(other, _)| other.name == scene.name) {
            return Err(miette::miette!(
                help = "give each scene a `name` of its own",
                "two scenes are named {:?}, and both would write to that folder",
                scene.name
            ));
        }
    }

    let all = scenes.iter().map(|(scene, _)| scene).chain(grid.iter().map(|combination| &combination.scene));
    let mut progress = Progress::new(all.map(|scene| scene.tick_count).sum(), "ticks");
    let mut reported = Vec::with_capacity(scenes.len());
    for (scene, expectation) in &scenes {
        progress.begin(&scene.name);
        let folder = out.join(&scene.name);
        let (run, _) = execute(scene, &folder, |ticks| progress.set(ticks))?;
        progress.end(scene.tick_count);
        reported.push(Reported { figure: figure(&run, &scene.name)?, run, expectation: *expectation });
    }
    let mut compared = Vec::with_capacity(grid.len());
    for Combination { drag, surface, scheme, spacing_m, scene } in &grid {
        progress.begin(&scene.name);
        let felt = surfaces::feel(scene, |ticks| progress.set(ticks)).map_err(|error| miette::miette!("{error}"))?;
        progress.end(scene.tick_count);
        compared.push(SurfaceEntry { drag, surface, scheme, spacing_m: *spacing_m, felt });
    }
    drop(progress);

    let runs = reported.iter();
    let entry = |r: &'_ Reported| (r.as_expected(), r.outcome());
    let file = ReportFile {
        version: env!("CARGO_PKG_VERSION"),
        runs: runs
            .map(|r| {
                let (as_expected, outcome) = entry(r);
                RunEntry { as_expected, outcome, summary: &r.run.summary }
            })
            .collect(),
        surfaces: (!compared.is_empty()).then_some(&compared),
    };
    write_json(&out.join("report.json"), &file)?;
    write_file(&out.join("index.html"), whole_page(&reported, &compared)?.into_string().as_bytes())?;

    say(table::runs(reported.iter().map(|r| (&r.run.summary, r.outcome()))))?;
    say(format_args!("report: {}", out.join("index.html").display()))?;
    Ok(if reported.iter().all(Reported::as_expected) { PASS } else { FAIL })
}

#[cfg(feature = "plots")]
fn figure(run: &FinishedRun, title: &str) -> miette::Result<String> {
    crate::output::plots::forces(title, &run.samples).map_err(|error| miette::miette!("cannot draw {title}: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &FinishedRun, _: &str) -> miette::Result<String> {
    Ok(String::new())
}

#[cfg(feature = "plots")]
fn surface_figure(compared: &[SurfaceEntry]) -> miette::Result<String> {
    use crate::output::plots::{Jump, jumps};
    let columns: Vec<String> = surfaces::SURFACES
        .iter()
        .flat_map(|(surface, _)| surfaces::SCHEMES.iter().map(move |(scheme, _)| format!("{surface} {scheme}")))
        .collect();
    let series = surfaces::DRAGS;
    let coarse = compared.iter().map(|entry| entry.spacing_m).fold(0.0, f64::max);
    let marks: Vec<Jump> = compared
        .iter()
        .map(|entry| {
            let name = format!("{} {}", entry.surface, entry.scheme);
            Jump {
                column: columns.iter().position(|column| *column == name).unwrap_or(0),
                series: series.iter().position(|drag| *drag == entry.drag).unwrap_or(0),
                hollow: entry.spacing_m < coarse,
                relative: entry.felt.jump_relative,
            }
        })
        .collect();
    jumps(&columns, &series, &marks).map_err(|error| miette::miette!("cannot draw the jumps: {error}"))
}

#[cfg(not(feature = "plots"))]
fn surface_figure(_: &[SurfaceEntry]) -> miette::Result<String> {
    Ok(String::new())
}

/// What the name of a scene over the limit surface ends with, after that of the scene it repeats.
const VARIANT: &str = "-subdivision";

fn figure_of(r: &Reported) -> Markup {
    html! {
        figure {
            (PreEscaped(&r.figure))
            figcaption {
                b { (r.run.summary.scene) } ": normal (solid) and tangential (dotted) force on the instrument. "
                @if let Some(share) = r.run.summary.stick_share {
                    (format!("{:.0} % of the ticks in contact stick. ", 100.0 * share))
                }
                @if let Some(counts) = &r.run.summary.condensation { (counts) ". " }
                @if let Some(fault) = &r.run.summary.fault { (fault) "." }
            }
        }
    }
}

fn surface_table(compared: &[SurfaceEntry]) -> Markup {
    let head = [
        "drag",
        "surface, scheme",
        "spacing (mm)",
        "mean force (N)",
        "largest jump (N)",
        "jump / force",
        "power above 100 Hz (N²)",
        "ripple over the mesh",
        "losses",
        "mode switches (1/s)",
        "energy residual",
    ];
    let percent = |value: f64| format!("{:.2} %", 100.0 * value);
    let row = |entry: &SurfaceEntry| {
        let felt = &entry.felt;
        [
            entry.drag.to_owned(),
            format!("{}, {}", entry.surface, entry.scheme),
            format!("{:.2}", 1e3 * entry.spacing_m),
            format!("{:.3}", felt.mean_force_n),
            format!("{:.4}", felt.largest_jump_n),
            percent(felt.jump_relative),
            format!("{:.1e}", felt.power_above_100_hz_n2),
            felt.mesh_ripple_relative.map_or("–".to_owned(), percent),
            felt.contact_losses.to_string(),
            format!("{:.1}", felt.mode_switches_per_s),
            felt.fault.clone().unwrap_or_else(|| percent(felt.energy_residual_relative)),
        ]
    };
    page::table("", head, compared.iter().map(row))
}

fn whole_page(reported: &[Reported], compared: &[SurfaceEntry]) -> miette::Result<Markup> {
    let variant = |r: &Reported| {
        let name = format!("{}{VARIANT}", r.run.summary.scene);
        reported.iter().find(|other| other.run.summary.scene == name)
    };
    let is_variant = |r: &Reported| {
        let base = r.run.summary.scene.strip_suffix(VARIANT);
        base.is_some_and(|base| reported.iter().any(|other| other.run.summary.scene == base))
    };
    let surfaces = if compared.is_empty() { String::new() } else { surface_figure(compared)? };
    let mut order: Vec<&Reported> = reported.iter().collect();
    // What failed comes first.
    order.sort_by_key(|r| r.as_expected());
    let row = |r: &&Reported| Row {
        class: (!r.as_expected()).then(|| "unexpected".to_owned()),
        cells: table::row(&r.run.summary, r.outcome()),
    };
    let body = html! {
        p {
            "A tip is pressed into a block of masses, springs and dampers and dragged over it. The table has \
             a row per scene; its jump is the largest change of force between two ticks in contact, its \
             energy residual what the contact scheme and the exterior of the local model made or lost, \
             relative to the work of the instrument. Version "
            (env!("CARGO_PKG_VERSION")) "."
        }
        (page::table("", table::HEAD, order.iter().map(row)))
        @for r in order.iter().filter(|r| !is_variant(r)) {
            div.pair {
                (figure_of(r))
                @if let Some(variant) = variant(r) { (figure_of(variant)) }
            }
        }
        @if !compared.is_empty() {
            h2 { "Contact surfaces and schemes" }
            p {
                "The deep drags with the whole network at the haptic rate, so that nothing but the contact \
                 differs, over two meshes of the same block, from the end of the press on. Filled marks: the \
                 coarser mesh."
            }
            figure { (PreEscaped(&surfaces)) }
            (surface_table(compared))
        }
    };
    Ok(page::page("stickslip report", &body))
}
