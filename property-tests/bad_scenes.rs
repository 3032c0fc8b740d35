//! Messages of the program about invalid scenes and meshes.

use std::error::Error;
use std::fs;
use std::io;
use std::path::Path;

use stickslip::mesh_file::MeshFile;
use stickslip::output::files::write_file;
use stickslip::scene::Scene;
use stickslip::session::Session;
use stickslip::verify::baseline::Store;

use super::{Folder, GOOD, run, stderr, stickslip};

/// Table of the scene's mesh.
const BLOCK: &str = "kind = \"block\"
nodes = [9, 9, 4]                   # along x, y, z; top layer at z = 0
spacing = 0.0125                    # m
stencil = \"shear\"
fixed = \"bottom\"";

/// Table of a mesh from a file of any format, with additional keys.
macro_rules! mesh_file {
    ($file:literal, $more:literal) => {
        concat!(
            "kind = \"file\"\npath = \"",
            env!("CARGO_MANIFEST_DIR"),
            "/fixtures/meshes/formats/",
            $file,
            "\"\n",
            $more
        )
    };
}

/// Line of the instrument's kind.
const KIND: &str = "kind = \"path\"";

/// Cases: (defect, text in the good scene, its replacement, words that the message must have).
const BAD: &[(&str, &str, &str, &[&str])] = &[
    (
        "unknown key",
        "substeps = 100",
        "sub_steps = 100",
        &["unknown field `sub_steps`", "did you mean `substeps`?", ":20:"],
    ),
    ("negative cost", "[sync]", "[timing]\ntick_cost = -1e-3\n[sync]", &["timing.tick_cost", "-0.001"]),
    ("no costs", "[sync]", "[timing]\ntick_cost = []\n[sync]", &["timing.tick_cost", "empty list"]),
    ("p99 below median", "[sync]", "[timing]\ntick_cost = { median = 2e-3, p99 = 1e-3 }\n[sync]", &["p99 = 0.001"]),
    ("share above 1", "[sync]", "[timing]\ntick_cost = { usual = 0, rare = 1, share = 2 }\n[sync]", &["share = 2"]),
    ("late deadline", "[sync]", "[timing]\ntick_cost = 0\ndeadline = 2e-3\n[sync]", &["timing.deadline", "0.002 s"]),
    ("idle deadline", "[sync]", "[timing]\ndeadline = 1e-3\n[sync]", &["no effect", "tick_cost"]),
    ("idle seed", "[sync]", "[timing]\ntick_cost = 1e-3\nseed = 1\n[sync]", &["timing.seed", "no effect"]),
    (
        "cost in real time",
        "[sync]",
        "[run]\nschedule = \"threads\"\n[timing]\ntick_cost = 0\n[sync]",
        &["no effect", "threads"],
    ),
    ("unknown policy", "[sync]", "[timing]\ntick_cost = 0\noverrun = \"wait\"\n[sync]", &["wait", "hold"]),
    ("unknown table", "[sync]", "[synch]", &["unknown field `synch`", "did you mean `sync`?"]),
    ("wrong type", "spacing = 0.0125", "spacing = \"wide\"", &["string \"wide\"", "mesh.spacing", ":8:"]),
    (
        "wrong choice",
        "stencil = \"shear\"",
        "stencil = \"sheer\"",
        &["sheer", "did you mean `shear`?", "\"structural\", \"shear\" (default) or \"full\"", ":9:"],
    ),
    (
        "a misspelt law",
        "law = \"stick-slip\"",
        "law = \"stickslip\"",
        &["did you mean `stick-slip`?", "accepted for `contact.law`: \"sliding\", \"sticking\" or \"stick-slip\""],
    ),
    ("missing key", "damping = 0.5", "", &["`material.damping` is missing", "damping_ratio", ":12:"]),
    ("missing table", "[contact]\nlaw", "[contact2]\nlaw", &["contact2"]),
    ("negative mass", "node_mass = 0.01", "node_mass = -0.01", &["material.node_mass", "-0.01", "above 0", ":13:"]),
    ("zero mass", "node_mass = 0.01", "node_mass = 0", &["material.node_mass"]),
    ("NaN mass", "node_mass = 0.01", "node_mass = nan", &["material.node_mass", "NaN"]),
    ("infinite mass", "node_mass = 0.01", "node_mass = inf", &["material.node_mass", "inf"]),
    ("NaN in a mass list", "node_mass = 0.01", "node_mass = [0.01, nan]", &["material.node_mass"]),
    ("negative stiffness", "stiffness = 100.0", "stiffness = -100.0", &["material.stiffness"]),
    ("zero stiffness", "stiffness = 100.0", "stiffness = 0.0", &["material.stiffness"]),
    ("NaN stiffness", "stiffness = 100.0", "stiffness = nan", &["material.stiffness"]),
    ("infinite stiffness", "stiffness = 100.0", "stiffness = -inf", &["material.stiffness"]),
    ("NaN damping", "damping = 0.5", "damping = nan", &["material.damping"]),
    ("negative damping", "damping = 0.5", "damping = -0.5", &["material.damping"]),
    ("infinite gravity", "damping = 0.5", "damping = 0.5\ngravity = [0.0, 0.0, -inf]", &["material.gravity"]),
    ("negative local rate", "rate = 1000.0", "rate = -1000.0", &["local.rate"]),
    ("zero local rate", "rate = 1000.0", "rate = 0.0", &["local.rate"]),
    ("NaN local rate", "rate = 1000.0", "rate = nan", &["local.rate"]),
    ("infinite local rate", "rate = 1000.0", "rate = inf", &["local.rate"]),
    ("negative global rate", "rate = 10.0 ", "rate = -10.0 ", &["global.rate"]),
    ("NaN global rate", "rate = 10.0 ", "rate = nan ", &["global.rate"]),
    ("negative spacing", "spacing = 0.0125", "spacing = -0.0125", &["mesh.spacing"]),
    ("zero spacing", "spacing = 0.0125", "spacing = 0.0", &["mesh.spacing"]),
    ("NaN spacing", "spacing = 0.0125", "spacing = nan", &["mesh.spacing"]),
    ("infinite spacing", "spacing = 0.0125", "spacing = inf", &["mesh.spacing"]),
    ("negative duration", "duration = 1.2", "duration = -1.2", &["duration"]),
    ("zero duration", "duration = 1.2", "duration = 0.0", &["duration"]),
    ("NaN duration", "duration = 1.2", "duration = nan", &["duration"]),
    ("infinite duration", "duration = 1.2", "duration = inf", &["duration"]),
    ("not a whole number of ticks", "duration = 1.2", "duration = 1.20005", &["duration", "whole number of ticks"]),
    ("negative friction", "friction = 1.0", "friction = -1.0", &["contact.friction"]),
    ("NaN friction", "friction = 1.0", "friction = nan", &["contact.friction"]),
    (
        "kinetic friction above the static",
        "friction = 1.0",
        "friction = { static = 0.3, kinetic = 0.5 }",
        &["contact.friction.kinetic", "0.5: above the static coefficient 0.3", ":32:"],
    ),
    ("half a friction pair", "friction = 1.0", "friction = { static = 0.3 }", &["contact.friction", "{ static"]),
    ("negative adhesion", "friction = 1.0", "friction = 1.0\nadhesion = -0.1", &["contact.adhesion", "-0.1"]),
    (
        "endless adhesion with slip",
        "friction = 1.0",
        "friction = 1.0\nadhesion = inf",
        &["contact.adhesion", "sticking"],
    ),
    ("NaN adhesion", "friction = 1.0", "friction = 1.0\nadhesion = nan", &["contact.adhesion"]),
    ("an unknown interpolation", "kind = \"path\"", "kind = \"path\"\ninterpolation = \"cubic\"", &["minimum-jerk"]),
    ("no friction", "friction = 1.0", "", &["`contact.friction` is missing"]),
    ("friction under sliding", "law = \"stick-slip\"", "law = \"sliding\"", &["contact.friction", "no effect", ":32:"]),
    ("friction under sticking", "law = \"stick-slip\"", "law = \"sticking\"", &["contact.friction", "no effect"]),
    ("one node along an axis", "nodes = [9, 9, 4]", "nodes = [9, 9, 1]", &["mesh.nodes", "at least 2"]),
    ("two node counts", "nodes = [9, 9, 4]", "nodes = [9, 9]", &["mesh.nodes"]),
    ("too large", "nodes = [9, 9, 4]", "nodes = [90000, 90000, 90000]", &["729000000000000 nodes", "MiB"]),
    ("too large to count", "nodes = [9, 9, 4]", "nodes = [9000000000, 9000000000, 9000000000]", &["MiB"]),
    ("exterior without one", "rings = 1", "rings = \"all\"", &["local.exterior", "no effect"]),
    ("a spacing that underflows", "spacing = 0.0125", "spacing = 1e-200", &["mesh.spacing", "1e-6"]),
    ("waypoints too far apart", "[1.2, 0.02", "[1.2, 1e308", &["instrument.waypoints", "not finite"]),
    ("a dense matrix too large", "nodes = [9, 9, 4]", "nodes = [100, 100, 10]", &["MiB"]),
    (
        "a tangent without one",
        "linearization = \"tangent\"",
        "linearization = \"none\"\ntangent = \"exact\"",
        &["local.tangent", "no effect"],
    ),
    (
        "condensing without",
        "exterior = \"fixed\"",
        "exterior = \"fixed\"\ncondense_rings = 4",
        &["local.condense_rings", "no effect"],
    ),
    (
        "condensing within the patch",
        "exterior = \"fixed\"",
        "exterior = \"condensed\"\ncondense_rings = 1",
        &["local.condense_rings", "above `rings`"],
    ),
    (
        "a far field without",
        "exterior = \"fixed\"",
        "exterior = \"drifting\"\nfar_field = \"coarse\"",
        &["local.far_field", "no effect"],
    ),
    (
        "a far field of none",
        "exterior = \"fixed\"",
        "exterior = \"condensed\"\nfar_field = \"coarse\"",
        &["local.far_field", "no effect", "condense_rings"],
    ),
    ("rates that do not fit", "rate = 10.0 ", "rate = 30.0 ", &["whole multiple"]),
    ("no rings", "rings = 1", "rings = 0", &["local.rings"]),
    ("half a ring", "rings = 1", "rings = 1.5", &["local.rings"]),
    ("rings in the full model", "model = \"patch\"", "model = \"full\"", &["local.rings", "no effect"]),
    ("no substeps", "substeps = 100", "substeps = 0", &["global.substeps"]),
    ("three threads", "substeps = 100", "threads = 3", &["`global.threads`", "3", "1 (default) or 2", ":20:"]),
    (
        "two threads under rk4",
        "integrator = \"semi-implicit-euler\"\nsubsteps = 100",
        "integrator = \"rk4\"\nthreads = 2",
        &["`global.threads` has no effect", "rk4"],
    ),
    ("two threads that overwrite", "substeps = 100", "threads = 2", &["`global.threads` has no effect", "overwrite"]),
    ("too late", "latency_ticks = 0", "latency_ticks = 100", &["sync.latency_ticks"]),
    (
        "an implicit step with the geometric scheme",
        "linearization = \"tangent\"\nexterior = \"fixed\"\nintegrator = \"semi-implicit-euler\"",
        "integrator = \"implicit-euler\"",
        &[
            "`local.integrator = \"implicit-euler\"` needs `contact.scheme = \"massless\"`",
            "or `\"velocity\"`",
            ":26:",
            "give",
        ],
    ),
    (
        "an implicit step of springs",
        "linearization = \"tangent\"\nexterior = \"fixed\"\nintegrator = \"semi-implicit-euler\"",
        "linearization = \"none\"\nintegrator = \"exponential\"",
        &["needs `local.linearization = \"tangent\"`", "which takes every model"],
    ),
    (
        "an implicit step of the full model",
        "model = \"patch\"\nrings = 1\nlinearization = \"tangent\"\nexterior = \"fixed\"\nintegrator = \"semi-implicit-euler\"",
        "model = \"full\"\nintegrator = \"implicit-midpoint\"",
        &["needs `local.model = \"patch\"`"],
    ),
    ("unsorted waypoints", "[1.2, 0.02", "[0.1, 0.02", &["instrument.waypoints", "not later"]),
    (
        "short waypoint",
        "[1.2, 0.02, 0.0013, -0.003]",
        "[1.2, 0.02, 0.0013]",
        &["instrument.waypoints", "four numbers", ":40:73"],
    ),
    ("no waypoints", "waypoints = [[0.0", "waypoints = [] # [[0.0", &["instrument.waypoints", "no waypoint"]),
    ("NaN waypoint", "[1.2, 0.02", "[1.2, nan", &["instrument.waypoints", "not finite"]),
    ("tip inside", "[0.0, -0.03, 0.0013, 0.002]", "[0.0, -0.03, 0.0013, -0.002]", &["inside the surface", "0.002"]),
    ("mass list of another length", "node_mass = 0.01", "node_mass = [0.01, 0.01]", &["2 values for 324 nodes"]),
    ("mass and density", "node_mass = 0.01", "node_mass = 0.01\ndensity = 1000.0", &["cannot both be given"]),
    ("neither mass nor density", "node_mass = 0.01", "", &["`material.node_mass` is missing"]),
    ("fixed node beyond the mesh", "fixed = \"bottom\"", "fixed = { nodes = [324] }", &["mesh.fixed", "324"]),
    ("unknown fixture", "fixed = \"bottom\"", "fixed = { above_z = 0.0 }", &["below_z"]),
    ("a name with a path in it", "name = \"fig5-stick-slip\"", "name = \"../up\"", &["name"]),
    (
        "missing recording",
        "kind = \"path\"",
        "kind = \"recording\"\nfile = \"none.csv\"",
        &["instrument.waypoints", "no effect"],
    ),
    ("a device under a path", KIND, "kind = \"path\"\ndevice = { substeps = 10 }", &["instrument.device", "no effect"]),
    ("a hand under a path", KIND, "hand = { mass = [0.1, 0.1, 0.1] }", &["instrument.hand", "no effect"]),
    ("a coupling under a path", KIND, "coupling = { mass = 0.1 }", &["instrument.coupling", "no effect"]),
    ("control under a path", KIND, "passivity_control = true", &["instrument.passivity_control", "no effect"]),
    (
        "waypoints beside a device's recording",
        KIND,
        "kind = \"phantom-1.5\"\nfile = \"x.csv\"",
        &["instrument.waypoints", "no effect"],
    ),
    (
        "a force limit of a device",
        KIND,
        "kind = \"phantom-1.5\"\nforce_limit = 9.0",
        &["instrument.force_limit", "no effect"],
    ),
    ("a force limit of zero", KIND, "kind = \"path\"\nforce_limit = 0.0", &["instrument.force_limit", "above 0"]),
    ("no force limit", KIND, "kind = \"path\"\nforce_limit = inf", &["instrument.force_limit", "finite"]),
    (
        "columns of a path",
        KIND,
        "kind = \"path\"\ncolumns = [\"a\", \"b\", \"c\", \"d\"]",
        &["instrument.columns", "no effect"],
    ),
    ("a unit of a path", KIND, "kind = \"path\"\nscale = 0.001", &["instrument.scale", "no effect"]),
    ("a unit of time of a path", KIND, "kind = \"path\"\ntime_scale = 0.001", &["instrument.time_scale", "no effect"]),
    (
        "a start of a device's waypoints",
        KIND,
        "kind = \"phantom-1.5\"\nstart = 1.0",
        &["instrument.start", "no effect"],
    ),
    ("a filter of a path", KIND, "kind = \"path\"\nfilter_hz = 10.0", &["instrument.filter_hz", "no effect"]),
    (
        "a hand out of reach",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { offset = [1.0, 0.0, 0.0] }",
        &["instrument.waypoints", "at 0 s", "the links reach", "offset", ":41:"],
    ),
    (
        "not a rotation",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]] }",
        &["instrument.device.rotation", "mirrors", ":40:"],
    ),
    (
        "too few substeps",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { substeps = 1 }",
        &["instrument.device.substeps", "too few", "take"],
    ),
    (
        "too few substeps for a light tip",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { structure = { tip_mass = 1e-6 } }",
        &["instrument.device.substeps", "too few", "take"],
    ),
    (
        "a structure without stiffness",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { structure = { stiffness = 0.0 } }",
        &["instrument.device.structure.stiffness", "above 0"],
    ),
    (
        "an unknown key of a structure",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { structure = { mass = 0.01 } }",
        &["unknown field `mass`", "tip_mass"],
    ),
    (
        "a coupling too light",
        KIND,
        "kind = \"phantom-1.5\"\ncoupling = { mass = 1e-4 }",
        &["instrument.coupling.mass", "coupling alone is unstable"],
    ),
    (
        "negative joint friction",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { joint_friction = [0.0, -1.0, 0.0] }",
        &["instrument.device.joint_friction", "-1", "at least 0"],
    ),
    (
        "a hand without mass",
        KIND,
        "kind = \"phantom-1.5\"\nhand = { mass = [0.0, 0.1, 0.1] }",
        &["instrument.hand.mass", "above 0"],
    ),
    (
        "an infinite offset",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { offset = [inf, 0.0, 0.0] }",
        &["instrument.device.offset", "inf"],
    ),
    (
        "too many bits",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { torque_bits = 33 }",
        &["instrument.device.torque_bits", "at most 32"],
    ),
    (
        "half a count",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { encoder_counts = 0.5 }",
        &["instrument.device.encoder_counts"],
    ),
    (
        "an unknown key of a device",
        KIND,
        "kind = \"phantom-1.5\"\ndevice = { substep = 3 }",
        &["unknown field `substep`"],
    ),
    ("no stiffness", "stiffness = 100.0", "", &["`material.stiffness` is missing", "young_modulus"]),
    (
        "stiffness twice",
        "stiffness = 100.0",
        "stiffness = 100.0\nyoung_modulus = 5e3",
        &["`material.young_modulus` and `material.stiffness` cannot both"],
    ),
    (
        "damping twice",
        "damping = 0.5",
        "damping = 0.5\ndamping_ratio = 0.1",
        &["`material.damping_ratio` and `material.damping` cannot both"],
    ),
    ("negative modulus", "stiffness = 100.0", "young_modulus = -1", &["material.young_modulus", "-1", "above 0"]),
    ("NaN modulus", "stiffness = 100.0", "young_modulus = nan", &["material.young_modulus", "NaN"]),
    ("negative ratio", "damping = 0.5", "damping_ratio = -0.1", &["material.damping_ratio", "-0.1", "at least 0"]),
    (
        "a modulus without shear stiffness",
        "stencil = \"shear\"",
        "stencil = \"structural\"",
        &["material.young_modulus", "no shear", "mesh.stencil", "material.stiffness"],
    ),
    (
        "identification of a block",
        "stiffness = 100.0",
        "young_modulus = 5e3\nidentification = \"lloyd\"",
        &["`material.identification` has no effect", "block"],
    ),
    (
        "identification without a modulus",
        "stiffness = 100.0",
        "stiffness = 100.0\nidentification = \"lloyd\"",
        &["`material.identification` has no effect", "material.stiffness"],
    ),
    ("settling without gravity", "duration = 1.2", "duration = 1.2\nsettle = true", &["`settle` has no effect", ":4:"]),
    ("settling of a number", "duration = 1.2", "duration = 1.2\nsettle = 1", &["settle", "true or false"]),
    (
        "settling of what floats",
        "duration = 1.2",
        "duration = 1.2\nsettle = true",
        &["node 0 is connected to no fixed node", "mesh.fixed", ":4:"],
    ),
    ("no nodes", "nodes = [9, 9, 4]", "", &["`mesh.nodes` is missing", "nodes along x, y and z"]),
    ("no spacing", "spacing = 0.0125", "", &["`mesh.spacing` is missing"]),
    ("a path of a block", "spacing = 0.0125", "path = \"x.msh\"\nspacing = 0.0125", &["`mesh.path` has no effect"]),
    ("a scaled block", "spacing = 0.0125", "scale = 1.0\nspacing = 0.0125", &["`mesh.scale` has no effect"]),
    ("a repaired block", "spacing = 0.0125", "repair = true\nspacing = 0.0125", &["`mesh.repair` has no effect"]),
    ("layers of a block", "spacing = 0.0125", "layers = 2\nspacing = 0.0125", &["`mesh.layers` has no effect"]),
    ("an anchored block", "spacing = 0.0125", "anchor = true\nspacing = 0.0125", &["`mesh.anchor` has no effect"]),
    ("nodes of a file", "kind = \"block\"", "kind = \"file\"\npath = \"x.msh\"", &["`mesh.nodes` has no effect"]),
    (
        "a spacing of a file",
        BLOCK,
        "kind = \"file\"\npath = \"x.msh\"\nspacing = 1.0",
        &["`mesh.spacing` has no effect", "mesh.kind = \"file\""],
    ),
    (
        "a stencil of a file",
        BLOCK,
        "kind = \"file\"\npath = \"x.msh\"\nstencil = \"shear\"",
        &["`mesh.stencil` has no effect"],
    ),
    ("no file", BLOCK, "kind = \"file\"", &["`mesh.path` is missing", ".vtu"]),
    ("a missing file", BLOCK, "kind = \"file\"\npath = \"none.msh\"", &["none.msh", "cannot be read", "relative to"]),
    ("a folder", BLOCK, "kind = \"file\"\npath = \".\"", &["cannot be read", "relative to"]),
    (
        "no mesh file",
        BLOCK,
        "kind = \"file\"\npath = \"scene.toml\"",
        &["not a mesh file by its extension", ".vtk, .vtu, .vtp"],
    ),
    ("a scale of zero", BLOCK, mesh_file!("solid-text.vtu", "scale = 0.0"), &["mesh.scale", "above 0"]),
    ("a scale of NaN", BLOCK, mesh_file!("solid-text.vtu", "scale = nan"), &["mesh.scale", "NaN"]),
    (
        "layers of a solid",
        BLOCK,
        mesh_file!("solid-text.vtu", "layers = 2"),
        &["`mesh.layers` has no effect", "tetrahedra"],
    ),
    ("an anchored solid", BLOCK, mesh_file!("solid-text.vtu", "anchor = false"), &["`mesh.anchor` has no effect"]),
    (
        "a depth in a solid",
        BLOCK,
        mesh_file!("solid-text.vtu", "layer_depth = 1.0"),
        &["`mesh.layer_depth` has no effect"],
    ),
    ("a node that is not there", BLOCK, mesh_file!("solid-text.vtu", "fixed = { nodes = [60] }"), &["node 60 of 60"]),
    ("no depth", BLOCK, mesh_file!("surface-meshio.vtu", "scale = 0.001"), &["`mesh.layer_depth` is missing"]),
    ("a depth of zero", BLOCK, mesh_file!("surface-meshio.vtu", "layer_depth = 0.0"), &["mesh.layer_depth", "above 0"]),
    (
        "no layers",
        BLOCK,
        mesh_file!("surface-meshio.vtu", "layer_depth = 1.0\nlayers = 0"),
        &["mesh.layers", "at least 1"],
    ),
    (
        "too many layers",
        BLOCK,
        mesh_file!("surface-meshio.vtu", "layer_depth = 1e-9\nlayers = 4000000000"),
        &["240000000060 nodes", "MiB"],
    ),
    (
        "too deep",
        BLOCK,
        mesh_file!("surface-meshio.vtu", "layer_depth = 0.05\nscale = 0.001"),
        &["0.05 m below the surface", "folds over", "smaller `mesh.layer_depth`"],
    ),
    ("not TOML", "duration = 1.2", "duration := 1.2", &[":3:"]),
];

