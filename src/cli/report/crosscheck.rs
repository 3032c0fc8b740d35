//! Comparison with independent references, from the last run of `reference/verify`.

use std::io;
use std::path::Path;

use maud::{Markup, html};
use serde::{Deserialize, Serialize};

use super::verdict::{Verdict, VerdictStatus};
use crate::cli::page;

/// Path of the file that `reference/verify` writes, relative to the clone.
const FILE: &str = "reports/crosscheck.json";

/// Contents of `crosscheck.json`.
#[derive(Debug, Serialize, Deserialize)]
pub struct CrossCheck {
    /// Version of the program that was checked.
    version: String,
    /// Commit of the clone, with `+` if it had changes.
    commit: String,
    /// Time of its end, UTC.
    date: String,
    passed: bool,
    failed: Vec<String>,
    skipped: Vec<String>,
    rows: Vec<Row>,
}

/// A quantity compared with a reference.
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    reference: String,
    quantity: String,
    tolerance: String,
    measured: String,
}

/// Reads the last cross-check.
///
/// # Errors
/// If there is none, or it cannot be read: the reason, and how to make one.
pub fn read() -> Result<CrossCheck, String> {
    let how = "run reference/verify in a clone of the project";
    match std::fs::read(Path::new(FILE)) {
        Ok(text) => serde_json::from_slice(&text).map_err(|error| format!("{FILE} cannot be read ({error}); {how}")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(format!("there is no {FILE} here; {how}")),
        Err(error) => Err(format!("{FILE} cannot be read ({error}); {how}")),
    }
}

pub fn verdict(found: &Result<CrossCheck, String>) -> Verdict {
    let (outcome, reason) = match found {
        // The list of failures decides, whatever verdict the file states.
        Ok(CrossCheck { passed, failed, date, .. }) if !passed || !failed.is_empty() => {
            let what = if failed.is_empty() { "the file does not list what".to_owned() } else { failed.join(", ") };
            (VerdictStatus::Fail, format!("failed on {date}: {what}"))
        }
        Ok(CrossCheck { rows, date, .. }) if rows.is_empty() => (
            VerdictStatus::Inconclusive,
            format!("nothing was compared on {date}; run reference/verify without --offline"),
        ),
        Ok(CrossCheck { rows, date, .. }) => {
            (VerdictStatus::Pass, format!("{} quantities agreed with independent references on {date}", rows.len()))
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
                    "Quantities compared with independent references by " code { "reference/verify" } " on "
                    (check.date) ", version " (check.version) ", commit " (check.commit)
                    ". They are not part of this run."
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
