//! Documents agree with the program: links resolve, every scene key has its row, and the example scene is valid.

use std::fs;
use std::path::{Path, PathBuf};

use stickslip::scene::Scene;

/// Folders whose Markdown files are checked, relative to the package.
const FOLDERS: &[&str] = &[
    "",
    "benches",
    "reference/docs",
    "reference/meshes",
    "reference/peers",
    "reference/python",
    "reports",
    "src/cli/report/view/three",
];

fn package() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns all documents. A folder may be absent from a package that was not cloned.
fn documents() -> Vec<PathBuf> {
    let entries = FOLDERS.iter().filter_map(|folder| fs::read_dir(package().join(folder)).ok()).flatten();
    let files = entries.map(|entry| entry.expect("an entry of a folder").path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "md")).collect()
}

/// Returns the lines outside fenced code.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut code = false;
    text.lines().filter(move |line| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        !code && !fence
    })
}

/// Returns the anchors of the headings, as GitHub makes them.
fn anchors(text: &str) -> Vec<String> {
    let headings = prose(text).filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    let slug = |heading: &str| {
        let kept = heading.chars().filter(|letter| letter.is_alphanumeric() || " -_".contains(*letter));
        kept.map(|letter| if letter == ' ' { '-' } else { letter.to_ascii_lowercase() }).collect()
    };
    headings.map(slug).collect()
}

/// Returns the targets of links and pictures.
fn links(text: &str) -> Vec<&str> {
    let after = |line| str::split(line, "](").skip(1).filter_map(|rest: &str| rest.split(')').next());
    prose(text).flat_map(after).collect()
}

/// The examples need nothing but what is public: names at the crate's root.
#[test]
fn examples_use_the_public_names_only() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference/examples");
    let mut checked = 0;
    for entry in fs::read_dir(folder).expect("the examples' folder") {
        let path = entry.expect("an entry").path();
        // Examples in other languages are in folders.
        if path.is_dir() {
            continue;
        }
        let text = fs::read_to_string(&path).expect("an example");
        for (at, _) in text.match_indices("stickslip::") {
            let rest = &text[at + "stickslip::".len()..];
            let names = match rest.strip_prefix('{') {
                Some(list) => list.split('}').next().unwrap_or_default(),
                None => rest.split([';', '(', ' ', ',']).next().unwrap_or_default(),
            };
            assert!(!names.contains("::"), "{}: `{names}` reaches into a module", path.display());
            checked += 1;
        }
    }
    assert!(checked >= 5, "{checked} uses of the library in the examples");
}

#[test]
fn links_between_documents_resolve() {
    let documents = documents();
    let mut checked = 0;
    for document in &documents {
        let text = read(document);
        for link in links(&text).into_iter().filter(|link| !link.starts_with("http")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let folder = document.parent().expect("the folder of a document");
            let target = if file.is_empty() { document.clone() } else { folder.join(file) };
            assert!(target.exists(), "{}: {link} leads nowhere", document.display());
            if !anchor.is_empty() {
                let found = anchors(&read(&target)).iter().any(|heading| heading == anchor);
                assert!(found, "{}: {link} has no such heading", document.display());
            }
            checked += 1;
        }
    }
    assert!(checked > 40, "only {checked} links in {} documents", documents.len());
}

/// Returns the keys of scenes: the first strings of the tuples in the source of `scene::keys`.
fn keys(source: &str) -> Vec<&str> {
    let tuples = source.split('(').filter_map(|tuple| tuple.trim_start().strip_prefix('"')?.split_once("\","));
    let is_key = |key: &&str| key.chars().all(|letter| letter.is_ascii_lowercase() || "_.".contains(letter));
    tuples.map(|(key, _)| key).filter(is_key).collect()
}

#[test]
fn every_scene_key_has_its_row() {
    let text = read(&package().join("reference/docs/scenes.md"));
    let (_, table) = text.split_once("\n## Keys\n").expect("the section on keys");
    let rows = table.lines().filter_map(|line| line.strip_prefix("| `")?.split_once('`'));
    let written: Vec<&str> = rows.map(|(key, _)| key).collect();
    let source = read(&package().join("src/scene/keys.rs"));
    assert_eq!(written, keys(&source), "rows of reference/docs/scenes.md, and keys of src/scene/keys.rs");
}

#[test]
fn the_example_scene_is_valid() {
    let path = package().join("reference/docs/scenes.md");
    let text = read(&path);
    let (_, rest) = text.split_once("```toml\nname = ").expect("an example that begins with its name");
    let (example, _) = rest.split_once("```").expect("the end of the example");
    Scene::parse(&format!("name = {example}"), &path).expect("a valid scene");
}
