//! All keys of a scene with their accepted values: one table for error messages and documentation.

use super::Schedule;
use super::words::*;
use crate::contact::rules::Deformation;
use crate::device::path::Interpolation;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::FarField;
use crate::local::step::LocalIntegrator;
use crate::model::material::Identification;
use crate::model::mesh::Stencil;
use crate::model::springs::TangentKind;
use crate::multirate::global::SyncMode;
use crate::multirate::timeline::OverrunPolicy;
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;

use Accepts::{Table, Text, Words};

/// The accepted values of a key.
enum Accepts {
    /// Values as described.
    Text(&'static str),
    /// One of some words, of which one may be the default; then further conditions.
    Words(&'static [&'static str], fn() -> Option<&'static str>, &'static str),
    /// A table of the keys that begin with this one; then further conditions.
    Table(&'static str),
}

/// Builds an entry from the words of an enum that has a default.
macro_rules! words {
    ($type:ty, $more:literal) => {
        Words(&<$type>::NAMES, || Some(<$type>::default().name()), $more)
    };
}

/// Keys and their accepted values, in the order of a scene file.
const KEYS: &[(&str, Accepts)] = &[
    ("name", Text("letters, digits, `-`, `_` and `.`, starting with a letter or digit; it names the output folder")),
    ("duration", Text("a finite number above 0, in s, that is a whole number of ticks of `local.rate`")),
    (
        "settle",
        Text(
            "true or false (default): whether the network starts in equilibrium under `material.gravity`, which it then needs",
        ),
    ),
    ("mesh", Text("a table with `nodes` and `spacing`, or with `kind = \"file\"` and `path`")),
    ("mesh.kind", words!(MeshKind, ": tetrahedra, or a closed surface of triangles")),
    ("mesh.nodes", Text("three whole numbers of at least 2: nodes along x, y and z; only with `kind = \"block\"`")),
    ("mesh.spacing", Text("a finite number of at least 1e-6, in m; only with `kind = \"block\"`")),
    (
        "mesh.stencil",
        words!(Stencil, ": edges, face diagonals too, or body diagonals too; only with `kind = \"block\"`"),
    ),
    (
        "mesh.path",
        Text(
            "a file of Gmsh (.msh), VTK (.vtk legacy, .vtu, .vtp), STL, OBJ or PLY, relative to the scene; only with `kind = \"file\"`",
        ),
    ),
    (
        "mesh.scale",
        Text(
            "a finite number above 0: m for a unit of the file, 0.001 for one in mm (default 1); only with `kind = \"file\"`",
        ),
    ),
    (
        "mesh.layers",
        Text(
            "a whole number of at least 1 (default 1): copies of a surface below it, joined by springs; only with a file that has triangles alone",
        ),
    ),
    (
        "mesh.layer_depth",
        Text(
            "a finite number above 0, in m: from one layer to the next, along the inward normals; required with a file that has triangles alone, only allowed there",
        ),
    ),
    (
        "mesh.anchor",
        Text("true (default) or false: the innermost layer is fixed; only with a file that has triangles alone"),
    ),
    (
        "mesh.repair",
        Text(
            "true or false (default): parts of the body that touch only at a node or an edge are separated there, instead of refused; only with `kind = \"file\"`",
        ),
    ),
    (
        "mesh.fixed",
        Text(
            "\"bottom\" (default without `anchor`: a block's lowest layer, or a file's nodes within 1e-6 of its diagonal from the lowest z), \"none\" (default with it), { below_z = a finite number in m } or { nodes = [indices below the number of nodes] }",
        ),
    ),
    (
        "material",
        Text("a table with `node_mass` or `density`, `stiffness` or `young_modulus`, and `damping` or `damping_ratio`"),
    ),
    (
        "material.node_mass",
        Text("a finite number above 0, in kg, or a list of one per node; not together with `density`"),
    ),
    (
        "material.density",
        Text("a finite number above 0, in kg/m³, or a list of one per node; not together with `node_mass`"),
    ),
    (
        "material.stiffness",
        Text("a finite number above 0, in N/m, for every spring; not together with `young_modulus`"),
    ),
    (
        "material.young_modulus",
        Text(
            "a finite number above 0, in Pa, from which every spring gets its stiffness (Poisson's ratio is 1/4); not with \
         `mesh.stencil = \"structural\"`, nor together with `stiffness`",
        ),
    ),
    (
        "material.identification",
        words!(Identification, ": springs from `young_modulus` in a mesh of tetrahedra; a block's are exact"),
    ),
    (
        "material.damping",
        Text("a finite number of at least 0, in N·s/m, for every spring; not together with `damping_ratio`"),
    ),
    (
        "material.damping_ratio",
        Text(
            "a finite number of at least 0: c = 2ζ√(k m), with 1/m = 1/m_i + 1/m_j of the spring's two nodes; not together with `damping`",
        ),
    ),
    ("material.drag", Text("a finite number of at least 0, in N·s/m (default 0)")),
    ("material.gravity", Text("three finite numbers, in m/s² (default [0, 0, 0])")),
    ("global", Table("")),
    ("global.rate", Text("a finite number above 0, in Hz, of which `local.rate` is a whole multiple (default 10)")),
    ("global.integrator", words!(GlobalIntegrator, "")),
    ("global.substeps", Text("a whole number of at least 1: equal steps per cycle (default 100)")),
    (
        "global.threads",
        Text(
            "1 (default) or 2, which share a network of at least 8,192 springs and change no bit of a result; with `integrator = \"semi-implicit-euler\"` and `sync.mode = \"replay\"`; beside `run.schedule = \"threads\"` a third processor is wanted",
        ),
    ),
    ("local", Table("")),
    ("local.rate", Text("a finite number above 0, in Hz, that is a whole multiple of `global.rate` (default 1000)")),
    ("local.model", words!(LocalModelName, "")),
    ("local.rings", Text("a whole number of at least 1 (default 1) or \"all\"; only with `model = \"patch\"`")),
    ("local.linearization", words!(LinearizationName, "; only with `model = \"patch\"`")),
    ("local.exterior", words!(ExteriorName, "; only with `model = \"patch\"` and a number of `rings`")),
    ("local.tangent", words!(TangentKind, "; only with `linearization = \"tangent\"` or `exterior = \"condensed\"`")),
    (
        "local.condense_rings",
        Text("a whole number above `rings`, or \"all\" (default); only with `exterior = \"condensed\"`"),
    ),
    ("local.far_field", words!(FarField, ": the exterior beyond `condense_rings`; only with a number of these")),
    (
        "local.integrator",
        words!(
            LocalIntegrator,
            "; all but the first only with `linearization = \"tangent\"` and `contact.scheme = \"velocity\"` or `\"massless\"`"
        ),
    ),
    (
        "local.library",
        Text(
            "a shared library with a renderer, relative to the scene; required with `model = \"external\"`, only allowed there",
        ),
    ),
    ("local.options", Text("a text that the renderer interprets (default empty); only with `model = \"external\"`")),
    ("contact", Text("a table with `law`")),
    ("contact.law", Words(&LawName::NAMES, || None, "")),
    (
        "contact.friction",
        Text(
            "a finite number of at least 0, or { static, kinetic } with `static` at least `kinetic`; required with `law = \"stick-slip\"`, only allowed there",
        ),
    ),
    (
        "contact.friction.static",
        Text("a finite number of at least `contact.friction.kinetic`: up to it a contact sticks"),
    ),
    ("contact.friction.kinetic", Text("a finite number of at least 0: that of a slipping contact")),
    (
        "contact.adhesion",
        Text(
            "a number of at least 0, in N (default 0): the tension that a contact bears; inf with `law = \"sticking\"`: it never ends",
        ),
    ),
    ("contact.scheme", words!(SchemeName, "")),
    ("contact.surface", words!(ContactSurface, "")),
    (
        "contact.radius",
        Text(
            "a finite number of at least 0, in m (default 0: a point): a Hertzian pressure of this radius spreads the contact; it may reach 512 nodes",
        ),
    ),
    ("contact.deformation", words!(Deformation, "; only with `scheme = \"geometric\"`")),
    ("contact.metric", words!(Metric, "; only with `scheme = \"geometric\"`")),
    ("contact.wall_stiffness", Text("a finite number of at least 0, in N/m (default 1000)")),
    ("contact.wall_damping", Text("a finite number of at least 0, in N·s/m (default 0)")),
    ("instrument", Text("a table with `waypoints`, or with `kind = \"recording\"` and `file`")),
    ("instrument.kind", words!(InstrumentName, ": the last a modelled device in a hand")),
    (
        "instrument.waypoints",
        Text(
            "a list of at least one [t, x, y, z], finite, in s and m, with ascending t: the tip, or what the hand of a device aims at; not with `file`",
        ),
    ),
    (
        "instrument.file",
        Text(
            "a CSV file with the header t,x,y,z, in s and m, with ascending t, relative to the scene: the tip with `kind = \"recording\"`, what the hand aims at with `kind = \"phantom-1.5\"`",
        ),
    ),
    (
        "instrument.columns",
        Text(
            "four names of columns of `file`, for time and position (default [\"t\", \"x\", \"y\", \"z\"], and no others in the file)",
        ),
    ),
    ("instrument.scale", Text("a finite number above 0, in m (default 1): length of the unit of `file`; 0.001 for mm")),
    (
        "instrument.time_scale",
        Text("a finite number above 0, in s (default 1): duration of the unit of time of `file`; 0.001 for ms"),
    ),
    (
        "instrument.start",
        Text("a finite number, in s (default 0): time in `file`, after `time_scale`, at which the scene starts"),
    ),
    (
        "instrument.filter_hz",
        Text(
            "a finite number above 0, in Hz: a low-pass without phase lag halves this frequency in `file`; without it nothing is filtered",
        ),
    ),
    ("instrument.interpolation", words!(Interpolation, ": between waypoints")),
    (
        "instrument.force_limit",
        Text(
            "a finite number above 0, in N (default 850): a contact force above it ends the run with a fault; not with `kind = \"phantom-1.5\"`, whose limit is a hundred times `device.largest_force`",
        ),
    ),
    (
        "instrument.smoothing_ticks",
        Text(
            "a whole number (default 0): ticks over which the force's jump at a hand-over fades; only with `local.model = \"patch\"`",
        ),
    ),
    (
        "instrument.passivity_control",
        Text(
            "true or false (default): a damper takes what the simulation would give out; only with `kind = \"phantom-1.5\"`",
        ),
    ),
    ("instrument.device", Table("; only with `kind = \"phantom-1.5\"`")),
    (
        "instrument.device.tip",
        Text(
            "\"quantised\" (default but with `contact.scheme = \"massless\"`): contact sees the encoders' reading; or \"observed\" (default with it): an estimate finer than a count, with its velocity",
        ),
    ),
    (
        "instrument.device.rotation",
        Text(
            "three rows of three numbers: a rotation, scene directions in device axes (x right, y up, z to the user; default [[1, 0, 0], [0, 0, 1], [0, -1, 0]])",
        ),
    ),
    (
        "instrument.device.offset",
        Text("three finite numbers: the scene's origin in device axes, in m (default [0, 0, 0])"),
    ),
    (
        "instrument.device.joint_friction",
        Text("three finite numbers of at least 0, in N·m (default [0.0086, 0.0086, 0.0068])"),
    ),
    (
        "instrument.device.friction_speed",
        Text("a finite number above 0, in rad/s: a joint this fast has tanh 1 of its friction (default 0.01)"),
    ),
    (
        "instrument.device.joint_damping",
        Text("a finite number of at least 0, in N·m·s/rad, of every joint (default 0.0005)"),
    ),
    (
        "instrument.device.rotor_inertia",
        Text("three finite numbers of at least 0, in kg·m² at the joints (default [0, 0, 0])"),
    ),
    ("instrument.device.capstan_ratio", Text("three finite numbers above 0 (default [13.3, 11.2, 11.2])")),
    ("instrument.device.torque_constant", Text("a finite number above 0, in N·m/A (default 0.0234)")),
    ("instrument.device.largest_current", Text("a finite number above 0, in A (default 5.5)")),
    ("instrument.device.torque_bits", Text("a whole number of at most 32 (default 16); 0: currents are not quantised")),
    (
        "instrument.device.encoder_counts",
        Text("a whole number, per turn of a motor (default 4096); 0: angles are not quantised"),
    ),
    ("instrument.device.amplifier_bandwidth", Text("a finite number above 0, in Hz (default 1000)")),
    ("instrument.device.largest_force", Text("a finite number above 0, in N (default 8.5)")),
    (
        "instrument.device.substeps",
        Text("a whole number of at least 1, large enough for its fastest motion (default 10)"),
    ),
    (
        "instrument.device.structure",
        Table(": a spring between the links, which the encoders measure, and the tip in the hand (without it, rigid)"),
    ),
    ("instrument.device.structure.stiffness", Text("a finite number above 0, in N/m (default 3500)")),
    (
        "instrument.device.structure.tip_mass",
        Text("a finite number above 0, in kg, in addition to the links (default 0.01)"),
    ),
    (
        "instrument.device.structure.damping_ratio",
        Text("a finite number of at least 0, of the tip against links that are held (default 0.05)"),
    ),
    ("instrument.hand", Table(" along the device's axes; only with `kind = \"phantom-1.5\"`")),
    ("instrument.hand.mass", Text("three finite numbers above 0, in kg (default [0.218, 0.269, 0.204])")),
    (
        "instrument.hand.stylus_stiffness",
        Text("three finite numbers of at least 0, in N/m (default [379.5, 552.4, 769.9])"),
    ),
    (
        "instrument.hand.stylus_damping",
        Text("three finite numbers of at least 0, in N·s/m (default [1.839, 3.609, 0.776])"),
    ),
    (
        "instrument.hand.arm_stiffness",
        Text("three finite numbers of at least 0, in N/m (default [78.75, 105.3, 271.7])"),
    ),
    (
        "instrument.hand.arm_damping",
        Text("three finite numbers of at least 0, in N·s/m (default [4.645, 6.430, 18.06])"),
    ),
    ("instrument.coupling", Table(" of a virtual coupling; only with `kind = \"phantom-1.5\"` (without it, none)")),
    ("instrument.coupling.stiffness", Text("a finite number above 0, in N/m (default 500)")),
    ("instrument.coupling.damping", Text("a finite number of at least 0, in N·s/m (default 2)")),
    (
        "instrument.coupling.mass",
        Text("a finite number above (h²k + 2hb)/4, in kg, with stiffness k, damping b and a tick of h (default 0.05)"),
    ),
    ("sync", Table("")),
    ("sync.mode", words!(SyncMode, "")),
    ("sync.latency_ticks", Text("a whole number from 0 (default) to less than the ticks of one global cycle")),
    ("run", Table("")),
    ("run.schedule", words!(Schedule, ": virtual or real time")),
    ("timing", Table("")),
    (
        "timing.tick_cost",
        Text(
            "what a tick takes in virtual time, s: a finite number of at least 0; a list of them; { median, p99 } (log-normal); or { usual, rare, share } (default 0)",
        ),
    ),
    ("timing.model_cost", Text("the same for a cycle of the global side, from its boundary to its model (default 0)")),
    ("timing.deadline", Text("a finite number above 0, at most a tick, in s (default a tick)")),
    ("timing.overrun", words!(OverrunPolicy, ": what a tick without its force by the deadline does")),
    ("timing.seed", Text("a whole number (default 0)")),
];

/// Returns a phrase for the accepted values of a key.
pub fn accepted(key: &str) -> Option<String> {
    let (_, accepts) = KEYS.iter().find(|(known, _)| *known == key)?;
    Some(match accepts {
        Text(text) => (*text).to_owned(),
        Words(names, default, more) => {
            let default = default();
            let note = |name| if default == Some(name) { " (default)" } else { "" };
            let quoted: Vec<String> = names.iter().map(|&name| format!("{name:?}{}", note(name))).collect();
            let (last, first) = quoted.split_last()?;
            format!("{} or {last}{more}", first.join(", "))
        }
        Table(more) => format!("a table of `{}`{more}", known_words(key).join("`, `")),
    })
}

/// Returns the words that a key accepts, or the keys of a table (of the scene, for an empty key).
pub fn known_words(key: &str) -> Vec<&'static str> {
    if let Some((_, Words(names, ..))) = KEYS.iter().find(|(known, _)| *known == key) {
        return names.to_vec();
    }
    let within = |known: &'static str| match key {
        "" => Some(known),
        table => known.strip_prefix(table)?.strip_prefix('.'),
    };
    KEYS.iter().filter_map(|(known, _)| within(known)).filter(|known| !known.contains('.')).collect()
}
