//! Tables on standard output.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};

use crate::output::summary::Summary;

/// Column heads of [`row`].
pub const HEAD: [&str; 9] = [
    "scene",
    "outcome",
    "free / stick / slide / slip",
    "peak F_N (N)",
    "peak F_T (N)",
    "largest jump (N)",
    "contact losses",
    "energy residual",
    "tunnelled",
];

/// A run as a row of text.
pub fn row(summary: &Summary, outcome: &str) -> [String; 9] {
    let ticks = &summary.mode_ticks;
    [
        summary.scene.clone(),
        outcome.to_owned(),
        format!("{} / {} / {} / {}", ticks.free, ticks.stick, ticks.slide, ticks.slip),
        format!("{:.3}", summary.largest_normal_force_n),
        format!("{:.3}", summary.largest_tangential_force_n),
        format!("{:.3}", summary.largest_force_jump_n),
        summary.contact_losses.to_string(),
        format!("{:+.1} %", 100.0 * summary.energy.residual_relative),
        summary.tunnelling_ticks.to_string(),
    ]
}

/// A table of runs.
pub fn runs<'a>(runs: impl IntoIterator<Item = (&'a Summary, &'a str)>) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(HEAD);
    for (summary, outcome) in runs {
        table.add_row(row(summary, outcome));
    }
    table
}
