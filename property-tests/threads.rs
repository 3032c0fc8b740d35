//! Two threads that share the global network give the results of one, to the last bit.

use stickslip::Vec3;
use stickslip::dynamics::constraint::{Constraint, Steps, Threads, Unconstrained};
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::springs::{Spring, Springs};
use stickslip::model::state::State;
use stickslip::pipeline::{self, Simulation};
use stickslip::scene::Scene;

use crate::check::scene;

/// Nodes of both halves that are prescribed along a wave, at the start and the end of a step.
struct Led {
    nodes: Vec<u32>,
    rest: Vec<Vec3>,
    step: u32,
}

const H: f64 = 5e-4;

impl Constraint for Led {
    fn nodes(&self, _: f64) -> &[u32] {
        &self.nodes
    }
    fn acts_node_by_node(&self) -> bool {
        true
    }
    /// Accelerations that `state` overrides and that must not remain in any column.
    fn accelerations(&self, a: &mut [Vec3]) {
        self.nodes.iter().for_each(|&node| a[node as usize] = Vec3::new(1.0, 2.0, 3.0));
    }
    fn state(&self, ahead: f64, state: &mut State) {
        let time = (f64::from(self.step) + ahead) * H;
        for (&node, rest) in self.nodes.iter().zip(&self.rest) {
            state.x[node as usize] = rest + Vec3::new(0.1, -0.2, 0.3) * (40.0 * time).sin() * 0.01;
            state.v[node as usize] = Vec3::new(0.1, -0.2, 0.3) * (40.0 * time).cos() * 0.4;
        }
    }
}

/// Numbers the nodes of a mesh at random within layers of a given size.
fn renumbered(mesh: &Mesh, layer: usize) -> Mesh {
    let count = mesh.nodes.len();
    let mut order: Vec<usize> = (0..count).collect();
    // The order is that of a hash of the number.
    order.sort_by_key(|&node| (node / layer, (node as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29)));
    let mut number = vec![0; count];
    order.iter().enumerate().for_each(|(new, &old)| number[old] = new);
    let new = |node: usize| number[node];
    let mut nodes = mesh.nodes.clone();
    (0..count).for_each(|node| nodes[new(node)] = mesh.nodes[node]);
    let map = |node: &u32| new(*node as usize) as u32;
    let edges = mesh.edges.iter().map(|edge| edge.each_ref().map(map)).collect();
    let triangles = mesh.triangles.iter().map(|triangle| triangle.each_ref().map(map)).collect();
    Mesh { nodes, edges, triangles, tetrahedra: vec![] }
}

fn network(mesh: &Mesh) -> Network {
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: (0..count).map(|i| 0.01 + 0.001 * (i % 7) as f64).collect(),
        stiffness: 100.0.into(),
        damping: 0.5.into(),
        drag: 0.02,
        gravity: Vec3::new(0.3, 0.0, -9.81),
    };
    let bottom = mesh.nodes.iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
    let fixed = mesh.nodes.iter().map(|x| x.z <= bottom).collect();
    Network::new(mesh, &material, fixed).expect("a mass for every node")
}

fn differing(a: &State, b: &State) -> usize {
    let numbers = |s: &State| -> Vec<u64> {
        s.x.iter().chain(&s.v).flat_map(|x| x.iter()).map(|c| c.to_bits()).collect::<Vec<_>>()
    };
    numbers(a).iter().zip(&numbers(b)).filter(|(a, b)| a != b).count()
}

#[test]
fn two_threads_change_no_bit() {
    let block = Block { nodes: [13, 11, 9], spacing: 0.0125, stencil: Stencil::Full }.mesh();
    let count = block.nodes.len();
    assert_eq!(count % 4, 3, "the last packet of nodes is not full");
    for (what, mesh) in [("a block", block.clone()), ("a block numbered at random", renumbered(&block, 4 * 143))] {
        let network = network(&mesh);
        let halves = network.springs.halves().expect("more than 8,192 springs");
        let nodes: Vec<u32> = (halves.split as u32 - 3..halves.split as u32 + 3).chain([count as u32 - 1]).collect();
        let rest: Vec<Vec3> = nodes.iter().map(|&node| network.rest[node as usize]).collect();
        let led = |step| Led { nodes: nodes.clone(), rest: rest.clone(), step };
        let integrator = GlobalIntegrator::SemiImplicitEuler;

        let (mut single, mut stepper) = (network.rest_state(), Stepper::new(&network));
        (0..60).for_each(|step| stepper.step(integrator, &network, &mut single, H, &led(step)));
        stepper.step(integrator, &network, &mut single, H, &Unconstrained);
        for threads in [Threads::One, Threads::Two] {
            let (mut state, mut stepper) = (network.rest_state(), Stepper::new(&network));
            // Two runs, and one more step by one thread: remains of the runs would show.
            for start in [0, 30] {
                let steps = Steps { length: H, count: 30, threads };
                stepper.steps(integrator, &network, &mut state, steps, |step| led(start + step));
            }
            stepper.step(integrator, &network, &mut state, H, &Unconstrained);
            assert_eq!(stepper.evaluations(), 61);
            let bits = differing(&state, &single);
            println!("RESIDUAL | steps one by one | {what}, {threads:?} thread(s), numbers that differ | 0 | {bits}");
            assert_eq!(bits, 0, "{what}, {threads:?}");
        }
        let moved = single.x.iter().zip(&network.rest).map(|(x, rest)| (x - rest).norm()).fold(0.0, f64::max);
        assert!(moved > 1e-3 && single.x.iter().all(|x| x.iter().all(|c| c.is_finite())), "{moved}");
    }
}

/// All springs of a hub end on one node: wherever the network is divided, they cross.
#[test]
fn a_hub_is_not_shared() {
    let spoke = |node| Spring { nodes: [0, node], stiffness: 1.0, damping: 0.0, rest_length: 1.0 };
    let springs: Vec<Spring> = (1..10_000).map(spoke).collect();
    assert!(Springs::new(10_000, &springs).halves().is_none());
    // Springs that connect a node with itself stay in their half.
    let loops: Vec<Spring> = (0..10_000).map(|node| Spring { nodes: [node; 2], ..springs[0] }).collect();
    let halves = Springs::new(10_000, &loops).halves().cloned().expect("10,000 springs");
    assert_eq!((halves.split, halves.reach.len()), (5_000, 0));
}

#[test]
fn a_scene_is_the_same_with_two_threads() {
    let text = include_str!("../fixtures/crosscheck/two-threads.toml");
    let forces = |scene: &Scene| {
        let mut forces = vec![];
        let outcome = pipeline::run(scene, |view| forces.push(view.force.map(f64::to_bits)));
        assert!(outcome.is_ok());
        forces
    };
    let (one, two) = (scene(&text.replace("threads = 2", "threads = 1")), scene(text));
    assert_eq!((one.global.threads, two.global.threads), (Threads::One, Threads::Two));
    assert!(Simulation::prepare(&two).expect("a scene").network().springs.halves().is_some());
    let (one, two) = (forces(&one), forces(&two));
    assert!(one.iter().any(|force| *force != one[0]));
    assert_eq!(one, two);
}
