//! The verdicts of a report, failures first.

use maud::{Markup, html};
use serde::Serialize;

pub use crate::output::verdict::Verdict as VerdictStatus;

/// A verdict of the report.
#[derive(Debug, Serialize)]
pub struct Verdict {
    pub what: String,
    pub outcome: VerdictStatus,
    pub reason: String,
    /// Whether its FAIL makes the command fail; false for verdicts on the machine or on an earlier run.
    pub decides: bool,
    /// Id of the page's section that it belongs to.
    #[serde(skip)]
    pub section: &'static str,
}

/// Sorts verdicts, the worst first.
pub fn worst_first(verdicts: &mut [Verdict]) {
    verdicts.sort_by_key(|verdict| verdict.outcome);
}

pub fn list(verdicts: &[Verdict]) -> Markup {
    html! {
        ul.verdicts {
            @for Verdict { what, outcome, reason, section, .. } in verdicts {
                li class=(outcome.name().to_lowercase()) {
                    b { (outcome.name()) } " " a href={ "#" (section) } { (what) } ": " (reason)
                }
            }
        }
    }
}

/// Builds the lines of the verdicts for the terminal.
pub fn lines(verdicts: &[Verdict]) -> String {
    let line = |verdict: &Verdict| format!("{}: {}: {}", verdict.outcome.name(), verdict.what, verdict.reason);
    verdicts.iter().map(line).collect::<Vec<_>>().join("\n")
}
