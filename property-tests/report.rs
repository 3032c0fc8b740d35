//! The report as a file: one page, failures on top, and a view that shows the run.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use stickslip::output::frames::{FrameRecorder, NoFrames};
use stickslip::pipeline;
use stickslip::scene::{SHIPPED, Scene};

use super::{Folder, GOOD, stderr, stickslip};

/// Page and numbers of a report.
fn left(out: &Path) -> (String, Value) {
    let json = fs::read_to_string(out.join("report.json")).expect("numbers");
    (fs::read_to_string(out.join("index.html")).expect("a page"), serde_json::from_str(&json).expect("JSON"))
}

/// Page without the contents of its scripts, and those contents.
fn apart(page: &str) -> (String, Vec<&str>) {
    let mut pieces = page.split("<script");
    let mut rest = pieces.next().unwrap_or_default().to_owned();
    let mut scripts = Vec::new();
    for piece in pieces {
        let (script, after) = piece.split_once("</script>").expect("a script that ends");
        let (_, script) = script.split_once('>').expect("a tag that ends");
        scripts.push(script);
        rest += after;
    }
    (rest, scripts)
}

/// Returns the runs in the 3-D view.
fn viewed(page: &str) -> Vec<Value> {
    let (_, scripts) = apart(page);
    let runs: Value = serde_json::from_str(scripts[0]).expect("JSON of the view");
    runs.as_array().expect("runs").clone()
}

#[test]
fn the_report_is_one_page_that_needs_nothing_else() {
    let folder = Folder::new("report");
    let out = folder.path("out");
    let output = stickslip(&["report", "--quick", "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let (page, json) = left(&out);
    assert!(page.len() < 6_000_000, "{} bytes", page.len());
    // There is one figure for each scene, and that of the elasticity.
    assert_eq!(page.matches("<svg").count(), SHIPPED.len() + 1);
    assert_eq!(json["runs"].as_array().expect("runs").len(), SHIPPED.len());
    assert_eq!(viewed(&page).len(), SHIPPED.len());

    let (text, scripts) = apart(&page);
    assert_eq!(scripts.len(), 3);
    for outside in ["src=", "@import", "url(", "<link", "<iframe"] {
        assert!(!text.contains(outside), "{outside}");
    }
    assert_eq!(text.matches("href=").count(), text.matches("href=\"#").count());
    assert!(text.split("href=\"#").skip(1).all(|link| {
        let target = link.split('"').next().expect("an end");
        text.contains(&format!("id=\"{target}\""))
    }));
    assert_eq!(
        text.matches("http").count(),
        text.matches("http-equiv").count() + text.matches("http://www.w3.org").count()
    );
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(table.contains("PASS: fault, as expected") && !table.contains("FAIL"), "{table}");

    // A quick report has meshes of two sizes: 2 lattices, 5 kinds of tetrahedra by 2 formulas, 6 quantities each.
    assert!(text.contains("id=\"elasticity\"") && text.contains("omits the finest meshes"));
    let rows = json["elasticity"].as_array().expect("rows");
    assert_eq!(rows.len(), 2 * (2 + 2 * 5) * 6);
    for row in rows {
        let error = row["relative_error"].as_f64().expect("a number");
        let is_homogeneous = row["quantity"] != "indentation";
        let is_exact = row["filling"].as_str().expect("a name").starts_with("lattice") && is_homogeneous;
        assert!(error.abs() <= if is_exact { 1e-9 } else { 1.0 }, "{row}");
        assert!(row["cells"] == 4 || row["cells"] == 6, "{row}");
    }
    assert_eq!(
        json["provenance"]["omitted"].as_array().expect("a list").last(),
        Some(&"elasticity of finer meshes".into())
    );
}

#[test]
fn what_failed_is_on_top() {
    let folder = Folder::new("report-fails");
    let out = folder.path("out");
    let fault = include_str!("../fixtures/scenes/deep-stick-slip-faceted.toml");
    // For a user's scene no fault is expected.
    let fault = folder.write("fault.toml", &fault.replacen("deep-stick-slip-faceted", "my-fault", 1));
    // It runs in its own folder: an earlier `reference/verify` may have left its cross-check in the current one.
    let output = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("stickslip"))
        .current_dir(folder.path(""))
        .args(["report", "fig5-stick-slip", &fault.display().to_string(), "--out", &out.display().to_string()])
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let (page, json) = left(&out);
    assert_eq!(json["verdicts"][0]["outcome"], "FAIL");
    assert_eq!(json["verdicts"][0]["what"], "my-fault");
    assert!(json["elasticity"].is_null() && page.contains("certificate, elasticity."), "no material is looked at");
    let places = ["<b>FAIL</b>", "<b>INCONCLUSIVE</b>", "<b>PASS</b>", "<h2"].map(|what| page.find(what));
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?}");
    let row = page.split("<tbody>").nth(1).and_then(|rows| rows.split("</td>").next()).expect("a row");
    assert!(row.contains("unexpected") && row.contains("my-fault"), "{row}");
    assert_eq!(viewed(&page)[1]["outcome"], "FAIL: fault");
    assert_eq!(json["runs"][1]["verdict"]["verdict"], "FAIL");
    assert!(json["runs"][1]["as_expected"].is_null() && json["runs"][0]["as_expected"] == true, "{}", json["runs"]);
    // The paper's local model, compared with the whole network.
    let error = json["runs"][0]["reference"]["compared"]["force_error_rms_rel"].as_f64().expect("a comparison");
    assert!((0.05..0.3).contains(&error), "{error}");
}

