//! Implicit steps of the network without contact against MuJoCo's `discrete` integrator, which takes M + hD + h²K for the
//! mass, K and D of each spring along itself: a Gauss–Newton matrix. Where springs have their rest lengths that is the
//! exact tangent, and MuJoCo's step is our implicit Euler step of the linear model. Elsewhere it is compared with a dense
//! step with the same matrix, and what the exact tangent makes otherwise is noted.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use stickslip::Vec3;
use stickslip::local::model::{ExteriorKind, Linearization, LocalModelBuilder, LocalSettings};
use stickslip::local::patch::Extent;
use stickslip::local::step::LocalIntegrator;
use stickslip::model::network::Network;
use stickslip::model::springs::TangentKind;
use stickslip::model::state::{ExternalForce, State};
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;
use stickslip_mujoco::Reference;
use stickslip_mujoco::mjcf::Integrator;
use stickslip_mujoco::residual::{check, largest, largest_difference, largest_norm, must_fail, note};
use stickslip_mujoco::samples::{self, SPACING, Variation};

/// Largest difference of a velocity after a step, relative to the largest: two factorisations of one matrix. Measured: 2e-14.
const STEP: f64 = 1e-11;
/// How far, over the spacing, nodes are from rest, as a tendon of exactly its rest length has no stiffness in MuJoCo; and
/// what that geometric stiffness may change. Measured: 1e-9.
const NEARLY: f64 = 1e-9;
const FROM_REST: f64 = 1e-8;
/// Difference of positions over a trajectory, relative to the spacing. Measured: 2e-15.
const TRAJECTORY: f64 = 1e-12;
/// Steps of a trajectory. What two programs round grows: they part by 4e-8 within 200 steps of 0.01 s, and by 2e-8
/// within 30 of 0.1 s, which are left out.
const STEPS: usize = 30;
/// s: explicit steps of these networks are stable up to some 4 ms.
const LENGTHS: [f64; 3] = [1e-3, 1e-2, 1e-1];

fn sample(damping: f64) -> Network {
    let gravity = ExternalForce::Gravity(Vec3::new(0.3, -0.2, -9.81));
    samples::network(&samples::block().mesh(), Variation { mass: 0.5, stiffness: 0.3, damping }, vec![gravity])
}

/// One of MuJoCo's steps.
fn theirs(network: &Network, state: &State, h: f64) -> State {
    let mut reference = Reference::new(network, Integrator::Discrete, h);
    reference.set_state(state);
    reference.step();
    State { x: reference.positions(), v: reference.velocities() }
}

/// One implicit Euler step of the linear model of the whole network around `state`.
fn linear(network: &Network, state: &State, kind: TangentKind, h: f64) -> State {
    let surface = Arc::new(Surface::new(&samples::block().mesh()).expect("a block has a surface"));
    let settings = LocalSettings {
        extent: Extent::All,
        linearization: Linearization::Tangent(kind),
        exterior: ExteriorKind::Fixed,
    };
    let (model, mut local) = LocalModelBuilder::new(network, SurfaceModel::faceted(surface), settings)
        .with_integrator(LocalIntegrator::ImplicitEuler, h)
        .build(network, state, state.x[0], None)
        .expect("its step has a solution");
    model.predict(model.step.as_ref().expect("an implicit step"), 0.0, &mut local);
    let mut after = state.clone();
    for (slot, &node) in model.patch.nodes.iter().enumerate() {
        after.x[node as usize] = local.x_predicted[slot];
        after.v[node as usize] = local.v_predicted[slot];
    }
    after
}

