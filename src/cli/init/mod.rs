//! `stickslip init`: a commented scene to start from.

mod body;

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};

use clap::Args;
use textwrap::Options;
use toml_edit::Value;

use self::body::{Body, Shell};
use super::PASS;
use super::terminal::{print, say};
use crate::output::time_steps::{TimeStep, TimeSteps};
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError, accepted};

/// Width of a comment.
const COLUMNS: usize = 110;
/// Share of its stability limit that a step may have: the limit is that of the body at rest.
const SAFE_STEP: f64 = 0.7;
/// Default of `global.substeps`.
const SUBSTEPS: u32 = 100;

#[derive(Debug, Args)]
pub struct InitArguments {
    /// File to write (default: standard output); a file that is there is not overwritten
    file: Option<PathBuf>,
    /// Mesh of the body, in any format that scenes read (default: a block)
    #[arg(long)]
    mesh: Option<PathBuf>,
}

pub fn init(InitArguments { file, mesh }: &InitArguments) -> miette::Result<u8> {
    // Known before a mesh is read; `create_new` decides.
    if let Some(file) = file.as_deref().filter(|file| file.exists()) {
        return Err(cannot_write(file, &io::ErrorKind::AlreadyExists.into()));
    }
    let text = match mesh {
        None => block(&scene_name(file.as_deref())),
        Some(mesh) => over_mesh(mesh, file.as_deref())?,
    };
    let Some(file) = file else {
        print(text.trim_end())?;
        return Ok(PASS);
    };
    let create = || OpenOptions::new().write(true).create_new(true).open(file)?.write_all(text.as_bytes());
    create().map_err(|error| cannot_write(file, &error))?;
    say(format_args!("{0}: run it with `stickslip run {0}`", file.display()))?;
    Ok(PASS)
}

fn cannot_write(file: &Path, error: &io::Error) -> miette::Report {
    match error.kind() {
        io::ErrorKind::AlreadyExists => miette::miette!(
            help = "give the name of a new file: `init` overwrites none",
            "{} is there already",
            file.display()
        ),
        _ => miette::miette!(
            help = "give a file in a folder that can be written",
            "cannot write {}: {error}",
            file.display()
        ),
    }
}

/// Returns a name for the scene of a file: that of the file, as far as names of scenes have its characters.
fn scene_name(file: Option<&Path>) -> String {
    let stem = file.and_then(Path::file_stem).map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let name: String = stem.chars().map(|c| if is_plain(c) { c } else { '-' }).collect();
    let name = name.trim_start_matches(['-', '_', '.']);
    if name.is_empty() { "my-scene".to_owned() } else { name.to_owned() }
}

/// The text of a scene as it is written.
struct Draft {
    text: String,
    table: &'static str,
}

impl Draft {
    fn new(what: &str) -> Self {
        let mut draft = Self { text: String::new(), table: "" };
        draft.comment(what);
        draft.comment(
            "Above each key are the values that it accepts. Keys in comments are optional: their values are the defaults, or \
             examples. Quantities are SI; reference/docs/scenes.md has every key. `stickslip run` runs the scene, and `stickslip \
             explain` prints what it needs and costs.",
        );
        draft
    }

    fn comment(&mut self, text: &str) {
        let options = Options::new(COLUMNS).initial_indent("# ").subsequent_indent("# ").break_words(false);
        for line in textwrap::wrap(text, options) {
            self.text += &line;
            self.text.push('\n');
        }
    }

    fn table(&mut self, name: &'static str) {
        self.table = name;
        self.text += &format!("\n[{name}]\n");
    }

    /// Begins a table of which every key is optional, so that it is in a comment itself.
    fn optional_table(&mut self, name: &'static str) {
        self.table = name;
        self.text += &format!("\n# [{name}]\n");
    }

    fn accepted(&mut self, key: &str) {
        let dotted = if self.table.is_empty() { key.to_owned() } else { format!("{}.{key}", self.table) };
        if let Some(values) = accepted(&dotted) {
            self.comment(&values);
        }
    }

    /// Writes a key with the reason for its value, if there is one to give.
    fn key(&mut self, key: &str, value: impl Into<Value>, why: &str) {
        self.accepted(key);
        if !why.is_empty() {
            self.comment(&format!("Chosen: {why}"));
        }
        self.text += &format!("{key} = {}\n", value.into().decorated("", ""));
    }

