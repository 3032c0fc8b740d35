//! The table of runs, in the terminal and in the report.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};

use super::terminal::significant;
use crate::output::summary::Summary;

/// Column headings of [`row`].
pub const HEAD: [&str; 9] = [
    "scene",
    "verdict",
    "ticks: free / stick / slide / slip",
    "peak F_N (N)",
    "peak F_T (N)",
    "largest force jump (N)",
    "contact losses",
    "energy residual",
    "ticks tunnelled",
];

/// Builds a run's row.
pub fn row(summary: &Summary, verdict: &str) -> [String; 9] {
    let ticks = &summary.mode_ticks;
    let residual = 100.0 * summary.energy.residual_relative;
    [
        summary.scene.clone(),
        verdict.to_owned(),
        format!("{} / {} / {} / {}", ticks.free, ticks.stick, ticks.slide, ticks.slip),
        fixed(summary.largest_normal_force_n, 3),
        fixed(summary.largest_tangential_force_n, 3),
        fixed(summary.largest_force_jump_n, 3),
        summary.contact_losses.to_string(),
        format!("{}{} %", if residual > 0.0 { "+" } else { "" }, fixed(residual, 1)),
        summary.tunnelling_ticks.to_string(),
    ]
}

/// Formats a number with fixed decimals, or with four significant digits from 10 000 on, as a diverged run gives.
pub fn fixed(value: f64, decimals: usize) -> String {
    if value.abs() >= 1e4 { significant(value) } else { format!("{value:.decimals$}") }
}

/// Builds the table of runs.
pub fn runs<'a>(runs: impl IntoIterator<Item = (&'a Summary, String)>) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(HEAD);
    for (summary, verdict) in runs {
        table.add_row(row(summary, &verdict));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::fixed;

    #[test]
    fn decimals_are_fixed_where_they_matter() {
        assert_eq!([fixed(1.26, 1), fixed(-38.97, 1), fixed(9999.0, 0)], ["1.3", "-39.0", "9999"]);
        assert_eq!([fixed(-2_971_409.2, 1), fixed(f64::NAN, 1), fixed(f64::INFINITY, 3)], ["-2.971e6", "NaN", "inf"]);
    }
}
