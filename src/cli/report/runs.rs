//! The scenes that were run: table, figures and verdicts.

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::verdict::Verdict as ReportVerdict;
use crate::cli::page::{self, Row};
use crate::cli::table;
use crate::output::files::FinishedRun;
use crate::output::frames::{Frames, NoFrames};
use crate::output::summary::Summary;
use crate::output::verdict::{DOUBTFUL_RESIDUAL, RunVerdict, Verdict};
use crate::scene::{Expectation, Scene};
use crate::verify::baseline::Provenance;
use crate::verify::short_reference::ShortReference;

/// A scene's run with its figure, frames and provenance.
pub struct Reported {
    run: FinishedRun,
    expectation: Option<Expectation>,
    reference: ShortReference,
    verdict: RunVerdict,
    figure: String,
    pub frames: Result<Frames, NoFrames>,
    pub provenance: Provenance,
}

/// A run in `report.json`.
#[derive(Serialize)]
pub struct RunEntry<'a> {
    /// Verdict on the run, judged with its reference and its stated expectation.
    verdict: &'a RunVerdict,
    /// Whether a shipped scene met its stated expectation; absent for other scenes.
    #[serde(skip_serializing_if = "Option::is_none")]
    as_expected: Option<bool>,
    reference: &'a ShortReference,
    scene_sha256: &'a str,
    summary: &'a Summary,
}

impl Reported {
    pub fn new(
        scene: &Scene,
        run: FinishedRun,
        expectation: Option<Expectation>,
        frames: Result<Frames, NoFrames>,
    ) -> miette::Result<Self> {
        let (figure, provenance) = (figure(&run, &scene.name)?, Provenance::of(scene));
        let reference = match (&run.fault, expectation) {
            // A run that diverges has no meaningful force to compare.
            (Some(_), _) => ShortReference::None("the run ended in a fault".to_owned()),
            _ => ShortReference::of(scene, &run.samples),
        };
        let verdict = RunVerdict::in_report(&run.summary, reference.force_error(), expectation);
        Ok(Self { run, expectation, reference, verdict, figure, frames, provenance })
    }

    pub fn summary(&self) -> &Summary {
        &self.run.summary
    }

    pub fn name(&self) -> &str {
        &self.run.summary.scene
    }

    pub fn verdict(&self) -> &RunVerdict {
        &self.verdict
    }

    fn passes(&self) -> bool {
        self.verdict.verdict == Verdict::Pass
    }

    pub fn entry(&self) -> RunEntry<'_> {
        RunEntry {
            verdict: &self.verdict,
            as_expected: self.expectation.map(|_| self.passes()),
            reference: &self.reference,
            scene_sha256: &self.provenance.scene_sha256,
            summary: &self.run.summary,
        }
    }
}

/// Returns one verdict for each scene that does not pass, one for the shipped scenes that do, and one for the others that
/// do.
pub fn verdicts(reported: &[Reported]) -> Vec<ReportVerdict> {
    let of =
        |what: String, outcome, reason| ReportVerdict { what, outcome, reason, decides: true, section: "experiments" };
    let failed = reported.iter().filter(|r| !r.passes());
    let mut verdicts: Vec<ReportVerdict> =
        failed.map(|r| of(r.name().to_owned(), r.verdict.verdict, r.verdict.reasons.join("; "))).collect();
    let (shipped, own): (Vec<_>, Vec<_>) = reported.iter().partition(|r| r.expectation.is_some());
    let passed = |runs: &[&Reported]| runs.iter().filter(|r| r.passes()).count();
    if passed(&shipped) > 0 {
        let reason = format!(
            "{} of {} shipped scenes end as expected, within their stated energy residuals",
            passed(&shipped),
            shipped.len()
        );
        verdicts.push(of("experiments".to_owned(), Verdict::Pass, reason));
    }
    if passed(&own) > 0 {
        let compared = own.iter().filter(|r| r.reference.force_error().is_some()).count();
        let reason = format!(
            "{} of {} scenes touch the body, without fault or tunnelling, with an energy residual of at most \
             {DOUBTFUL_RESIDUAL} of the work; the force of {compared} of them was compared with that of the whole network",
            passed(&own),
            own.len()
        );
        verdicts.push(of("scenes".to_owned(), Verdict::Pass, reason));
    }
    verdicts
}

#[cfg(feature = "plots")]
fn figure(run: &FinishedRun, title: &str) -> miette::Result<String> {
    crate::output::figures::forces::forces(title, &run.samples)
        .map_err(|error| miette::miette!("cannot draw {title}: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &FinishedRun, _: &str) -> miette::Result<String> {
    Ok(String::new())
}

/// Suffix of a scene over the limit surface, after the name of the scene that it repeats.
const VARIANT: &str = "-subdivision";

fn figure_of(r: &Reported) -> Markup {
    html! {
        figure {
            (PreEscaped(&r.figure))
            figcaption {
                b { (r.name()) } ": normal (solid) and tangential (dotted) force on the instrument. "
                @if let Some(share) = r.run.summary.stick_share {
                    (format!("The contact sticks in {:.0} % of its stick and slip ticks. ", 100.0 * share))
                }
                @if let ShortReference::Compared { ticks, force_error_rms_rel } = &r.reference {
                    (format!(
                        "Over its first {ticks} ticks the force is {:.1} % off that of the whole network at the haptic rate. ",
                        100.0 * force_error_rms_rel
                    ))
                }
                @for warning in &r.run.summary.warnings { "Warning: " (warning) ". " }
                @if let Some(counts) = &r.run.summary.condensation { (counts) ". " }
                @if let Some(fault) = &r.run.summary.fault { (fault) "." }
            }
        }
    }
}

/// Builds the section of all scenes; those that failed come first.
pub fn section(reported: &[Reported]) -> Markup {
    let variant = |r: &Reported| {
        let name = format!("{}{VARIANT}", r.name());
        reported.iter().find(|other| other.name() == name)
    };
    let is_variant = |r: &Reported| {
        let base = r.name().strip_suffix(VARIANT);
        base.is_some_and(|base| reported.iter().any(|other| other.name() == base))
    };
    let mut order: Vec<&Reported> = reported.iter().collect();
    order.sort_by_key(|r| r.passes() && variant(r).is_none_or(Reported::passes));
    let row = |r: &&Reported| Row {
        class: (r.verdict.verdict == Verdict::Fail).then(|| "unexpected".to_owned()),
        cells: table::row(&r.run.summary, &r.verdict.cell()),
    };
    html! {
        h2 #experiments { "Experiments" }
        p {
            "A tip is pressed into a network of masses, springs and dampers and dragged over it. Largest force jump: \
             the largest change of force between two successive ticks in contact. Energy residual: the energy that \
             the contact scheme and the local model's exterior generate (negative) or lose (positive), relative to \
             the instrument's Σ|f·Δq|. Ticks tunnelled: ticks in which the tip is inside the surface without force."
        }
        (page::table("", table::HEAD, order.iter().map(row)))
        @for r in order.iter().filter(|r| !is_variant(r)) {
            div.pair {
                (figure_of(r))
                @if let Some(variant) = variant(r) { (figure_of(variant)) }
            }
        }
    }
}
