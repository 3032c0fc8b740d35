//! `--set KEY=VALUE`: changes of single keys of a scene.

use std::fs;

use serde_json::{Value, json};
use stickslip::Scene;
use stickslip::session::Session;

use super::{Folder, stderr, stickslip};

/// A message without the line breaks of the terminal.
fn flat(message: &str) -> String {
    message.replace("\n  │", "").split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn changes_are_recorded_and_give_the_run_of_the_changed_scene() {
    let folder = Folder::new("changes");
    let [changed, written] = ["changed", "written"].map(|name| folder.path(name).display().to_string());
    let sets = ["--set", "duration=0.2", "--set", "mesh.nodes=[5,5,3]", "--set", "name=other"];
    let output = stickslip(&[&["run", "fig5-stick-slip", "--out", &changed][..], &sets[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));

    let text = super::GOOD
        .replace("duration = 1.2", "duration = 0.2")
        .replace("[9, 9, 4]", "[5, 5, 3]")
        .replace("name = \"fig5-stick-slip\"", "name = \"other\"");
    let scene = folder.write("written.toml", &text);
    assert_eq!(stickslip(&["run", &scene.display().to_string(), "--out", &written]).status.code(), Some(0));
    let trace = |out: &str| fs::read(folder.path(out).join("trace.csv")).expect("a trace");
    assert!(trace("changed") == trace("written"));

    let summary = |out: &str| -> Value {
        serde_json::from_slice(&fs::read(folder.path(out).join("summary.json")).expect("a summary")).expect("JSON")
    };
    assert_eq!(summary("changed")["scene"], "other");
    assert_eq!(summary("changed")["changes"], json!(["duration=0.2", "mesh.nodes=[5,5,3]", "name=other"]));
    assert!(summary("written").get("changes").is_none());
}

#[test]
fn an_error_in_a_change_points_at_the_option_and_another_at_its_line() {
    let folder = Folder::new("bad-changes");
    let bad_line = folder.write("bad.toml", &super::GOOD.replace("node_mass = 0.01", "node_mass = -1"));
    let bad_line = bad_line.display().to_string();
    let shipped = "fig5-stick-slip";
    let cases: [(&str, &[&str], &[&str]); 9] = [
        (
            shipped,
            &["contact.frictoin=1"],
            &["did you mean `friction`?", "Option: --set contact.frictoin=1", "change:1:9"],
        ),
        (
            shipped,
            &["contact.friction=-0.5"],
            &["`contact.friction` cannot be -0.5", "Option: --set contact.friction=-0.5"],
        ),
        (
            shipped,
            &["contact.law=stick"],
            &["\"sliding\", \"sticking\" or \"stick-slip\"", "Option: --set contact.law=stick"],
        ),
        (shipped, &["mesh.nodes=[9,9]"], &["Option: --set mesh.nodes=[9,9]"]),
        (shipped, &["duration.x=1"], &["Option: --set duration.x=1"]),
        // The key without effect is the file's.
        (shipped, &["contact.law=sliding"], &["`contact.friction` has no effect", "fig5-stick-slip:32:"]),
        // A table that is put in before an error does not move its line.
        (
            &bad_line,
            &["settle=false", "timing.tick_cost=1e-6", "mesh.nodes=[5,5,3]"],
            &["material.node_mass", "bad.toml:13:"],
        ),
        (shipped, &["contact.friction"], &["KEY=VALUE"]),
        (shipped, &["mesh.nodes=[9,9"], &["no TOML value"]),
    ];
    for (scene, changes, words) in cases {
        let mut arguments = vec!["explain", scene];
        changes.iter().for_each(|change| arguments.extend(["--set", change]));
        let output = stickslip(&arguments);
        let message = flat(&stderr(&output));
        assert_eq!(output.status.code(), Some(2), "{changes:?}: {message}");
        for word in words {
            assert!(message.contains(word), "{changes:?}: {word:?} is not in\n{}", stderr(&output));
        }
    }
    // A problem that only shows when the simulation is prepared.
    let output = stickslip(&["run", shipped, "--set", "instrument.waypoints=[[0.0,0.0,0.0,-0.01]]"]);
    assert!(flat(&stderr(&output)).contains("m inside the surface"), "{}", stderr(&output));
    let output = stickslip(&["report", "--set", "contact.friction=1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--set"), "{}", stderr(&output));
}

#[test]
fn a_session_holds_the_changed_scene() {
    let changes =
        ["contact.friction=0.25".parse().expect("a change"), "run.schedule=threads".parse().expect("a change")];
    let scene = Scene::parse_with(super::GOOD, "fig5.toml".as_ref(), &changes).expect("a scene");
    let session = Session::new(&scene, scene.deadline.overrun);
    let read: Session = serde_json::from_value(serde_json::to_value(&session).expect("JSON")).expect("a session");
    assert_eq!(read.changes, ["contact.friction=0.25", "run.schedule=threads"]);
    let again = read.scene().expect("its scene");
    assert_eq!(format!("{:?}", again.contact), format!("{:?}", scene.contact));
    assert_eq!(again.text(), scene.text());
}
