//! The section of a page on the accuracy of local models.

use maud::{Markup, PreEscaped, html};

use super::super::page::{self, Row};
use super::{AccuracyFile, sentences, table};

pub fn section(file: &AccuracyFile) -> miette::Result<Markup> {
    let row = |i: usize| {
        let cells = table::row(file, i);
        let special = if cells[1].is_empty() { "" } else { " special" };
        Row { class: Some(format!("{}{special}", file.points[i].status.name())), cells }
    };
    Ok(html! {
        h2 #accuracy { "Accuracy of local models" }
        p {
            "The drag of " (file.scene) " with each local model, compared with the full network at the haptic rate \
             with the same contact: only the local model differs. Version "
            (env!("CARGO_PKG_VERSION")) "."
        }
        @for sentence in sentences(file) { p { (sentence) } }
        @for (k, reference) in file.references.iter().enumerate() {
            h3 { (reference.contact) }
            div.pair {
                @for (figure, caption) in figures(file, k)? {
                    figure { (PreEscaped(figure)) figcaption { (caption) } }
                }
            }
            (page::table("methods", table::HEAD, rows(file, k).into_iter().map(row)))
        }
        h3 { "Orders of the integrators" }
        p {
            "Order at which the positions of a small block converge with the time step over a smooth motion, ± the \
             largest distance of the four logarithms of errors from their fitted line. Momentum defect: the part of \
             the momentum of the same block, with no node fixed, that the tip's impulse does not account for."
        }
        (page::table("methods", table::ORDERS_HEAD, file.orders.iter().map(table::order)))
    })
}

/// Returns the points of a reference by error, with those that diverged last.
fn rows(file: &AccuracyFile, reference: usize) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..file.points.len()).filter(|&i| file.points[i].reference == reference).collect();
    let error = |i: usize| {
        let point = &file.points[i];
        let failed = if point.status == super::Status::Diverged { f64::INFINITY } else { 0.0 };
        failed + point.errors.force_error_rms_rel
    };
    rows.sort_by(|&a, &b| error(a).total_cmp(&error(b)));
    rows
}

#[cfg(feature = "plots")]
const ERROR_CAPTION: &str = "Blue: fixed exterior; green: drifting; orange: statically condensed; grey: no exterior. \
    Circles: linearised; triangles: nonlinear springs; hollow: over budget; crosses at the top: diverged. Line: the \
    Pareto front of error and time.";

/// Draws the figures of a reference and returns them with their captions.
#[cfg(feature = "plots")]
fn figures(file: &AccuracyFile, reference: usize) -> miette::Result<Vec<(String, &'static str)>> {
    use super::Point;
    use crate::output::figures::precision::{Mark, Precision, compared_forces, precision};
    use crate::verify::accuracy::PERCEPTION;
    use miette::{IntoDiagnostic, WrapErr};

    const GROUPS: [&str; 4] = ["fixed", "drifting", "condensed", "no exterior"];
    let best = file.best.as_ref().map(|best| best.point);
    let of_reference = || file.points.iter().enumerate().filter(move |(_, point)| point.reference == reference);
    let figure = |title: &str, cost: &str, of: fn(&Point) -> Option<f64>, budget: f64| {
        let front = super::front(&file.points, &file.references, reference, of);
        let marks: Vec<Mark> = of_reference()
            .map(|(i, point)| {
                let labels = [(best == Some(i), "best"), (point.is_paper, "paper"), (point.is_own, "scene")];
                let labels: Vec<&str> = labels.iter().filter(|(holds, _)| *holds).map(|(_, label)| *label).collect();
                Mark {
                    cost: of(point),
                    error: point.errors.force_error_rms_rel,
                    group: GROUPS.iter().position(|group| point.names.exterior == Some(group)).unwrap_or(3),
                    triangle: point.names.linearization == Some("none"),
                    hollow: point.status == super::Status::Overrun,
                    diverged: point.status == super::Status::Diverged,
                    on_front: front.contains(&i),
                    label: (!labels.is_empty()).then(|| labels.join(", ")),
                }
            })
            .collect();
        let floor = file.references[reference].floor_rms_rel;
        precision(&Precision { title, cost, groups: &GROUPS, marks: &marks, budget, floor, perception: PERCEPTION })
    };
    let cycle_ms = file.budget.cycle_ms.unwrap_or(1e3 / file.cycle_rate);
    let tick = |point: &Point| Some(1e-3 * point.cost.tick_ns_p50);
    let drawn = || {
        let mut figures = vec![
            (figure("error against time per tick", "median tick (µs)", tick, file.budget.tick_us)?, ERROR_CAPTION),
            (
                figure("error against building a model", "model (ms)", |p| p.cost.build_ms, cycle_ms)?,
                "Force error against the time to build a local model in each cycle. Left edge: no model is built.",
            ),
        ];
        let mut runs = vec![("full network", file.references[reference].samples.as_slice())];
        let paper = of_reference().find(|(_, point)| point.is_paper);
        runs.extend(paper.map(|(_, point)| ("the paper's local model", point.samples.as_slice())));
        let best = best.filter(|_| reference == 0).map(|i| &file.points[i]);
        runs.extend(best.map(|point| (point.name.as_str(), point.samples.as_slice())));
        let caption = "Normal (solid) and tangential (dotted) force.";
        figures.push((compared_forces("force of the reference, the paper's model and the best", &runs)?, caption));
        Ok::<_, std::io::Error>(figures)
    };
    drawn().into_diagnostic().wrap_err("cannot draw the figures")
}

#[cfg(not(feature = "plots"))]
fn figures(_: &AccuracyFile, _: usize) -> miette::Result<Vec<(String, &'static str)>> {
    Ok(Vec::new())
}
