//! Every key of a scene and what it accepts: one table for error messages and documentation.

/// (key, accepted values), in the order of a scene file.
pub const KEYS: &[(&str, &str)] = &[
    ("name", "letters, digits, `-`, `_` and `.`, starting with a letter or digit; it names the output folder"),
    ("duration", "a finite number above 0, in s, that is a whole number of ticks of `local.rate`"),
    (
        "settle",
        "true or false (default): whether the network starts in equilibrium under `material.gravity`, which it then needs",
    ),
    ("mesh", "a table with `nodes` and `spacing`, or with `kind = \"file\"` and `path`"),
    ("mesh.kind", "\"block\" (default) or \"file\" (tetrahedra, or a closed surface of triangles)"),
    ("mesh.nodes", "three whole numbers of at least 2: nodes along x, y and z; only with `kind = \"block\"`"),
    ("mesh.spacing", "a finite number of at least 1e-6, in m; only with `kind = \"block\"`"),
    (
        "mesh.stencil",
        "\"structural\" (edges), \"shear\" (and face diagonals; default) or \"full\" (and body diagonals); only with `kind = \"block\"`",
    ),
    (
        "mesh.path",
        "a Gmsh file (.msh, version 2.2 or 4.1) or a VTK one (.vtk legacy, .vtu), relative to the scene; only with `kind = \"file\"`",
    ),
    (
        "mesh.scale",
        "a finite number above 0: m for a unit of the file, 0.001 for one in mm (default 1); only with `kind = \"file\"`",
    ),
    (
        "mesh.layers",
        "a whole number of at least 1 (default 1): copies of a surface below it, joined by springs; only with a file that has triangles alone",
    ),
    (
        "mesh.layer_depth",
        "a finite number above 0, in m: from one layer to the next, along the inward normals; required with a file that has triangles alone, only allowed there",
    ),
    ("mesh.anchor", "true (default) or false: the innermost layer is fixed; only with a file that has triangles alone"),
    (
        "mesh.fixed",
        "\"bottom\" (default without `anchor`: a block's lowest layer, or a file's nodes within 1e-6 of its diagonal from the lowest z), \"none\" (default with it), { below_z = a finite number in m } or { nodes = [indices below the number of nodes] }",
    ),
    (
        "material",
        "a table with `node_mass` or `density`, `stiffness` or `young_modulus`, and `damping` or `damping_ratio`",
    ),
    ("material.node_mass", "a finite number above 0, in kg, or a list of one per node; not together with `density`"),
    ("material.density", "a finite number above 0, in kg/m³, or a list of one per node; not together with `node_mass`"),
    ("material.stiffness", "a finite number above 0, in N/m, for every spring; not together with `young_modulus`"),
    (
        "material.young_modulus",
        "a finite number above 0, in Pa, from which every spring gets its stiffness (Poisson's ratio is 1/4); not with \
         `mesh.stencil = \"structural\"`, nor together with `stiffness`",
    ),
    (
        "material.identification",
        "\"van-gelder\" (default) or \"lloyd\": springs from `young_modulus` in a mesh of tetrahedra; a block's are exact",
    ),
    (
        "material.damping",
        "a finite number of at least 0, in N·s/m, for every spring; not together with `damping_ratio`",
    ),
    (
        "material.damping_ratio",
        "a finite number of at least 0: c = 2ζ√(k m), with 1/m = 1/m_i + 1/m_j of the spring's two nodes; not together with `damping`",
    ),
    ("material.drag", "a finite number of at least 0, in N·s/m (default 0)"),
    ("material.gravity", "three finite numbers, in m/s² (default [0, 0, 0])"),
    ("global", "a table of `rate`, `integrator`, `substeps`, `threads`"),
    ("global.rate", "a finite number above 0, in Hz, of which `local.rate` is a whole multiple (default 10)"),
    ("global.integrator", "\"semi-implicit-euler\" (default), \"implicit-euler\" or \"rk4\""),
    ("global.substeps", "a whole number of at least 1: equal steps per cycle (default 100)"),
    (
        "global.threads",
        "1 (default) or 2, which share a network of at least 8,192 springs and change no bit of a result; with `integrator = \"semi-implicit-euler\"` and `sync.mode = \"replay\"`; beside `run.schedule = \"threads\"` a third processor is wanted",
    ),
    (
        "local",
        "a table of `rate`, `model`, `rings`, `linearization`, `exterior`, `tangent`, `condense_rings`, `far_field`, `integrator`",
    ),
    ("local.rate", "a finite number above 0, in Hz, that is a whole multiple of `global.rate` (default 1000)"),
    ("local.model", "\"patch\" (default) or \"full\""),
    ("local.rings", "a whole number of at least 1 (default 1) or \"all\"; only with `model = \"patch\"`"),
    ("local.linearization", "\"tangent\" (default) or \"none\"; only with `model = \"patch\"`"),
    (
        "local.exterior",
        "\"fixed\" (default), \"drifting\" or \"condensed\"; only with `model = \"patch\"` and a number of `rings`",
    ),
    (
        "local.tangent",
        "\"exact\" (default) or \"stabilised\"; only with `linearization = \"tangent\"` or `exterior = \"condensed\"`",
    ),
    (
        "local.condense_rings",
        "a whole number above `rings`, or \"all\" (default); only with `exterior = \"condensed\"`",
    ),
    (
        "local.far_field",
        "\"fixed\" (default) or \"coarse\": the exterior beyond `condense_rings`; only with a number of these",
    ),
    (
        "local.integrator",
        "\"semi-implicit-euler\" (default), \"implicit-euler\", \"implicit-midpoint\" or \"exponential\"; but the first only with `linearization = \"tangent\"` and `contact.scheme = \"velocity\"`",
    ),
    ("contact", "a table with `law`"),
    ("contact.law", "\"sliding\", \"sticking\" or \"stick-slip\""),
    ("contact.friction", "a finite number of at least 0; required with `law = \"stick-slip\"`, only allowed there"),
    ("contact.scheme", "\"geometric\" (default) or \"velocity\""),
    ("contact.surface", "\"faceted\" (default), \"shaded\" or \"subdivision\""),
    ("contact.deformation", "\"rigid\" (default) or \"least-norm\"; only with `scheme = \"geometric\"`"),
    ("contact.metric", "\"euclidean\" (default) or \"mass\"; only with `scheme = \"geometric\"`"),
    ("contact.wall_stiffness", "a finite number of at least 0, in N/m (default 1000)"),
    ("contact.wall_damping", "a finite number of at least 0, in N·s/m (default 0)"),
    ("instrument", "a table with `waypoints`, or with `kind = \"recording\"` and `file`"),
    ("instrument.kind", "\"path\" (default), \"recording\" or \"phantom-1.5\" (a modelled device in a hand)"),
    (
        "instrument.waypoints",
        "a list of at least one [t, x, y, z], finite, in s and m, with ascending t: the tip, or what the hand of a device aims at; not with `kind = \"recording\"`",
    ),
    (
        "instrument.file",
        "a CSV file with the header t,x,y,z, in s and m, with ascending t, relative to the scene; only with `kind = \"recording\"`",
    ),
    (
        "instrument.smoothing_ticks",
        "a whole number (default 0): ticks over which the force's jump at a hand-over fades; only with `local.model = \"patch\"`",
    ),
    (
        "instrument.passivity_control",
        "true or false (default): a damper takes what the simulation would give out; only with `kind = \"phantom-1.5\"`",
    ),
    (
        "instrument.device",
        "a table of `rotation`, `offset`, `joint_friction`, `friction_speed`, `joint_damping`, `rotor_inertia`, `capstan_ratio`, `torque_constant`, `largest_current`, `torque_bits`, `encoder_counts`, `amplifier_bandwidth`, `largest_force`, `substeps`; only with `kind = \"phantom-1.5\"`",
    ),
    (
        "instrument.device.rotation",
        "three rows of three numbers: a rotation, scene directions in device axes (x right, y up, z to the user; default [[1, 0, 0], [0, 0, 1], [0, -1, 0]])",
    ),
    ("instrument.device.offset", "three finite numbers: the scene's origin in device axes, in m (default [0, 0, 0])"),
    (
        "instrument.device.joint_friction",
        "three finite numbers of at least 0, in N·m (default [0.0086, 0.0086, 0.0068])",
    ),
    (
        "instrument.device.friction_speed",
        "a finite number above 0, in rad/s: a joint this fast has tanh 1 of its friction (default 0.01)",
    ),
    ("instrument.device.joint_damping", "a finite number of at least 0, in N·m·s/rad, of every joint (default 0.0005)"),
    (
        "instrument.device.rotor_inertia",
        "three finite numbers of at least 0, in kg·m² at the joints (default [0, 0, 0])",
    ),
    ("instrument.device.capstan_ratio", "three finite numbers above 0 (default [13.3, 11.2, 11.2])"),
    ("instrument.device.torque_constant", "a finite number above 0, in N·m/A (default 0.0234)"),
    ("instrument.device.largest_current", "a finite number above 0, in A (default 5.5)"),
    ("instrument.device.torque_bits", "a whole number of at most 32 (default 16); 0: currents are not quantised"),
    (
        "instrument.device.encoder_counts",
        "a whole number, per turn of a motor (default 4096); 0: angles are not quantised",
    ),
    ("instrument.device.amplifier_bandwidth", "a finite number above 0, in Hz (default 1000)"),
    ("instrument.device.largest_force", "a finite number above 0, in N (default 8.5)"),
    ("instrument.device.substeps", "a whole number of at least 1, large enough for its fastest motion (default 10)"),
    (
        "instrument.hand",
        "a table of `mass`, `stylus_stiffness`, `stylus_damping`, `arm_stiffness`, `arm_damping`, along the device's axes; only with `kind = \"phantom-1.5\"`",
    ),
    ("instrument.hand.mass", "three finite numbers above 0, in kg (default [0.218, 0.269, 0.204])"),
    ("instrument.hand.stylus_stiffness", "three finite numbers of at least 0, in N/m (default [379.5, 552.4, 769.9])"),
    ("instrument.hand.stylus_damping", "three finite numbers of at least 0, in N·s/m (default [1.839, 3.609, 0.776])"),
    ("instrument.hand.arm_stiffness", "three finite numbers of at least 0, in N/m (default [78.75, 105.3, 271.7])"),
    ("instrument.hand.arm_damping", "three finite numbers of at least 0, in N·s/m (default [4.645, 6.430, 18.06])"),
    (
        "instrument.coupling",
        "a table of `stiffness`, `damping`, `mass` of a virtual coupling; only with `kind = \"phantom-1.5\"` (without it, none)",
    ),
    ("instrument.coupling.stiffness", "a finite number above 0, in N/m (default 500)"),
    ("instrument.coupling.damping", "a finite number of at least 0, in N·s/m (default 2)"),
    (
        "instrument.coupling.mass",
        "a finite number above (h²k + 2hb)/4, in kg, with stiffness k, damping b and a tick of h (default 0.05)",
    ),
    ("sync", "a table of `mode`, `latency_ticks`"),
    ("sync.mode", "\"replay\" (default) or \"overwrite\""),
    ("sync.latency_ticks", "a whole number from 0 (default) to less than the ticks of one global cycle"),
    ("run", "a table of `schedule`"),
    ("run.schedule", "\"lockstep\" (virtual time; default) or \"threads\" (real time)"),
    ("timing", "a table of `tick_cost`, `model_cost`, `deadline`, `overrun`, `seed`"),
    (
        "timing.tick_cost",
        "what a tick takes in virtual time, s: a finite number of at least 0; a list of them; { median, p99 } (log-normal); or { usual, rare, share } (default 0)",
    ),
    ("timing.model_cost", "the same for a cycle of the global side, from its boundary to its model (default 0)"),
    ("timing.deadline", "a finite number above 0, at most a tick, in s (default a tick)"),
    ("timing.overrun", "\"hold\" (default), \"zero\" or \"skip\": what a tick without its force by the deadline does"),
    ("timing.seed", "a whole number (default 0)"),
];

/// What a key accepts.
pub fn accepted(key: &str) -> Option<&'static str> {
    KEYS.iter().find(|(known, _)| *known == key).map(|(_, accepted)| *accepted)
}
