//! The free network: conservation by Newton's laws, closed forms, and convergence.

use nalgebra::DMatrix;
use stickslip::Vec3;
use stickslip::dynamics::constraint::Unconstrained;
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::model::material::PerSpring;
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network, NetworkError};
use stickslip::model::springs::Spring;
use stickslip::model::state::State;
use stickslip::pipeline::{OwnParts, Simulation};
use stickslip::scene::{Problem, Scene};

use crate::check::Worst;

fn block(damping: f64) -> (Network, State) {
    let mesh = Block { nodes: [4, 3, 3], spacing: 0.0125, stencil: Stencil::Full }.mesh();
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: (0..count).map(|i| 0.01 + 0.001 * (i % 7) as f64).collect(),
        stiffness: 100.0.into(),
        damping: damping.into(),
        drag: 0.0,
        gravity: Vec3::zeros(),
    };
    let network = Network::new(&mesh, &material, vec![false; count]).expect("a value for each node");
    let mut state = network.rest_state();
    for (i, v) in state.v.iter_mut().enumerate() {
        let wave = |k: f64| (k * (i as f64 + 1.0)).sin();
        *v = Vec3::new(wave(1.3) + 0.5, wave(2.1), wave(3.1) - 0.2) * 0.05;
    }
    (network, state)
}

fn momentum(network: &Network, state: &State) -> (Vec3, Vec3) {
    let parts = network.mass.iter().zip(&state.v);
    let linear = parts.clone().map(|(m, v)| v * *m).sum();
    let angular = parts.zip(&state.x).map(|((m, v), x)| x.cross(v) * *m).sum();
    (linear, angular)
}

fn energy(network: &Network, state: &State) -> f64 {
    let kinetic: f64 = network.mass.iter().zip(&state.v).map(|(m, v)| 0.5 * m * v.norm_squared()).sum();
    kinetic + network.springs.elastic_energy(&state.x)
}

#[test]
fn momentum_is_kept_and_energy_bounded() {
    // Sums of some thousand terms over 2,000 steps. Measured: 5e-15.
    let kept = Worst::new("Newton's third law", "momentum and angular momentum, relative, 2,000 steps", 1e-13);
    // The symplectic step conserves a nearby energy; the two differ by O(hω) ≈ 0.2 in the fastest
    // modes, which hold a part of it. Measured: 7e-2.
    let bounded = Worst::new("symplectic step", "energy undamped, relative to its start", 0.1);
    let (network, mut state) = block(0.0);
    let (linear, angular) = momentum(&network, &state);
    let start = energy(&network, &state);
    let mut stepper = Stepper::new(&network);
    for _ in 0..2000 {
        stepper.step(GlobalIntegrator::SemiImplicitEuler, &network, &mut state, 1e-3, &Unconstrained);
        let now = momentum(&network, &state);
        kept.check((now.0 - linear).norm() / linear.norm());
        kept.check((now.1 - angular).norm() / angular.norm());
        bounded.check((energy(&network, &state) / start - 1.0).abs());
    }
}

#[test]
fn dampers_take_energy_and_no_momentum() {
    let kept = Worst::new("Newton's third law", "momentum with dampers, relative, 1,000 steps", 1e-13);
    let (network, mut state) = block(0.5);
    let (linear, angular) = momentum(&network, &state);
    let mut last = energy(&network, &state);
    let start = last;
    let mut stepper = Stepper::new(&network);
    for step in 0..1000 {
        for _ in 0..10 {
            stepper.step(GlobalIntegrator::SemiImplicitEuler, &network, &mut state, 1e-4, &Unconstrained);
        }
        let now = momentum(&network, &state);
        kept.check((now.0 - linear).norm() / linear.norm());
        kept.check((now.1 - angular).norm() / angular.norm());
        // Damping need not be monotone step by step under an explicit method, but it is over
        // milliseconds, until only the motion of the whole remains.
        let energy = energy(&network, &state);
        assert!(energy <= last * (1.0 + 1e-9), "energy rises from {last:e} to {energy:e} at millisecond {step}");
        last = energy;
    }
    // No damper acts on the motion of the centre of mass and on the rotation.
    assert!(last < 0.9 * start, "dampers took little: {last} of {start}");
}

/// Solves two nodes, one fixed: m ẍ = −k x − c ẋ about the rest length.
fn oscillator(damping: f64) -> (Network, State) {
    let spring = Spring { nodes: [0, 1], stiffness: 4.0, damping, rest_length: 1.0 };
    let nodes = vec![Vec3::zeros(), Vec3::x()];
    let network = Network::from_parts(nodes, vec![0.25; 2], vec![true, false], &[spring], vec![]);
    let mut state = network.rest_state();
    state.x[1].x += 0.1;
    (network, state)
}

fn exact(damping: f64, t: f64) -> f64 {
    let (omega, decay) = (4.0_f64, damping / 0.5);
    let a = 0.1;
    if decay < omega {
        let w = (omega * omega - decay * decay).sqrt();
        a * (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin())
    } else if decay == omega {
        a * (1.0 + omega * t) * (-omega * t).exp()
    } else {
        let w = (decay * decay - omega * omega).sqrt();
        let (fast, slow) = (-decay - w, -decay + w);
        a * (slow * (fast * t).exp() - fast * (slow * t).exp()) / (slow - fast)
    }
}

