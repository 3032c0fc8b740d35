//! The scenes that were run: table, figures and verdicts.

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::verdict::{Verdict, VerdictStatus};
use crate::cli::page::{self, Row};
use crate::cli::table;
use crate::output::files::FinishedRun;
use crate::output::frames::{Frames, NoFrames};
use crate::output::summary::Summary;
use crate::scene::{Expectation, Scene};
use crate::verify::baseline::Provenance;

/// A scene's run with its figure, frames and provenance.
pub struct Reported {
    run: FinishedRun,
    expectation: Expectation,
    figure: String,
    pub frames: Result<Frames, NoFrames>,
    pub provenance: Provenance,
}

/// A run in `report.json`.
#[derive(Serialize)]
pub struct RunEntry<'a> {
    as_expected: bool,
    outcome: &'static str,
    scene_sha256: &'a str,
    summary: &'a Summary,
}

impl Reported {
    pub fn new(
        scene: &Scene,
        run: FinishedRun,
        expectation: Expectation,
        frames: Result<Frames, NoFrames>,
    ) -> miette::Result<Self> {
        let (figure, provenance) = (figure(&run, &scene.name)?, Provenance::of(scene));
        Ok(Self { run, expectation, figure, frames, provenance })
    }

    pub fn summary(&self) -> &Summary {
        &self.run.summary
    }

    pub fn name(&self) -> &str {
        &self.run.summary.scene
    }

    pub fn as_expected(&self) -> bool {
        match self.expectation {
            Expectation::Completes => self.run.summary.passes(),
            Expectation::Faults => !self.run.summary.completed && self.run.summary.tunnelling_ticks == 0,
        }
    }

    pub fn outcome(&self) -> &'static str {
        match (self.run.summary.completed, self.as_expected()) {
            (true, true) => "completed",
            (false, true) => "fault, as expected",
            (true, false) => "completed, UNEXPECTED",
            (false, false) => "fault, UNEXPECTED",
        }
    }

    pub fn entry(&self) -> RunEntry<'_> {
        RunEntry {
            as_expected: self.as_expected(),
            outcome: self.outcome(),
            scene_sha256: &self.provenance.scene_sha256,
            summary: &self.run.summary,
        }
    }

    /// Returns the reason why the run is not as expected.
    fn complaint(&self) -> String {
        let summary = &self.run.summary;
        match &summary.fault {
            Some(fault) => format!("{}: {fault}", self.outcome()),
            None if summary.tunnelling_ticks > 0 => {
                format!("the tip passed through the surface in {} ticks", summary.tunnelling_ticks)
            }
            None => self.outcome().to_owned(),
        }
    }
}

/// Returns one verdict per scene that did not end as expected, and one for all others.
pub fn verdicts(reported: &[Reported]) -> Vec<Verdict> {
    let of = |what: String, outcome, reason| Verdict { what, outcome, reason, decides: true, section: "experiments" };
    let failed = reported.iter().filter(|r| !r.as_expected());
    let mut verdicts: Vec<Verdict> =
        failed.map(|r| of(r.name().to_owned(), VerdictStatus::Fail, r.complaint())).collect();
    let passed = reported.len() - verdicts.len();
    if passed > 0 {
        let reason = format!("{passed} of {} scenes end as expected", reported.len());
        verdicts.push(of("experiments".to_owned(), VerdictStatus::Pass, reason));
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
    order.sort_by_key(|r| r.as_expected() && variant(r).is_none_or(Reported::as_expected));
    let row = |r: &&Reported| Row {
        class: (!r.as_expected()).then(|| "unexpected".to_owned()),
        cells: table::row(&r.run.summary, r.outcome()),
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
