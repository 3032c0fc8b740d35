//! What came of it all, what failed first.

use maud::{Markup, html};
use serde::Serialize;

/// Worst first.
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

/// A line of the list.
#[derive(Debug, Serialize)]
pub struct Verdict {
    pub what: String,
    pub outcome: VerdictStatus,
    pub reason: String,
    /// Whether a FAIL of it is one of the command: not where the machine is judged, or an earlier run.
    pub decides: bool,
    /// Section of the page that it is about.
    #[serde(skip)]
    pub section: &'static str,
}

/// Sorts the worst to the top.
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

/// The same for the terminal.
pub fn lines(verdicts: &[Verdict]) -> String {
    let line = |verdict: &Verdict| format!("{}: {}: {}", verdict.outcome.name(), verdict.what, verdict.reason);
    verdicts.iter().map(line).collect::<Vec<_>>().join("\n")
}