/// Returns the largest distance from the closed form at every tenth of the first second.
fn largest_error(integrator: GlobalIntegrator, damping: f64, steps: u32) -> f64 {
    let (network, mut state) = oscillator(damping);
    let mut stepper = Stepper::new(&network);
    let mut largest: f64 = 0.0;
    for step in 1..=steps {
        stepper.step(integrator, &network, &mut state, 1.0 / f64::from(steps), &Unconstrained);
        if step % (steps / 10) == 0 {
            let error = (state.x[1].x - 1.0 - exact(damping, f64::from(step) / f64::from(steps))).abs();
            largest = if error <= largest { largest } else { error };
        }
    }
    largest
}

#[test]
fn one_mass_follows_its_closed_form() {
    // Truncation (hω)⁴/120 ≈ 1e-14 of the amplitude, and the round-off of 4,000 steps. Measured: 3e-15.
    let closed = Worst::new("closed form", "one mass, under-, critically and over-damped, RK4, m", 1e-13);
    // Asymptotic order at steps where the next term is a few per cent. Measured: 2e-4, 0.04.
    let first = Worst::new("closed form", "order of semi-implicit Euler, distance from 1", 0.01);
    let fourth = Worst::new("closed form", "order of RK4, distance from 4", 0.2);
    for damping in [0.2, 2.0, 6.0] {
        closed.check(largest_error(GlobalIntegrator::Rk4, damping, 4000));
        let order = |integrator, steps| {
            let error = |steps| largest_error(integrator, damping, steps);
            (error(steps) / error(2 * steps)).log2()
        };
        first.check((order(GlobalIntegrator::SemiImplicitEuler, 2000) - 1.0).abs());
        fourth.check((order(GlobalIntegrator::Rk4, 100) - 4.0).abs());
    }
}

/// A chain of equal masses between two walls, each mode a sine: ω_j = 2√(k/m) sin(jπ/2(N+1)).
#[test]
fn a_chain_swings_in_its_modes() {
    // Longitudinal motion of a straight chain is linear; RK4 over a quarter period, truncation (hω)⁴. Measured: 1e-11.
    let worst = Worst::new("closed form", "modes of a chain after a quarter period, relative", 1e-10);
    let (count, k, m, spacing) = (6_u32, 50.0, 0.02, 0.1);
    let nodes: Vec<Vec3> = (0..count + 2).map(|i| Vec3::x() * (spacing * f64::from(i))).collect();
    let springs: Vec<Spring> =
        (0..=count).map(|i| Spring { nodes: [i, i + 1], stiffness: k, damping: 0.0, rest_length: spacing }).collect();
    let fixed = (0..count + 2).map(|i| i == 0 || i == count + 1).collect();
    let network = Network::from_parts(nodes, vec![m; count as usize + 2], fixed, &springs, vec![]);
    let mut stepper = Stepper::new(&network);
    for mode in 1..=count {
        let phase = std::f64::consts::PI * f64::from(mode) / f64::from(count + 1);
        let omega = 2.0 * (k / m).sqrt() * (phase / 2.0).sin();
        let shape = |i: u32| 1e-3 * (phase * f64::from(i)).sin();
        let mut state = network.rest_state();
        (1..=count).for_each(|i| state.x[i as usize].x += shape(i));
        let steps = 2000;
        let h = std::f64::consts::FRAC_PI_2 / omega / f64::from(steps);
        for _ in 0..steps {
            stepper.step(GlobalIntegrator::Rk4, &network, &mut state, h, &Unconstrained);
        }
        for i in 1..=count {
            // A quarter period later the displacement is velocity: −ω times the shape.
            worst.check((state.v[i as usize].x + omega * shape(i)).abs() / (omega * 1e-3));
            worst.check((state.x[i as usize].x - network.rest[i as usize].x).abs() / 1e-3);
        }
    }
}

/// A spring compressed to zero length has no direction: it has no force, and gives no NaN.
#[test]
fn a_collapsed_spring_is_finite() {
    let (network, mut state) = oscillator(0.3);
    state.x[1] = state.x[0];
    state.v[1] = Vec3::y();
    let mut f = vec![Vec3::zeros(); 2];
    network.forces(&state.x, &state.v, &mut f);
    assert_eq!(f, vec![Vec3::zeros(); 2]);
}

