//! Folders of results are whole or known to be incomplete, have one writer at a time, and keep no trace of an interrupted
//! run.

use std::fs;
use std::io::Read as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::{Folder, GOOD, run, stderr, stickslip};

fn program() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("stickslip"))
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("a folder")
        .flatten()
        .map(|f| f.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_summary_names_the_files_of_its_run() {
    let folder = Folder::new("manifest");
    let out = folder.path("out");
    assert_eq!(
        run(&folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 0.2")), &out).status.code(),
        Some(0)
    );
    let read = |name: &str| fs::read(out.join(name)).expect("a file");
    let summary: serde_json::Value = serde_json::from_slice(&read("summary.json")).expect("JSON");
    let files = summary["files"].as_object().expect("a table");
    assert!(files.len() >= 2, "{files:?}");
    for (name, hash) in files {
        let digest = stickslip::output::folder::sha256(&out.join(name)).expect("a file");
        assert_eq!(hash, &digest, "{name}");
    }
    let mut all: Vec<String> = files.keys().cloned().chain(["summary.json".to_owned()]).collect();
    all.sort();
    assert_eq!(names(&out), all);
}

#[test]
fn two_runs_into_one_folder_refuse_each_other() {
    let folder = Folder::new("busy");
    let out = folder.path("out");
    fs::create_dir_all(&out).expect("a folder");
    fs::write(out.join("summary.json"), "of the other").expect("a file");
    let other = fs::File::open(&out).expect("a folder");
    other.lock().expect("a lock");
    let output = run(Path::new("fig3-sliding"), &out);
    let message = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("another process is writing") && message.contains("--out DIR"), "{message}");
    assert_eq!(fs::read_to_string(out.join("summary.json")).expect("a file"), "of the other");
    drop(other);
    assert_eq!(run(Path::new("fig3-sliding"), &out).status.code(), Some(0));
}

#[test]
fn frames_of_an_earlier_run_do_not_stay() {
    let folder = Folder::new("frames");
    let (scene, out) = (folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 0.2")), folder.path("out"));
    let with_frames = ["run", &scene.display().to_string(), "--out", &out.display().to_string(), "--vtk"];
    assert_eq!(stickslip(&with_frames).status.code(), Some(0));
    assert!(out.join("network.pvd").exists() && names(&out.join("vtk")).len() == 20);
    fs::write(out.join("vtk/mine.vtu"), "a file of another").expect("a file");
    assert_eq!(run(&scene, &out).status.code(), Some(0));
    assert!(!out.join("network.pvd").exists() && !out.join("instrument.pvd").exists());
    assert_eq!(names(&out.join("vtk")), ["mine.vtu"]);
}

/// A run that a signal ends leaves no temporary file, and no summary of an earlier run beside its own files.
#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_nothing_half_written() {
    let folder = Folder::new("interrupted");
    let (scene, out) =
        (folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 600.0")), folder.path("out"));
    fs::create_dir_all(&out).expect("a folder");
    fs::write(out.join("summary.json"), "of an earlier run").expect("a file");
    let mut child = program()
        .args(["run", &scene.display().to_string(), "--out", &out.display().to_string()])
        .stdout(Stdio::null())
        .spawn()
        .expect("it starts");
    let begun = Instant::now();
    while !names(&out).iter().any(|name| name.starts_with(".tmp")) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", names(&out));
        sleep(Duration::from_millis(5));
    }
    let kill = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill");
    assert!(kill.success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    assert!(names(&out).iter().all(|name| name == "network.json"), "{:?}", names(&out));
}

/// The verdict is the same if no message can be delivered.
#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_error_changes_no_verdict() {
    let folder = Folder::new("full-stderr");
    // The scene has a warning: the tip never comes down.
    let scene = folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 0.01"));
    for (arguments, code) in [
        (vec!["run".to_owned(), scene.display().to_string()], 0),
        (vec!["run".to_owned(), folder.path("absent.toml").display().to_string()], 2),
    ] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
        let out = folder.path("out").display().to_string();
        let status = program()
            .args(&arguments)
            .args(["--out", &out])
            .stdout(Stdio::null())
            .stderr(full)
            .status()
            .expect("it runs");
        assert_eq!(status.code(), Some(code), "{arguments:?}");
    }
}

#[cfg(unix)]
#[test]
fn files_have_the_permissions_of_the_process() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("umask");
    let (scene, out) = (folder.write("s.toml", &GOOD.replace("duration = 1.2", "duration = 0.2")), folder.path("out"));
    for (umask, mode) in [("077", 0o600), ("022", 0o644)] {
        let program = assert_cmd::cargo::cargo_bin!("stickslip").display().to_string();
        let command = format!("umask {umask}; exec {program} run {} --out {} -q", scene.display(), out.display());
        assert_eq!(Command::new("sh").args(["-c", &command]).status().expect("a shell").code(), Some(0));
        for name in ["trace.csv", "summary.json"] {
            let found = fs::metadata(out.join(name)).expect("a file").permissions().mode() & 0o777;
            assert_eq!(found, mode, "{name} under umask {umask}: {found:o}");
        }
    }
}

/// Errors about scenes with escape sequences, and with a line of a megabyte, stay printable and short.
#[test]
fn messages_show_no_control_characters_and_no_endless_lines() {
    let folder = Folder::new("messages");
    let long = "x".repeat(1_000_000);
    for (text, what) in [
        (GOOD.replace("friction = 1.0", "\"\\u001b[2J\\u0007\" = 1"), "an escape sequence"),
        (GOOD.replace("friction = 1.0", &format!("friction = -1.0 # {long}")), "a long line"),
        (GOOD.replace("friction = 1.0", &format!("\"{long}\" = 1")), "a long key"),
        (GOOD.replace("name = \"", "name = \"\u{1b}]0;title\u{7}"), "a control character"),
    ] {
        let output = run(&folder.write("s.toml", &text), &folder.path("out"));
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{what}");
        assert!(message.chars().all(|c| !c.is_control() || c == '\n'), "{what}: {message:?}");
        assert!(message.len() < 20_000, "{what}: {} bytes", message.len());
        let mut first = [0; 20];
        assert!(message.as_bytes().read(&mut first).is_ok_and(|read| read > 10), "{what}");
    }
}
