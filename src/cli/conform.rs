//! `stickslip conform`: the properties that every haptic renderer has.

use std::path::PathBuf;

use clap::Args;
use maud::{Markup, html};

use super::junit::{JunitArguments, JunitCase, JunitSuite};
use super::page::{self, Row};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{hand_out, say, significant};
use super::{Changes, exit_code, folder, load, never_touches};
use crate::output::files::{write_file, write_json};
use crate::output::verdict::Verdict;
use crate::verify::conformance::{Conformance, PropertyFinding, RUNS};

#[derive(Debug, Args)]
pub struct ConformArguments {
    /// A scene file or the name of a shipped scene: its body, contact law and surface are used, and the place where its path
    /// first touches the body
    scene: PathBuf,
    #[command(flatten)]
    changes: Changes,
    /// Output folder (default: reports/SCENE)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    renderer: RendererArguments,
    #[command(flatten)]
    junit: JunitArguments,
}

pub fn conform(arguments: &ConformArguments) -> miette::Result<u8> {
    let scene = load(&arguments.scene, &arguments.changes, &arguments.renderer)?;
    let folder = folder(arguments.out.clone(), &scene, &["conformance.json", "index.html"])?;
    let out = folder.path();
    arguments.junit.prepare()?;
    let mut progress = Progress::new(RUNS, "runs");
    progress.begin(&scene.name);
    let conformance = Conformance::of(&scene, || progress.end(1))?;
    drop(progress);
    let conformance = conformance.ok_or_else(|| never_touches(&scene))?;
    write_json(&out.join("conformance.json"), &conformance)?;
    let title = format!("stickslip: conformance over {}", conformance.scene);
    write_file(&out.join("index.html"), page::page(&title, &section(&conformance)).into_string().as_bytes())?;
    arguments.junit.write(|| verdicts(&conformance))?;
    hand_out(&conformance)?;
    for finding in &conformance.properties {
        say(format_args!("{:<12} {}: {}", finding.verdict.name(), finding.name, finding.finding))?;
    }
    say(verdict(&conformance))?;
    say(format_args!("report: {}", out.join("index.html").display()))?;
    Ok(exit_code(conformance.verdict))
}

/// Returns the verdicts for continuous integration.
fn verdicts(conformance: &Conformance) -> JunitSuite {
    let case = |finding: &PropertyFinding| JunitCase {
        name: finding.name.to_owned(),
        class: format!("stickslip.conform.{}", conformance.scene),
        seconds: None,
        verdict: finding.verdict,
        reasons: vec![finding.finding.clone()],
    };
    JunitSuite { name: "stickslip conform", cases: conformance.properties.iter().map(case).collect() }
}

/// Returns the finding in a sentence.
fn verdict(conformance: &Conformance) -> String {
    let of = |verdict| conformance.properties.iter().filter(move |finding| finding.verdict == verdict);
    let names = |verdict| of(verdict).map(|finding| finding.name).collect::<Vec<_>>().join(", ");
    let (count, passed) = (conformance.properties.len(), of(Verdict::Pass).count());
    let and = match conformance.verdict {
        Verdict::Pass => String::new(),
        Verdict::Inconclusive => format!("; not decided: {}", names(Verdict::Inconclusive)),
        Verdict::Fail => format!("; failed: {}", names(Verdict::Fail)),
    };
    format!("{}: {passed} of {count} properties hold{and}", conformance.verdict.name())
}

fn section(conformance: &Conformance) -> Markup {
    let number = |value: f64, finding: &PropertyFinding| format!("{} {}", significant(value), finding.unit);
    let rows = conformance.properties.iter().map(|finding| Row {
        class: (finding.verdict == Verdict::Fail).then(|| "unexpected".to_owned()),
        cells: [
            finding.name.to_owned(),
            finding.verdict.name().to_owned(),
            finding.measured.map_or("–".to_owned(), |measured| number(measured, finding)),
            number(finding.limit, finding),
            finding.property.to_owned(),
            finding.finding.clone(),
            finding.motion.clone(),
        ],
    });
    html! {
        p { strong { (verdict(conformance)) } }
        p {
            "Renderer: " code { (conformance.renderer) } ". Body, contact law and contact surface: scene "
            code { (conformance.scene) } ". Presses are " (significant(1e3 * conformance.depth_m)) " mm deep, drags "
            (significant(1e3 * conformance.drag_m)) " mm long."
        }
        (page::table("words", ["property", "verdict", "measured", "limit", "what every renderer does", "finding", "motions"], rows))
    }
}
