//! `stickslip check`: results compared with accepted baselines.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use serde::Serialize;

use super::junit::{JunitArguments, JunitCase, JunitSuite};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{complain, hand_out, say};
use super::{Changes, FAIL, PASS, load, time};
use crate::output::files::{WriteError, write_json};
use crate::output::verdict::Verdict;
use crate::scene::{SHIPPED, Scene, SceneError};
use crate::verify::accept::accept;
use crate::verify::baseline::{Provenance, Store};
use crate::verify::compare::{Comparison, ComparisonOutcome, compare};
use crate::verify::paired::{FEWEST_PAIRS, MOST_PAIRS};
use crate::verify::results::Results;

/// Folder of the baselines in a clone of the project.
const IN_CLONE: &str = "fixtures/baselines";

#[derive(Debug, Args)]
pub struct CheckArguments {
    /// Scene files or names of shipped scenes (default: all shipped scenes)
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    /// Output folder of check.json
    #[arg(long, value_name = "DIR", default_value = "reports/check")]
    out: PathBuf,
    /// Folder with a SCENE.json per scene (default: fixtures/baselines if there is such a folder, else the
    /// baselines built into the program)
    #[arg(long, value_name = "DIR")]
    baselines: Option<PathBuf>,
    /// Accept the present results of a scene as its baseline
    #[arg(long, value_name = "SCENE", requires = "reason", conflicts_with_all = ["scenes", "out", "time", "file"])]
    accept: Option<PathBuf>,
    /// Reason why the accepted results are right; kept in the baseline with the values that they replace
    #[arg(long, value_name = "TEXT", requires = "accept", value_parser = reason)]
    reason: Option<String>,
    /// Let a quantity differ from its baseline by this share of its size (default 1e-9, and 0 for counts); names are those of
    /// check.json. With --accept, the baseline keeps it
    #[arg(long = "tolerance", value_name = "QUANTITY=SHARE", value_parser = tolerance)]
    tolerances: Vec<(String, f64)>,
    /// Also compare the run times of this program and another one; the verdict does not depend on them
    #[arg(long, requires = "against", conflicts_with = "changes")]
    time: bool,
    /// Program to compare run times with
    #[arg(long, value_name = "PROGRAM", requires = "time")]
    against: Option<PathBuf>,
    /// Rounds in which both programs and the control take a turn
    #[arg(long, value_name = "N", requires = "time", default_value_t = 40, value_parser = rounds)]
    rounds: usize,
    #[command(flatten)]
    junit: JunitArguments,
}

fn reason(text: &str) -> Result<String, String> {
    if text.trim().is_empty() { Err("state what changed and why it is right".to_owned()) } else { Ok(text.to_owned()) }
}

fn tolerance(text: &str) -> Result<(String, f64), String> {
    let (name, share) = text.rsplit_once('=').ok_or("give QUANTITY=SHARE, as in \"fx rms=1e-6\"")?;
    let share = share.trim().parse().ok().filter(|share: &f64| share.is_finite() && *share >= 0.0);
    Ok((name.trim().to_owned(), share.ok_or("the share has to be a finite number of at least 0")?))
}

fn rounds(text: &str) -> Result<usize, String> {
    let rounds = text.parse().ok().filter(|rounds| (FEWEST_PAIRS..=MOST_PAIRS).contains(rounds));
    rounds.ok_or_else(|| format!("give a whole number from {FEWEST_PAIRS} to {MOST_PAIRS}"))
}

/// Contents of `check.json`.
#[derive(Serialize)]
struct CheckFile<'a> {
    version: &'static str,
    verdict: &'static str,
    baselines: String,
    scenes: &'a [Checked],
    /// Run times compared with those of another program; absent without --time.
    #[serde(skip_serializing_if = "Option::is_none")]
    times: Option<time::Compared>,
}

/// Outcome of `--accept`.
#[derive(Serialize)]
struct Accepted<'a> {
    scene: &'a str,
    /// Path of the new baseline; absent if nothing differs.
    baseline: Option<PathBuf>,
    /// Number of quantities that had another value.
    replaced: usize,
}

/// Comparison of a scene's results with its baseline.
#[derive(Serialize)]
pub struct Checked {
    pub scene: String,
    pub verdict: &'static str,
    /// Reason why there is no baseline to compare with, if so.
    pub problem: Option<String>,
    pub identical: usize,
    pub within_tolerance: usize,
    pub improved: usize,
    pub failed: usize,
    provenance: Provenance,
    baseline_provenance: Option<Provenance>,
    pub comparisons: Vec<Comparison>,
}

