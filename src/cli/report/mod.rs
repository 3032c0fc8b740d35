//! `stickslip report`: scenes and studies on one page.

mod contact;
mod crosscheck;
mod elasticity;
mod provenance;
mod runs;
mod surfaces;
mod verdict;
mod view;

use std::path::{Path, PathBuf};

use clap::Args;
use maud::{Markup, html};
use serde::Serialize;

use self::crosscheck::CrossCheck;
use self::provenance::Origin;
use self::runs::{Reported, RunEntry};
use self::surfaces::SurfaceEntry;
use self::verdict::{Verdict, VerdictStatus};
use super::accuracy::{self, AccuracyFile};
use super::progress::Progress;
use super::run::{Executed, execute};
use super::stability::{self, StabilityFile};
use super::terminal::{hand_out, say};
use super::{Changes, FAIL, INCONCLUSIVE, PASS, page, read, table, warn};
use crate::output::files::{write_file, write_json};
use crate::output::folder::ResultFolder;
use crate::output::frames::FrameRecorder;
use crate::pipeline::Simulation;
use crate::scene::{Expectation, SHIPPED, Scene, SceneError};
use crate::verify::contact_limits::LimitRow;
use crate::verify::elasticity::ElasticityRow;

#[derive(Debug, Args)]
pub struct ReportArguments {
    /// Scene files or names of shipped scenes (default: all shipped scenes)
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    /// Output folder of the report
    #[arg(long, value_name = "DIR", default_value = "reports")]
    out: PathBuf,
    /// Only run the scenes and compare the elasticity of coarser meshes; omit contact surfaces, accuracy, stability and
    /// certificate (if scenes are named, elasticity too)
    #[arg(long)]
    quick: bool,
}

impl Default for ReportArguments {
    /// Returns the arguments of `report` without any given.
    fn default() -> Self {
        Self { scenes: Vec::new(), changes: Changes::default(), out: "reports".into(), quick: false }
    }
}

/// Scene whose drag compares local models.
const ACCURACY_SCENE: &str = "deep-stick-slip";
/// Scene of the stability limits and of the certificate.
const LOOP_SCENE: &str = "fig5-stick-slip";
/// Duration of the servo loop in real time, s.
#[cfg(all(feature = "realtime", target_os = "linux"))]
const CERTIFICATE_S: f64 = 5.0;

/// Contents of `report.json`.
#[derive(Serialize)]
struct ReportFile<'a> {
    provenance: &'a Origin,
    verdicts: &'a [Verdict],
    runs: Vec<RunEntry<'a>>,
    /// Contact surfaces and schemes compared; like the following fields, absent if not part of this report.
    surfaces: Option<&'a [SurfaceEntry]>,
    /// What contact must reach, for three contacts.
    contact: Option<&'a [LimitRow]>,
    accuracy: Option<&'a AccuracyFile>,
    stability: Option<&'a StabilityFile>,
    /// Springs compared with the elastic solid; absent if scenes are named.
    elasticity: Option<&'a [ElasticityRow]>,
    certificate: Option<&'a serde_json::Value>,
    crosscheck: Option<&'a CrossCheck>,
}

/// Studies that only a whole report has.
struct Studies {
    surfaces: Vec<SurfaceEntry>,
    contact: Vec<LimitRow>,
    accuracy: AccuracyFile,
    stability: StabilityFile,
    certificate: Option<serde_json::Value>,
    sections: Vec<Markup>,
    verdicts: Vec<Verdict>,
}

