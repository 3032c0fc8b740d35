//! `--junit FILE`: verdicts for continuous integration.

use std::fs;
use std::path::Path;

use super::{Folder, stderr, stickslip};

/// Returns the counts of tests, failures and errors of a file, and the elements of its cases.
pub fn counts(file: &Path) -> ([usize; 3], Vec<String>) {
    let text = fs::read_to_string(file).expect("the file");
    let document = roxmltree::Document::parse(&text).unwrap_or_else(|error| panic!("{error}:\n{text}"));
    let suite = document.descendants().find(|node| node.has_tag_name("testsuite")).expect("a suite");
    let count = |name| suite.attribute(name).and_then(|count| count.parse().ok()).expect("a count");
    let cases = suite.children().filter(|node| node.has_tag_name("testcase"));
    let inner =
        |case: roxmltree::Node| case.first_element_child().map_or("", |inner| inner.tag_name().name()).to_owned();
    (["tests", "failures", "errors"].map(count), cases.map(inner).collect())
}

#[test]
fn check_writes_a_case_per_scene_and_nothing_of_an_earlier_run() {
    let folder = Folder::new("junit");
    let [out, baselines, junit] =
        ["out", "baselines", "new/junit.xml"].map(|name| folder.path(name).display().to_string());
    let short = ["--set", "duration=0.1", "--set", "mesh.nodes=[5,5,3]", "--baselines", &baselines];
    let accept = ["check", "--accept", "fig3-sliding", "--reason", "first", "--set", "name=short"];
    let output = stickslip(&[&accept[..], &short[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));

    let checked = |more: &[&str]| {
        let command = ["check", "fig3-sliding", "--out", &out, "--junit", &junit];
        stickslip(&[&command[..], &short[..], more].concat())
    };
    let output = checked(&["--set", "name=short"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(counts(Path::new(&junit)), ([1, 0, 0], vec![String::new()]));

    let output = checked(&["--set", "name=short", "--set", "material.stiffness=90"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(counts(Path::new(&junit)), ([1, 1, 0], vec!["failure".to_owned()]));
    let text = fs::read_to_string(&junit).expect("the file");
    assert!(text.contains("scene_sha256") && text.contains("name=\"short\""), "{text}");

    // A run that ends before its verdict leaves none, not even an earlier one.
    assert_eq!(checked(&["--set", "name=short", "--tolerance", "no such=1"]).status.code(), Some(2));
    assert!(!Path::new(&junit).exists());
    let output = stickslip(&["check", "fig3-sliding", "--junit", "/dev/null/junit.xml", "--out", &out]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--junit"), "{}", stderr(&output));
}
