//! `stickslip accuracy` as a command: its files and its exit codes.

use std::fs;
use std::path::Path;

use super::{Folder, stderr, stickslip};

/// Small scene, for a comparison of a hundred methods.
const TINY: &str = r#"
name = "tiny"
duration = 0.2
[mesh]
nodes = [4, 4, 3]
spacing = 0.0125
[material]
node_mass = 0.01
stiffness = 100.0
damping = 0.5
[contact]
law = "stick-slip"
friction = 0.5
[instrument]
waypoints = [[0.0, 0.0, 0.001, 0.001], [0.05, 0.0, 0.001, -0.002], [0.2, 0.006, 0.001, -0.002]]
"#;

fn accuracy(scene: &Path, out: &Path, budget_us: &str) -> (Option<i32>, serde_json::Value, String) {
    let (scene, folder) = (scene.display().to_string(), out.display().to_string());
    let output = stickslip(&["accuracy", &scene, "--out", &folder, "--budget-us", budget_us]);
    let json = fs::read_to_string(out.join("accuracy.json")).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    (output.status.code(), serde_json::from_str(&json).expect("JSON"), stdout)
}

/// Removes the values that depend on the clock and the budget, except whether a method diverged.
fn timeless(mut json: serde_json::Value) -> serde_json::Value {
    json.as_object_mut().expect("an object").retain(|key, _| key != "best" && key != "budget");
    for list in ["points", "references"] {
        for entry in json[list].as_array_mut().expect(list) {
            let timed = |key: &String| ["tick_ns", "build_ms", "cycle_ms"].iter().any(|start| key.starts_with(start));
            let entry = entry.as_object_mut().expect("an object");
            entry.retain(|key, _| !timed(key) && key != "repeats" && key != "on_front");
            if let Some(status) = entry.get_mut("status") {
                *status = (*status == "diverged").into();
            }
        }
    }
    json
}

#[test]
fn accuracy_compares_methods_and_repeats_but_for_the_clock_and_the_budget() {
    let folder = Folder::new("accuracy");
    let scene = folder.write("tiny.toml", TINY);
    let (code, json, stdout) = accuracy(&scene, &folder.path("a"), "1e6");
    assert_eq!(code, Some(0), "{stdout}");
    let points = json["points"].as_array().expect("points");
    for point in points {
        for key in [
            "rings",
            "linearization",
            "exterior",
            "tangent",
            "integrator",
            "scheme",
            "surface",
            "global_rate",
            "status",
            "force_error_rms_rel",
            "force_error_max_n",
            "mode_agreement",
            "tick_ns_p50",
            "tick_ns_p99",
            "build_ms",
            "handover_jump_rel",
            "energy_residual_rel",
        ] {
            assert!(point.get(key).is_some(), "{key} is not in {point}");
        }
        let status = point["status"].as_str().expect("a status");
        assert!(["ok", "diverged", "overrun", "unresolved"].contains(&status), "{status}");
        assert!(point["work"]["models_built"].as_u64() > Some(0) && point["force_error_rms_rel"].is_f64(), "{point}");
        assert!(point["tick_ns_p50"].as_f64() <= point["tick_ns_p99"].as_f64());
    }
    let counted = |key: &str| points.iter().filter(|point| point[key] == true).count();
    assert_eq!((counted("is_paper"), counted("is_own")), (1, 1));
    assert!(counted("on_front") > 1);
    assert_eq!(json["references"].as_array().expect("references").len(), 2);
    let best = json["best"]["point"].as_u64().expect("an index") as usize;
    assert_eq!(json["best"]["name"], points[best]["name"]);
    assert!(stdout.contains("Most accurate local model within") && stdout.contains("paper"), "{stdout}");

    let page = fs::read_to_string(folder.path("a").join("index.html")).expect("a page");
    assert_eq!(page.matches("<svg").count(), 6);
    for outside in ["src=", "href=", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    // Every method is listed.
    assert_eq!(page.matches(" Hz</td>").count(), points.len());

    // The second run has a budget that no method meets.
    let (code, again, stdout) = accuracy(&scene, &folder.path("b"), "1e-3");
    assert_eq!(code, Some(1), "{stdout}");
    assert!(again["best"].is_null() && stdout.contains("No local model is within 0.001 µs"), "{stdout}");
    let points = again["points"].as_array().expect("points");
    assert!(points.iter().all(|point| point["status"] == "overrun" || point["status"] == "diverged"));
    assert_eq!(timeless(json), timeless(again));
}

#[test]
fn accuracy_refuses_bad_scenes_and_budgets() {
    let folder = Folder::new("accuracy-bad");
    let out = folder.path("out");
    let bad = folder.write("bad.toml", "name = 1").display().to_string();
    let inside = TINY.replace("[0.0, 0.0, 0.001, 0.001]", "[0.0, 0.0, 0.001, -0.001]");
    let inside = folder.write("inside.toml", &inside).display().to_string();
    for arguments in [&[bad.as_str()][..], &[&inside], &["fig3-sliding", "--budget-us", "0"], &[]] {
        let out = out.display().to_string();
        let output = stickslip(&[&["accuracy"], arguments, &["--out", &out]].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    }
    assert!(!out.exists());
}
