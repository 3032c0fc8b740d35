//! Real time by the command line: `certify`, `run` of a scene with `schedule = "threads"`, `replay`.

use serde_json::{Value, json};
use stickslip::scene::Scene;
use stickslip::session::{Session, SessionError};

use super::{Folder, stickslip};

/// The verdict depends on the machine; the contents of a certificate do not.
#[test]
fn certify_measures_judges_and_leaves_what_can_be_done_again() {
    let folder = Folder::new("certify");
    let out = folder.path("out");
    let to = out.display().to_string();
    let junit = folder.path("junit.xml");
    let file = junit.display().to_string();
    let output = stickslip(&[
        "certify",
        "fig5-stick-slip",
        "--duration",
        "1.5",
        "--rate",
        "2000",
        "--out",
        &to,
        "--junit",
        &file,
    ]);
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
    let number = |verdict: &str| verdicts.iter().filter(|found| **found == verdict).count();
    assert_eq!(super::junit::counts(&junit).0, [3, number("FAIL"), number("INCONCLUSIVE")]);
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

    // Which model came first depends on the machine.
    let mut changed: Value = serde_json::from_slice(&std::fs::read(&session).unwrap()).unwrap();
    let from = &mut changed["passes"][0]["times"]["arrivals"][0]["from"];
    *from = json!(from.as_u64().expect("a model arrived") + 1);
    std::fs::write(&session, changed.to_string()).unwrap();
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

/// Returns a session of two passes of five ticks, with the forces of the first, changed in one place.
fn session(changed: impl Fn(&mut Value)) -> Value {
    let times = json!({ "arrivals": [], "late": [], "skipped": [] });
    let tick = json!({ "tip": [0.0, 0.0, 0.0], "force": [0.0, 0.0, 0.0] });
    let pass = |number: u32| json!({ "pass": number, "ticks": 5, "times": times, "checksum": "0000000000000000" });
    let mut session = json!({
        "format": "stickslip-session-1", "version": "0.1.0", "scene_path": "x.toml", "scene": super::GOOD, "rate_hz": 1000.0,
        "overrun": "hold", "passes": [pass(0), pass(1)],
        "worst": [{ "pass": 1, "tick": 4, "why": "most CPU time" }],
    });
    session["passes"][0]["tape"] = json!(vec![tick; 5]);
    changed(&mut session);
    session
}

#[test]
fn a_session_that_contradicts_itself_is_not_replayed() {
    let folder = Folder::new("damaged-sessions");
    let replayed = |session: Value| {
        let file = folder.write("session.json", &session.to_string()).display().to_string();
        let output = stickslip(&["replay", &file]);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).replace("\n  │", ""))
    };
    // Its forces are not those of the scene, which a replay finds.
    assert_eq!(replayed(session(|_| ())).0, Some(1));
    type Case = (fn(&mut Value), &'static str);
    let cases: [Case; 9] = [
        (|s| s["passes"] = json!([]), "nothing to replay"),
        (
            |s| {
                s["passes"].as_array_mut().unwrap().iter_mut().for_each(|pass| {
                    (pass["ticks"], pass["tape"]) = (json!(0), json!([]));
                })
            },
            "nothing to replay",
        ),
        (|s| s["rate_hz"] = json!(1e9), "at most 100000 Hz"),
        (|s| s["passes"][0]["ticks"] = json!(4), "forces of 5"),
        (|s| s["passes"][1]["ticks"] = json!(1201), "1201 ticks"),
        (|s| s["passes"][1]["ticks"] = json!(u64::MAX), "18446744073709551615 ticks"),
        (|s| s["passes"][1]["times"]["late"] = json!([3, 2]), "late ticks of pass 1"),
        (|s| s["worst"][0]["tick"] = json!(5), "tick 5 of pass 1"),
        (|s| s["worst"][0]["pass"] = json!(7), "tick 4 of pass 7"),
    ];
    for (change, words) in cases {
        let (code, text) = replayed(session(change));
        assert_eq!(code, Some(2), "{words}: {text}");
        assert!(text.contains(words) && text.contains("help"), "{words}: {text}");
    }
}

