//! Start in equilibrium under gravity.

use stickslip::Vec3;
use stickslip::dynamics::settle::{RESIDUAL, ROUND_OFF, SettleError, settle};
use stickslip::dynamics::statics::Statics;
use stickslip::model::network::Network;
use stickslip::model::springs::{Spring, TangentKind};
use stickslip::model::state::ExternalForce;
use stickslip::pipeline::{self, Simulation};
use stickslip::scene::{Problem, Scene};
use stickslip::verify::residual::larger;

use crate::check::{Worst, scene};

const G: f64 = 9.81;

fn gravity(g: Vec3) -> Vec<ExternalForce> {
    vec![ExternalForce::Gravity(g)]
}

/// Builds a vertical chain of nodes, the first fixed.
fn chain(g: Vec3) -> Network {
    let count = 8_u32;
    let nodes: Vec<Vec3> = (0..count).map(|i| Vec3::z() * (-0.1 * f64::from(i))).collect();
    let springs: Vec<Spring> = (1..count)
        .map(|i| Spring { nodes: [i - 1, i], stiffness: 20.0 + f64::from(i), damping: 0.1, rest_length: 0.1 })
        .collect();
    let mass = (0..count).map(|i| 0.01 * f64::from(1 + i % 3)).collect();
    let fixed = (0..count).map(|i| i == 0).collect();
    Network::from_parts(nodes, mass, fixed, &springs, gravity(g))
}

/// A spring of a chain is longer by the weight below it over k, however far that is. Laterally the chain has no
/// stiffness at rest, so the exact tangent is singular there. Under a slanted gravity it swings to its direction.
#[test]
fn a_hanging_chain_is_as_long_as_its_springs_make_it() {
    // Forces to 1e-12 of the largest weight over springs of 20 N/m and more, summed down the chain. Measured: 2e-16.
    let worst = Worst::new("closed form", "places in a hanging chain, relative to its length", 1e-14);
    for g in [Vec3::z() * -G, Vec3::new(3.0, -1.0, -9.0)] {
        let network = chain(g);
        let x = settle(&network).unwrap_or_else(|error| panic!("{error}"));
        let mut expected = Vec3::zeros();
        for (i, x) in x.iter().enumerate().skip(1) {
            let below: f64 = network.mass[i..].iter().sum::<f64>() * g.norm();
            expected += g.normalize() * (0.1 + below / (20.0 + i as f64));
            worst.check((x - expected).norm() / 0.7);
        }
    }
}

/// Builds a bar of 10 cm, which sags by 16 mm or by 0.02 mm.
fn bar(settle: bool, young_modulus: f64, local: &str) -> Scene {
    scene(&format!(
        r#"
        name = "bar"
        duration = 0.3
        settle = {settle}
        [mesh]
        nodes = [4, 4, 9]
        spacing = 0.0125
        fixed = {{ nodes = [128, 129, 130, 131, 132, 133, 134, 135, 136, 137, 138, 139, 140, 141, 142, 143] }}
        [material]
        density = 1000.0
        young_modulus = {young_modulus:e}
        damping_ratio = 0.05
        gravity = [0.0, 0.0, -9.81]
        [local]
        {local}
        [contact]
        law = "sliding"
        [instrument]
        waypoints = [[0.0, 0.0, 0.0, 0.05]]
        "#
    ))
}

