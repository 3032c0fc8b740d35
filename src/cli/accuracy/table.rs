//! The tables of methods and of orders, in the terminal and on the page.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};

use super::super::table::fixed;
use super::{AccuracyFile, Point};
use crate::verify::orders::ObservedOrder;

/// Column headings of [`row`].
pub const HEAD: [&str; 12] = [
    "local model",
    "role",
    "status",
    "force error (%)",
    "normal / tangential (%)",
    "largest error (N)",
    "mode agreement (%)",
    "jump at hand-over (%)",
    "tick p50 (µs)",
    "tick p99 (µs)",
    "building a model (ms)",
    "springs / matrix products per tick",
];

/// Builds a point's row.
pub fn row(file: &AccuracyFile, i: usize) -> [String; 12] {
    let point = &file.points[i];
    let (errors, cost, work) = (&point.errors, &point.cost, &point.work);
    let ticks = point.samples.len() as f64;
    [
        point.name.clone(),
        marks(file, i),
        point.status.name().to_owned(),
        fixed(100.0 * errors.force_error_rms_rel, 2),
        format!(
            "{} / {}",
            fixed(100.0 * errors.normal_error_rms_rel, 2),
            fixed(100.0 * errors.tangential_error_rms_rel, 2)
        ),
        fixed(errors.force_error_max_n, 3),
        format!("{:.1}", 100.0 * errors.mode_agreement),
        fixed(100.0 * errors.handover_jump_rel, 1),
        format!("{:.2}", 1e-3 * cost.tick_ns_p50),
        format!("{:.2}", 1e-3 * cost.tick_ns_p99),
        cost.build_ms.map_or("–".to_owned(), |ms| format!("{ms:.2}")),
        format!("{:.0} / {:.1}", work.tick_springs as f64 / ticks, work.matrix_products as f64 / ticks),
    ]
}

/// Returns the roles of a point: best, paper's, scene's, on the Pareto front.
fn marks(file: &AccuracyFile, i: usize) -> String {
    let point = &file.points[i];
    let is_best = file.best.as_ref().is_some_and(|best| best.point == i);
    let marks =
        [(is_best, "best"), (point.is_paper, "paper"), (point.is_own, "scene"), (point.on_front, "Pareto front")];
    let marks: Vec<&str> = marks.into_iter().filter(|(holds, _)| *holds).map(|(_, mark)| mark).collect();
    marks.join(", ")
}

/// Builds the table of points that have a role, with the scene's own contact, by error.
pub fn points(file: &AccuracyFile) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(HEAD);
    let special = |(i, point): &(usize, &Point)| point.reference == 0 && !marks(file, *i).is_empty();
    let mut rows: Vec<(usize, &Point)> = file.points.iter().enumerate().filter(special).collect();
    rows.sort_by(|(_, a), (_, b)| a.errors.force_error_rms_rel.total_cmp(&b.errors.force_error_rms_rel));
    for (i, _) in rows {
        table.add_row(row(file, i));
    }
    table
}

/// Column headings of [`order`].
pub const ORDERS_HEAD: [&str; 5] = ["integrator", "scheme", "contact", "observed order", "momentum defect"];

/// Builds an observed order's row.
pub fn order(observed: &ObservedOrder) -> [String; 5] {
    let order = observed.order.zip(observed.residual);
    [
        observed.integrator.clone(),
        observed.scheme.unwrap_or("–").to_owned(),
        observed.law.to_owned(),
        order.map_or("exact".to_owned(), |(order, residual)| format!("{order:.2} ± {residual:.2}")),
        observed.momentum_defect.map_or("–".to_owned(), |defect| format!("{defect:.1e}")),
    ]
}

/// Builds the table of observed orders.
pub fn orders(file: &AccuracyFile) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(ORDERS_HEAD).add_rows(file.orders.iter().map(order));
    table
}
