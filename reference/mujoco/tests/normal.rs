//! The normal direction: contact pushes, and never pulls.

use std::sync::Arc;

use stickslip::Vec3;
use stickslip::contact::law::{Law, Mode};
use stickslip::contact::rules::{ContactRules, Deformation, Scheme, Wall};
use stickslip::contact::simulation::LocalSimulation;
use stickslip::contact::state::ContactState;
use stickslip::local::model::{LocalModelBuilder, LocalSettings};
use stickslip::model::mesh::Mesh;
use stickslip::model::network::Network;
use stickslip::model::state::State;
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;
use stickslip::surface::support::Metric;
use stickslip_mujoco::Reference;
use stickslip_mujoco::mjcf::{PointTendon, TendonConstraint};
use stickslip_mujoco::residual::{check, largest, must_fail};
use stickslip_mujoco::samples::{self, Point, SPACING, Variation};

/// Difference of F_N, relative to the largest F_N. Ours comes out of a whole tick, in which dampers
/// already act: by the time of collision nodes have 1e-10 m/s. Measured: 2e-10.
const NORMAL_FORCE: f64 = 1e-8;
/// MuJoCo's force where ours is zero, N. It is zero, not small.
const NO_FORCE: f64 = 0.0;

/// s. So short that within a tick nothing moves but the tip.
const TICK: f64 = 1e-12;
/// How far outside the surface the tip starts, and how far inside it ends, m.
const APPROACH: f64 = 1e-10;
/// How deep the limit is violated, m: MuJoCo leaves a limit out that is merely reached.
const VIOLATION: f64 = 1e-12;

/// A tick that touched the surface.
struct Touched {
    /// The network at its end: as it was when the force was taken.
    state: State,
    point: Point,
    mode: Mode,
    normal_force: f64,
}

/// Puts the tip onto a point of a network at rest in a deformed state, and does one tick.
fn touch(mesh: &Mesh, network: &Network, point: &Point, state: &State) -> Touched {
    let surface = SurfaceModel::faceted(Arc::new(Surface::new(mesh).expect("a block has a surface")));
    let rules = ContactRules {
        law: Law::Sliding,
        scheme: Scheme::Geometric { deformation: Deformation::Rigid, metric: Metric::Mass },
        adhesion_n: 0.0,
        wall: Wall { stiffness: 1000.0, damping: 0.0 },
    };
    let position = point.support().map(|(node, weight)| state.x[node] * weight).iter().sum::<Vec3>();
    let mut builder = LocalModelBuilder::new(network, surface.clone(), LocalSettings::FULL);
    let (model, local) = builder.build(network, state, position, None).expect("an explicit model");
    let mut simulation = LocalSimulation::new(rules, TICK, surface.clone(), model, local);
    let approach = point.normal(&state.x) * APPROACH;
    let report = simulation.tick(position + approach, position - approach);

    let contact = simulation.contact().expect("the tip went through the surface");
    assert_eq!(contact.state == ContactState::Tension, report.mode == Mode::Free);
    let patch = &simulation.model().patch;
    let mut after = network.rest_state();
    for (slot, &node) in patch.nodes.iter().enumerate() {
        after.x[node as usize] = simulation.state().x[slot];
    }
    let nodes = surface.topology.triangle_nodes(contact.point.triangle);
    Touched {
        state: after,
        point: Point { nodes, weights: contact.point.weights },
        mode: report.mode,
        normal_force: report.normal_force,
    }
}

/// MuJoCo's force at the same place: a limit on how far out the contact point may come.
fn limit_force(network: &Network, touched: &Touched) -> f64 {
    let support = touched.point.support();
    let direction = touched.point.normal(&touched.state.x);
    let height: f64 = support.iter().map(|&(node, weight)| weight * direction.dot(&touched.state.x[node])).sum();
    let constraint = TendonConstraint::UpperLimit(height - VIOLATION);
    let tendon = PointTendon { support: &support, direction, constraint };
    let mut reference = Reference::constrained(network, TICK, &[tendon], 1.0);
    reference.set_state(&touched.state);
    assert_eq!(reference.at_bound().len(), 1, "the limit is reached");
    // MuJoCo's satisfied limits exert no force, and have nothing to recover.
    if reference.at_bound()[0] { reference.constraint_forces()[0] } else { reference.hard_forces()[0] }
}

/// Deformed states that push at the tip, and others that pull.
fn touches() -> (Network, Vec<Touched>) {
    let mesh = samples::block().mesh();
    let network = samples::network(&mesh, Variation { mass: 0.5, stiffness: 0.3, damping: 0.5 }, Vec::new());
    let points = Point::all(&mesh, &network, 3);
    let touched = points.iter().enumerate().map(|(i, point)| {
        let mut state = samples::state(&network, i as u64, 0.1 * SPACING, 0.0);
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        point.press(&network, side * 0.1 * SPACING, &mut state);
        touch(&mesh, &network, point, &state)
    });
    let touched = touched.collect();
    (network, touched)
}

#[test]
fn contact_pushes_and_never_pulls() {
    let (network, touches) = touches();
    let (pushing, pulling): (Vec<_>, Vec<_>) = touches.iter().partition(|touched| touched.mode == Mode::Slide);
    println!("{} push, {} pull", pushing.len(), pulling.len());
    assert!(pushing.len() >= 10 && pulling.len() >= 10, "too few of either kind");
    let scale = largest(pushing.iter().map(|touched| touched.normal_force));
    let push = pushing.iter().map(|touched| (touched.normal_force - limit_force(&network, touched)).abs() / scale);
    check("normal: F_N that pushes", NORMAL_FORCE, largest(push));
    assert!(pushing.iter().all(|touched| touched.normal_force > 0.0));
    assert!(pulling.iter().all(|touched| touched.normal_force == 0.0));
    let pull = pulling.iter().map(|touched| limit_force(&network, touched).abs());
    check("normal: F_N where the mesh pulls, N", NO_FORCE, largest(pull));
}

#[test]
fn a_force_that_pulls_shows() {
    let (network, touches) = touches();
    let pulling = touches.iter().filter(|touched| touched.mode == Mode::Free);
    let tensile = pulling.map(|touched| {
        let mut forces = vec![Vec3::zeros(); network.node_count()];
        network.forces(&touched.state.x, &touched.state.v, &mut forces);
        let reaction = touched.point.operators(Metric::Mass, &network).reaction(&forces);
        let tension = reaction.dot(&touched.point.normal(&touched.state.x));
        (tension - limit_force(&network, touched)).abs()
    });
    must_fail("normal: tensile force passed on, N", NO_FORCE, largest(tensile));
}
