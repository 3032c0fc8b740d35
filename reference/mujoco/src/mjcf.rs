//! A network as a MuJoCo model.
//!
//! - A free node is a body with its mass and three slide joints. Their `ref` is the rest position,
//!   so that `qpos` holds absolute coordinates: x, y, z of one free node after the other.
//! - A fixed node is a site of the world.
//! - A spring is a spatial tendon between two sites, with both ends of `springlength` at its rest
//!   length: it pulls and pushes.
//! - Gravity is the option of that name, drag the joints' damping.
//! - A contact point enters by [`PointTendon`]s.
//!
//! Contacts, the implicit treatment of joint damping by MuJoCo's Euler integrator and the automatic
//! reset of a diverging state are switched off. The solver is PGS: the rows of one contact point are
//! uncoupled, so that its first sweep is exact, where the line search of MuJoCo's default, Newton,
//! stalls on hard friction.

use std::fmt::Write;

use stickslip::Vec3;
use stickslip::model::network::Network;
use stickslip::model::state::ExternalForce;

/// MuJoCo's name of an integration scheme.
#[derive(Debug, Clone, Copy)]
pub enum Integrator {
    /// v ← v + h M⁻¹f, x ← x + h v.
    Euler,
    /// The classical fourth-order Runge–Kutta method.
    Rk4,
    /// (M + hD + h²K)(v⁺ − v) = h(f − hKv), x ← x + h v⁺, with K and D of joints and tendons along themselves only:
    /// what a tendon pulls with across when it turns, its geometric stiffness, is not in K. A tendon of exactly its
    /// `springlength` has no K: it is in its dead band.
    Discrete,
}

/// A coordinate of a contact point, Σ wᵢ xᵢ·direction over its free nodes, and what constrains it.
#[derive(Debug, Clone)]
pub struct PointTendon<'a> {
    /// Nodes and their weights; fixed nodes are left out of the sum.
    pub support: &'a [(usize, f64)],
    /// The direction of the coordinate.
    pub direction: Vec3,
    /// What acts on it.
    pub constraint: TendonConstraint,
}

/// What constrains the length of a [`PointTendon`].
#[derive(Debug, Clone, Copy)]
pub enum TendonConstraint {
    /// It keeps its length at rest.
    Equality,
    /// Dry friction of at most this force, N.
    FrictionLoss(f64),
    /// It does not become longer than this, m.
    UpperLimit(f64),
}

/// Impedance of every constraint, the same at every distance: the hardest that MuJoCo has.
/// A constraint is then softened by R = (1 − d)/d Â, with Â MuJoCo's estimate of A = WM⁻¹Wᵀ.
const IMPEDANCE: &str = "0.9999 0.9999 0.001 0.5 1";

/// Writes the model. Numbers are in shortest round-trip form: MuJoCo reads the same bits.
pub fn write(network: &Network, integrator: Integrator, timestep: f64, tendons: &[PointTendon]) -> String {
    let mut gravity = Vec3::zeros();
    let mut drag = 0.0;
    for force in &network.external {
        match force {
            ExternalForce::Gravity(g) => gravity += g,
            ExternalForce::Drag(b) => drag += b,
        }
    }
    // PGS leaves hD + h²K out without a word.
    let (integrator, solver) = match integrator {
        Integrator::Euler => ("Euler", "PGS"),
        Integrator::Rk4 => ("RK4", "PGS"),
        Integrator::Discrete => ("discrete", "Newton"),
    };
    let gravity = triple(gravity);
    let mut world = String::new();
    for node in 0..network.node_count() {
        write_node(&mut world, network, node, drag);
    }
    let mut paths = String::new();
    for spring in network.springs.iter() {
        let [i, j] = spring.nodes;
        if network.fixed[i as usize] && network.fixed[j as usize] {
            continue;
        }
        let (k, c, rest) = (spring.stiffness, spring.damping, spring.rest_length);
        writeln!(
            paths,
            r#"<spatial stiffness="{k}" damping="{c}" springlength="{rest} {rest}"><site site="s{i}"/><site site="s{j}"/></spatial>"#
        )
        .expect("writing to a string");
    }
    let mut equalities = String::new();
    for (index, tendon) in tendons.iter().enumerate() {
        write_tendon(&mut paths, &mut equalities, network, index, tendon);
    }
    format!(
        r#"<mujoco>
<compiler autolimits="false"/>
<size memory="16M"/>
<option integrator="{integrator}" timestep="{timestep}" gravity="{gravity}" jacobian="dense" solver="{solver}" tolerance="0">
<flag contact="disable" eulerdamp="disable" autoreset="disable"/>
</option>
<worldbody>
{world}</worldbody>
<tendon>
{paths}</tendon>
<equality>
{equalities}</equality>
</mujoco>
"#
    )
}

fn triple(v: Vec3) -> String {
    format!("{} {} {}", v.x, v.y, v.z)
}

fn write_node(world: &mut String, network: &Network, node: usize, drag: f64) {
    let rest = network.rest[node];
    let position = triple(rest);
    if network.fixed[node] {
        writeln!(world, r#"<site name="s{node}" pos="{position}"/>"#).expect("writing to a string");
        return;
    }
    let mass = network.mass[node];
    let mut joints = String::new();
    for (axis, (name, reference)) in ["x", "y", "z"].into_iter().zip(rest.iter()).enumerate() {
        let mut direction = Vec3::zeros();
        direction[axis] = 1.0;
        let direction = triple(direction);
        write!(
            joints,
            r#"<joint name="j{node}{name}" type="slide" axis="{direction}" ref="{reference}" damping="{drag}"/>"#
        )
        .expect("writing to a string");
    }
    // Nothing turns: the moments of inertia are there because MuJoCo asks for them.
    writeln!(
        world,
        r#"<body pos="{position}"><inertial pos="0 0 0" mass="{mass}" diaginertia="{mass} {mass} {mass}"/>{joints}<site name="s{node}"/></body>"#
    )
    .expect("writing to a string");
}

fn write_tendon(paths: &mut String, equalities: &mut String, network: &Network, index: usize, tendon: &PointTendon) {
    let constraint = match tendon.constraint {
        TendonConstraint::Equality => {
            writeln!(equalities, r#"<tendon tendon1="p{index}" solimp="{IMPEDANCE}"/>"#).expect("writing to a string");
            String::new()
        }
        TendonConstraint::FrictionLoss(force) => format!(r#"frictionloss="{force}" solimpfriction="{IMPEDANCE}""#),
        TendonConstraint::UpperLimit(length) => {
            format!(r#"limited="true" range="-1000 {length}" solimplimit="{IMPEDANCE}""#)
        }
    };
    write!(paths, r#"<fixed name="p{index}" {constraint}>"#).expect("writing to a string");
    for &(node, weight) in tendon.support.iter().filter(|&&(node, _)| !network.fixed[node]) {
        for (name, component) in ["x", "y", "z"].into_iter().zip(tendon.direction.iter()) {
            let coefficient = weight * component;
            if coefficient != 0.0 {
                write!(paths, r#"<joint joint="j{node}{name}" coef="{coefficient}"/>"#).expect("writing to a string");
            }
        }
    }
    writeln!(paths, "</fixed>").expect("writing to a string");
}
