//! The program's exit codes, messages and files.

mod bad_scenes;
mod baselines;
mod by_file;
mod changes;
mod compared;
#[cfg(all(feature = "external", feature = "realtime", target_os = "linux"))]
mod external;
mod junit;
mod printed;
mod recorded_paths;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod recordings;
mod report;
mod result_files;

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use stickslip::scene::SHIPPED;
use stickslip::verify::extremes::{EXTREMES, Extreme};

/// The shipped stick-slip scene, from which every bad scene is made by one replacement.
const GOOD: &str = include_str!("../fixtures/scenes/fig5-stick-slip.toml");

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a temporary folder");
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        fs::write(self.path(name), text).expect("a temporary file");
        self.path(name)
    }
}

fn stickslip(arguments: &[&str]) -> Output {
    Command::new(assert_cmd::cargo::cargo_bin!("stickslip")).args(arguments).output().expect("it runs")
}

fn run(scene: &Path, out: &Path) -> Output {
    stickslip(&["run", &scene.display().to_string(), "--out", &out.display().to_string()])
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// All scenes over mesh files complete without tunnelling, with the forces of a soft body: the ellipsoid is pressed and
/// dragged, the liver slid over, and a solid and a shell are read from every kind of file. One of them has the verdict
/// FAIL, and another INCONCLUSIVE.
#[test]
fn scenes_over_mesh_files_complete() {
    let folder = Folder::new("mesh-scenes");
    let scenes = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/meshes")).expect("a folder");
    let scenes: Vec<PathBuf> = scenes.map(|scene| scene.expect("a file").path()).collect();
    let scenes: Vec<&PathBuf> = scenes.iter().filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    assert!(scenes.len() >= 6, "{} scenes", scenes.len());
    for scene in scenes {
        let out = folder.path("out");
        let output = run(scene, &out);
        let expected = match scene.file_stem().and_then(|name| name.to_str()) {
            Some("bar-8") => 1,
            Some("solid") => 3,
            _ => 0,
        };
        assert_eq!(output.status.code(), Some(expected), "{}: {}", scene.display(), stderr(&output));
        let summary = fs::read_to_string(out.join("summary.json")).expect("a summary");
        let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
        let peak = summary["largest_normal_force_n"].as_f64().expect("a force");
        assert!((0.05..5.0).contains(&peak), "{}: {peak} N", scene.display());
        assert_eq!(summary["tunnelling_ticks"], 0, "{}", scene.display());
        let network = fs::read_to_string(out.join("network.json")).expect("a network");
        let network: serde_json::Value = serde_json::from_str(&network).expect("JSON");
        assert_eq!(network["nodes"].as_array().map(Vec::len), network["mass"].as_array().map(Vec::len));
    }
}

#[test]
fn a_run_leaves_its_files_and_repeats_to_the_byte() {
    let folder = Folder::new("run");
    let (a, b) = (folder.path("a"), folder.path("b"));
    for out in [&a, &b] {
        let output = run(Path::new("fig5-stick-slip"), out);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert_eq!(stderr(&output), "", "no progress where there is no terminal");
    }
    let read = |folder: &Path, name: &str| fs::read_to_string(folder.join(name)).expect(name);
    for name in ["trace.csv", "network.json", "forces.svg"] {
        assert_eq!(read(&a, name), read(&b, name), "{name}");
    }
    assert_eq!(fs::read_dir(&a).expect("a folder").count(), 4, "nothing else is left");

    let trace = read(&a, "trace.csv");
    let mut lines = trace.lines();
    let header = lines.next().expect("a header");
    assert!(header.starts_with(
        "tick,t,qx,qy,qz,fx,fy,fz,fn,ft,mode,triangle,alpha,beta,gamma,nx,ny,nz,kinetic,elastic,gravitational,work,model_age"
    ));
    let columns = header.split(',').count();
    assert_eq!(lines.clone().count(), 1200);
    assert!(lines.all(|line| line.split(',').count() == columns));
    assert!(trace.contains("0,0.001,-0.03,0.0013,0.001975,0.0,0.0,0.0,0.0,0.0,free,,,,,,,,"));

    let network: serde_json::Value = serde_json::from_str(&read(&a, "network.json")).expect("JSON");
    for (key, count) in [("nodes", 324), ("mass", 324), ("fixed", 324), ("springs", 2195), ("triangles", 448)] {
        assert_eq!(network[key].as_array().expect(key).len(), count, "{key}");
    }
    let summary: serde_json::Value = serde_json::from_str(&read(&a, "summary.json")).expect("JSON");
    assert_eq!(summary["mode_ticks"]["stick"], 264);
    assert_eq!(summary["tunnelling_ticks"], 0);
}

#[test]
fn a_fault_ends_with_code_1_and_keeps_the_rows_before_it() {
    let folder = Folder::new("fault");
    let out = folder.path("out");
    let output = run(Path::new("deep-stick-slip-faceted"), &out);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("fault at tick 884") && stderr(&output).contains("diverged: "),
        "{}",
        stderr(&output)
    );
    // This scene's tangent is the exact one, kept for a cycle.
    assert!(stderr(&output).contains("`local.tangent = \"stabilised\"`"), "{}", stderr(&output));
    let rows = fs::read_to_string(out.join("trace.csv")).expect("a trace").lines().count() - 1;
    assert_eq!(rows, 884);
}

