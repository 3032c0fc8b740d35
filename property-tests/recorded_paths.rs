//! Recorded motions: their columns, units and clock, and what is suspicious about them.

use std::fmt::Write;
use std::fs;

use serde_json::Value;

use super::{Folder, GOOD, run, stderr, stickslip};

#[test]
fn bad_recordings_are_named_with_their_line() {
    let folder = Folder::new("recordings");
    let text = GOOD
        .replace("kind = \"path\" ", "kind = \"recording\"\nfile = \"tip.csv\" ")
        .replace("waypoints", "# waypoints");
    let scene = folder.write("scene.toml", &text);
    for (csv, word) in [
        ("t,x,y\n0,0,0\n", "header"),
        ("t,x,y,z\n0,0,0,zero\n", "line 2"),
        ("t,x,y,z\n0,0,0,0.01\n0.2,0,0,0.01\n0.1,0,0,0.01\n", "line 4: its time, 0.1 s, is not later than that"),
        ("t,x,y,z\n0,0,0,0.01\n0,0,0,0.01\n", "line 3"),
        ("t,x,y,z\n", "no waypoint"),
        ("t,x,y,z\n0,0,0,NaN\n", "line 2: `NaN` is not a finite number"),
        ("t,x,y,z\n0,0,0,0.01\n1e999,0,0,0\n", "line 3: `1e999` is not a finite number"),
    ] {
        folder.write("tip.csv", csv);
        let output = run(&scene, &folder.path("out"));
        let message = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(output.status.code(), Some(2), "{csv:?}: {message}");
        assert!(message.contains(word), "{csv:?}: {message}");
    }
    folder.write("tip.csv", "t,x,y,z\n0,0,0,0.01\n0.5,0,0,-0.002\n");
    assert_eq!(run(&scene, &folder.path("out")).status.code(), Some(0));
    // Other columns, unit and clock record the same motion, and so give the same bytes.
    let trace = |out: &str| std::fs::read(folder.path(out).join("trace.csv")).expect("a trace");
    folder.write("log.csv", "n,px,py,pz,stamp\n0,0,0,10,7000\n1,0,0,-2,7500\n");
    let others = "file = \"log.csv\"\ncolumns = [\"stamp\", \"px\", \"py\", \"pz\"]\nscale = 0.001\ntime_scale = 0.001\nstart = 7.0";
    let other = folder.write("other.toml", &text.replace("file = \"tip.csv\"", others));
    assert_eq!(run(&other, &folder.path("other")).status.code(), Some(0));
    assert!(trace("out") == trace("other"), "the same motion");
    for (wrong, word) in [
        (others.replace("stamp", "time"), "no column `time`"),
        (others.replace("\nscale = 0.001", "\nscale = -1.0"), "instrument.scale"),
        (others.replace("time_scale = 0.001", "time_scale = 0"), "instrument.time_scale"),
        (others.replace("7.0", "nan"), "instrument.start"),
        (format!("{others}\nfilter_hz = 0.0"), "instrument.filter_hz"),
    ] {
        let other = folder.write("other.toml", &text.replace("file = \"tip.csv\"", &wrong));
        let output = run(&other, &folder.path("wrong"));
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        assert!(stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ").contains(word), "{wrong}");
    }
}

/// A recording in mm, and one on another clock: the run completes, and its summary has what is suspicious by name.
#[test]
fn recordings_in_other_units_are_warned_of() {
    let folder = Folder::new("recording-units");
    let text = GOOD
        .replace("kind = \"path\" ", "kind = \"recording\"\nfile = \"tip.csv\" ")
        .replace("duration = 1.2", "duration = 0.4")
        .replace("waypoints", "# waypoints");
    let scene = folder.write("scene.toml", &text);
    let codes = || -> Vec<String> {
        let output = run(&scene, &folder.path("out"));
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let summary = fs::read(folder.path("out/summary.json")).expect("a summary");
        let summary: serde_json::Value = serde_json::from_slice(&summary).expect("JSON");
        let warnings = summary["warnings"].as_array().expect("a list");
        assert!(warnings.iter().all(|w| stderr(&output).contains(w["message"].as_str().expect("a message"))));
        warnings.iter().map(|warning| warning["code"].as_str().expect("a code").to_owned()).collect()
    };
    folder.write("tip.csv", "t,x,y,z\n0,0,0.0013,0.002\n0.2,0,0.0013,-0.003\n0.4,0.01,0.0013,-0.003\n");
    assert_eq!(codes(), [""; 0]);
    folder.write("tip.csv", "t,x,y,z\n0,0,1.3,2.0\n0.2,0,1.3,-3.0\n0.4,10,1.3,-3.0\n");
    assert_eq!(codes(), ["patch-speed", "tip-far", "never-touches"]);
    folder.write("tip.csv", "t,x,y,z\n1.7e9,0,0.0013,0.002\n1700000000.4,0,0.0013,-0.003\n");
    assert_eq!(codes(), ["recording-outside-run", "never-touches"]);
    folder.write("tip.csv", "t,x,y,z\n0,0,0.0013,0.002\n0.1,0,0.0013,-0.003\n");
    assert_eq!(codes(), ["recording-outside-run"]);
}

/// A tracker at 100 Hz that loses its target for a third of a second, and records on after the scene's end.
#[test]
fn the_rate_and_the_gaps_of_a_recording_are_stated() {
    let folder = Folder::new("recording-facts");
    let text = GOOD
        .replace("kind = \"path\" ", "kind = \"recording\"\nfile = \"tip.csv\" ")
        .replace("duration = 1.2", "duration = 0.6")
        .replace("[9, 9, 4]", "[3, 3, 2]")
        .replace("waypoints", "# waypoints");
    let scene = folder.write("scene.toml", &text).display().to_string();
    let record = |rate: f64, lost: std::ops::Range<i32>| {
        let mut csv = "t,x,y,z\n".to_owned();
        for sample in (0..(0.8 * rate) as i32).filter(|sample| !lost.contains(sample)) {
            writeln!(csv, "{},0,0.0013,0.002", f64::from(sample) / rate).expect("a string");
        }
        folder.write("tip.csv", &csv);
        let output = stickslip(&["explain", &scene, "--json"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let codes = found["warnings"].as_array().expect("a list").iter().map(|warning| warning["code"].to_string());
        (found["recording"].clone(), codes.collect::<Vec<_>>().join(" "))
    };
    let near = |value: &Value, expected: f64| value.as_f64().is_some_and(|value| (value - expected).abs() < 1e-9);
    let (facts, codes) = record(100.0, 20..54);
    assert!(codes.contains("recording-gap"), "{codes}");
    assert!(near(&facts["rate_hz"], 100.0) && facts["is_resampled"] == true && facts["samples"] == 46, "{facts}");
    assert!(near(&facts["longest_interval_s"], 0.35) && near(&facts["longest_from_s"], 0.19), "{facts}");
    assert!(near(&facts["unused_s"], 0.19), "{facts}");
    // Nine times the usual interval is no gap yet.
    assert!(!record(100.0, 20..28).1.contains("recording-gap"));
    assert!(record(100.0, 20..30).1.contains("recording-gap"));
    assert_eq!(record(1000.0, 0..0).0["is_resampled"], false);
    let output = stickslip(&["explain", &scene]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("\nRecording\n") && text.contains("800 samples, from 0 to 0.799 s"), "{text}");
    // A path that is not recorded has no such facts.
    let output = stickslip(&["explain", "fig5-stick-slip", "--json"]);
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(found.get("recording").is_none());
}
