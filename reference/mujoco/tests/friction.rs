//! Stick-slip along a line: dry friction on the coordinate of a contact point.

use stickslip::Vec3;
use stickslip::contact::law::{Interface, Law, Mode};
use stickslip::model::network::Network;
use stickslip::model::state::State;
use stickslip::surface::support::Metric;
use stickslip_mujoco::Reference;
use stickslip_mujoco::mjcf::{PointTendon, TendonConstraint};
use stickslip_mujoco::residual::{check, largest, largest_difference, must_fail};
use stickslip_mujoco::samples::{self, Point, SPACING, Variation};

/// Difference of the forces that stick, relative to |λ|: MuJoCo's is softer by R/A.
/// Measured: 6e-11.
const STICK_FORCE: f64 = 1e-9;
/// Difference of the forces that slip, relative to |λ|. Ours goes through F_N and the unit vector t̂:
/// a few roundings. Measured: 1e-16.
const SLIP_FORCE: f64 = 1e-14;
/// MuJoCo's |f| against the bound μF_N, relative to it: it takes the bound as it is. Measured: 0.
const BOUND: f64 = 1e-15;
/// Largest difference of a position, relative to the spacing, while both slip by the same scheme:
/// round-off over some sixty steps. Measured: 8e-16.
const SLIP_TRAJECTORY: f64 = 1e-12;
/// Largest R/A: much above it MuJoCo would not tell 0.9999 of the bound from 1.0001. Measured: 1e-10.
const SOFTNESS: f64 = 1e-9;

/// What R is divided by. MuJoCo's hardest impedance, 0.9999, leaves R/A = 1e-4, which shifts the
/// load at which a contact slips by as much as this test resolves.
const HARDENING: f64 = 1e6;

/// s.
const STEP: f64 = 1e-4;
/// More than any slip takes.
const MOST_STEPS: usize = 10_000;
/// How far the triangle in contact is pushed in, so that the mesh pushes back, m.
const DEPTH: f64 = 0.4 * SPACING;

fn sample() -> Network {
    samples::network(&samples::block().mesh(), Variation { mass: 0.5, stiffness: 0.3, damping: 0.1 }, Vec::new())
}

/// A contact point held by the tip on a deformed network, and the reaction there.
struct Held {
    point: Point,
    state: State,
    normal: Vec3,
    reaction: Vec3,
    /// F_N.
    normal_force: f64,
    /// F_T and t̂.
    tangential_force: f64,
    tangent: Vec3,
}

impl Held {
    fn all(network: &Network) -> Vec<Self> {
        let points = Point::all(&samples::block().mesh(), network, 2);
        let held: Vec<Self> =
            points.into_iter().enumerate().map(|(i, point)| Self::new(network, point, i as u64)).collect();
        assert!(held.len() > 50, "too few contact points: {}", held.len());
        held
    }

    fn new(network: &Network, point: Point, seed: u64) -> Self {
        let mut state = samples::state(network, seed, 0.1 * SPACING, 0.02);
        point.press(network, DEPTH, &mut state);
        let operators = point.operators(Metric::Mass, network);
        operators.project_sticking(&mut state.v);
        let mut forces = vec![Vec3::zeros(); network.node_count()];
        network.forces(&state.x, &state.v, &mut forces);
        let reaction = operators.reaction(&forces);
        let normal = point.normal(&state.x);
        let normal_force = reaction.dot(&normal);
        assert!(normal_force > 0.0, "the mesh has to push");
        let tangential = reaction - normal * normal_force;
        let tangential_force = tangential.norm();
        let tangent = tangential / tangential_force;
        Self { point, state, normal, reaction, normal_force, tangential_force, tangent }
    }

    /// μ for which F_T is this share of μF_N.
    fn friction(&self, share: f64) -> f64 {
        self.tangential_force / (share * self.normal_force)
    }

    /// MuJoCo with dry friction of at most `bound` along t̂.
    fn reference(&self, network: &Network, bound: f64) -> Reference {
        let support = self.point.support();
        let constraint = TendonConstraint::FrictionLoss(bound);
        let tendon = PointTendon { support: &support, direction: self.tangent, constraint };
        let mut reference = Reference::constrained(network, STEP, &[tendon], HARDENING);
        reference.set_state(&self.state);
        reference
    }
}

/// What a contact does at some share of the bound, and its force along t̂, N.
struct Outcome {
    bound: f64,
    ours: (Mode, f64),
    theirs: (Mode, f64),
}