/// (M + hD + h²K) a = f − hKv, v ← v + h a, x ← x + h v with K = Σ k uuᵀ and D = Σ c uuᵀ along the springs.
fn gauss_newton(network: &Network, state: &State, h: f64, with_stiffness: bool) -> State {
    let n = network.node_count();
    let mut forces = vec![Vec3::zeros(); n];
    network.forces(&state.x, &state.v, &mut forces);
    let (mut k, mut d) = (DMatrix::<f64>::zeros(3 * n, 3 * n), DMatrix::<f64>::zeros(3 * n, 3 * n));
    for spring in network.springs.iter() {
        let [i, j] = spring.nodes.map(|node| node as usize);
        let along = (state.x[j] - state.x[i]).normalize();
        let square = along * along.transpose();
        for (row, column, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            k.fixed_view_mut::<3, 3>(3 * row, 3 * column).zip_apply(&square, |k, s| *k += sign * spring.stiffness * s);
            d.fixed_view_mut::<3, 3>(3 * row, 3 * column).zip_apply(&square, |d, s| *d += sign * spring.damping * s);
        }
    }
    if !with_stiffness {
        k.fill(0.0);
    }
    let free: Vec<usize> = (0..3 * n).filter(|i| !network.fixed[i / 3]).collect();
    let v = DVector::from_fn(3 * n, |i, _| state.v[i / 3][i % 3]);
    let right = DVector::from_fn(3 * n, |i, _| forces[i / 3][i % 3]) - &k * &v * h;
    let matrix = d * h + k * (h * h);
    let matrix = DMatrix::from_fn(free.len(), free.len(), |a, b| {
        let mass = if a == b { network.mass[free[a] / 3] } else { 0.0 };
        mass + matrix[(free[a], free[b])]
    });
    let right = DVector::from_fn(free.len(), |a, _| right[free[a]]);
    let acceleration = matrix.lu().solve(&right).expect("positive definite");
    let mut after = state.clone();
    for (a, &i) in acceleration.iter().zip(&free) {
        after.v[i / 3][i % 3] += h * a;
        after.x[i / 3][i % 3] += h * after.v[i / 3][i % 3];
    }
    after
}

/// Largest difference of velocities over the largest.
fn apart(ours: &State, theirs: &State) -> f64 {
    largest_difference(&ours.v, &theirs.v) / largest_norm(&theirs.v)
}

#[test]
fn a_step_from_rest_lengths_is_the_linear_implicit_euler_step() {
    // What dampers pull across when they turn is in our K as well, so that only one of damping and speed is there.
    for (damping, speed) in [(0.0, 0.2), (0.5, 0.0)] {
        let network = sample(damping);
        for h in LENGTHS {
            let errors = (0..5).map(|seed| {
                let state = samples::state(&network, seed, NEARLY * SPACING, speed);
                apart(&linear(&network, &state, TangentKind::Exact, h), &theirs(&network, &state, h))
            });
            let name = format!("implicit: linear step from rest lengths, c = {damping}, h = {h}");
            check(&name, FROM_REST, largest(errors));
        }
    }
}

#[test]
fn a_step_from_a_deformed_state_has_the_gauss_newton_matrix() {
    let network = sample(0.5);
    for h in LENGTHS {
        let state = samples::state(&network, 3, 0.2 * SPACING, 0.2);
        let reference = theirs(&network, &state, h);
        let error = apart(&gauss_newton(&network, &state, h, true), &reference);
        check(&format!("implicit: Gauss–Newton step, h = {h}"), STEP, error);
        let damping_alone = apart(&gauss_newton(&network, &state, h, false), &reference);
        must_fail(&format!("implicit: K left out, h = {h}"), STEP, damping_alone);
        for kind in [TangentKind::Exact, TangentKind::Stabilised] {
            let error = apart(&linear(&network, &state, kind, h), &reference);
            note(&format!("implicit: our {kind:?} tangent against Gauss–Newton, h = {h}, relative velocity"), error);
        }
    }
}

#[test]
fn trajectories_agree_beyond_the_explicit_limit() {
    let network = sample(0.5);
    for &h in &LENGTHS[..2] {
        let mut state = samples::state(&network, 7, 0.2 * SPACING, 0.2);
        let mut exact = state.clone();
        let start = largest_norm(&state.v);
        let mut reference = Reference::new(&network, Integrator::Discrete, h);
        reference.set_state(&state);
        let (mut positions, mut velocities, mut otherwise) = (0.0, 0.0, 0.0);
        for _ in 0..STEPS {
            state = gauss_newton(&network, &state, h, true);
            exact = linear(&network, &exact, TangentKind::Exact, h);
            reference.step();
            positions = largest([positions, largest_difference(&state.x, &reference.positions()) / SPACING]);
            velocities = largest([velocities, largest_difference(&state.v, &reference.velocities()) / start]);
            otherwise = largest([otherwise, largest_difference(&exact.x, &reference.positions()) / SPACING]);
        }
        check(&format!("implicit: positions over {STEPS} steps, h = {h}"), TRAJECTORY, positions);
        check(&format!("implicit: velocities over {STEPS} steps, h = {h}"), TRAJECTORY, velocities);
        note(&format!("implicit: exact tangent over {STEPS} steps, h = {h}, positions over the spacing"), otherwise);
    }
}