/// Too few or too many values for the mesh, and nodes that it does not have, are refused before they cause NaN or an
/// index out of bounds.
#[test]
fn a_material_that_does_not_fit_the_mesh_is_refused() {
    let mesh = Block { nodes: [3, 3, 2], spacing: 0.01, stencil: Stencil::Shear }.mesh();
    let (nodes, edges) = (mesh.nodes.len(), mesh.edges.len());
    let network = |masses: usize, fixed: usize, springs: [usize; 2]| {
        let [stiffness, damping] = springs.map(|count| PerSpring::Each(vec![1.0; count]));
        let node_mass = vec![0.01; masses];
        let material = Material { node_mass, stiffness, damping, drag: 0.0, gravity: Vec3::zeros() };
        Network::new(&mesh, &material, vec![false; fixed])
    };
    let fitting = network(nodes, nodes, [edges; 2]).expect("a value for each");
    assert!(fitting.springs.iter().all(|spring| spring.stiffness == 1.0 && spring.damping == 1.0));
    for wrong in [-1, 1] {
        let [nodes_off, edges_off] = [nodes, edges].map(|count| count.saturating_add_signed(wrong));
        for (quantity, found, needed, made) in [
            ("node_mass", nodes_off, nodes, network(nodes_off, nodes, [edges; 2])),
            ("fixed", nodes_off, nodes, network(nodes, nodes_off, [edges; 2])),
            ("stiffness", edges_off, edges, network(nodes, nodes, [edges_off, edges])),
            ("damping", edges_off, edges, network(nodes, nodes, [edges, edges_off])),
        ] {
            assert_eq!(made.err(), Some(NetworkError::WrongCount { quantity, found, needed }));
        }
    }

    let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
    let problem = |mesh| match Simulation::prepare_with(&scene, OwnParts { mesh: Some(mesh), ..OwnParts::default() })
        .expect_err("it does not fit")
        .problem()
    {
        Problem::Network(error) => *error,
        other => panic!("{other}"),
    };
    let mut unknown = scene.mesh.mesh();
    let count = unknown.nodes.len();
    unknown.triangles[7][1] = u32::MAX;
    assert_eq!(problem(unknown), NetworkError::UnknownNode { node: u32::MAX, nodes: count });
    let mut larger = scene.mesh.mesh();
    larger.nodes.push(Vec3::zeros());
    let (found, needed) = (count, count + 1);
    assert_eq!(problem(larger), NetworkError::WrongCount { quantity: "node_mass", found, needed });
}

/// Returns the network's dense Jacobian over all nodes.
pub fn dense_jacobian(network: &Network) -> (DMatrix<f64>, DMatrix<f64>) {
    use stickslip::model::springs::TangentKind;
    let dof = 3 * network.node_count();
    let (mut k, mut d) = (DMatrix::zeros(dof, dof), DMatrix::zeros(dof, dof));
    for spring in network.springs.iter() {
        let [i, j] = spring.nodes.map(|node| node as usize);
        let (along_x, along_v) = spring.jacobian(network.rest[j] - network.rest[i], Vec3::zeros(), TangentKind::Exact);
        for (matrix, block) in [(&mut k, along_x), (&mut d, along_v)] {
            for (row, column, sign) in [(i, i, -1.0), (i, j, 1.0), (j, i, 1.0), (j, j, -1.0)] {
                let mut view = matrix.view_mut((3 * row, 3 * column), (3, 3));
                view += block * sign;
            }
        }
    }
    (k, d)
}

/// The packed sweep compared with springs one by one: random networks, springs given in either direction,
/// several between the same nodes, and node numbers near the end where no packet fits.
#[test]
fn packed_springs_are_the_same_springs() {
    use proptest::prelude::*;
    // Sums of up to some dozen forces per node. Measured: 4e-16.
    let worst = Worst::new("springs one by one", "packed forces, relative to the largest", 1e-14);
    let spring = (0..24_u32, 1..24_u32, 1.0..100.0_f64, prop_oneof![Just(0.0), 0.1..1.0_f64], 0.1..2.0_f64);
    let vectors = || prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 24);
    let case = (prop::collection::vec(spring, 1..300), vectors(), vectors());
    let run = crate::check::runner(500).run(&case, |(springs, x, v)| {
        let springs: Vec<Spring> = springs
            .into_iter()
            .map(|(i, step, stiffness, damping, rest_length)| Spring {
                nodes: [i, (i + step) % 24],
                stiffness,
                damping,
                rest_length,
            })
            .collect();
        let (x, v) =
            (x.into_iter().map(Vec3::from).collect::<Vec<_>>(), v.into_iter().map(Vec3::from).collect::<Vec<_>>());
        let mut expected = vec![Vec3::zeros(); 24];
        for s in &springs {
            let [i, j] = s.nodes.map(|node| node as usize);
            let (d, omega) = (x[j] - x[i], v[j] - v[i]);
            let u = d / d.norm();
            let force = u * (s.stiffness * (d.norm() - s.rest_length) + s.damping * omega.dot(&u));
            expected[i] += force;
            expected[j] -= force;
        }
        let mut f = vec![Vec3::zeros(); 24];
        stickslip::model::springs::Springs::new(24, &springs).add_forces(&x, &v, &mut f);
        let scale = expected.iter().map(Vec3::norm).fold(0.0, f64::max);
        for (f, expected) in f.iter().zip(&expected) {
            worst.case((f - expected).norm() / scale)?;
        }
        Ok(())
    });
    run.unwrap();
}
