//! The network alone: accelerations of deformed states, and trajectories by the same scheme.

use stickslip::Vec3;
use stickslip::dynamics::constraint::Unconstrained;
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::model::network::Network;
use stickslip::model::springs::Spring;
use stickslip::model::state::{ExternalForce, State};
use stickslip_mujoco::Reference;
use stickslip_mujoco::mjcf::Integrator;
use stickslip_mujoco::residual::{check, largest, largest_difference, largest_norm, must_fail, note};
use stickslip_mujoco::samples::{self, SPACING, Variation};

/// Largest difference of an acceleration, relative to the largest acceleration. Both sum some twenty
/// spring forces a node: a few hundred roundings of 1e-16. Measured: 4e-16.
const ACCELERATION: f64 = 1e-13;

/// Largest difference of a position, relative to the spacing, and of a velocity, relative to the
/// fastest node at the start, over [`STEPS`] steps of the same scheme. A round-off in each step adds
/// up, and a lightly damped nonlinear network magnifies it. Measured: 2e-14 and 1e-13.
const TRAJECTORY: f64 = 1e-12;

/// Steps of a trajectory: five seconds, in which the network still moves at the end.
const STEPS: usize = 5000;
/// s.
const STEP: f64 = 1e-3;
/// Mean damping of a spring in trajectories, N·s/m: light, so that they stay alive.
const LIGHT_DAMPING: f64 = 0.003;

fn sample(damping: f64, external: Vec<ExternalForce>) -> Network {
    samples::network(&samples::block().mesh(), Variation { mass: 0.5, stiffness: 0.3, damping }, external)
}

fn gravity_and_drag() -> Vec<ExternalForce> {
    vec![ExternalForce::Gravity(Vec3::new(0.3, -0.2, -9.81)), ExternalForce::Drag(0.001)]
}

/// A network that differs in its springs.
fn altered(network: &Network, alter: impl Fn(usize, Spring) -> Spring) -> Network {
    let springs: Vec<Spring> = network.springs.iter().enumerate().map(|(i, spring)| alter(i, spring)).collect();
    let Network { rest, mass, fixed, external, .. } = network.clone();
    Network::from_parts(rest, mass, fixed, &springs, external)
}

fn our_accelerations(network: &Network, state: &State) -> Vec<Vec3> {
    let mut a = vec![Vec3::zeros(); network.node_count()];
    network.forces(&state.x, &state.v, &mut a);
    a.iter_mut().zip(&network.inverse_mass).for_each(|(a, inverse_mass)| *a *= *inverse_mass);
    a
}

fn acceleration_error(ours: &Network, theirs: &Network) -> f64 {
    let mut reference = Reference::new(theirs, Integrator::Euler, STEP);
    largest((0..20).map(|seed| {
        let state = samples::state(ours, seed, 0.2 * SPACING, 0.2);
        reference.set_state(&state);
        let expected = our_accelerations(ours, &state);
        largest_difference(&expected, &reference.accelerations()) / largest_norm(&expected)
    }))
}

#[test]
fn accelerations_agree() {
    let springs = sample(0.5, Vec::new());
    check("network: accelerations, springs alone", ACCELERATION, acceleration_error(&springs, &springs));
    let all = sample(0.5, gravity_and_drag());
    check("network: accelerations, with gravity and drag", ACCELERATION, acceleration_error(&all, &all));
}

#[test]
fn a_mistake_in_the_forces_shows() {
    let network = sample(0.5, Vec::new());
    let flipped = altered(&network, |_, spring| Spring { damping: -spring.damping, ..spring });
    must_fail("network: damping sign flipped", ACCELERATION, acceleration_error(&network, &flipped));
    let stiffer = altered(&network, |i, spring| {
        if i == 200 { Spring { stiffness: spring.stiffness * (1.0 + 1e-9), ..spring } } else { spring }
    });
    must_fail("network: one spring stiffer by 1e-9", ACCELERATION, acceleration_error(&network, &stiffer));
    let longer = altered(&network, |i, spring| {
        if i == 200 { Spring { rest_length: spring.rest_length * (1.0 + 1e-9), ..spring } } else { spring }
    });
    must_fail("network: one rest length off by 1e-9", ACCELERATION, acceleration_error(&network, &longer));
}

/// How far two trajectories come apart, and how fast the network still is at the end.
struct Comparison {
    position: f64,
    velocity: f64,
    final_speed: f64,
}

fn compare(ours: &Network, ours_by: GlobalIntegrator, theirs: &Network, theirs_by: Integrator) -> Comparison {
    let mut state = samples::state(ours, 7, 0.2 * SPACING, 0.2);
    let start_speed = largest_norm(&state.v);
    let mut reference = Reference::new(theirs, theirs_by, STEP);
    reference.set_state(&state);
    let mut stepper = Stepper::new(ours);
    let (mut position, mut velocity) = (0.0, 0.0);
    for _ in 0..STEPS {
        stepper.step(ours_by, ours, &mut state, STEP, &Unconstrained);
        reference.step();
        position = largest([position, largest_difference(&state.x, &reference.positions()) / SPACING]);
        velocity = largest([velocity, largest_difference(&state.v, &reference.velocities()) / start_speed]);
    }
    Comparison { position, velocity, final_speed: largest_norm(&state.v) }
}

fn trajectories_agree(scheme: &str, ours_by: GlobalIntegrator, theirs_by: Integrator) {
    for (what, external) in [("springs alone", Vec::new()), ("with gravity and drag", gravity_and_drag())] {
        let network = sample(LIGHT_DAMPING, external);
        let Comparison { position, velocity, final_speed } = compare(&network, ours_by, &network, theirs_by);
        assert!(final_speed > 0.01, "a network at rest compares nothing: {final_speed} m/s");
        check(&format!("network: {scheme} positions over {STEPS} steps, {what}"), TRAJECTORY, position);
        check(&format!("network: {scheme} velocities over {STEPS} steps, {what}"), TRAJECTORY, velocity);
    }
    let undamped = sample(0.0, Vec::new());
    let Comparison { position, .. } = compare(&undamped, ours_by, &undamped, theirs_by);
    note(&format!("network: {scheme} positions over {STEPS} steps, undamped and chaotic"), position);
}

#[test]
fn semi_implicit_euler_trajectories_agree() {
    trajectories_agree("semi-implicit Euler", GlobalIntegrator::SemiImplicitEuler, Integrator::Euler);
}

#[test]
fn rk4_trajectories_agree() {
    trajectories_agree("RK4", GlobalIntegrator::Rk4, Integrator::Rk4);
}

#[test]
fn a_mistake_in_the_scheme_shows() {
    let network = sample(LIGHT_DAMPING, gravity_and_drag());
    let swapped = compare(&network, GlobalIntegrator::SemiImplicitEuler, &network, Integrator::Rk4);
    must_fail("network: semi-implicit Euler against RK4", TRAJECTORY, swapped.position);
    let undragged = sample(LIGHT_DAMPING, vec![network.external[0]]);
    let dropped = compare(&network, GlobalIntegrator::Rk4, &undragged, Integrator::Rk4);
    must_fail("network: drag left out", TRAJECTORY, dropped.position);
}
