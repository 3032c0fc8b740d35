//! Traces and logs of other programs: exit codes, files, and what is printed first.

use std::fs;

use serde_json::Value;

use super::{Folder, stderr, stickslip};

/// A small scene with the whole network, whose own trace is the reference.
const SCENE: &str = "name = \"small\"\nduration = 0.2\n[mesh]\nnodes = [5, 5, 3]\nspacing = 0.0125\n\
    [material]\nnode_mass = 0.01\nstiffness = 100.0\ndamping = 0.5\n[local]\nmodel = \"full\"\n\
    [contact]\nlaw = \"stick-slip\"\nfriction = 0.5\nscheme = \"massless\"\nsurface = \"subdivision\"\n\
    [instrument]\ninterpolation = \"minimum-jerk\"\n\
    waypoints = [[0.0, -0.006, 0.0013, 0.0005], [0.1, -0.006, 0.0013, -0.002], [0.2, 0.002, 0.0013, -0.002]]\n";

#[test]
fn a_trace_is_judged_with_what_does_not_fit_first() {
    let folder = Folder::new("judge");
    let scene = folder.write("small.toml", SCENE).display().to_string();
    let out = |name: &str| folder.path(name).display().to_string();
    let ran = stickslip(&["run", &scene, "--out", &out("run"), "--quiet"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let trace = folder.path("run").join("trace.csv");
    let trace = trace.to_str().expect("a path in Unicode");

    // The trace of the whole network is the reference, to the bit.
    let judged = stickslip(&["judge", &scene, "--trace", trace, "--out", &out("own"), "--json"]);
    assert_eq!(judged.status.code(), Some(0), "{}", stderr(&judged));
    let printed: Value = serde_json::from_slice(&judged.stdout).expect("JSON alone");
    let written = fs::read(folder.path("own").join("judge.json")).expect("judge.json");
    assert_eq!(printed, serde_json::from_slice::<Value>(&written).expect("JSON"));
    assert_eq!((&printed["verdict"], &printed["force_error_rms_rel"]), (&"PASS".into(), &0.0.into()));
    assert_eq!((&printed["mode_agreement"], &printed["trace"]["rows"]), (&1.0.into(), &200.into()));

    let late = ["--scale", "-1", "--time-offset", "0.001"];
    let judged = stickslip(&[&["judge", &scene, "--trace", trace, "--out", &out("late")], &late[..]].concat());
    assert_eq!(judged.status.code(), Some(1), "{}", stderr(&judged));
    let printed = String::from_utf8_lossy(&judged.stdout).into_owned();
    let place = |text: &str| printed.find(text).unwrap_or_else(|| panic!("no `{text}` in {printed}"));
    assert!(
        place("those on the body") < place("1 tick (1.000 ms) late") && place("1 tick") < place("FAIL: force error")
    );

    let half = fs::read_to_string(trace).expect("a trace");
    let half: Vec<&str> = half.lines().take(100).collect();
    let half = folder.write("half.csv", &half.join("\n")).display().to_string();
    let judged = stickslip(&["judge", &scene, "--trace", &half, "--out", &out("half")]);
    assert_eq!(judged.status.code(), Some(3), "{}", stderr(&judged));

    let bad = folder.write("bad.csv", "t,fx,fy,fz\n0.001,0,0,0\n0.002,0,0,nan\n").display().to_string();
    let judged = stickslip(&["judge", &scene, "--trace", &bad, "--out", &out("bad")]);
    assert_eq!(judged.status.code(), Some(2));
    assert!(stderr(&judged).contains("line 3: `fz` is NaN"), "{}", stderr(&judged));
    assert!(!folder.path("bad").exists(), "a bad trace leaves no folder");
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
#[test]
fn a_log_is_certified_without_a_scene() {
    let folder = Folder::new("log");
    let rows: String = (0..1200).map(|tick: u64| format!("{0},{0},{1}\n", tick * 1000, tick * 1000 + 20)).collect();
    let log = folder.write("loop.csv", &format!("release_ns,start_ns,end_ns\n{rows}")).display().to_string();
    let out = folder.path("out").display().to_string();
    let certified = stickslip(&["certify", "--times", &log, "--rate", "1e6", "--out", &out]);
    assert_eq!(certified.status.code(), Some(0), "{}", stderr(&certified));
    let certificate = fs::read(folder.path("out").join("certificate.json")).expect("certificate.json");
    let certificate: Value = serde_json::from_slice(&certificate).expect("JSON");
    assert_eq!((&certificate["platform"]["verdict"], &certificate["platform"]["misses"]), (&"PASS".into(), &0.into()));
    assert!(certificate.get("compute").is_none());
    for name in ["certificate.md", "response.svg", "distribution.svg"] {
        assert!(folder.path("out").join(name).exists(), "{name}");
    }
    // A scene or a log, and not both.
    for arguments in [&["certify"][..], &["certify", "fig3-sliding", "--times", &log]] {
        assert_eq!(stickslip(arguments).status.code(), Some(2), "{arguments:?}");
    }
    let other = stickslip(&["certify", "--times", &log, "--rate", "1000", "--out", &out]);
    assert_eq!(other.status.code(), Some(2));
    assert!(stderr(&other).contains("1000 ns apart"), "{}", stderr(&other));
}