fn prepared(scene: &Scene) -> Simulation {
    Simulation::prepare(scene).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_settled_bar_is_in_equilibrium_and_near_its_closed_form() {
    // The stated tolerance, relative to the weight, or to k L where rounding leaves more. Measured: 4e-13.
    let left = Worst::new("equilibrium", "largest force left on a node, of what may be, times 1e-12", RESIDUAL);
    // Nonlinear: the difference from the linear result is of the order of the strain, 2 % and 2e-5 here. Measured:
    // 0.44.
    let linear = Worst::new("linear statics", "settled displacements, over the strain", 1.5);
    // The clamped end cannot contract, and is stiffer over a part of the width, which is 3/8 of the length.
    // Measured: 0.034.
    let sag = Worst::new("closed form", "sag of a bar against ρgL²/2E, relative", 0.06);
    for young_modulus in [5e4, 5e7] {
        let simulation = prepared(&bar(true, young_modulus, ""));
        let network = simulation.network();
        let x = &simulation.global().state().x;
        let mut force = vec![Vec3::zeros(); x.len()];
        network.forces(x, &force.clone(), &mut force);
        let heaviest = network.mass.iter().fold(0.0, |a: f64, b| a.max(*b)) * G;
        let tightest = network.springs.iter().fold(0.0, |a: f64, spring| a.max(spring.stiffness * spring.rest_length));
        let scale = heaviest.max(ROUND_OFF / RESIDUAL * tightest);
        for (force, fixed) in force.iter().zip(&network.fixed) {
            left.check(if *fixed { 0.0 } else { force.norm() / scale });
        }
        let load: Vec<Vec3> = network.mass.iter().map(|mass| Vec3::z() * (-mass * G)).collect();
        let mut statics = Statics::new(network.fixed.iter().map(|fixed| [*fixed; 3]));
        let u = statics.displacements(network, &network.rest, TangentKind::Exact, 0.0, &load).expect("it is held");
        let largest = u.iter().map(Vec3::norm).fold(0.0, f64::max);
        let strain = 1000.0 * G * 0.1 / young_modulus;
        for ((x, rest), u) in x.iter().zip(&network.rest).zip(&u) {
            linear.check((x - rest - u).norm() / largest / strain);
        }
        let lower: f64 = (0..16).map(|node| network.rest[node].z - x[node].z).sum::<f64>() / 16.0;
        sag.check(((lower / (1000.0 * G * 0.01 / (2.0 * young_modulus))) - 1.0).abs());
    }
}

/// Returns the largest speed of a node of the local model in a run, m/s.
fn fastest(scene: &Scene) -> f64 {
    let mut fastest = 0.0_f64;
    let end = pipeline::run(scene, |view| {
        let speeds = view.local.state().v.iter().map(Vec3::norm);
        fastest = speeds.fold(fastest, larger);
    });
    end.unwrap_or_else(|error| panic!("{error}"));
    fastest
}

#[test]
fn a_settled_scene_stays_still_and_an_unsettled_one_swings() {
    // Motion by a force of 1e-12 of the weight, g·1e-12/ω, and rounding. Measured: 3e-14.
    let still = Worst::new("equilibrium", "largest speed in a settled run, m/s", 1e-12);
    for local in ["model = \"full\"", "rings = 1", "exterior = \"condensed\"", "integrator = \"implicit-euler\""] {
        let implicit = local.contains("integrator");
        let set = |settle| {
            let mut scene = bar(settle, 5e4, if implicit { "" } else { local });
            if implicit {
                scene.contact.scheme = stickslip::contact::rules::Scheme::Velocity;
                scene.integrator = stickslip::local::step::LocalIntegrator::ImplicitEuler;
            }
            scene
        };
        still.check(fastest(&set(true)));
        let swings = fastest(&set(false));
        assert!(swings > 0.01, "{local}: unsettled, the fastest node has {swings} m/s");
    }
}

/// The tip must be outside of the settled surface: 10 mm lower than at rest, or beneath the tip.
#[test]
fn the_tip_starts_outside_of_the_settled_surface() {
    let standing = |settle: bool, z: f64| {
        scene(&format!(
            r#"
            name = "standing"
            duration = 0.01
            settle = {settle}
            [mesh]
            nodes = [5, 5, 5]
            spacing = 0.0125
            [material]
            density = 1000.0
            young_modulus = 2e3
            damping_ratio = 0.1
            gravity = [0.0, 0.0, -9.81]
            [contact]
            law = "sliding"
            [instrument]
            waypoints = [[0.0, 0.001, 0.002, {z}]]
            "#
        ))
    };
    let inside = Simulation::prepare(&standing(false, -0.001)).expect_err("it is a millimetre inside");
    assert!(matches!(inside.problem(), Problem::TipInside { .. }), "{inside}");
    let settled = prepared(&standing(true, -0.001));
    let energy = settled.local().model().elastic_energy(&settled.local().state().x);
    assert!(energy > 0.0, "it starts with the energy of its sag, {energy} J");
}

#[test]
fn what_cannot_settle_is_refused() {
    let mut floating = chain(Vec3::z() * -G);
    floating.fixed[0] = false;
    assert_eq!(settle(&floating), Err(SettleError::Floating { node: 0 }));
    let heavy = chain(Vec3::z() * -1e300);
    let refused = settle(&heavy);
    assert!(matches!(refused, Err(SettleError::NotSettled { .. })), "{refused:?}");
}

/// A chain that stands on its fixed end is in unstable equilibrium: it falls over, and hangs.
#[test]
fn a_standing_chain_falls_over() {
    let network = chain(Vec3::new(0.01, 0.0, G));
    let x = settle(&network).unwrap_or_else(|error| panic!("{error}"));
    assert!(x[7].z > 0.7, "the last node is at {}", x[7]);
}

/// A force that is not a number is no equilibrium, whatever comes after it. The second free node alone would be in
/// equilibrium: its weight is below round-off of the springs, 1e-14 k L = 1e-13 N.
#[test]
fn a_force_that_is_no_number_is_no_equilibrium() {
    let spring = |end| Spring { nodes: [0, end], stiffness: 100.0, damping: 0.0, rest_length: 0.1 };
    let nodes = vec![Vec3::zeros(), Vec3::z() * -0.1, Vec3::x() * 0.1];
    let mass = vec![1.0, f64::NAN, 1e-15];
    let network =
        Network::from_parts(nodes, mass, vec![true, false, false], &[spring(1), spring(2)], gravity(Vec3::z() * -G));
    let settled = settle(&network);
    assert!(matches!(settled, Err(SettleError::NotSettled { residual_n, .. }) if residual_n.is_nan()), "{settled:?}");
}
