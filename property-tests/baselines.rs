//! `stickslip check`: every difference from a baseline is found and named, and only `--accept`
//! changes a baseline.

use std::fs;
use std::path::Path;
use std::process::Output;
use stickslip::scene::SHIPPED;

use assert_cmd::Command;
use serde_json::{Value, json};
use stickslip::contact::law::Law;
use stickslip::contact::rules::Scheme;
use stickslip::dynamics::integrators::GlobalIntegrator;
use stickslip::local::model::{ExteriorKind, LocalSettings};
use stickslip::local::patch::Extent;
use stickslip::scene::Scene;
use stickslip::surface::geometry::ContactSurface;
use stickslip::verify::baseline::{Provenance, Store};
use stickslip::verify::compare::{ComparisonOutcome, compare};
use stickslip::verify::results::{Number, Results};

use super::{Folder, stderr, stickslip};

const SCENE: &str = "fig5-stick-slip";
const FAULTED: &str = "deep-stick-slip-faceted";

fn shipped(scene: &str) -> Value {
    let text = fs::read_to_string(format!("fixtures/baselines/{scene}.json")).expect("a shipped baseline");
    serde_json::from_str(&text).expect("JSON")
}

fn check(scene: &str, folder: &Folder) -> (Output, String) {
    let (baselines, out) = (folder.path("baselines"), folder.path("out"));
    let output = stickslip(&[
        "check",
        scene,
        "--baselines",
        &baselines.display().to_string(),
        "--out",
        &out.display().to_string(),
    ]);
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    (output, table)
}

fn accept(folder: &Folder, reason: &[&str]) -> Output {
    let baselines = folder.path("baselines").display().to_string();
    stickslip(&[&["check", "--accept", SCENE, "--baselines", &baselines], reason].concat())
}

fn write(folder: &Folder, scene: &str, baseline: &Value) {
    fs::create_dir_all(folder.path("baselines")).expect("a temporary folder");
    folder.write(&format!("baselines/{scene}.json"), &baseline.to_string());
}

/// Returns the value of a quantity at a kept tick.
fn value<'a>(baseline: &'a mut Value, quantity: &str, tick: u64) -> &'a mut Value {
    let results = &mut baseline["results"];
    let names = results["quantities"].as_array().expect("names");
    let place = names.iter().position(|name| name == quantity).expect("a quantity");
    let trace = results["trace"].as_array_mut().expect("a trace");
    let row = trace.iter_mut().find(|row| row["tick"] == tick).expect("a kept tick");
    &mut row["values"][place]
}

fn shift(value: &mut Value, by: f64) {
    *value = json!(value.as_f64().expect("a number") + by);
}

#[test]
fn the_shipped_baselines_hold_in_a_clone_and_out_of_one() {
    let folder = Folder::new("check");
    for place in [Path::new("."), &folder.0] {
        let mut command = Command::cargo_bin("stickslip").expect("the program");
        let out = folder.path("out");
        let output = command.current_dir(place).arg("check").arg("--out").arg(&out).output().expect("it runs");
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(output.status.code(), Some(0), "{table}{}", stderr(&output));
        assert_eq!(stderr(&output), "", "no progress where there is no terminal");
        let file: Value =
            serde_json::from_str(&fs::read_to_string(out.join("check.json")).expect("a file")).expect("JSON");
        assert_eq!((&file["verdict"], file["scenes"].as_array().map(Vec::len)), (&json!("PASS"), Some(SHIPPED.len())));
        assert_eq!(file["baselines"] == "in the program", place == folder.0);
    }
}

/// Cases: (name, scene, change of its baseline, words of one line of the table).
type Change = (&'static str, &'static str, fn(&mut Value), &'static [&'static str]);