/// Under a deep drag over a small block the patch folds, and the advice comes with the fault.
#[test]
fn a_folded_patch_ends_with_code_1_and_a_way_out() {
    let folder = Folder::new("folded");
    let scene = GOOD
        .replace("duration = 1.2", "duration = 0.4")
        .replace("nodes = [9, 9, 4]", "nodes = [5, 5, 3]")
        .replace("friction = 1.0", "friction = 0.5")
        .replace("[0.0, -0.03, 0.0013, 0.002]", "[0.0, -0.012, 0.0013, 0.001]")
        .replace("[0.2, -0.03, 0.0013, -0.003]", "[0.1, -0.012, 0.0013, -0.008]")
        .replace("[1.2, 0.02, 0.0013, -0.003]", "[0.4, 0.02, 0.0013, -0.008]");
    let output = run(&folder.write("folded.toml", &scene), &folder.path("out"));
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    assert!(message.contains("the patch folded over the tip") && message.contains("contact.adhesion"), "{message}");
    let summary = fs::read_to_string(folder.path("out/summary.json")).expect("a summary");
    assert!(summary.contains("\"patch_folded\": 1,"), "{summary}");
}

/// Under the velocity scheme at 10 kHz the mass under the tip answers an encoder count within a tick; under the massless
/// scheme it does not.
#[test]
fn a_count_that_commands_a_tenth_of_a_newton_is_warned_of() {
    let folder = Folder::new("count");
    for (scheme, is_warned_of) in [("velocity", true), ("massless", false)] {
        let scene = GOOD
            .replace("duration = 1.2", "duration = 0.1")
            .replace("rate = 1000.0", "rate = 10000.0")
            .replace("scheme = \"geometric\"", &format!("scheme = \"{scheme}\""))
            .replace("deformation = \"rigid\"\nmetric = \"euclidean\"\n", "")
            .replace("kind = \"path\"", "kind = \"phantom-1.5\"");
        let output = run(&folder.write("count.toml", &scene), &folder.path("out"));
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let message = stderr(&output);
        assert_eq!(message.contains("Warning: one encoder count commands"), is_warned_of, "{message}");
    }
}

#[test]
fn a_run_that_makes_energy_fails() {
    let folder = Folder::new("shaken");
    let mesh = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/meshes/bar-8.msh");
    let scene = include_str!("../fixtures/meshes/bar-8.toml").replace("bar-8.msh", mesh);
    for (rate, code, because) in [("rate = 10", 1, "energy"), ("rate = 50", 0, "completed")] {
        let output = run(&folder.write("bar.toml", &scene.replace("rate = 10", rate)), &folder.path("out"));
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        assert_eq!(stderr(&output).contains("`global.rate`"), code == 1, "{}", stderr(&output));
        let summary: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path("out/summary.json")).expect("a summary")).expect("JSON");
        assert_eq!(summary["verdict"]["because"], because, "{summary}");
    }
}

#[test]
fn an_output_folder_that_cannot_be_is_named() {
    let folder = Folder::new("blocked");
    let file = folder.write("file", "");
    let output = run(Path::new("fig3-sliding"), &file.join("below"));
    assert_eq!(output.status.code(), Some(2));
    let message = stderr(&output);
    assert!(message.contains("cannot write") && message.contains("--out DIR"), "{message}");
}

/// Names can be copied out of messages: lines do not break at their hyphens.
#[test]
fn names_stay_whole_in_messages() {
    let message = stderr(&stickslip(&["run", "no-such-scene"]));
    assert!(message.lines().count() > 3, "no line is broken: {message}");
    for shipped in SHIPPED {
        assert!(message.contains(shipped.name), "{} is not in\n{message}", shipped.name);
    }
    // The cause is a part of the message, and is not told twice.
    assert_eq!(message.matches("No such file").count(), 1, "{message}");
}

