//! What independent references said of the program, from the last run of `reference/verify`.

use std::io;
use std::path::Path;

use maud::{Markup, html};
use serde::{Deserialize, Serialize};

use super::verdict::{Verdict, VerdictStatus};
use crate::cli::page;

/// Where `reference/verify` leaves it, from the folder of the clone.
const FILE: &str = "reports/crosscheck.json";

/// The file.
#[derive(Debug, Serialize, Deserialize)]
pub struct CrossCheck {
    /// Of the program that was checked.
    version: String,
    /// Of the clone, with `+` where it had changes.
    commit: String,
    /// When it ended, UTC.
    date: String,
    passed: bool,
    failed: Vec<String>,
    skipped: Vec<String>,
    rows: Vec<Row>,
}

/// A quantity that a reference was held against.
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    reference: String,
    quantity: String,
    tolerance: String,
    measured: String,
}

/// The last cross-check, or why there is none.
pub fn read() -> Result<CrossCheck, String> {
    let how = "reference/verify in a clone of the project makes one";
    match std::fs::read(Path::new(FILE)) {
        Ok(text) => serde_json::from_slice(&text).map_err(|error| format!("{FILE} cannot be read ({error}); {how}")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(format!("there is no {FILE} here; {how}")),
        Err(error) => Err(format!("{FILE} cannot be read ({error}); {how}")),
    }
}

pub fn verdict(found: &Result<CrossCheck, String>) -> Verdict {
    let (outcome, reason) = match found {
        Ok(CrossCheck { passed: true, rows, date, .. }) => {
            (VerdictStatus::Pass, format!("{} quantities agreed with independent references on {date}", rows.len()))
        }
        Ok(CrossCheck { failed, date, .. }) => {
            (VerdictStatus::Fail, format!("on {date} this failed: {}", failed.join(", ")))
        }
        Err(reason) => (VerdictStatus::Inconclusive, reason.clone()),
    };
    Verdict { what: "cross-check".to_owned(), outcome, reason, decides: false, section: "crosscheck" }
}

pub fn section(found: &Result<CrossCheck, String>) -> Markup {
    html! {
        h2 #crosscheck { "Cross-check" }
        @match found {
            Err(reason) => p { "Not shown: " (reason) "." },
            Ok(check) => {
                p {
                    "What was held against independent references by " code { "reference/verify" } " on " (check.date)
                    ", version " (check.version) ", commit " (check.commit) ". It is no part of this run."
                }
                @for what in &check.failed { p.unexpected { "Failed: " (what) "." } }
                @for what in &check.skipped { p { "Skipped: " (what) "." } }
                details {
                    summary { (check.rows.len()) " quantities" }
                    (page::table("words", ["reference", "quantity", "tolerance", "measured"], check.rows.iter().map(
                        |Row { reference, quantity, tolerance, measured }| {
                            [reference, quantity, tolerance, measured].map(String::clone)
                        },
                    )))
                }
            }
        }
    }
}
