//! The problem set: each problem is complete and valid, and its result is recognised as the result.

use std::collections::HashSet;
use std::fs;

use serde_json::Value;
use stickslip::output::folder::sha256;
use stickslip::output::verdict::Verdict;
use stickslip::scene::Scene;
use stickslip::verify::judge::{ForceTrace, Judgement, TraceFormat, reference};
use stickslip::verify::suite::{Body, PROBLEMS, ProblemSpec, guide, write, write_inputs};

#[test]
fn the_smallest_problem_is_complete_and_solved_by_its_reference() {
    let folder = tempfile::tempdir().expect("a folder");
    // Its first tap; all others are like it.
    let tap = PROBLEMS.iter().find(|problem| problem.name == "tap").expect("a problem of that name");
    let file = write(&ProblemSpec { duration_s: 0.1, ..*tap }, folder.path(), |_| ()).expect("a folder to write into");
    assert_eq!((file.reference.fault.as_ref(), file.ticks), (None, 100));
    assert!(file.reference.contact_ticks > 30, "{:?}", file.reference);
    let at = |name: &str| folder.path().join("tap").join(name);

    let written: Value = serde_json::from_slice(&fs::read(at("problem.json")).expect("problem.json")).expect("JSON");
    let files = written["files"].as_object().expect("files");
    for (name, hash) in files {
        assert_eq!(hash.as_str(), sha256(&at(name)).ok().as_deref(), "{name}");
    }
    let listed: HashSet<String> = files.keys().cloned().chain(["problem.json".to_owned()]).collect();
    let present = fs::read_dir(folder.path().join("tap")).expect("a folder");
    let present: HashSet<String> =
        present.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    assert_eq!(listed, present);
    let rows = |name: &str| fs::read_to_string(at(name)).expect(name).lines().count() - 1;
    assert_eq!((rows("tip.csv"), rows("reference.csv")), (101, 100));
    let network: Value = serde_json::from_slice(&fs::read(at("network.json")).expect("network.json")).expect("JSON");
    assert_eq!(network["nodes"].as_array().map(Vec::len), Some(file.body.nodes));

    // Moved elsewhere, the folder is all that a comparison needs.
    let elsewhere = folder.path().join("elsewhere");
    fs::rename(folder.path().join("tap"), &elsewhere).expect("a folder that can be moved");
    let scene = Scene::load(&elsewhere.join("problem.toml")).expect("a scene");
    let own = ForceTrace::read(&elsewhere.join("reference.csv"), &TraceFormat::default()).expect("a trace");
    let judgement = Judgement::of(&own, &scene, &reference(&scene, |_| ()).expect("it starts outside"));
    let judgement = judgement.expect("the whole scene");
    assert_eq!((judgement.verdict, judgement.force_error_rms_rel), (Verdict::Pass, 0.0));
    assert!(judgement.below_floor && judgement.findings.is_empty(), "{judgement:?}");
    assert_eq!(judgement.floor_rms_rel, file.reference.floor_rms_rel);
    assert_eq!((judgement.mode_agreement, judgement.contact_point_error_max_m), (Some(1.0), Some(0.0)));
    // The floor is far below the tolerance, so that the problem can tell solutions apart.
    assert!(file.reference.floor_rms_rel < 0.02, "{}", file.reference.floor_rms_rel);
    assert!(guide(&[file]).contains("[`tap`](tap/problem.json)"));
}

#[test]
fn every_problem_can_start() {
    let names: HashSet<&str> = PROBLEMS.iter().map(|problem| problem.name).collect();
    assert!(names.len() == PROBLEMS.len() && names.len() >= 12);
    let folder = tempfile::tempdir().expect("a folder");
    for problem in &PROBLEMS {
        let (scene, body) =
            write_inputs(problem, folder.path()).unwrap_or_else(|error| panic!("{}: {error}", problem.name));
        assert!(scene.is_full() && scene.name == problem.name);
        let warnings = scene.warnings();
        assert!(warnings.is_empty(), "{}: {warnings:?}", problem.name);
        match problem.body {
            Body::Block => assert_eq!((body.nodes, body.springs), (324, 2195)),
            Body::FineBlock => assert_eq!(body.nodes, 2023),
            Body::Liver => assert!((400..600).contains(&body.nodes)),
        }
        // The tip starts outside, and a step of 1 ms is small against the body, at speeds of a hand.
        let positions: Vec<_> = (0..=scene.tick_count()).map(|tick| problem.motion.at(tick as f64 * 1e-3)).collect();
        let fastest = positions.windows(2).map(|pair| (pair[1] - pair[0]).norm() * 1e3).fold(0.0, f64::max);
        assert!(fastest > 0.01 && fastest < 0.5, "{}: {fastest} m/s", problem.name);
        // Nothing jumps: a second difference is an acceleration, here below that of a quick hand.
        let accelerated = positions.windows(3).map(|p| (p[2] - 2.0 * p[1] + p[0]).norm() * 1e6).fold(0.0, f64::max);
        assert!(accelerated < 20.0, "{}: {accelerated} m/s²", problem.name);
    }
}
