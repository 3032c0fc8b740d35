//! Verdicts, and the verdict on a run.

use serde::Serialize;

use super::summary::Summary;
use crate::scene::Expectation;

/// A verdict, ordered from the worst to the best.
///
/// ```
/// use stickslip::output::verdict::Verdict;
///
/// let verdicts = [Verdict::Pass, Verdict::Fail, Verdict::Inconclusive];
/// assert_eq!(serde_json::to_value(verdicts)?, serde_json::json!(verdicts.map(Verdict::name)));
/// assert_eq!(verdicts.into_iter().min(), Some(Verdict::Fail));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Verdict {
    /// The requirement is not met.
    Fail,
    /// The measurements do not decide.
    Inconclusive,
    /// The requirement is met, as far as it was measured.
    Pass,
}

impl Verdict {
    /// Returns the name as it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "PASS",
            Verdict::Fail => "FAIL",
            Verdict::Inconclusive => "INCONCLUSIVE",
        }
    }
}

/// Energy residual over Σ |f·Δq| from which a run is inconclusive. The geometric scheme moves nodes without work, so its
/// energy balance has a residual: up to 0.39 in shipped scenes that end without a fault.
pub const DOUBTFUL_RESIDUAL: f64 = 0.5;

/// Force error relative to the reference, root mean square, from which a run is inconclusive. The paper's local model has
/// an error of up to 0.37 in the deep shipped scenes.
pub const DOUBTFUL_FORCE_ERROR: f64 = 0.5;

/// Verdict on a run: whether the run tests anything about the scene, and whether its results are right as far as it alone
/// can show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunVerdict {
    /// The worst of the findings.
    pub verdict: Verdict,
    /// The deciding finding, in a word or two.
    pub because: &'static str,
    /// The findings that decide; for a PASS, everything that was checked.
    pub reasons: Vec<String>,
}

/// A finding about a run.
struct Finding {
    verdict: Verdict,
    because: &'static str,
    reason: String,
}

