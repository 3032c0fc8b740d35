//! Real time by the command line: `certify`, `run` of a scene with `schedule = "threads"`, `replay`.

use serde_json::Value;

use super::{Folder, stickslip};

/// The verdict depends on the machine; the contents of a certificate do not.
#[test]
fn certify_measures_judges_and_leaves_what_can_be_done_again() {
    let folder = Folder::new("certify");
    let out = folder.path("out");
    let to = out.display().to_string();
    let output = stickslip(&["certify", "fig5-stick-slip", "--duration", "1.5", "--rate", "2000", "--out", &to]);
    let code = output.status.code();
    assert!(matches!(code, Some(0 | 1 | 3)), "{}", String::from_utf8_lossy(&output.stderr));
    let certificate: Value = serde_json::from_slice(&std::fs::read(out.join("certificate.json")).unwrap()).unwrap();
    assert_eq!(certificate["ticks"], 3000);
    assert_eq!(certificate["rate_hz"], 2000.0);
    assert_eq!(certificate["deadline_us"], 500.0);
    assert_eq!(certificate["window"]["allocations"], 0);
    assert_eq!(certificate["replayed"], true);
    // 1.5 s cover the path of 1.2 s.
    assert_eq!(certificate["coverage"]["path_share"], 1.0);
    assert!(certificate["coverage"]["window"]["mode_ticks"]["slip"].as_u64() > Some(100));
    let worst = certificate["worst"].as_array().unwrap();
    let mut places: Vec<String> = worst.iter().map(|tick| format!("{} {}", tick["pass"], tick["tick"])).collect();
    places.sort();
    places.dedup();
    assert_eq!(places.len(), worst.len(), "a tick is listed once");
    assert!(certificate["compute"]["compute_ns"]["p9999"].is_null(), "3000 ticks are too few");
    for path in [
        "/compute/verdict",
        "/compute/compute_ns/p999",
        "/settings/cpu/is_dma_latency_held",
        "/platform/verdict",
        "/platform/misses",
        "/platform/longest_miss_run",
        "/platform/response_ns/max",
        "/platform/release_ns/p50",
        "/settings/policy",
        "/window/page_faults",
        "/window/voluntary_switches",
        "/window/involuntary_switches",
        "/worst/0/cold_ns",
        "/duration_s",
        "/miss_rate/ticks/upper",
        "/machine/kernel",
        "/identity/date",
        "/identity/scene_sha256",
        "/identity/mesh_sha256",
        "/identity/program_sha256",
        "/identity/machine_sha256",
        "/coverage/window/edge_crossings",
        "/compute/idle_ns/max",
        "/global/largest_age_ticks",
    ] {
        assert!(certificate.pointer(path).is_some_and(|value| !value.is_null()), "{path}");
    }
    let verdicts = ["compute", "platform", "global"].map(|part| &certificate[part]["verdict"]);
    let expected = if verdicts.contains(&&Value::from("FAIL")) {
        1
    } else if verdicts.iter().all(|verdict| **verdict == "PASS") {
        0
    } else {
        3
    };
    assert_eq!(code, Some(expected));
    let page = std::fs::read_to_string(out.join("certificate.md")).unwrap();
    assert!(page.contains("response.svg") && out.join("response.svg").exists());
    assert!(page.contains("distribution.svg") && out.join("distribution.svg").exists());

    let output = stickslip(&["replay", &out.join("session.json").display().to_string()]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("the same to the bit") && text.contains("longest response"), "{text}");
}

#[test]
fn a_run_by_threads_leaves_a_session_that_replay_compares() {
    let folder = Folder::new("threads");
    let text = super::GOOD.replace("[sync]", "[run]\nschedule = \"threads\"\n[sync]");
    let out = folder.path("out");
    let scene = folder.write("threads.toml", &text);
    let output = stickslip(&["run", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let trace = std::fs::read_to_string(out.join("trace.csv")).unwrap();
    assert_eq!(trace.lines().count(), 1201);
    let session = out.join("session.json");
    assert_eq!(stickslip(&["replay", &session.display().to_string()]).status.code(), Some(0));

    let changed = std::fs::read_to_string(&session).unwrap().replacen("\"from\": 100", "\"from\": 101", 1);
    std::fs::write(&session, changed).unwrap();
    let output = stickslip(&["replay", &session.display().to_string()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("DIFFERS from tick"));
}

#[test]
fn a_fault_of_a_run_by_threads_is_a_fault_of_its_files() {
    let folder = Folder::new("threads-fault");
    let text = include_str!("../fixtures/scenes/deep-stick-slip-faceted.toml");
    let out = folder.path("out");
    let scene = folder.write("fault.toml", &format!("{text}\n[run]\nschedule = \"threads\"\n"));
    let output = stickslip(&["run", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("fault at tick"));
    let summary: Value = serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["completed"], false);
    let output = stickslip(&["replay", &out.join("session.json").display().to_string()]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&output.stdout).contains("the same end: fault at tick"));
}

#[test]
fn what_cannot_be_certified_or_replayed_is_refused_with_a_way_out() {
    let folder = Folder::new("refused");
    let out = folder.path("out").display().to_string();
    let broken = folder.write("broken.json", "{}").display().to_string();
    let cases: &[(&[&str], &str)] = &[
        (&["certify", "fig5-stick-slip", "--rate", "333", "--out", &out], "333 Hz"),
        (&["certify", "fig5-stick-slip", "--rate", "nan", "--out", &out], "NaN"),
        (&["certify", "fig5-stick-slip", "--deadline", "0", "--out", &out], "deadline of 0"),
        (&["certify", "fig5-stick-slip", "--deadline", "2000", "--out", &out], "2000 µs"),
        (&["certify", "fig5-stick-slip", "--duration", "nan", "--out", &out], "NaN s"),
        (&["certify", "fig5-stick-slip", "--duration", "1e9", "--out", &out], "duration"),
        (&["replay", "/nowhere/session.json"], "cannot read"),
        (&["replay", &broken], "not a recorded session"),
    ];
    for (arguments, words) in cases {
        let output = stickslip(arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(words) && text.contains("help"), "{arguments:?}: {text}");
    }
    assert!(!folder.path("out").exists(), "nothing half-written");
}