const FAILING: &[Change] = &[
    ("a number", SCENE, |b| shift(value(b, "fx", 400), 1e-6), &["trace fx", " 400 ", "FAIL"]),
    ("not a number", SCENE, |b| *value(b, "fn", 600) = Value::Null, &["trace fn", "not a number", " 600 ", "FAIL"]),
    ("a statistic", SCENE, |b| shift(&mut b["results"]["statistics"]["ft"]["rms"], 1e-6), &["ft rms", "FAIL"]),
    (
        "no statistic",
        SCENE,
        |b| b["results"]["statistics"]["ft"]["rms"] = Value::Null,
        &["ft rms", "not a number", "FAIL"],
    ),
    (
        "no summary",
        SCENE,
        |b| drop(b["results"]["summary"].as_object_mut().expect("numbers").remove("stored_j")),
        &["stored_j", "missing", "FAIL"],
    ),
    (
        "fewer rows",
        SCENE,
        |b| drop(b["results"]["trace"].as_array_mut().expect("rows").remove(30)),
        &["trace ticks", " 600 ", "FAIL"],
    ),
    (
        "no rows",
        SCENE,
        |b| b["results"]["trace"].as_array_mut().expect("rows").clear(),
        &["trace mode", "missing", "FAIL"],
    ),
    ("a count", SCENE, |b| b["results"]["counts"]["slip_ticks"] = json!(1), &["slip_ticks", "856", "FAIL"]),
    ("less work", SCENE, |b| b["results"]["work"]["triangles_tested"] = json!(21), &["triangles_tested", "22", "FAIL"]),
    ("another scene", SCENE, |b| b["provenance"]["scene_sha256"] = json!("0"), &["scene_sha256", "FAIL"]),
    ("another fault", FAULTED, |b| b["results"]["fault_tick"] = json!(885), &["tick 885", "tick 884", "FAIL"]),
    ("no fault", FAULTED, |b| b["results"]["fault"] = Value::Null, &["fault", "FAIL"]),
];

#[test]
fn what_differs_fails_and_is_named() {
    let folder = Folder::new("check-failing");
    for (what, scene, change, words) in FAILING {
        let mut baseline = shipped(scene);
        change(&mut baseline);
        write(&folder, scene, &baseline);
        let (output, table) = check(scene, &folder);
        assert_eq!(output.status.code(), Some(1), "{what}: {table}");
        let named = |line: &str| line.contains(scene) && words.iter().all(|word| line.contains(word));
        assert!(table.lines().any(named), "{what}: no line with {words:?} in\n{table}");
    }
}

#[test]
fn without_a_baseline_it_fails_and_makes_none() {
    let folder = Folder::new("check-missing");
    let (output, table) = check(SCENE, &folder);
    assert_eq!(output.status.code(), Some(1));
    assert!(table.contains("there is no baseline") && table.contains(&format!("{SCENE}.json")), "{table}");
    assert!(!folder.path("baselines").exists());
    write(&folder, SCENE, &json!({}));
    let (output, table) = check(SCENE, &folder);
    assert_eq!(output.status.code(), Some(1));
    assert!(table.contains("is not a baseline"), "{table}");
}

#[test]
fn round_off_passes_and_less_work_is_reported() {
    let folder = Folder::new("check-passing");
    let mut baseline = shipped(SCENE);
    shift(value(&mut baseline, "fx", 400), 1e-13);
    baseline["results"]["work"]["matrix_products"] = json!(1202);
    write(&folder, SCENE, &baseline);
    let (output, table) = check(SCENE, &folder);
    assert_eq!(output.status.code(), Some(0), "{table}");
    assert!(table.contains("1 within tolerance") && table.contains("1 improved"), "{table}");
    let improved = |line: &str| ["matrix_products", "1202", "1201", "improved"].iter().all(|word| line.contains(word));
    assert!(table.lines().any(improved), "{table}");
}