fn outcome(network: &Network, held: &Held, share: f64) -> Outcome {
    let friction = held.friction(share);
    let bound = friction * held.normal_force;
    let (mode, force) =
        Law::StickSlip { friction: friction.into() }.contact_force(held.reaction, held.normal, Interface::NEW);
    let reference = held.reference(network, bound);
    let theirs = if reference.at_bound()[0] { Mode::Slip } else { Mode::Stick };
    let along = (force - held.normal * held.normal_force).dot(&held.tangent);
    // MuJoCo's force acts on the network, ours on the instrument.
    Outcome { bound, ours: (mode, along), theirs: (theirs, -reference.constraint_forces()[0]) }
}

/// Loads every contact alike, and returns the largest difference of the forces relative to |λ|, and
/// of MuJoCo's from the bound relative to it.
fn compare(network: &Network, held: &[Held], share: f64, expected: Mode) -> (f64, f64) {
    let (mut force, mut bound) = (0.0, 0.0);
    for held in held {
        let outcome = outcome(network, held, share);
        let ((our_mode, ours), (their_mode, theirs)) = (outcome.ours, outcome.theirs);
        assert_eq!((our_mode, their_mode), (expected, expected), "at {share} of the bound");
        force = largest([force, (ours - theirs).abs() / held.reaction.norm()]);
        bound = largest([bound, (theirs - outcome.bound).abs() / outcome.bound]);
    }
    (force, bound)
}

#[test]
fn it_sticks_below_the_bound_and_slips_above() {
    let network = sample();
    let held = Held::all(&network);
    let softness = held.iter().map(|held| held.reference(&network, 1.0).softness());
    check("friction: softness R/A", SOFTNESS, largest(softness));
    let (force, _) = compare(&network, &held, 0.9999, Mode::Stick);
    check("friction: force that sticks, at 0.9999 of the bound", STICK_FORCE, force);
    let (force, bound) = compare(&network, &held, 1.0001, Mode::Slip);
    check("friction: force that slips, at 1.0001 of the bound", SLIP_FORCE, force);
    check("friction: MuJoCo's force against the bound while slipping", BOUND, bound);
}

/// Steps both networks from twice the bound for as long as ours slips; `kept` is the share of the
/// force at the bound that acts on our mesh. Returns the steps and the largest difference.
fn slip_along(network: &Network, held: &Held, kept: f64) -> (usize, f64) {
    let friction = held.friction(2.0);
    let mut reference = held.reference(network, friction * held.normal_force);
    let operators = held.point.operators(Metric::Mass, network);
    let State { mut x, mut v } = held.state.clone();
    let mut forces = vec![Vec3::zeros(); network.node_count()];
    let mut error = 0.0;
    for step in 0..MOST_STEPS {
        network.forces(&x, &v, &mut forces);
        // Along the line only: F_N stays what it was, and nothing holds the point across it.
        let along = operators.reaction(&forces).dot(&held.tangent);
        let reaction = held.normal * held.normal_force + held.tangent * along;
        let (mode, force) =
            Law::StickSlip { friction: friction.into() }.contact_force(reaction, held.normal, Interface::NEW);
        if mode == Mode::Stick || along < 0.0 {
            return (step, error);
        }
        let friction_force = held.tangent * (kept * force.dot(&held.tangent));
        operators.subtract_contact_force(friction_force, &mut forces);
        for (node, &inverse_mass) in network.inverse_mass.iter().enumerate() {
            v[node] += forces[node] * (STEP * inverse_mass);
            x[node] += v[node] * STEP;
        }
        reference.step();
        error = largest([error, largest_difference(&x, &reference.positions()) / SPACING]);
    }
    panic!("it still slips after {MOST_STEPS} steps")
}

#[test]
fn it_slips_along_the_same_path() {
    let network = sample();
    let runs: Vec<(usize, f64)> = Held::all(&network).iter().map(|held| slip_along(&network, held, 1.0)).collect();
    let steps: usize = runs.iter().map(|(steps, _)| steps).sum();
    println!("{} slips, {steps} steps", runs.len());
    assert!(steps > 1000, "too few steps slipped: {steps}");
    check("friction: positions while slipping", SLIP_TRAJECTORY, largest(runs.iter().map(|(_, error)| *error)));
}

#[test]
fn a_mistake_in_the_friction_shows() {
    let network = sample();
    let held = &Held::all(&network)[0];
    must_fail("friction: force dropped to zero at slip", SLIP_TRAJECTORY, slip_along(&network, held, 0.0).1);
    must_fail("friction: force of the wrong sign at slip", SLIP_TRAJECTORY, slip_along(&network, held, -1.0).1);
    let below = outcome(&network, held, 0.9999).theirs.1;
    let above = outcome(&network, held, 1.0001).ours.1;
    must_fail(
        "friction: 0.9999 of the bound taken for 1.0001",
        SLIP_FORCE,
        (above - below).abs() / held.reaction.norm(),
    );
}