impl Checked {
    fn new(store: &Store, scene: &Scene, results: &Results, tolerances: &BTreeMap<String, f64>) -> Self {
        let provenance = Provenance::of(scene);
        let (baseline_provenance, comparisons, problem) = match store.load(&scene.name) {
            Ok(mut baseline) => {
                baseline.tolerances.extend(tolerances.clone());
                let comparisons = compare(&baseline, &provenance, results);
                (Some(baseline.provenance), comparisons, None)
            }
            Err(error) => (None, Vec::new(), Some(error.to_string())),
        };
        let count = |outcome| comparisons.iter().filter(|comparison| comparison.outcome == outcome).count();
        let failed = count(ComparisonOutcome::Fail);
        let passes = failed == 0 && !comparisons.is_empty();
        Self {
            scene: scene.name.clone(),
            verdict: verdict(passes),
            problem,
            identical: count(ComparisonOutcome::Identical),
            within_tolerance: count(ComparisonOutcome::Within),
            improved: count(ComparisonOutcome::Improved),
            failed,
            provenance,
            baseline_provenance,
            comparisons,
        }
    }

    /// Returns the verdict for continuous integration, with the quantities that fail.
    fn case(&self, seconds: f64) -> JunitCase {
        let failed = self.comparisons.iter().filter(|comparison| comparison.outcome == ComparisonOutcome::Fail);
        let reason = |c: &Comparison| {
            let tick = c.first_tick.map_or(String::new(), |tick| format!(", from tick {tick} on"));
            format!("{}: {} in the baseline, {} now{tick}", c.quantity, value(&c.baseline), value(&c.now))
        };
        JunitCase {
            name: self.scene.clone(),
            class: "stickslip.check".to_owned(),
            seconds: Some(seconds),
            verdict: if self.verdict == verdict(true) { Verdict::Pass } else { Verdict::Fail },
            reasons: self.problem.iter().cloned().chain(failed.map(reason)).collect(),
        }
    }
}

fn verdict(passes: bool) -> &'static str {
    if passes { "PASS" } else { "FAIL" }
}

pub fn check(arguments: &CheckArguments) -> miette::Result<u8> {
    let tolerances: BTreeMap<String, f64> = arguments.tolerances.iter().cloned().collect();
    if let (Some(scene), Some(reason)) = (&arguments.accept, &arguments.reason) {
        return accept_results(scene, &arguments.changes, reason, &tolerances, arguments.baselines.as_deref());
    }
    if let Some(against) = &arguments.against {
        time::probe(against)?;
    }
    let shipped = SHIPPED.iter().map(|shipped| shipped.name.into());
    let scenes = if arguments.scenes.is_empty() { shipped.collect() } else { arguments.scenes.clone() };
    // All scenes are read before the first one runs.
    let loaded: Vec<Scene> = scenes
        .iter()
        .map(|scene| load(scene, &arguments.changes, &RendererArguments::default()))
        .collect::<Result<_, SceneError>>()?;
    let store = match &arguments.baselines {
        Some(folder) => Store::Folder(folder.clone()),
        None if Path::new(IN_CLONE).is_dir() => Store::Folder(IN_CLONE.into()),
        None => Store::Program,
    };

    arguments.junit.prepare()?;
    let mut progress = Progress::new(loaded.iter().map(|scene| scene.tick_count()).sum(), "ticks");
    let mut checked = Vec::with_capacity(loaded.len());
    let mut seconds = Vec::with_capacity(loaded.len());
    for scene in &loaded {
        progress.begin(&scene.name);
        let start = Instant::now();
        let results = Results::of(scene, |ticks| progress.set(ticks))?;
        progress.end(scene.tick_count());
        seconds.push(start.elapsed().as_secs_f64());
        checked.push(Checked::new(&store, scene, &results, &tolerances));
    }
    drop(progress);
    let compared = checked.iter().flat_map(|scene| &scene.comparisons);
    if checked.iter().any(|scene| scene.problem.is_none()) {
        known(&tolerances, compared)?;
    }

    let passes = checked.iter().all(|scene| scene.verdict == verdict(true));
    let out = &arguments.out;
    fs::create_dir_all(out).map_err(|source| WriteError { path: out.clone(), source })?;
    let baselines = match &store {
        Store::Folder(folder) => folder.display().to_string(),
        Store::Program => "in the program".to_owned(),
    };
    say(verdict_table(&checked))?;
    if let Some(table) = change_table(&checked) {
        say(table)?;
    }
    say(format_args!("{}: all quantities are in {}", verdict(passes), out.join("check.json").display()))?;
    let against = arguments.against.as_ref();
    let times = against.map(|against| time::compare(&scenes, against, arguments.rounds)).transpose()?;
    let version = env!("CARGO_PKG_VERSION");
    let file = CheckFile { version, verdict: verdict(passes), baselines, scenes: &checked, times };
    write_json(&out.join("check.json"), &file)?;
    arguments.junit.write(|| JunitSuite {
        name: "stickslip check",
        cases: checked.iter().zip(&seconds).map(|(scene, &seconds)| scene.case(seconds)).collect(),
    })?;
    hand_out(&file)?;
    Ok(if passes { PASS } else { FAIL })
}