pub fn report(arguments: &ReportArguments) -> miette::Result<u8> {
    let ReportArguments { scenes, changes, out, quick } = arguments;
    let is_whole = scenes.is_empty() && !quick;
    let scenes_checked = checked(scenes, changes)?;
    let folder = ResultFolder::take(out)?;
    folder.clear(&OWN_FILES)?;
    let reported = run_all(&scenes_checked, out)?;
    let studies = if is_whole { Some(Studies::make(out)?) } else { None };
    let elasticity = if scenes.is_empty() { Some(elasticity::compare(elasticity::cells(*quick))?) } else { None };
    let crosscheck = crosscheck::read();

    let mut verdicts = runs::verdicts(&reported);
    let mut omitted = match &studies {
        Some(_) => Vec::new(),
        None => vec!["limits of contact", "contact surfaces", "accuracy", "stability", "certificate"],
    };
    match (&elasticity, quick) {
        (None, _) => omitted.push("elasticity"),
        (Some(_), true) => omitted.push("elasticity of finer meshes"),
        (Some(_), false) => {}
    }
    let origin = Origin::new(&reported, omitted);
    let mut sections = vec![runs::section(&reported), view::section(&reported)?];
    let studies = studies.map(|mut studies| {
        sections.append(&mut studies.sections);
        verdicts.append(&mut studies.verdicts);
        studies
    });
    if let Some(rows) = &elasticity {
        sections.push(elasticity::section(rows, *quick)?);
    }
    verdicts.push(crosscheck::verdict(&crosscheck));
    sections.extend([crosscheck::section(&crosscheck), provenance::section(&origin, &reported)]);
    verdict::worst_first(&mut verdicts);

    let studies = studies.as_ref();
    let file = ReportFile {
        provenance: &origin,
        verdicts: &verdicts,
        runs: reported.iter().map(Reported::entry).collect(),
        surfaces: studies.map(|studies| studies.surfaces.as_slice()),
        contact: studies.map(|studies| studies.contact.as_slice()),
        accuracy: studies.map(|studies| &studies.accuracy),
        stability: studies.map(|studies| &studies.stability),
        elasticity: elasticity.as_deref(),
        certificate: studies.and_then(|studies| studies.certificate.as_ref()),
        crosscheck: crosscheck.as_ref().ok(),
    };
    write_json(&out.join("report.json"), &file)?;
    write_file(&out.join("index.html"), whole_page(&verdicts, &sections).into_string().as_bytes())?;

    hand_out(&file)?;
    say(table::runs(reported.iter().map(|r| (r.summary(), r.verdict().cell()))))?;
    say(verdict::lines(&verdicts))?;
    say(format_args!("report: {}", out.join("index.html").display()))?;
    Ok(match verdicts.iter().filter(|verdict| verdict.decides).map(|verdict| verdict.outcome).min() {
        Some(VerdictStatus::Fail) => FAIL,
        Some(VerdictStatus::Inconclusive) => INCONCLUSIVE,
        Some(VerdictStatus::Pass) | None => PASS,
    })
}

/// Files of a report beside the folders of its scenes.
const OWN_FILES: [&str; 2] = ["index.html", "report.json"];

/// Loads and prepares all scenes before the first one runs.
fn checked(scenes: &[PathBuf], changes: &Changes) -> miette::Result<Vec<(Scene, Option<Expectation>)>> {
    if scenes.is_empty() && !changes.changes.is_empty() {
        return Err(miette::miette!(help = "name the scenes to change", "--set changes no scene, as none is named"));
    }
    let shipped = SHIPPED.iter().map(|shipped| shipped.name.into());
    let scenes: Vec<PathBuf> = if scenes.is_empty() { shipped.collect() } else { scenes.to_vec() };
    let scenes: Vec<(Scene, Option<Expectation>)> =
        scenes.iter().map(|scene| read(scene, changes)).collect::<Result<_, SceneError>>()?;
    for (i, (scene, _)) in scenes.iter().enumerate() {
        Simulation::prepare(scene)?;
        if OWN_FILES.contains(&scene.name.as_str()) {
            return Err(miette::miette!(
                help = "give the scene another `name`",
                "a scene is named {:?}, which is the name of a file of the report",
                scene.name
            ));
        }
        if scenes[..i].iter().any(|(other, _)| other.name == scene.name) {
            return Err(miette::miette!(
                help = "give each scene a `name` of its own",
                "two scenes are named {:?}, and both would write to the folder of that name",
                scene.name
            ));
        }
    }
    Ok(scenes)
}

fn run_all(scenes: &[(Scene, Option<Expectation>)], out: &Path) -> miette::Result<Vec<Reported>> {
    let mut progress = Progress::new(scenes.iter().map(|(scene, _)| scene.tick_count()).sum(), "ticks");
    let mut reported = Vec::with_capacity(scenes.len());
    for (scene, expectation) in scenes {
        progress.begin(&scene.name);
        let mut recorder = FrameRecorder::new(scene, view::share(scenes.len()));
        let Executed { finished, .. } = execute(scene, &out.join(&scene.name), None, warn, |view| {
            recorder.record(view);
            progress.set(view.tick + 1);
        })?;
        progress.end(scene.tick_count());
        reported.push(Reported::new(scene, finished, *expectation, recorder.finish())?);
    }
    Ok(reported)
}

