//! Sticking: the force that holds a contact point is the Lagrange multiplier of the constraint.

use std::sync::Arc;

use stickslip::Vec3;
use stickslip::contact::law::Law;
use stickslip::contact::rules::{ContactRules, Scheme, Wall};
use stickslip::contact::simulation::LocalSimulation;
use stickslip::local::model::{LocalModelBuilder, LocalSettings};
use stickslip::model::network::Network;
use stickslip::model::state::ExternalForce;
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;
use stickslip::surface::support::Metric;
use stickslip_mujoco::Reference;
use stickslip_mujoco::mjcf::{PointTendon, TendonConstraint};
use stickslip_mujoco::residual::{check, largest, must_fail, note};
use stickslip_mujoco::samples::{self, Point, SPACING, Variation};

/// Largest difference of λ, relative to |λ|. Both sides sum some sixty spring forces; what MuJoCo adds
/// to pull the point back to its rest position, a_ref, is taken off again. Measured: 1e-15.
const REACTION: f64 = 1e-10;

/// s. Of no consequence: nothing is integrated.
const STEP: f64 = 1e-3;

fn sample(mass_variation: f64) -> Network {
    samples::network(
        &samples::block().mesh(),
        Variation { mass: mass_variation, stiffness: 0.3, damping: 0.5 },
        vec![ExternalForce::Gravity(Vec3::z() * -9.81)],
    )
}

/// For every contact point: λ by our operators, and by MuJoCo. The latter is given the weights that
/// `mistake` makes of the right ones.
fn reactions(network: &Network, metric: Metric, mistake: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<[Vec3; 2]> {
    let points = Point::all(&samples::block().mesh(), network, 1);
    let compare = |(i, point): (usize, &Point)| {
        let state = samples::state(network, i as u64, 0.2 * SPACING, 0.2);
        let mut forces = vec![Vec3::zeros(); network.node_count()];
        network.forces(&state.x, &state.v, &mut forces);
        let ours = point.operators(metric, network).reaction(&forces);

        let support = Point { weights: mistake(point.weights), ..point.clone() }.support();
        let tendons = [Vec3::x(), Vec3::y(), Vec3::z()].map(|direction| PointTendon {
            support: &support,
            direction,
            constraint: TendonConstraint::Equality,
        });
        let mut reference = Reference::constrained(network, STEP, &tendons, 1.0);
        reference.set_state(&state);
        // MuJoCo's force acts on the network, ours on the instrument.
        let theirs = -Vec3::from_column_slice(reference.hard_forces().as_slice());
        [ours, theirs]
    };
    points.iter().enumerate().map(compare).collect()
}

fn error(reactions: &[[Vec3; 2]]) -> f64 {
    largest(reactions.iter().map(|[ours, theirs]| (ours - theirs).norm() / theirs.norm()))
}

fn median_error(reactions: &[[Vec3; 2]]) -> f64 {
    let mut errors: Vec<f64> = reactions.iter().map(|[ours, theirs]| (ours - theirs).norm() / theirs.norm()).collect();
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

fn right(weights: [f64; 3]) -> [f64; 3] {
    weights
}

#[test]
fn the_mass_metric_gives_the_multiplier() {
    let network = sample(0.5);
    check("sticking: λ, mass metric, masses ±50 %", REACTION, error(&reactions(&network, Metric::Mass, right)));
}

#[test]
fn with_equal_masses_so_does_the_euclidean_metric() {
    let network = sample(0.0);
    check("sticking: λ, mass metric, equal masses", REACTION, error(&reactions(&network, Metric::Mass, right)));
    check(
        "sticking: λ, Euclidean metric, equal masses",
        REACTION,
        error(&reactions(&network, Metric::Euclidean, right)),
    );
}

#[test]
fn with_unequal_masses_the_euclidean_metric_does_not() {
    for variation in [0.1, 0.5, 0.9] {
        let reactions = reactions(&sample(variation), Metric::Euclidean, right);
        let percent = (100.0 * variation).round();
        note(&format!("sticking: λ, Euclidean metric, masses ±{percent} %, median"), median_error(&reactions));
        note(&format!("sticking: λ, Euclidean metric, masses ±{percent} %, largest"), error(&reactions));
        must_fail(&format!("sticking: Euclidean metric, masses ±{percent} %"), REACTION, error(&reactions));
    }
}

/// A tip that stays where it touches: the velocity scheme's force is h G⁻¹W M⁻¹f over h, the multiplier.
#[test]
fn the_velocity_scheme_commands_the_multiplier() {
    let mesh = samples::block().mesh();
    let network = sample(0.5);
    let surface = SurfaceModel::faceted(Arc::new(Surface::new(&mesh).expect("a block has a surface")));
    let rules = ContactRules {
        law: Law::Sticking,
        scheme: Scheme::Velocity,
        adhesion_n: 0.0,
        wall: Wall { stiffness: 1000.0, damping: 0.0 },
    };
    let (mut pushed, mut differences) = (0, Vec::new());
    for (i, point) in Point::all(&mesh, &network, 1).iter().enumerate() {
        // At rest in a deformed state, so that nothing but forces moves it.
        let mut state = samples::state(&network, i as u64, 0.2 * SPACING, 0.0);
        state.v.fill(Vec3::zeros());
        let support = point.support();
        let position: Vec3 = support.map(|(node, weight)| state.x[node] * weight).iter().sum();
        let normal = point.normal(&state.x);
        let mut builder = LocalModelBuilder::new(&network, surface.clone(), LocalSettings::FULL);
        let (model, local) = builder.build(&network, &state, position, None).expect("an explicit model");
        let mut simulation = LocalSimulation::new(rules, STEP, surface.clone(), model, local);
        // The mesh, on its way back to rest, meets the tip or leaves it. What it takes to bring the point that was
        // met to the tip within the tick is taken off with the same G.
        let sunk = normal * 1e-9;
        let report = simulation.tick(position + sunk, position - sunk);
        let Some(touch) = report.touch.filter(|_| !report.rigid) else { continue };
        pushed += 1;
        let nodes = surface.topology.triangle_nodes(touch.point.triangle);
        let there = Point { nodes, weights: touch.point.weights };
        let response = there.operators(Metric::Mass, &network).scale();
        let follow = (position - sunk - touch.position) * (-1.0 / (response * STEP * STEP));

        let support = there.support();
        let tendons = [Vec3::x(), Vec3::y(), Vec3::z()].map(|direction| PointTendon {
            support: &support,
            direction,
            constraint: TendonConstraint::Equality,
        });
        let mut reference = Reference::constrained(&network, STEP, &tendons, 1.0);
        reference.set_state(&state);
        let multiplier = -Vec3::from_column_slice(reference.hard_forces().as_slice());
        differences.push((report.force - follow - multiplier).norm() / multiplier.norm());
    }
    assert!(pushed > 10, "{pushed} points are pushed on");
    check("sticking: force of the velocity scheme", REACTION, largest(differences));
}

#[test]
fn a_mistake_in_the_weights_shows() {
    let network = sample(0.5);
    let swapped = reactions(&network, Metric::Mass, |[a, b, c]| [b, a, c]);
    must_fail("sticking: α and β swapped", REACTION, error(&swapped));
    let off = reactions(&network, Metric::Mass, |[a, b, c]| [a + 1e-8, b - 1e-8, c]);
    must_fail("sticking: weights off by 1e-8", REACTION, error(&off));
}