#[test]
fn a_bad_scene_keeps_the_whole_report_from_starting() {
    let folder = Folder::new("bad-report");
    let scene = folder.write("bad.toml", "name = 1");
    let out = folder.path("out");
    let output =
        stickslip(&["report", "fig3-sliding", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(!out.exists());
}

#[test]
fn a_tip_inside_keeps_the_whole_report_from_starting() {
    let folder = Folder::new("inside-report");
    let text = GOOD.replace("[0.0, -0.03, 0.0013, 0.002]", "[0.0, -0.03, 0.0013, -0.002]");
    let scene = folder.write("inside.toml", &text);
    let out = folder.path("out");
    let output =
        stickslip(&["report", "fig3-sliding", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(!out.exists());
}

#[test]
fn two_scenes_of_one_name_are_refused() {
    let folder = Folder::new("same-name");
    let scene = folder.write("same.toml", GOOD);
    let out = folder.path("out");
    let output =
        stickslip(&["report", "fig5-stick-slip", &scene.display().to_string(), "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("two scenes are named"), "{}", stderr(&output));
    assert!(!out.exists());
}

/// A user's scene with the name of a shipped extreme is not expected to end as the extreme.
#[test]
fn expectations_belong_to_shipped_scenes_only() {
    let folder = Folder::new("own-name");
    let scene = folder.write("own.toml", &GOOD.replace("fig5-stick-slip", "deep-stick-slip-faceted"));
    let output =
        stickslip(&["report", &scene.display().to_string(), "--out", &folder.path("out").display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn a_full_disk_on_standard_output_is_no_panic() {
    let full = fs::File::options().write(true).open("/dev/full").expect("/dev/full");
    let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("stickslip"))
        .args(["explain", "fig5-stick-slip"])
        .stdout(full)
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("standard output"), "{}", stderr(&output));
}

/// A tip that approaches through a metre of air is not inside on its way.
#[test]
fn a_far_start_is_outside() {
    let folder = Folder::new("far");
    let text = GOOD.replace(
        "waypoints = [[0.0, -0.03, 0.0013, 0.002], [0.2",
        "waypoints = [[0.0, -0.3, 0.13, 1.1], [0.1, -0.03, 0.0013, 0.002], [0.2",
    );
    let output = run(&folder.write("far.toml", &text), &folder.path("out"));
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
}

/// An implicit step of 19,200 nodes takes 3.1 GiB for its factor, and the process has 0.6 GB of address space.
#[cfg(unix)]
#[test]
fn a_run_beyond_the_memory_of_its_process_is_refused() {
    let folder = Folder::new("address-space");
    let text = GOOD
        .replace("nodes = [9, 9, 4]", "nodes = [40, 40, 12]")
        .replace("integrator = \"semi-implicit-euler\"\nsubsteps", "integrator = \"implicit-euler\"\nsubsteps");
    assert!(text.contains("implicit-euler\"\nsubsteps"));
    let (scene, out) = (folder.write("large.toml", &text), folder.path("out"));
    let program = assert_cmd::cargo::cargo_bin!("stickslip").display().to_string();
    let limited = format!("ulimit -v 600000; exec {program} run {} --out {}", scene.display(), out.display());
    let output = Command::new("sh").args(["-c", &limited]).output().expect("a shell");
    let message = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("19200 nodes") && message.contains("MiB are free") && !out.exists(), "{message}");
}

#[test]
fn explain_tells_sizes_limits_and_what_is_left_out() {
    let output = stickslip(&["explain", "fig3-sliding"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0));
    let omitted = text.split("\nOmitted\n").nth(1).expect("a list");
    for part in ["friction", "sticking operator P", "gravity", "vertex normals"] {
        assert!(omitted.contains(part), "{part} is not in\n{omitted}");
    }
    assert!(text.contains("42 × 84") && text.contains("stable up to 2.869 ms") && !text.contains("Warning"), "{text}");

    let folder = Folder::new("explain");
    let stiff = folder.write("stiff.toml", &GOOD.replace("stiffness = 100.0", "stiffness = 1e5"));
    let output = stickslip(&["explain", &stiff.display().to_string(), "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let warnings: Vec<&str> =
        json["warnings"].as_array().expect("a list").iter().filter_map(|warning| warning["code"].as_str()).collect();
    assert_eq!(warnings, ["local-step-limit", "global-step-limit"]);
    // A run gives the same warnings, and names the cause when it diverges.
    let output = run(&stiff, &folder.path("out"));
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("Warning: the local tick is beyond its stability limit"), "{}", stderr(&output));
    let advice = stderr(&output).lines().last().unwrap_or_default().to_owned();
    assert!(advice.starts_with("Cause: the local tick") || !stderr(&output).contains("diverged"), "{advice}");
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path("out/summary.json")).expect("a summary")).expect("JSON");
    assert_eq!(summary["warnings"][0]["code"], "local-step-limit", "{summary}");
}

#[test]
fn a_scene_with_a_device_tells_of_it() {
    let folder = Folder::new("device");
    let header = |out: &Path| fs::read_to_string(out.join("trace.csv")).expect("a trace");
    for (name, is_hard) in [("hard-wall", true), ("virtual-wall", false)] {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/closed-loop/{name}.toml"));
        let out = folder.path(name);
        assert_eq!(run(&scene, &out).status.code(), Some(0));
        let summary = fs::read_to_string(out.join("summary.json")).expect("a summary");
        let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
        let device = &summary["device"];
        let (saturated, energy) = (&device["saturated_ticks"], &device["largest_energy_to_hand_j"]);
        assert_eq!(saturated.as_u64().expect("a number") > 0, is_hard, "{device}");
        assert_eq!(energy.as_f64().expect("a number") > 1e-2, is_hard, "{device}");
        let columns =
            "device_x,device_y,device_z,contact_fx,contact_fy,contact_fz,hand_energy,contact_kinetic,contact_exchange";
        assert!(header(&out).lines().next().expect("a header").ends_with(columns));
        let explained = stickslip(&["explain", &scene.display().to_string()]);
        let text = String::from_utf8_lossy(&explained.stdout).into_owned();
        assert!(text.contains("PHANTOM Premium 1.5: 78, 53, 32 g at the tip"), "{text}");
        assert_eq!(text.contains("Warning: contact.wall_stiffness = 20000 N/m is beyond"), is_hard, "{text}");
    }
    let out = folder.path("path");
    assert_eq!(run(&folder.write("path.toml", GOOD), &out).status.code(), Some(0));
    assert!(header(&out).lines().nth(1).expect("a row").ends_with(",,,,,,,,"));
    assert!(!fs::read_to_string(out.join("summary.json")).expect("a summary").contains("\"device\":"));
}

#[test]
fn usage_errors_have_code_2_and_help_teaches() {
    assert_eq!(stickslip(&["fly"]).status.code(), Some(2));
    assert_eq!(stickslip(&["run"]).status.code(), Some(2));
    let help = String::from_utf8_lossy(&stickslip(&["--help"]).stdout).into_owned();
    for word in ["run", "report", "explain", "fig5-stick-slip", "Exit codes", "3 a verdict is INCONCLUSIVE"] {
        assert!(help.contains(word), "{word}");
    }
}

#[test]
fn stability_writes_a_page_that_stands_alone_and_its_numbers() {
    let folder = Folder::new("stability");
    let out = folder.path("out");
    let output = stickslip(&["stability", "--out", &out.display().to_string()]);
    let table = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}{table}", stderr(&output));
    assert!(table.contains("one-free-node") && table.contains("fault at tick"), "{table}");
    let page = fs::read_to_string(out.join("index.html")).expect("a page");
    assert_eq!(page.matches("<svg").count(), 4);
    assert!(!page.contains("href=") && !page.contains("src="), "a link out of the page");
    let json = fs::read_to_string(out.join("stability.json")).expect("numbers");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&json["passes"], &json["verdict"]), (&true.into(), &"PASS".into()), "{}", json["reasons"]);
    let models = json["path"]["models"].as_array().expect("models");
    assert!(!models.is_empty() && models.iter().all(|model| model["growth_per_cycle"].as_f64() < Some(1.0)));
    let maps = json["maps"].as_array().expect("maps");
    assert!(maps.len() >= 84 && maps.iter().all(|boundary| boundary["ratio"].is_number()));
    let walls = json["z_width"].as_array().expect("virtual walls");
    assert!(walls.len() == 12 && walls.iter().all(|wall| wall["agrees"] == true), "{walls:?}");
    let extremes = json["extremes"].as_array().expect("extremes");
    let runs = |extreme: &Extreme| extreme.variants().len();
    assert_eq!(EXTREMES.len(), fs::read_dir("fixtures/extremes").expect("scenes").count());
    assert_eq!(extremes.len(), EXTREMES.iter().map(runs).sum::<usize>());
    let rows: HashSet<_> =
        extremes.iter().map(|extreme| (extreme["scene"].as_str(), extreme["contact"].as_str())).collect();
    assert_eq!(rows.len(), extremes.len(), "a run that is there twice");
    assert!(extremes.iter().all(|extreme| extreme["as_expected"] == true));

    let missing = stickslip(&["stability", "no-such-scene"]);
    assert_eq!(missing.status.code(), Some(2), "{}", stderr(&missing));
}
