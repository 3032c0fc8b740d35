//! The section that compares contact surfaces and schemes.

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::table::fixed;
use crate::verify::surfaces::{self, Combination, SurfaceMeasures};

/// Refinements of the block of the deep drags.
const REFINEMENTS: [usize; 2] = [1, 2];

/// A row of the comparison, also in `report.json`.
#[derive(Serialize)]
pub struct SurfaceEntry {
    drag: &'static str,
    surface: &'static str,
    scheme: &'static str,
    spacing_m: f64,
    #[serde(flatten)]
    measures: SurfaceMeasures,
}

/// Runs every combination.
pub fn compare() -> miette::Result<Vec<SurfaceEntry>> {
    let grid: Vec<Combination> = REFINEMENTS.into_iter().flat_map(surfaces::grid).collect();
    let mut progress = Progress::new(grid.iter().map(|combination| combination.scene.tick_count()).sum(), "ticks");
    let mut compared = Vec::with_capacity(grid.len());
    for Combination { drag, surface, scheme, spacing_m, scene } in &grid {
        progress.begin(&scene.name);
        let measures =
            surfaces::measure(scene, |ticks| progress.set(ticks)).map_err(|error| miette::miette!("{error}"))?;
        progress.end(scene.tick_count());
        compared.push(SurfaceEntry { drag, surface, scheme, spacing_m: *spacing_m, measures });
    }
    Ok(compared)
}

#[cfg(feature = "plots")]
fn figure(compared: &[SurfaceEntry]) -> miette::Result<String> {
    use crate::output::figures::forces::{Jump, jumps};
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
                relative: entry.measures.jump_relative,
            }
        })
        .collect();
    jumps(&columns, &series, &marks).map_err(|error| miette::miette!("cannot draw the force jumps: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &[SurfaceEntry]) -> miette::Result<String> {
    Ok(String::new())
}

const HEAD: [&str; 11] = [
    "drag",
    "surface, scheme",
    "spacing (mm)",
    "mean force (N)",
    "largest jump (N)",
    "jump / mean force",
    "power above 100 Hz (N²)",
    "ripple at edge crossings",
    "contact losses",
    "mode switches (1/s)",
    "energy residual",
];

fn row(entry: &SurfaceEntry) -> [String; 11] {
    let percent = |value: f64| format!("{} %", fixed(100.0 * value, 2));
    let measures = &entry.measures;
    [
        entry.drag.to_owned(),
        format!("{}, {}", entry.surface, entry.scheme),
        format!("{:.2}", 1e3 * entry.spacing_m),
        fixed(measures.mean_force_n, 3),
        fixed(measures.largest_jump_n, 4),
        percent(measures.jump_relative),
        format!("{:.1e}", measures.power_above_100_hz_n2),
        measures.mesh_ripple_relative.map_or("–".to_owned(), percent),
        measures.contact_losses.to_string(),
        format!("{:.1}", measures.mode_switches_per_s),
        measures.fault.clone().unwrap_or_else(|| percent(measures.energy_residual_relative)),
    ]
}

pub fn section(compared: &[SurfaceEntry]) -> miette::Result<Markup> {
    let figure = figure(compared)?;
    Ok(html! {
        h2 #surfaces { "Contact surfaces and schemes" }
        p {
            "The deep drags with the whole network at the haptic rate, so that only the contact differs, over two \
             meshes of the same block, evaluated after the press. Filled marks: the coarser mesh."
        }
        figure {
            (PreEscaped(figure))
            figcaption { "Largest change of force between two ticks in contact over the mean force." }
        }
        details {
            summary { "Table of all combinations" }
            (page::table("", HEAD, compared.iter().map(row)))
        }
    })
}