/// The recorded path is first written beside the session, as on another machine, and then replaced by another one.
#[test]
fn a_session_finds_its_files_beside_itself_and_takes_no_others() {
    let folder = Folder::new("moved-session");
    let recorded = "t,x,y,z\n0.0,-0.03,0.0013,0.002\n1.2,-0.03,0.0013,0.001\n";
    let scene = super::GOOD.replace("kind = \"path\"", "kind = \"recording\"\nfile = \"tips/path.csv\"");
    let scene: String =
        scene.lines().filter(|line| !line.starts_with("waypoints")).map(|line| format!("{line}\n")).collect();
    std::fs::create_dir_all(folder.path("tips")).unwrap();
    folder.write("tips/path.csv", recorded);
    let loaded = Scene::load(&folder.write("scene.toml", &scene)).unwrap();
    let files = serde_json::to_value(Session::new(&loaded, loaded.deadline.overrun)).unwrap()["files"].clone();
    assert_eq!(files[0]["path"], "tips/path.csv");

    let elsewhere = Folder::new("moved-session-there");
    std::fs::create_dir_all(elsewhere.path("tips")).unwrap();
    let moved = session(|session| {
        session["scene"] = json!(scene);
        session["scene_path"] = json!("/nowhere/scene.toml");
        session["files"] = files.clone();
    });
    let file = elsewhere.write("session.json", &moved.to_string());
    let scene_of = || Session::load(&file).unwrap().scene();
    assert!(matches!(scene_of(), Err(SessionError::OtherFile { .. })));
    elsewhere.write("tips/path.csv", recorded);
    assert!(scene_of().is_ok());
    elsewhere.write("tips/path.csv", &recorded.replace("0.001", "0.0011"));
    let error = scene_of().expect_err("another path");
    assert!(error.to_string().contains("tips/path.csv"), "{error}");
}

/// A global cycle of 10⁸ ticks costs a run of 40 ticks no memory.
#[test]
fn a_slow_global_side_takes_no_more_memory_than_the_run() {
    let folder = Folder::new("slow-global");
    let text = super::GOOD
        .replace("duration = 1.2 ", "duration = 0.04 ")
        .replace("rate = 10.0", "rate = 0.00001")
        .replace("[sync]", "[run]\nschedule = \"threads\"\n[sync]");
    let scene = folder.write("slow.toml", &text).display().to_string();
    let out = folder.path("out");
    let output = stickslip(&["run", &scene, "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(
        (&summary["completed"], &summary["reproduced"], &summary["ticks"]),
        (&json!(true), &json!(true), &json!(40))
    );
}

#[test]
fn what_cannot_be_certified_or_replayed_is_refused_with_a_way_out() {
    let folder = Folder::new("refused");
    let out = folder.path("out").display().to_string();
    let broken = folder.write("broken.json", "{}").display().to_string();
    let too_fast = super::GOOD
        .replace("rate = 1000.0", "rate = 200000.0")
        .replace("[sync]", "[run]\nschedule = \"threads\"\n[sync]");
    let too_fast = folder.write("too-fast.toml", &too_fast).display().to_string();
    let cases: &[(&[&str], &str)] = &[
        (&["certify", "fig5-stick-slip", "--rate", "333", "--out", &out], "333 Hz"),
        (&["certify", "fig5-stick-slip", "--rate", "nan", "--out", &out], "NaN"),
        (&["certify", "fig5-stick-slip", "--rate", "1e9", "--duration", "0.01", "--out", &out], "--rate 1000000000"),
        (&["certify", "fig5-stick-slip", "--deadline", "0", "--out", &out], "deadline of 0"),
        (&["certify", "fig5-stick-slip", "--deadline", "2000", "--out", &out], "2000 µs"),
        (&["certify", "fig5-stick-slip", "--duration", "nan", "--out", &out], "NaN s"),
        (&["certify", "fig5-stick-slip", "--duration", "1e9", "--out", &out], "duration"),
        (&["replay", "/nowhere/session.json"], "cannot read"),
        (&["replay", &broken], "not a recorded session"),
        (&["run", &too_fast, "--out", &out], "`local.rate` cannot be 200000 Hz in real time"),
    ];
    for (arguments, words) in cases {
        let output = stickslip(arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(words) && text.contains("help"), "{arguments:?}: {text}");
    }
    assert!(!folder.path("out").exists(), "nothing half-written");
}
