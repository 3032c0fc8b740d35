//! The verdicts of a report, failures first.

use maud::{Markup, html};
use serde::Serialize;

/// Status of a verdict; the worst is the smallest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum VerdictStatus {
    Fail,
    Inconclusive,
    Pass,
}

impl VerdictStatus {
    fn name(self) -> &'static str {
        match self {
            VerdictStatus::Fail => "FAIL",
            VerdictStatus::Inconclusive => "INCONCLUSIVE",
            VerdictStatus::Pass => "PASS",
        }
    }

    fn class(self) -> &'static str {
        match self {
            VerdictStatus::Fail => "fail",
            VerdictStatus::Inconclusive => "inconclusive",
            VerdictStatus::Pass => "pass",
        }
    }

    pub fn pass_if(holds: bool) -> Self {
        if holds { VerdictStatus::Pass } else { VerdictStatus::Fail }
    }
}

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
                li class=(outcome.class()) {
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