impl Studies {
    /// Runs the studies one after the other, so that none disturbs the times of another.
    fn make(out: &Path) -> miette::Result<Self> {
        let contact = contact::limits()?;
        let surfaces = surfaces::compare()?;
        let (accuracy, about_accuracy) = accuracy::brief(&shipped(ACCURACY_SCENE)?)?;
        let (stability, about_stability) = stability::brief(&shipped(LOOP_SCENE)?)?;
        let mut sections =
            vec![contact::section(&contact), surfaces::section(&surfaces)?, about_accuracy, about_stability];
        let mut verdicts = vec![accuracy_verdict(&accuracy), stability_verdict(&stability)];
        let (certificate, about_certificate) = certificate(&mut verdicts, &out.join(LOOP_SCENE))?;
        sections.push(about_certificate);
        Ok(Self { surfaces, contact, accuracy, stability, certificate, sections, verdicts })
    }
}

fn shipped(name: &str) -> miette::Result<Scene> {
    Scene::shipped(name).ok_or_else(|| miette::miette!("there is no shipped scene {name}"))
}

fn accuracy_verdict(file: &AccuracyFile) -> Verdict {
    let (outcome, reason) = match (file.failure(), file.best_in_words()) {
        (Some(failure), _) => (VerdictStatus::Fail, failure),
        (None, (true, best)) => (VerdictStatus::Pass, best),
        (None, (false, none)) => (VerdictStatus::Inconclusive, none),
    };
    // Which methods are fast enough depends on the machine.
    let decides = outcome == VerdictStatus::Fail;
    Verdict { what: "accuracy".to_owned(), outcome, reason, decides, section: "accuracy" }
}

fn stability_verdict(file: &StabilityFile) -> Verdict {
    let (outcome, reason) = (file.verdict, file.reasons.join("; "));
    Verdict { what: "stability".to_owned(), outcome, reason, decides: true, section: "stability" }
}

/// Makes a short certificate with its verdicts on this machine. If it fails, the rest of the report still stands.
#[cfg(all(feature = "realtime", target_os = "linux"))]
fn certificate(verdicts: &mut Vec<Verdict>, out: &Path) -> miette::Result<(Option<serde_json::Value>, Markup)> {
    use miette::IntoDiagnostic;

    let (certificate, section) = match super::certify::brief(&shipped(LOOP_SCENE)?, CERTIFICATE_S, out) {
        Ok(made) => made,
        Err(error) => return Ok((None, not_certified(verdicts, VerdictStatus::Fail, &error.to_string()))),
    };
    let mut add = |part: &str, found, reasons: &[String]| {
        verdicts.push(certified(&format!("certificate, {part}"), found, &reasons.join("; ")));
    };
    add("compute", certificate.compute.verdict, &certificate.compute.reasons);
    add("platform", certificate.platform.verdict, &certificate.platform.reasons);
    if let Some(global) = &certificate.global {
        add("global side", global.verdict, &global.reasons);
    }
    Ok((Some(serde_json::to_value(&certificate).into_diagnostic()?), section))
}

#[cfg(not(all(feature = "realtime", target_os = "linux")))]
fn certificate(verdicts: &mut Vec<Verdict>, _: &Path) -> miette::Result<(Option<serde_json::Value>, Markup)> {
    let reason = "this program was built without the feature `realtime`, which needs Linux";
    Ok((None, not_certified(verdicts, VerdictStatus::Inconclusive, reason)))
}

fn certified(what: &str, outcome: VerdictStatus, reason: &str) -> Verdict {
    let (what, reason) = (what.to_owned(), reason.to_owned());
    Verdict { what, outcome, reason, decides: false, section: "certificate" }
}

fn not_certified(verdicts: &mut Vec<Verdict>, outcome: VerdictStatus, reason: &str) -> Markup {
    verdicts.push(certified("certificate", outcome, reason));
    html! { h2 #certificate { "Certificate of the servo loop" } p { "No certificate: " (reason) "." } }
}

fn whole_page(verdicts: &[Verdict], sections: &[Markup]) -> Markup {
    let body = html! {
        (verdict::list(verdicts))
        @for about in sections { section { (about) } }
    };
    page::page("stickslip report", &body)
}
