//! Tables on standard output.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};

use super::check::Checked;
use crate::output::summary::Summary;
use crate::verify::compare::{Comparison, Outcome};

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

/// A line per scene that was checked.
pub fn checked(scenes: &[Checked]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(["scene", "verdict", "quantities"]);
    for scene in scenes {
        let share = scene.comparisons.iter().filter(|c| c.outcome == Outcome::Within);
        let share = share.map(Comparison::share_of_tolerance).fold(0.0, f64::max);
        let within = match scene.within_tolerance {
            0 => String::new(),
            count => format!(", {count} within tolerance (using up to {share:.1e} of it)"),
        };
        let quantities = scene.problem.clone().unwrap_or_else(|| {
            let improved = if scene.improved > 0 { format!(", {} improved", scene.improved) } else { String::new() };
            let failed = if scene.failed > 0 { format!(", {} FAIL", scene.failed) } else { String::new() };
            format!("{} identical to the bit{within}{improved}{failed}", scene.identical)
        });
        table.add_row([scene.scene.clone(), scene.verdict.to_owned(), quantities]);
    }
    table
}

/// What failed or improved; none if nothing did.
pub fn changed(scenes: &[Checked]) -> Option<Table> {
    let mut table = Table::new();
    let head = ["scene", "quantity", "baseline", "now", "difference", "tolerance", "first tick", "outcome"];
    table.load_style(UTF8_FULL_CONDENSED).set_header(head);
    let shown = |c: &&Comparison| matches!(c.outcome, Outcome::Fail | Outcome::Improved);
    for scene in scenes {
        for c in scene.comparisons.iter().filter(shown) {
            table.add_row([
                scene.scene.clone(),
                c.quantity.clone(),
                value(&c.baseline),
                value(&c.now),
                if c.difference.0.is_finite() { format!("{:+.3e}", c.difference.0) } else { "–".to_owned() },
                format!("{:.1e}", c.tolerance.0),
                c.first_tick.map_or("–".to_owned(), |tick| tick.to_string()),
                if c.outcome == Outcome::Fail { "FAIL" } else { "improved" }.to_owned(),
            ]);
        }
    }
    (!table.is_empty()).then_some(table)
}

fn value(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "not a number, or missing".to_owned(),
        serde_json::Value::String(text) if text.len() == 64 => format!("{}…", &text[..12]),
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}