    /// Writes an optional key in a comment; `value` is TOML.
    fn option(&mut self, key: &str, value: &str) {
        self.accepted(key);
        self.text += &format!("# {key} = {value}\n");
    }
}

/// Writes the scene of a block.
fn block(name: &str) -> String {
    let mut draft = Draft::new("A tip is pressed into a block of springs, and dragged over it.");
    draft.key("name", name, "");
    draft.key("duration", 0.4, "");
    draft.option("settle", "false");
    draft.table("mesh");
    draft.key("kind", "block", "");
    draft.key("nodes", Value::from_iter([9, 9, 4]), "100 × 100 × 37.5 mm, centred in x and y, with the top at z = 0");
    draft.key("spacing", 0.0125, "");
    draft.option("stencil", "\"shear\"");
    draft.option("fixed", "\"bottom\"");
    draft.table("material");
    draft.key("node_mass", 0.01, "masses and springs of the paper's block");
    draft.option("density", "1000.0");
    draft.key("stiffness", 100.0, "");
    draft.option("young_modulus", "5e3");
    draft.key("damping", 0.5, "");
    draft.option("damping_ratio", "0.1");
    draft.option("drag", "0.0");
    draft.option("gravity", "[0.0, 0.0, -9.81]");
    let steps = Steps { substeps: SUBSTEPS, substeps_why: String::new(), integrator: None };
    sides(&mut draft, &steps);
    let waypoints = [[0.0, 0.0, 0.001, 0.002], [0.1, 0.0, 0.001, -0.003], [0.4, 0.02, 0.001, -0.003]];
    motion(&mut draft, &waypoints, "from 2 mm above the top 3 mm into it, then 20 mm along x");
    draft.text
}

