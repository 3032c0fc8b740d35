//! `stickslip report`: the main job.

use std::path::{Path, PathBuf};

use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

use super::progress::Progress;
use super::{FAIL, PASS, load, say, table};
use crate::output::files::{FinishedRun, run_into, write_file, write_json};
use crate::pipeline::Simulation;
use crate::scene::{Expectation, SHIPPED, Scene, SceneError};

/// `report.json`.
#[derive(Serialize)]
struct ReportFile<'a> {
    version: &'static str,
    runs: Vec<RunEntry<'a>>,
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

    let mut progress = Progress::new(scenes.iter().map(|(scene, _)| scene.tick_count).sum());
    let mut reported = Vec::with_capacity(scenes.len());
    for (scene, expectation) in &scenes {
        progress.begin(&scene.name);
        let folder = out.join(&scene.name);
        let run = run_into(scene, &folder, |ticks| progress.set(ticks))?;
        progress.end(scene.tick_count);
        reported.push(Reported { figure: figure(&run, &scene.name)?, run, expectation: *expectation });
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
    };
    write_json(&out.join("report.json"), &file)?;
    write_file(&out.join("index.html"), page(&reported).into_string().as_bytes())?;

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

const STYLE: &str = "
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 76rem; margin: 0 auto; padding: 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #8886; text-align: right; }
td { white-space: nowrap; }
th:first-child, td:first-child, th:nth-child(2), td:nth-child(2) { text-align: left; }
.unexpected { color: #c22; font-weight: bold; }
figure { margin: 2rem 0; }
figure svg { width: 100%; height: auto; background: #fff; border-radius: 6px; }
";

fn page(reported: &[Reported]) -> Markup {
    let mut order: Vec<&Reported> = reported.iter().collect();
    // What failed comes first.
    order.sort_by_key(|r| r.as_expected());
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "stickslip report" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "stickslip report" }
                p {
                    "A tip is pressed into a block of masses, springs and dampers and dragged over it. The table has \
                     a row per scene; its jump is the largest change of force between two ticks in contact, its \
                     energy residual what the contact scheme and the exterior of the local model made or lost, \
                     relative to the work of the instrument. Version "
                    (env!("CARGO_PKG_VERSION")) "."
                }
                div.wide {
                    table {
                        thead { tr { @for head in table::HEAD { th { (head) } } } }
                        tbody {
                            @for r in &order {
                                tr class=[(!r.as_expected()).then_some("unexpected")] {
                                    @for cell in table::row(&r.run.summary, r.outcome()) { td { (cell) } }
                                }
                            }
                        }
                    }
                }
                @for r in &order {
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
        }
    }
}