/// Change of the solver, and the first tick at which it can show.
type Changed = (&'static str, fn(&mut Scene), u64);

fn change_local(scene: &mut Scene, change: fn(&mut LocalSettings)) {
    let mut local = scene.local();
    change(&mut local);
    *scene = scene.clone().with_local_model(local);
}

/// Solvers other than the accepted one, on the same scene. A cycle has 100 ticks, and
/// every 20th tick is kept.
const OTHER_SOLVERS: &[Changed] = &[
    ("another global integrator", |scene| scene.global.integrator = GlobalIntegrator::Rk4, 100),
    ("other global steps", |scene| scene.global.substeps = 50, 100),
    ("another local model", |scene| change_local(scene, |local| local.extent = Extent::Rings(2)), 80),
    (
        "an exterior that is not stopped",
        |scene| change_local(scene, |local| local.exterior = ExteriorKind::Drifting),
        100,
    ),
    ("another contact scheme", |scene| scene.contact.scheme = Scheme::Velocity, 80),
    ("another normal", |scene| scene.surface = ContactSurface::Shaded, 80),
    ("another friction", |scene| scene.contact.law = Law::StickSlip { friction: (1.0 + 1e-8).into() }, 200),
];

#[test]
fn another_solver_fails_from_where_it_shows() {
    let scene = Scene::shipped(SCENE).expect("a shipped scene");
    let baseline = Store::Program.load(SCENE).expect("a baseline in the program");
    let failed = |change: &dyn Fn(&mut Scene)| {
        let mut changed = scene.clone();
        change(&mut changed);
        let results = Results::of(&changed, |_| {}).expect("it starts outside");
        let comparisons = compare(&baseline, &Provenance::of(&scene), &results);
        comparisons.into_iter().filter(|c| c.outcome == ComparisonOutcome::Fail).collect::<Vec<_>>()
    };
    assert!(failed(&|_| {}).is_empty());
    for (what, change, earliest) in OTHER_SOLVERS {
        let failed = failed(change);
        let force = failed.iter().find(|c| c.quantity == "trace fx").unwrap_or_else(|| panic!("{what} passes"));
        let tick = force.first_tick.unwrap_or_else(|| panic!("{what}: no tick"));
        assert!(tick >= *earliest && tick <= earliest + 400, "{what}: tick {tick}");
    }
}

#[test]
fn a_run_that_is_not_finite_fails_against_anything() {
    let scene = Scene::shipped(SCENE).expect("a shipped scene");
    let mut baseline = Store::Program.load(SCENE).expect("a baseline in the program");
    let mut results = Results::of(&scene, |_| {}).expect("it starts outside");
    assert_eq!(results.not_finite(), None);
    for wrong in [f64::NAN, f64::INFINITY] {
        results.trace[20].values[3] = Number(wrong);
        baseline.results.trace[20].values[3] = Number(wrong);
        assert_eq!(results.not_finite(), Some(("fn".to_owned(), Some(400))));
        let failed: Vec<_> = compare(&baseline, &Provenance::of(&scene), &results)
            .into_iter()
            .filter(|comparison| comparison.outcome == ComparisonOutcome::Fail)
            .map(|comparison| (comparison.quantity, comparison.first_tick))
            .collect();
        assert_eq!(failed, [("trace fn".to_owned(), Some(400))]);
    }
}

#[test]
fn only_accept_with_a_reason_changes_a_baseline_and_keeps_what_was() {
    let folder = Folder::new("check-accept");
    let mut before = shipped(SCENE);
    shift(value(&mut before, "fx", 400), 1e-3);
    let old = value(&mut before, "fx", 400).clone();
    write(&folder, SCENE, &before);
    let read = || fs::read_to_string(folder.path(&format!("baselines/{SCENE}.json"))).expect("a baseline");

    for reason in [&[][..], &["--reason", ""], &["--reason", "  "]] {
        let output = accept(&folder, reason);
        assert_eq!(output.status.code(), Some(2), "{reason:?}");
        assert!(stderr(&output).contains("--reason"), "{}", stderr(&output));
        assert_eq!(read(), before.to_string());
    }
    assert_eq!(stickslip(&["check", "--reason", "because"]).status.code(), Some(2));

    let output = accept(&folder, &["--reason", "the force was wrong"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let after: Value = serde_json::from_str(&read()).expect("JSON");
    assert_eq!(after["results"], shipped(SCENE)["results"], "every bit survives the file");
    let history = after["accepted"].as_array().expect("a history");
    let past = shipped(SCENE)["accepted"].as_array().expect("a history").len();
    assert_eq!(history.len(), past + 1);
    assert_eq!(history[past]["reason"], "the force was wrong");
    assert_eq!(history[past]["previous"], json!({ "trace fx": old }));
    assert_eq!(check(SCENE, &folder).0.status.code(), Some(0));

    let text = read();
    assert_eq!(accept(&folder, &["--reason", "once more"]).status.code(), Some(0));
    assert_eq!(read(), text, "nothing to accept, nothing written");
    folder.write(&format!("baselines/{SCENE}.json"), "{}");
    assert_eq!(accept(&folder, &["--reason", "lost"]).status.code(), Some(2));
    assert_eq!(read(), "{}");
}

/// Layout and comments do not change the hash; every value does.
#[test]
fn the_hash_of_a_scene_is_that_of_what_it_says() {
    let hash = |text: &str| {
        let scene = Scene::parse(text, Path::new(SCENE)).expect("a scene");
        Provenance::of(&scene).scene_sha256
    };
    let text = super::GOOD;
    assert_eq!(hash(&format!("# another comment\n{text}\n")), hash(text));
    assert_eq!(hash(&text.replace("friction = 1.0", "friction =   1")), hash(text));
    assert_ne!(hash(&text.replace("friction = 1.0", "friction = 1.1")), hash(text));

    // The contents of a file that the scene names are part of the hash.
    let folder = Folder::new("check-hash");
    let scene = text.replace("kind = \"path\"", "kind = \"recording\"\nfile = \"path.csv\"");
    let scene: String =
        scene.lines().filter(|line| !line.starts_with("waypoints")).map(|line| format!("{line}\n")).collect();
    let scene = folder.write("scene.toml", &scene);
    let with = |x: &str| {
        folder.write("path.csv", &format!("t,x,y,z\n0.0,-0.03,0.0013,0.002\n1.2,{x},0.0013,0.002\n"));
        Provenance::of(&Scene::load(&scene).expect("a scene")).scene_sha256
    };
    assert_ne!(with("0.02"), with("0.03"));
}

#[test]
fn a_quantity_can_have_a_tolerance_of_its_own() {
    let folder = Folder::new("check-tolerance");
    let mut baseline = shipped(SCENE);
    shift(value(&mut baseline, "fx", 400), 1e-6);
    baseline["results"]["counts"]["slip_ticks"] = json!(855);
    write(&folder, SCENE, &baseline);
    let asked = |given: &[&str]| {
        let (baselines, out) = (folder.path("baselines"), folder.path("out"));
        let paths = ["--baselines", baselines.to_str().expect("text"), "--out", out.to_str().expect("text")];
        stickslip(&[&["check", SCENE], &paths[..], given].concat())
    };
    assert_eq!(asked(&[]).status.code(), Some(1));
    assert_eq!(asked(&["--tolerance", "trace fx=1e-5"]).status.code(), Some(1), "the count differs too");
    let both = ["--tolerance", "trace fx=1e-5", "--tolerance", "slip_ticks=0.01"];
    assert_eq!(asked(&both).status.code(), Some(0));
    assert_eq!(asked(&["--tolerance", "trace fx=1e-9", "--tolerance", "slip_ticks=0.01"]).status.code(), Some(1));
    for (wrong, words) in [
        ("no such=1e-3", "no such"),
        ("trace mode=1", "trace mode"),
        ("fx rms", "QUANTITY=SHARE"),
        ("fx rms=nan", "finite"),
    ] {
        let output = asked(&["--tolerance", wrong]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
    // A tolerance in the baseline holds without being asked for.
    baseline["tolerances"] = json!({ "trace fx": 1e-5, "slip_ticks": 0.01 });
    write(&folder, SCENE, &baseline);
    assert_eq!(asked(&[]).status.code(), Some(0));
    let output = accept(&folder, &["--reason", "wider", "--tolerance", "ft rms=1e-6"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = fs::read_to_string(folder.path(&format!("baselines/{SCENE}.json"))).expect("a baseline");
    let accepted: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(accepted["tolerances"], json!({ "trace fx": 1e-5, "slip_ticks": 0.01, "ft rms": 1e-6 }));
}

#[test]
fn timing_has_a_control_and_no_say_in_the_verdict() {
    let folder = Folder::new("check-time");
    let this = assert_cmd::cargo::cargo_bin!("stickslip").display().to_string();
    let out = folder.path("out").display().to_string();
    let timed = |against: &str, rounds: &str| {
        stickslip(&["check", "fig3-sliding", "--out", &out, "--time", "--against", against, "--rounds", rounds])
    };
    // Programs that do not exist, that do not run scenes, and that end like a run with a fault.
    for other in ["no-such-program", "/bin/false", "/bin/echo"] {
        let output = timed(other, "6");
        assert_eq!(output.status.code(), Some(2), "{other}");
        assert!(stderr(&output).contains(&format!("cannot run {other}")), "{}", stderr(&output));
    }
    let output = timed(&this, "6");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{text}{}", stderr(&output));
    for word in ["median ratio", "96.9 % interval", "control", "the smallest detectable effect is"] {
        assert!(text.contains(word), "{word} is not in\n{text}");
    }
    let json =
        stickslip(&["check", "fig3-sliding", "--out", &out, "--time", "--against", &this, "--rounds", "6", "--json"]);
    let found: Value = serde_json::from_slice(&json.stdout).expect("JSON and nothing else");
    let times = &found["times"]["scenes"][0];
    assert!(times["ratio"]["median"].as_f64() > Some(0.0) && times["control"]["upper"].is_number(), "{found}");
    assert_eq!(timed(&this, "5").status.code(), Some(2));
    assert_eq!(stickslip(&["check", "--time"]).status.code(), Some(2));
}
