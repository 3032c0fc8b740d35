//! `stickslip list`: the shipped scenes.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use serde::Serialize;

use super::PASS;
use super::terminal::{hand_out, say};
use crate::scene::{Expectation, SHIPPED, Shipped};

/// A shipped scene, as `--json` prints it.
#[derive(Serialize)]
struct Entry {
    name: &'static str,
    /// What the scene shows.
    shows: String,
    /// How a run is expected to end: `completes` or `fault`.
    ends: &'static str,
    /// Largest energy residual that is expected, as a share of the instrument's work; absent for a fault.
    #[serde(skip_serializing_if = "Option::is_none")]
    energy_residual: Option<f64>,
}

impl Entry {
    fn new(shipped: &Shipped) -> Self {
        let (ends, energy_residual) = match shipped.expectation {
            Expectation::Completes { energy_residual } => ("completes", Some(energy_residual)),
            Expectation::Faults => ("fault", None),
        };
        Self { name: shipped.name, shows: shipped.description(), ends, energy_residual }
    }
}

pub fn list() -> miette::Result<u8> {
    let entries: Vec<Entry> = SHIPPED.iter().map(Entry::new).collect();
    hand_out(&entries)?;
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(["scene", "shows"]);
    for Entry { name, shows, .. } in entries {
        // The first sentence; `--json` has all.
        let line = shows.split_inclusive(". ").next().unwrap_or_default().trim_end().to_owned();
        table.add_row([name.to_owned(), line]);
    }
    say(table)?;
    Ok(PASS)
}