#[test]
fn bad_scenes_end_with_code_2_one_message_and_no_folder() {
    let folder = Folder::new("bad-scenes");
    for (what, good, bad, words) in BAD {
        assert!(GOOD.contains(good), "{what}: the good scene has no {good:?}");
        let mut text = GOOD.replacen(good, bad, 1);
        if *what == "a dense matrix too large" {
            text = text.replace("rings = 1", "rings = 100");
        }
        if *what == "two threads that overwrite" {
            text = text.replace("\"replay\"", "\"overwrite\"");
        }
        if *what == "a modulus without shear stiffness" {
            text = text.replace("stiffness = 100.0", "young_modulus = 5e3");
        }
        if *what == "settling of what floats" {
            text =
                text.replace("\"bottom\"", "\"none\"").replace("[material]", "[material]\ngravity = [0.0, 0.0, -9.81]");
        }
        let scene = folder.write("scene.toml", &text);
        let out = folder.path("out");
        let output = run(&scene, &out);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{what}: {message}");
        assert!(!out.exists(), "{what}: a folder was left");
        assert_eq!(message.matches('×').count(), 1, "{what}: one error\n{message}");
        // The words may be wrapped by the terminal.
        let flat = message.replace("\n  │", "").split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(flat.contains("scene.toml:"), "{what}: no file, line and column\n{message}");
        for word in *words {
            assert!(flat.contains(word), "{what}: {word:?} is not in\n{message}");
        }
        assert!(output.stdout.is_empty(), "{what}");
    }
}