/// Rejects tolerances of quantities that no scene has or that are not numbers.
fn known<'a>(
    tolerances: &BTreeMap<String, f64>,
    compared: impl Iterator<Item = &'a Comparison> + Clone,
) -> miette::Result<()> {
    let is_known = |name: &str| compared.clone().any(|each| each.quantity == name && each.is_numeric());
    match tolerances.keys().find(|name| !is_known(name)) {
        None => Ok(()),
        Some(name) => Err(miette::miette!(
            help =
                "names of quantities are those of check.json, such as `fx rms`, `trace fn` or `work: matrix_products`",
            "no numeric quantity is called `{name}`, so it cannot have a tolerance"
        )),
    }
}

fn accept_results(
    scene: &Path,
    changes: &Changes,
    reason: &str,
    tolerances: &BTreeMap<String, f64>,
    folder: Option<&Path>,
) -> miette::Result<u8> {
    let scene = load(scene, changes, &RendererArguments::default())?;
    let folder = match folder {
        Some(folder) => folder,
        None if Path::new(IN_CLONE).is_dir() => Path::new(IN_CLONE),
        None => miette::bail!(
            help = "run the command in a clone of the project, or give a folder with --baselines DIR",
            "there is no folder {IN_CLONE} here"
        ),
    };
    let mut progress = Progress::new(scene.tick_count(), "ticks");
    progress.begin(&scene.name);
    let results = Results::of(&scene, |ticks| progress.set(ticks))?;
    drop(progress);
    if let Some((quantity, tick)) = results.not_finite() {
        let place = tick.map_or(String::new(), |tick| format!(" at tick {tick}"));
        complain(format_args!("{}: {quantity} is not finite{place}; the results are not accepted", scene.name));
        return Ok(FAIL);
    }
    let present = Store::Folder(folder.to_owned()).load(&scene.name);
    let mut found = Accepted { scene: &scene.name, baseline: None, replaced: 0 };
    if let Ok(present) = &present {
        known(tolerances, compare(present, &Provenance::of(&scene), &results).iter())?;
    }
    match accept(present, &scene, results, tolerances, reason)? {
        None => say(format_args!("{}: all results equal the baseline, which is unchanged", scene.name))?,
        Some(baseline) => {
            let path = baseline.save(folder)?;
            let replaced = baseline.accepted.last().map_or(0, |acceptance| acceptance.previous.len());
            say(format_args!("{}: accepted with {replaced} changed quantities: {}", scene.name, path.display()))?;
            found = Accepted { baseline: Some(path), replaced, ..found };
        }
    }
    hand_out(&found)?;
    Ok(PASS)
}

/// Builds the table of verdicts, with a row per scene.
fn verdict_table(scenes: &[Checked]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(["scene", "verdict", "quantities"]);
    for scene in scenes {
        let share = scene.comparisons.iter().filter(|c| c.outcome == ComparisonOutcome::Within);
        let share = share.map(Comparison::share_of_tolerance).fold(0.0, f64::max);
        let within = match scene.within_tolerance {
            0 => String::new(),
            count => format!(", {count} within tolerance (largest difference: {share:.1e} of the tolerance)"),
        };
        let quantities = scene.problem.clone().unwrap_or_else(|| {
            let improved = if scene.improved > 0 { format!(", {} improved", scene.improved) } else { String::new() };
            let failed = if scene.failed > 0 { format!(", {} FAIL", scene.failed) } else { String::new() };
            format!("{} identical to the bit{within}{improved}{failed}", scene.identical)
        });
        table.add_row([scene.scene.clone(), scene.verdict.to_owned(), quantities]);
    }
    table
}

/// Builds the table of quantities that failed or improved; none if nothing did.
fn change_table(scenes: &[Checked]) -> Option<Table> {
    let mut table = Table::new();
    let head = ["scene", "quantity", "baseline", "now", "difference", "tolerance", "first tick", "outcome"];
    table.load_style(UTF8_FULL_CONDENSED).set_header(head);
    let shown = |c: &&Comparison| matches!(c.outcome, ComparisonOutcome::Fail | ComparisonOutcome::Improved);
    for scene in scenes {
        for c in scene.comparisons.iter().filter(shown) {
            table.add_row([
                scene.scene.clone(),
                c.quantity.clone(),
                value(&c.baseline),
                value(&c.now),
                if c.difference.0.is_finite() { format!("{:+.3e}", c.difference.0) } else { "–".to_owned() },
                format!("{:.1e}", c.tolerance.0),
                c.first_tick.map_or("–".to_owned(), |tick| tick.to_string()),
                if c.outcome == ComparisonOutcome::Fail { "FAIL" } else { "improved" }.to_owned(),
            ]);
        }
    }
    (!table.is_empty()).then_some(table)
}

fn value(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "missing, or not a number".to_owned(),
        serde_json::Value::String(text) if text.len() == 64 => format!("{}…", &text[..12]),
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}