/// Steps of the two sides.
struct Steps {
    substeps: u32,
    substeps_why: String,
    /// Integrator of the local model other than the default, with the reason.
    integrator: Option<(&'static str, String)>,
}

/// Writes the tables of the two sides and of the contact between them.
fn sides(draft: &mut Draft, steps: &Steps) {
    draft.table("global");
    let why =
        "ten cycles a second, the paper's, are too few for many bodies: their slow modes then gain energy from it";
    draft.key("rate", 50.0, why);
    draft.option("integrator", "\"semi-implicit-euler\"");
    draft.key("substeps", i64::from(steps.substeps), &steps.substeps_why);
    draft.table("local");
    draft.key("rate", 1000.0, "");
    draft.option("model", "\"patch\"");
    draft.key("rings", 2, "");
    draft.option("linearization", "\"tangent\"");
    draft.option("exterior", "\"fixed\"");
    draft.option("tangent", "\"exact\"");
    match &steps.integrator {
        Some((integrator, why)) => draft.key("integrator", *integrator, why),
        None => draft.option("integrator", "\"semi-implicit-euler\""),
    }
    draft.table("contact");
    draft.key("law", "stick-slip", "");
    draft.key("friction", 0.5, "");
    draft.option("adhesion", "0.0");
    draft.key("scheme", "massless", "the recommended scheme; the default is the paper's");
    draft.key("surface", "subdivision", "the recommended surface; the default is the paper's");
    draft.option("radius", "0.0");
    draft.option("wall_stiffness", "1000.0");
}

/// Writes the motion of the tip, and the tables that most scenes leave out.
fn motion(draft: &mut Draft, waypoints: &[[f64; 4]], why: &str) {
    draft.table("instrument");
    draft.key("kind", "path", "");
    draft.key("waypoints", waypoints.iter().map(|point| Value::from_iter(*point)).collect::<Value>(), why);
    draft.option("interpolation", "\"linear\"");
    draft.comment("A recorded motion instead, with `kind = \"recording\"` and without `waypoints`:");
    draft.option("file", "\"motion.csv\"");
    draft.option("columns", "[\"t\", \"x\", \"y\", \"z\"]");
    draft.option("scale", "1.0");
    draft.option("time_scale", "1.0");
    draft.option("start", "0.0");
    draft.optional_table("sync");
    draft.option("mode", "\"replay\"");
    draft.option("latency_ticks", "0");
    draft.optional_table("run");
    draft.option("schedule", "\"lockstep\"");
    draft.optional_table("timing");
    draft.option("tick_cost", "{ median = 2e-4, p99 = 6e-4 }");
    draft.option("deadline", "1e-3");
    draft.option("overrun", "\"hold\"");
}

/// Writes a scene over a mesh from a file, with steps that are stable in it.
fn over_mesh(mesh: &Path, file: Option<&Path>) -> miette::Result<String> {
    let body = Body::of(mesh).map_err(|error| {
        let help = error.problem().advice().to_string();
        miette::miette!(help = help, "{error}")
    })?;
    let name = scene_name(Some(file.unwrap_or(mesh)));
    let path = relative(mesh, file).unwrap_or_else(|| mesh.to_owned());
    let scene_path = file.unwrap_or(Path::new("scene.toml"));
    let write = |steps: &Steps| over_body(&name, &path, &body, steps);
    let mut steps = Steps { substeps: SUBSTEPS, substeps_why: String::new(), integrator: None };
    let found = time_steps(&write(&steps), scene_path)?;
    if let Some(many) = times(&found.global) {
        steps.substeps = (many * SUBSTEPS as f64).ceil() as u32;
        steps.substeps_why = "so many that a step is well below its stability limit in this mesh".to_owned();
    }
    if times(&found.local).is_some() {
        let why = "explicit steps of a tick would be near or beyond their stability limit in this mesh".to_owned();
        steps.integrator = Some(("implicit-euler", why));
    }
    Ok(write(&steps))
}

/// Returns how many times too long a step is, if it is.
fn times(step: &TimeStep) -> Option<f64> {
    step.limit_s.map(|limit| step.step_s / (SAFE_STEP * limit)).filter(|times| !(*times <= 1.0))
}

fn time_steps(text: &str, path: &Path) -> Result<TimeSteps, SceneError> {
    let scene = Scene::parse(text, path)?;
    Ok(TimeSteps::new(&scene, &Simulation::prepare(&scene)?))
}

/// Returns the path of a mesh from the folder of a scene's file; `None` if there is none, as between two drives.
fn relative(mesh: &Path, file: Option<&Path>) -> Option<PathBuf> {
    let folder = file.and_then(Path::parent).filter(|folder| !folder.as_os_str().is_empty());
    let Some(folder) = folder.filter(|_| mesh.is_relative()) else { return Some(mesh.to_owned()) };
    let (folder, mesh) = (fs::canonicalize(folder).ok()?, fs::canonicalize(mesh).ok()?);
    let [mut folder, mut mesh] = [folder.components().peekable(), mesh.components().peekable()];
    while folder.peek().is_some() && folder.peek() == mesh.peek() {
        folder.next();
        mesh.next();
    }
    let up = folder.map(|component| matches!(component, Component::Normal(_)).then_some(Component::ParentDir));
    up.chain(mesh.map(Some)).collect()
}

fn over_body(name: &str, path: &Path, body: &Body, steps: &Steps) -> String {
    let mut draft = Draft::new("A tip is pressed into a body from a mesh file, and dragged over it.");
    draft.key("name", name, "");
    draft.key("duration", 1.2, "");
    draft.option("settle", "false");
    draft.table("mesh");
    draft.key("kind", "file", "");
    let size = format!("{} nodes, {:.3} m across its diagonal", body.nodes, body.diagonal_m);
    draft.key("path", path.to_string_lossy().replace('\\', "/"), &size);
    let unit = if body.scale == 1.0 {
        "the file is taken to be in m, as the body is then at most 10 m large"
    } else {
        "the file is taken to be in mm, as the body would be more than 10 m large otherwise"
    };
    draft.key("scale", body.scale, unit);
    if let Some(Shell { layers, layer_depth_m }) = body.shell {
        draft.key("layers", layers as i64, "");
        let why = "5 % of the diagonal, or as much of it as the curvature of the surface leaves room for";
        draft.key("layer_depth", layer_depth_m, why);
        draft.option("anchor", "true");
    }
    if let Some(z) = body.fixed_below_z_m {
        let mut region = toml_edit::InlineTable::new();
        region.insert("below_z", z.into());
        draft.key("fixed", region, "the lower fifth of the body");
    }
    draft.option("repair", "false");
    draft.table("material");
    if body.shell.is_some() {
        draft.key(
            "node_mass",
            0.01,
            "masses and springs of the paper's block, as a surface has no volume for an elastic solid",
        );
        draft.key("stiffness", 100.0, "");
        draft.key("damping", 0.5, "");
    } else {
        draft.key("density", 1000.0, "soft tissue, which is nearly water");
        draft.key("young_modulus", 5e3, "soft tissue, as liver: organs are between 1 and 100 kPa");
        draft.key("damping_ratio", 0.1, "");
    }
    draft.option("drag", "0.0");
    draft.option("gravity", "[0.0, 0.0, -9.81]");
    sides(&mut draft, steps);
    let times = [0.0, 0.2, 1.2];
    let waypoints: Vec<[f64; 4]> = times.iter().zip(&body.tip).map(|(&t, tip)| [t, tip.x, tip.y, tip.z]).collect();
    let depth = 1e3 * (body.tip[0].z - body.tip[1].z);
    motion(
        &mut draft,
        &waypoints,
        &format!(
            "down by {depth:.3} mm at the top, from above it to at most 2 % of the diagonal inside, then by 10 % of the diagonal \
             along x towards the middle"
        ),
    );
    draft.text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::summary::Recorder;
    use crate::output::verdict::Verdict;
    use crate::pipeline;
    use crate::scene::Change;

    /// Ticks that are run of each scene: the press of 0.2 s at most and the first millimetres of the drag. Whole runs end the
    /// same (1200 ticks over these meshes and over the ellipsoid of 500 nodes), but take minutes without optimisation.
    const TICKS: u64 = 260;

    fn verdict(text: &str, path: &str) -> Verdict {
        let scene = Scene::parse(text, Path::new(path)).unwrap_or_else(|error| panic!("{path}: {error}\n{text}"));
        assert_eq!(scene.warnings(), [], "{path}");
        let scene = scene.with_ticks(TICKS);
        let mut recorder = Recorder::default();
        pipeline::run(&scene, |tick| recorder.record(tick)).unwrap_or_else(|error| panic!("{path}: {error}"));
        let summary = recorder.summary(&scene, None, 0.0);
        assert!(summary.contact_ticks() > 150, "{path}: {} ticks in contact", summary.contact_ticks());
        summary.verdict.verdict
    }

    #[test]
    fn what_is_written_runs() {
        assert_eq!(verdict(&block("block"), "block.toml"), Verdict::Pass);
        for mesh in ["formats/solid-2.2-text.msh", "formats/surface-2.2-text.msh"] {
            let mesh = Path::new("fixtures/meshes").join(mesh);
            let text = over_mesh(&mesh, None).unwrap_or_else(|error| panic!("{}: {error:?}", mesh.display()));
            assert_eq!(verdict(&text, "scene.toml"), Verdict::Pass, "{text}");
        }
    }

    /// Keys in comments are keys of the scene, and every table of the scene is there.
    #[test]
    fn optional_keys_are_known() {
        let text = block("block");
        let mut table = String::new();
        let mut tables = Vec::new();
        for line in text.lines() {
            let line = line.trim_start_matches("# ");
            if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
                table = format!("{name}.");
                tables.push(name.to_owned());
            } else if let Some((key, value)) = line.split_once(" = ").filter(|(key, _)| !key.contains([' ', '`'])) {
                let change: Change = format!("{table}{key}={value}").parse().expect("a change");
                assert!(accepted(change.key()).is_some(), "{line}");
                let is_syntax = |error: &SceneError| matches!(error.problem(), crate::scene::Problem::Syntax(_));
                let changed = Scene::parse_with(&text, Path::new("block.toml"), &[change]);
                assert!(!changed.as_ref().is_err_and(is_syntax), "{line}: {changed:?}");
            }
        }
        assert_eq!(tables, ["mesh", "material", "global", "local", "contact", "instrument", "sync", "run", "timing"]);
    }

    #[test]
    fn a_mesh_is_named_from_the_folder_of_the_scene() {
        let from = |file: Option<&str>| relative(Path::new("fixtures/meshes/liver-500.msh"), file.map(Path::new));
        for (file, expected) in [
            (None, "fixtures/meshes/liver-500.msh"),
            (Some("scene.toml"), "fixtures/meshes/liver-500.msh"),
            (Some("fixtures/scenes/liver.toml"), "../meshes/liver-500.msh"),
            (Some("fixtures/liver.toml"), "meshes/liver-500.msh"),
        ] {
            assert_eq!(from(file).as_deref(), Some(Path::new(expected)), "{file:?}");
        }
        assert_eq!(scene_name(Some(Path::new("a/my organ.toml"))), "my-organ");
        assert_eq!(scene_name(Some(Path::new("_.toml"))), "my-scene");
    }
}
