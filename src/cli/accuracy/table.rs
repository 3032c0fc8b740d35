//! The tables of methods and of orders, in the terminal and on the page.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};

use super::{AccuracyFile, Point};
use crate::verify::orders::ObservedOrder;

/// Column heads of [`row`].
pub const HEAD: [&str; 12] = [
    "method",
    "",
    "status",
    "force error (%)",
    "normal / tangential (%)",
    "largest (N)",
    "mode agreement (%)",
    "jump at hand-over (%)",
    "tick p50 (µs)",
    "tick p99 (µs)",
    "model (ms)",
    "springs / products per tick",
];

/// A point as a row of text.
pub fn row(file: &AccuracyFile, i: usize) -> [String; 12] {
    let point = &file.points[i];
    let (errors, cost, work) = (&point.errors, &point.cost, &point.work);
    let ticks = point.samples.len() as f64;
    [
        point.name.clone(),
        marks(file, i),
        point.status.name().to_owned(),
        format!("{:.2}", 100.0 * errors.force_error_rms_rel),
        format!("{:.2} / {:.2}", 100.0 * errors.normal_error_rms_rel, 100.0 * errors.tangential_error_rms_rel),
        format!("{:.3}", errors.force_error_max_n),
        format!("{:.1}", 100.0 * errors.mode_agreement),
        format!("{:.1}", 100.0 * errors.handover_jump_rel),
        format!("{:.2}", 1e-3 * cost.tick_ns_p50),
        format!("{:.2}", 1e-3 * cost.tick_ns_p99),
        cost.build_ms.map_or("–".to_owned(), |ms| format!("{ms:.2}")),
        format!("{:.0} / {:.1}", work.tick_springs as f64 / ticks, work.matrix_products as f64 / ticks),
    ]
}

/// What is special about a point.
fn marks(file: &AccuracyFile, i: usize) -> String {
    let point = &file.points[i];
    let is_best = file.best.as_ref().is_some_and(|best| best.point == i);
    let marks = [(is_best, "best"), (point.is_paper, "paper"), (point.is_own, "scene"), (point.on_front, "front")];
    let marks: Vec<&str> = marks.into_iter().filter(|(holds, _)| *holds).map(|(_, mark)| mark).collect();
    marks.join(", ")
}

/// The points with something special, with the scene's own contact, by their error.
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

/// Column heads of [`order`].
pub const ORDERS_HEAD: [&str; 5] = ["integrator", "scheme", "contact", "observed order", "momentum defect"];

/// An observed order as a row of text.
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

/// All observed orders.
pub fn orders(file: &AccuracyFile) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(ORDERS_HEAD).add_rows(file.orders.iter().map(order));
    table
}
