//! Standard output in other formats than text, and files for other programs.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::process::Output;

use base64::{Engine, prelude::BASE64_STANDARD};
use serde_json::Value;
use stickslip::scene::SHIPPED;

use super::{Folder, stderr, stickslip};

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

#[test]
fn json_is_what_the_file_says_and_nothing_else() {
    let folder = Folder::new("printed-json");
    let out = folder.path("run");
    let output = stickslip(&["run", "fig3-sliding", "--out", &text(&out), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let printed: Value = serde_json::from_slice(&output.stdout).expect("JSON alone");
    let written: Value =
        serde_json::from_slice(&fs::read(out.join("summary.json")).expect("summary.json")).expect("JSON");
    assert_eq!(printed, written);

    let output = stickslip(&["--json", "check", "fig3-sliding", "--out", &text(&folder.path("check"))]);
    let printed: Value = serde_json::from_slice(&output.stdout).expect("JSON alone");
    assert_eq!(printed["verdict"], "PASS", "{printed}");

    let output = stickslip(&["explain", "fig3-sliding", "--json"]);
    let printed: Value = serde_json::from_slice(&output.stdout).expect("JSON alone");
    assert_eq!(printed["sizes"]["nodes"], 324);
}

#[test]
fn quiet_prints_nothing_but_errors() {
    let folder = Folder::new("printed-quiet");
    let output = stickslip(&["run", "fig3-sliding", "--out", &text(&folder.path("run")), "--quiet"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout.is_empty() && output.stderr.is_empty(), "{}{}", stdout(&output), stderr(&output));
    assert!(folder.path("run").join("trace.csv").is_file());

    let output = stickslip(&["-q", "run", "no-such-scene"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty());
    assert!(stderr(&output).contains("no-such-scene"), "{}", stderr(&output));
}

#[test]
fn colour_is_for_terminals_that_want_it() {
    for (name, value) in [("NO_COLOR", "1"), ("CLICOLOR", "0")] {
        let output = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("stickslip"))
            .env(name, value)
            .args(["run", "no-such-scene"])
            .output()
            .expect("it runs");
        assert!(!output.stderr.contains(&0x1b), "{name}={value}: {}", stderr(&output));
    }
}

#[test]
fn completions_and_manual_name_every_command() {
    const COMMANDS: [&str; 9] =
        ["report", "run", "explain", "stability", "check", "accuracy", "replay", "completions", "man"];
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = stickslip(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0), "{shell}: {}", stderr(&output));
        for command in COMMANDS {
            assert!(stdout(&output).contains(command), "{shell} does not complete {command}");
        }
    }
    let folder = Folder::new("printed-man");
    assert!(stdout(&stickslip(&["man"])).contains(".TH"), "no manual page");
    let output = stickslip(&["man", "--out", &text(&folder.path("man1"))]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for command in COMMANDS {
        let page = fs::read_to_string(folder.path("man1").join(format!("stickslip-{command}.1"))).expect(command);
        assert!(page.contains(&format!("stickslip\\-{command}")) && page.contains(".SH SYNOPSIS"), "{command}: {page}");
    }
}

/// Returns the arrays of a `.vtu` file by name, as bytes.
fn arrays(path: &Path) -> HashMap<String, Vec<u8>> {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let parts = text.split("<DataArray ").skip(1);
    parts
        .map(|part| {
            let name = part.split("Name=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a name");
            let data = part.split('>').nth(1).and_then(|rest| rest.split('<').next()).expect("data");
            let bytes = BASE64_STANDARD.decode(data).expect("base 64");
            let (length, bytes) = bytes.split_first_chunk().expect("a length");
            assert_eq!(u64::from_le_bytes(*length), bytes.len() as u64, "{name}");
            (name.to_owned(), bytes.to_vec())
        })
        .collect()
}

fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight"))).collect()
}

#[test]
fn frames_for_paraview_hold_the_run() {
    let folder = Folder::new("printed-vtk");
    let out = folder.path("run");
    let output = stickslip(&["run", "fig5-stick-slip", "--out", &text(&out), "--vtk=100"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let network: Value =
        serde_json::from_slice(&fs::read(out.join("network.json")).expect("network.json")).expect("JSON");
    let count = |key: &str| network[key].as_array().expect(key).len();
    let list = fs::read_to_string(out.join("network.pvd")).expect("network.pvd");
    assert_eq!(list.matches("<DataSet").count(), 12, "a frame in 100 of 1200 ticks");

    // Tick 900 is slipping and lies in the tenth frame.
    let row = fs::read_to_string(out.join("trace.csv")).expect("trace.csv");
    let row: Vec<&str> = row.lines().nth(901).expect("tick 900").split(',').collect();
    let number = |column: usize| row[column].parse::<f64>().expect("a number");
    let tip = arrays(&out.join("vtk/instrument-000009.vtu"));
    assert_eq!(doubles(&tip["Points"]), [number(2), number(3), number(4)]);
    assert_eq!(doubles(&tip["force"]), [number(5), number(6), number(7)]);
    assert_eq!(doubles(&tip["normal"]), [number(15), number(16), number(17)]);
    assert_eq!(row[10], "slip");
    assert_eq!(tip["mode"], [3]);

    let frame = arrays(&out.join("vtk/network-000009.vtu"));
    assert_eq!(doubles(&frame["Points"]).len(), 3 * count("nodes"));
    assert_eq!(frame["types"].len(), count("triangles") + count("springs"));
    assert_eq!(frame["patch"].iter().filter(|&&inside| inside == 1).count(), 14);
    let weights = doubles(&frame["contact_weight"]);
    let mut corners = [number(12), number(13), number(14)];
    let mut found: Vec<f64> = weights.iter().copied().filter(|weight| *weight != 0.0).collect();
    corners.sort_by(f64::total_cmp);
    found.sort_by(f64::total_cmp);
    assert_eq!(found, corners);
    // A node of the network at rest has no net force, and one in contact moves.
    let forces = doubles(&frame["force"]);
    assert!(forces.iter().all(|force| force.is_finite()) && forces.iter().any(|force| force.abs() > 1e-3));
}

/// While the contact sticks, the contact point from the frame's nodes and weights is at the tip.
#[test]
fn frames_for_paraview_have_the_nodes_where_the_tip_holds_them() {
    let folder = Folder::new("printed-vtk-stick");
    let out = folder.path("run");
    let output = stickslip(&["run", "fig4-sticking", "--out", &text(&out), "--vtk=400"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let tip = arrays(&out.join("vtk/instrument-000001.vtu"));
    assert_eq!(tip["mode"], [1], "tick 400 sticks");
    let frame = arrays(&out.join("vtk/network-000001.vtu"));
    let (x, q) = (doubles(&frame["Points"]), doubles(&tip["Points"]));
    let mut point = [0.0; 3];
    for (x, weight) in x.chunks_exact(3).zip(doubles(&frame["contact_weight"])) {
        (0..3).for_each(|axis| point[axis] += weight * x[axis]);
    }
    let off = (0..3).map(|axis| (point[axis] - q[axis]).powi(2)).sum::<f64>().sqrt();
    // The tolerance is round-off of positions of centimetres.
    println!("RESIDUAL | the held tip | contact point of a frame for ParaView, m | 1e-15 | {off:.1e}");
    assert!(off <= 1e-15, "{off:e} m");
}

/// A scene that `init` prints is one that `init` writes, is read again, and is never written over another file; `list` has
/// every shipped scene once.
#[test]
fn a_first_scene_is_printed_or_written_and_overwrites_nothing() {
    let folder = Folder::new("printed-init");
    let file = folder.path("first.toml");
    let written = stickslip(&["init", &text(&file)]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let scene = fs::read_to_string(&file).expect("a scene");
    let explained = stickslip(&["explain", &text(&file)]);
    assert_eq!(explained.status.code(), Some(0), "{}", stderr(&explained));
    let printed = stdout(&stickslip(&["init"]));
    // The scene is named after its file.
    let unnamed = |scene: &str| scene.lines().filter(|line| !line.starts_with("name")).collect::<Vec<_>>().join("\n");
    assert_eq!(unnamed(&printed), unnamed(&scene));

    fs::write(&file, "mine").expect("it can be written");
    let refused = stickslip(&["init", &text(&file)]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("first.toml"), "{}", stderr(&refused));
    assert_eq!(fs::read_to_string(&file).expect("the file"), "mine");

    let output = stickslip(&["list", "--json"]);
    let listed: Value = serde_json::from_slice(&output.stdout).expect("JSON alone");
    let names: Vec<&str> =
        listed.as_array().expect("a list").iter().filter_map(|entry| entry["name"].as_str()).collect();
    assert_eq!(names, SHIPPED.iter().map(|shipped| shipped.name).collect::<Vec<_>>());
}