impl RunVerdict {
    /// Judges a run by its summary. `force_error` is its force error relative to a reference, if there was one: the root mean
    /// square of the difference over that of the reference.
    ///
    /// ```
    /// use stickslip::output::{summary::Recorder, verdict::{RunVerdict, Verdict}};
    /// use stickslip::{pipeline, scene::{Expectation, Scene}};
    ///
    /// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
    /// let judge = |ticks: u64| {
    ///     let scene = scene.clone().with_ticks(ticks);
    ///     let mut recorder = Recorder::default();
    ///     pipeline::run(&scene, |tick| recorder.record(tick))?;
    ///     Ok::<_, pipeline::RunError>(recorder.summary(&scene, None, 0.0))
    /// };
    /// let whole = judge(1200)?;
    /// assert_eq!(whole.verdict.verdict, Verdict::Pass);
    /// // A tip that has not come down yet shows nothing about contact.
    /// let early = judge(50)?;
    /// assert_eq!((early.verdict.verdict, early.verdict.because), (Verdict::Inconclusive, "no contact"));
    /// // A force error above one half, one that is not a number, and an expected fault that does not occur.
    /// assert_eq!(RunVerdict::of(&whole, Some(0.6), None).verdict, Verdict::Inconclusive);
    /// assert_eq!(RunVerdict::of(&whole, Some(f64::NAN), None).verdict, Verdict::Fail);
    /// assert_eq!(RunVerdict::of(&whole, None, Some(Expectation::Faults)).verdict, Verdict::Fail);
    /// # Ok::<(), pipeline::RunError>(())
    /// ```
    pub fn of(summary: &Summary, force_error: Option<f64>, expectation: Option<Expectation>) -> Self {
        let mut findings = Vec::new();
        let mut found = |verdict, because, reason| findings.push(Finding { verdict, because, reason });
        use Verdict::{Fail, Inconclusive, Pass};
        let is_expected = expectation == Some(Expectation::Faults);
        if summary.reproduced == Some(false) {
            let reason = "the repetition in virtual time commands other forces than the run in real time: the trace is that of \
                          the repetition";
            found(Fail, "not reproduced", reason.to_owned());
        }
        match (&summary.fault, is_expected) {
            (Some(fault), true) => found(Pass, "fault, as expected", fault.clone()),
            (Some(fault), false) => found(Fail, "fault", fault.clone()),
            (None, true) => {
                found(Fail, "no fault", "the run is expected to end in a fault and reached its end".to_owned())
            }
            (None, false) if !summary.completed && summary.reproduced != Some(false) => {
                found(Inconclusive, "stopped", format!("the run was stopped after {} ticks", summary.ticks));
            }
            (None, false) => found(Pass, "completed", format!("no fault in {} ticks", summary.ticks)),
        }
        if summary.tunnelling_ticks > 0 {
            let ticks = summary.tunnelling_ticks;
            found(
                Fail,
                "tunnelled",
                format!("the tip was inside the surface without force or contact in {ticks} ticks"),
            );
        }
        let contact_ticks = summary.contact_ticks();
        if contact_ticks == 0 {
            let reason =
                "the tip never touched the body: nothing about contact was tested; see the warnings".to_owned();
            found(Inconclusive, "no contact", reason);
        } else {
            found(Pass, "contact", format!("contact in {contact_ticks} ticks"));
        }
        // In a run that diverges to a fault, the energy balance means nothing.
        if contact_ticks > 0 && summary.fault.is_none() {
            let share = summary.energy.residual_relative.abs();
            let reason = format!("the energy residual is {:.1} % of the instrument's work Σ|f·Δq|", 100.0 * share);
            let advice = "compare with a higher `global.rate`, `local.tangent = \"stabilised\"` and \
                          `contact.scheme = \"massless\"`";
            let stated = match expectation {
                Some(Expectation::Completes { energy_residual }) => energy_residual,
                _ => f64::INFINITY,
            };
            match share {
                _ if !(share <= stated) => {
                    found(Fail, "energy", format!("{reason}; at most {} % is expected of this scene", 100.0 * stated));
                }
                _ if !(share <= 1.0) => found(Fail, "energy", format!("{reason}, more than the work itself: {advice}")),
                _ if share > DOUBTFUL_RESIDUAL => {
                    found(
                        Inconclusive,
                        "energy",
                        format!("{reason}, more than {} %: {advice}", 100.0 * DOUBTFUL_RESIDUAL),
                    );
                }
                _ => found(Pass, "energy", reason),
            }
        }
        if let Some(error) = force_error {
            let reason =
                format!("the force is {:.1} % off that of the whole network at the haptic rate", 100.0 * error);
            let advice = "compare local models with `stickslip accuracy`";
            match error {
                _ if !(error < 1.0) => found(Fail, "force", format!("{reason}: {advice}")),
                _ if error > DOUBTFUL_FORCE_ERROR => {
                    found(
                        Inconclusive,
                        "force",
                        format!("{reason}, more than {} %: {advice}", 100.0 * DOUBTFUL_FORCE_ERROR),
                    );
                }
                _ => found(Pass, "force", reason),
            }
        }
        let verdict = findings.iter().map(|finding| finding.verdict).min().unwrap_or(Inconclusive);
        let decides = || findings.iter().filter(|finding| finding.verdict == verdict);
        let because = decides().next().map_or("nothing", |finding| finding.because);
        Self { verdict, because, reasons: decides().map(|finding| finding.reason.clone()).collect() }
    }

    /// The verdict before any check.
    pub(super) fn nothing() -> Self {
        Self { verdict: Verdict::Inconclusive, because: "nothing", reasons: Vec::new() }
    }

    /// Returns the verdict with what decides, for a table.
    pub fn cell(&self) -> String {
        format!("{}: {}", self.verdict.name(), self.because)
    }
}