/// A body in mm that is mistaken for one in m.
#[test]
fn a_unit_in_doubt_is_a_warning() {
    let folder = Folder::new("units");
    let mesh = mesh_file!("solid-2.2-bytes.msh", "fixed = { below_z = -10.0 }");
    let scene = folder.write("scene.toml", &GOOD.replacen(BLOCK, mesh, 1).replace("duration = 1.2", "duration = 0.1"));
    let output = run(&scene, &folder.path("out"));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).starts_with("Warning: the mesh is 4e1 m large"), "{}", stderr(&output));
    assert!(stderr(&output).contains("`mesh.scale = 0.001`"), "{}", stderr(&output));
    let explained = stickslip(&["explain", &scene.display().to_string()]);
    let text = String::from_utf8_lossy(&explained.stdout).into_owned();
    assert!(text.contains("Warning: the mesh is 4e1 m large") && text.contains("60 nodes"), "{text}");
    assert_eq!(stderr(&explained), "", "warned of once");
    folder.write(
        "scene.toml",
        &fs::read_to_string(&scene).expect("a scene").replace("fixed =", "scale = 0.001\nfixed ="),
    );
    assert!(!stderr(&run(&scene, &folder.path("out"))).contains("the mesh is"));
}

#[test]
fn missing_files_are_named() {
    let folder = Folder::new("missing");
    let out = folder.path("out");
    let output = run(&folder.path("none.toml"), &out);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("none.toml") && stderr(&output).contains("fig5-stick-slip"));
    let output = stickslip(&["run", "fig5-stickslip"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("did you mean `fig5-stick-slip`?"), "{}", stderr(&output));
    let text = GOOD
        .replace("kind = \"path\" ", "kind = \"recording\"\nfile = \"none.csv\" ")
        .replace("waypoints", "# waypoints");
    let output = run(&folder.write("scene.toml", &text), &out);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("none.csv"), "{}", stderr(&output));
    assert!(!out.exists());
}