/// The tip sticks to a point of the surface: the view has to show both in one place.
#[test]
fn the_view_shows_the_surface_where_the_tip_holds_it() {
    let folder = Folder::new("report-view");
    let out = folder.path("out");
    let output = stickslip(&["report", "fig4-sticking", "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let (page, _) = left(&out);
    let run = &viewed(&page)[0];
    let positions = Positions::of(run);
    let trace = fs::read_to_string(out.join("fig4-sticking/trace.csv")).expect("a trace");
    let rows: Vec<Vec<&str>> = trace.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|head| *head == name).expect("a column");
    let number = |row: &[&str], name: &str| row[column(name)].parse::<f64>().expect("a number");
    // The tolerance is rounding by half a step along each axis.
    let tolerance = run["step_m"].as_f64().expect("a step");
    let (mut largest, mut sticking, mut furthest): (f64, usize, f64) = (0.0, 0, 0.0);
    for (frame, time) in run["time_s"].as_array().expect("times").iter().enumerate() {
        let tick = (time.as_f64().expect("a time") / 1e-3).round() as usize;
        let row = &rows[tick];
        let tip = ["qx", "qy", "qz"].map(|name| number(row, name));
        assert_eq!(run["tip_m"][frame], serde_json::json!(tip));
        assert_eq!(run["mode"][frame], row[column("mode")]);
        if row[column("mode")] != "stick" {
            continue;
        }
        let triangle = row[column("triangle")].parse::<usize>().expect("a triangle");
        let weights = ["alpha", "beta", "gamma"].map(|name| number(row, name));
        let mut off = 0.0;
        for (axis, tip) in tip.iter().enumerate() {
            let corner =
                |k: usize| positions.at(frame, run["triangles"][triangle][k].as_u64().expect("a vertex"), axis);
            let point: f64 = (0..3).map(|k| weights[k] * corner(k)).sum();
            off += (point - tip).powi(2);
        }
        let off = off.sqrt();
        // Written so that NaN is counted.
        largest = if off <= largest { largest } else { off };
        sticking += 1;
        furthest = furthest.max(tip[2].abs());
    }
    println!("RESIDUAL | 3-D view | held point to tip, m, {sticking} frames | {tolerance:.1e} | {largest:.1e}");
    assert!(sticking >= 20 && furthest > 1e-3);
    assert!(largest <= tolerance);
}

/// Decodes as the page's script does.
struct Positions {
    origin: Vec<f64>,
    step: f64,
    first: Vec<u16>,
    moving: Vec<u64>,
    steps: Vec<u16>,
}

impl Positions {
    fn of(run: &Value) -> Self {
        let decoded = |key: &str| {
            use base64::Engine;
            let bytes = base64::prelude::BASE64_STANDARD.decode(run[key].as_str().expect("text")).expect("base 64");
            bytes.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect::<Vec<_>>()
        };
        let list = |key: &str| run[key].as_array().expect("a list").iter();
        Self {
            origin: list("origin_m").map(|x| x.as_f64().expect("a number")).collect(),
            step: run["step_m"].as_f64().expect("a number"),
            first: decoded("first"),
            moving: list("moving").map(|v| v.as_u64().expect("a vertex")).collect(),
            steps: decoded("positions"),
        }
    }

    fn at(&self, frame: usize, vertex: u64, axis: usize) -> f64 {
        let steps = match self.moving.binary_search(&vertex) {
            Ok(k) => self.steps[3 * (self.moving.len() * frame + k) + axis],
            Err(_) => self.first[3 * vertex as usize + axis],
        };
        self.origin[axis] + self.step * f64::from(steps)
    }
}

#[test]
fn a_larger_run_has_fewer_frames_or_none() {
    let scene = Scene::shipped("fig5-stick-slip").expect("shipped");
    let frames = |most_bytes: usize| {
        let mut recorder = FrameRecorder::new(&scene, most_bytes);
        pipeline::run(&scene, |view| recorder.record(view)).expect("it completes");
        recorder.finish()
    };
    let all = frames(usize::MAX).expect("frames");
    // The limit is 60 frames in a second, at whole ticks.
    assert_eq!(all.time_s.len(), 71);
    let bytes = 2 * (all.first.len() + all.positions.len());
    let half = frames(bytes / 2).expect("frames");
    assert!((30..=36).contains(&half.time_s.len()) && 2 * (half.first.len() + half.positions.len()) <= bytes / 2);
    let vertices = all.first.len() / 3;
    assert_eq!(frames(1000).unwrap_err(), NoFrames::TooLarge { vertices });
    assert_eq!(FrameRecorder::new(&scene, bytes).finish().unwrap_err(), NoFrames::NoTick);
}

#[test]
fn the_last_cross_check_is_shown_where_there_is_one() {
    let folder = Folder::new("report-crosscheck");
    folder.write("tiny.toml", &GOOD.replace("duration = 1.2", "duration = 0.1"));
    let with = |text: Option<&str>| {
        fs::create_dir_all(folder.path("reports")).expect("a folder");
        let file = folder.path("reports/crosscheck.json");
        let _ = fs::remove_file(&file);
        if let Some(text) = text {
            fs::write(&file, text).expect("a file");
        }
        let mut program = Command::new(assert_cmd::cargo::cargo_bin!("stickslip"));
        let output = program.args(["report", "tiny.toml"]).current_dir(folder.path("")).output().expect("it runs");
        // An earlier run does not decide this one's verdict.
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        left(&folder.path("reports"))
    };
    let (page, json) = with(None);
    assert!(page.contains("there is no reports/crosscheck.json") && json["crosscheck"].is_null());
    let (page, json) = with(Some("{}"));
    assert!(page.contains("cannot be read") && json["crosscheck"].is_null());
    let check = r#"{"version": "0.0.9", "commit": "abc", "date": "2020-02-03", "passed": true, "failed": [], "skipped": [],
        "rows": [{"reference": "a book", "quantity": "a force", "tolerance": "1e-9", "measured": "1e-12"}]}"#;
    let (page, json) = with(Some(check));
    assert!(["2020-02-03", "0.0.9", "abc", "a book", "1e-12"].iter().all(|word| page.contains(word)));
    assert_eq!(json["crosscheck"]["rows"][0]["quantity"], "a force");
    // The list of failures decides, whatever verdict the file states; a comparison of nothing is no pass.
    let (_, json) = with(Some(&check.replace("\"failed\": []", "\"failed\": [\"traces\"]")));
    let verdict = |json: &Value| {
        let verdicts = json["verdicts"].as_array().expect("verdicts").clone();
        verdicts.into_iter().find(|verdict| verdict["what"] == "cross-check").expect("one")["outcome"].clone()
    };
    assert_eq!(verdict(&json), "FAIL");
    let empty = check.split("\"rows\"").next().expect("a start").to_owned() + "\"rows\": []}";
    assert_eq!(verdict(&with(Some(&empty)).1), "INCONCLUSIVE");
    let (page, _) = with(Some(&check.replace("true, \"failed\": []", "false, \"failed\": [\"traces\"]")));
    let places = ["<b>FAIL</b>", "traces", "<b>PASS</b>"].map(|what| page.find(what));
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?}");
}

#[test]
fn a_scene_named_like_a_file_of_the_report_is_refused_before_it_runs() {
    let folder = Folder::new("report-name");
    let scene = folder.write("s.toml", &GOOD.replacen("name = \"fig5-stick-slip\"", "name = \"report.json\"", 1));
    let out = folder.path("out");
    let output = stickslip(&["report", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("a file of the report") && !out.exists(), "{}", stderr(&output));
}

/// A report is about contact: a scene whose tip never comes down is no pass.
#[test]
fn a_report_without_contact_is_inconclusive() {
    let folder = Folder::new("report-free");
    let scene = folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 0.01"));
    let out = folder.path("out");
    let output = stickslip(&["report", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let (_, json) = left(&out);
    assert_eq!(json["runs"][0]["verdict"]["because"], "no contact");
}
