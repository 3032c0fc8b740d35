//! Forces of the full network per spring, and the cost of a new local model on meshes of different
//! size.
//!
//! `cargo bench --bench network`

#[path = "interleaved.rs"]
mod interleaved;

use std::hint::black_box;
use std::sync::Arc;

use criterion::Criterion;
use stickslip::Vec3;
use stickslip::dynamics::constraint::{Steps, Threads, Unconstrained};
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::local::linearization::LinearForces;
use stickslip::local::model::{ExteriorKind, Linearization, LocalModelBuilder, LocalSettings};
use stickslip::local::patch::{Extent, PatchSelector};
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::springs::TangentKind;
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;

const STEPS: u32 = 100;

fn network(nodes: [usize; 3]) -> (Network, Arc<Surface>) {
    let block = Block { nodes, spacing: 0.0125, stencil: Stencil::Full };
    let mesh = block.mesh();
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: vec![0.01; count],
        stiffness: 100.0.into(),
        damping: 0.5.into(),
        drag: 0.0,
        gravity: Vec3::zeros(),
    };
    let fixed = (0..count).map(|i| block.is_bottom(i)).collect();
    (
        Network::new(&mesh, &material, fixed).expect("a value for each node"),
        Arc::new(Surface::new(&mesh).expect("a block")),
    )
}

fn forces(nodes: [usize; 3]) -> (usize, impl FnMut()) {
    let (network, _) = network(nodes);
    let mut state = network.rest_state();
    for (i, (x, v)) in state.x.iter_mut().zip(&mut state.v).enumerate() {
        let wave = |k: f64| (k * i as f64).sin();
        *x += Vec3::new(wave(1.1), wave(2.3), wave(3.7)) * 1e-3;
        *v = Vec3::new(wave(0.7), wave(1.9), wave(2.9)) * 1e-2;
    }
    let mut f = vec![Vec3::zeros(); network.node_count()];
    (network.springs.len(), move || network.forces(black_box(&state.x), black_box(&state.v), &mut f))
}

/// Times a cycle's steps by semi-implicit Euler.
fn steps(nodes: [usize; 3], threads: Threads) -> impl FnMut() {
    let (network, _) = network(nodes);
    let (rest, mut stepper) = (network.rest_state(), Stepper::new(&network));
    let mut state = rest.clone();
    let steps = Steps { length: 1e-3, count: STEPS, threads };
    move || {
        state.clone_from(&rest);
        state.x.iter_mut().enumerate().for_each(|(i, x)| x.z += 1e-4 * (0.7 * i as f64).sin());
        stepper.steps(GlobalIntegrator::SemiImplicitEuler, &network, black_box(&mut state), steps, |_| Unconstrained);
    }
}

/// Times the linearisation of a patch of one ring in the middle of the top.
fn linearise(nodes: [usize; 3]) -> impl FnMut() {
    let (network, surface) = network(nodes);
    let state = network.rest_state();
    let mut selector = PatchSelector::new(&network, &surface);
    let patch = selector.select(&network, &surface, &state.x, Vec3::zeros(), &[], Extent::Rings(1));
    let slots = patch.nodes.iter().chain(&patch.boundary);
    let x: Vec<Vec3> = slots.map(|&node| state.x[node as usize]).collect();
    let v = vec![Vec3::zeros(); x.len()];
    move || {
        black_box(LinearForces::new(&patch, &network.external, black_box(&x), &v, None, TangentKind::Exact));
    }
}

/// Times the selection of that patch: the nearest of all surface vertices, then its rings.
fn select(nodes: [usize; 3]) -> impl FnMut() {
    let (network, surface) = network(nodes);
    let state = network.rest_state();
    let mut selector = PatchSelector::new(&network, &surface);
    move || {
        let x = black_box(&state.x);
        drop(black_box(selector.select(&network, &surface, x, Vec3::zeros(), &[], Extent::Rings(1))));
    }
}

/// Times the whole message: patch, linear forces, and the geometry of the exterior.
fn build(nodes: [usize; 3]) -> impl FnMut() {
    let (network, surface) = network(nodes);
    let state = network.rest_state();
    let linearization = Linearization::Tangent(TangentKind::Exact);
    let settings = LocalSettings { extent: Extent::Rings(1), linearization, exterior: ExteriorKind::Fixed };
    let mut builder = LocalModelBuilder::new(&network, SurfaceModel::faceted(surface), settings);
    move || drop(black_box(builder.build(&network, black_box(&state), Vec3::zeros(), None)))
}

fn main() {
    let sizes = [[9, 9, 4], [16, 16, 16], [32, 32, 32]];
    let (springs, sweep) = forces(sizes[1]);
    let (many_springs, large_sweep) = forces(sizes[2]);
    let mut cases: Vec<interleaved::Case> = vec![
        ("forces, 4,096 nodes, 46,620 springs", Box::new(sweep)),
        ("forces, 32,768 nodes", Box::new(large_sweep)),
        ("linearise one ring, 324 nodes", Box::new(linearise(sizes[0]))),
        ("linearise one ring, 4,096 nodes", Box::new(linearise(sizes[1]))),
        ("linearise one ring, 32,768 nodes", Box::new(linearise(sizes[2]))),
        ("select one ring, 324 nodes", Box::new(select(sizes[0]))),
        ("select one ring, 4,096 nodes", Box::new(select(sizes[1]))),
        ("select one ring, 32,768 nodes", Box::new(select(sizes[2]))),
        ("build the model, 324 nodes", Box::new(build(sizes[0]))),
        ("build the model, 4,096 nodes", Box::new(build(sizes[1]))),
        ("build the model, 32,768 nodes", Box::new(build(sizes[2]))),
    ];
    let mut criterion = Criterion::default().configure_from_args().sample_size(20);
    let mut group = criterion.benchmark_group("network");
    for (name, case) in &mut cases {
        group.bench_function(*name, |bencher| bencher.iter(&mut *case));
    }
    group.finish();
    criterion.final_summary();
    println!("\nper spring: divide the first by {springs}, the second by {many_springs}");
    interleaved::print_ratios(&mut cases, 20);

    let cycle = |nodes, threads| Box::new(steps(nodes, threads)) as Box<dyn FnMut()>;
    let mut cycles: Vec<interleaved::Case> = vec![
        ("4,096 nodes, one thread", cycle(sizes[1], Threads::One)),
        ("4,096 nodes, two threads", cycle(sizes[1], Threads::Two)),
        ("32,768 nodes, one thread", cycle(sizes[2], Threads::One)),
        ("32,768 nodes, two threads", cycle(sizes[2], Threads::Two)),
    ];
    println!("\n{STEPS} steps; per spring and step: divide by {STEPS} and by the springs");
    interleaved::print_ratios(&mut cycles, 1);
}