/// Programs find the cause of an error as its source, whatever the error is wrapped in.
#[test]
fn errors_keep_their_sources() {
    fn kind(error: &dyn Error) -> Option<io::ErrorKind> {
        let source = error.source()?;
        source.downcast_ref::<io::Error>().map(io::Error::kind).or_else(|| kind(source))
    }
    let folder = Folder::new("sources");
    let file = folder.write("file", "");
    let missing = folder.path("missing.vtk");
    let scene = folder.write("scene.toml", &GOOD.replace(BLOCK, &format!("kind = \"file\"\npath = {missing:?}")));
    let found = [
        kind(&Scene::load(&missing).expect_err("no scene")),
        kind(&Scene::load(&scene).expect_err("no mesh")),
        kind(&MeshFile::read(&missing, 1 << 20).expect_err("no mesh")),
        kind(&Session::load(&missing).expect_err("no session")),
    ];
    assert_eq!(found, [Some(io::ErrorKind::NotFound); 4]);
    let found = [
        kind(&Store::Folder(file.clone()).load("below").expect_err("a file is no folder")),
        kind(&write_file(&file.join("below"), b"").expect_err("a file is no folder")),
    ];
    assert_eq!(found, [Some(io::ErrorKind::NotADirectory); 2]);
    let baseline = folder.write("empty.json", "{}");
    let baselines = Path::parent(&baseline).expect("a folder").to_owned();
    assert!(Store::Folder(baselines).load("empty").expect_err("no baseline").source().is_some());
}
