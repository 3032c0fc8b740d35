//! The modelled device in motion: order, energy, static balance, and robustness.

use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::dynamics::{JointSettings, gravity};
use stickslip::device::phantom::hand::HandSettings;
use stickslip::device::phantom::kinematics::tip_force;
use stickslip::device::phantom::plant::{Plant, PlantState};
use stickslip::device::phantom::{Axes, DeviceError, Phantom, PhantomSettings};

use crate::check::{Worst, runner};

const TICK: f64 = 1e-3;

fn path(waypoints: &[(f64, [f64; 3])]) -> TipPath {
    let waypoints = waypoints.iter().map(|&(time, at)| Waypoint { time, position: Vec3::from(at) }).collect();
    TipPath::new(waypoints).expect("ascending and finite")
}

fn still() -> TipPath {
    path(&[(0.0, [0.0; 3])])
}

/// Returns joints without friction; the hand's springs and masses are unchanged, its dampers zero.
fn lossless(hand: HandSettings) -> PhantomSettings {
    let zero = Vec3::zeros();
    PhantomSettings {
        joints: JointSettings { damping: zero, friction: zero, ..JointSettings::default() },
        hand: HandSettings { stylus_damping: zero, arm_damping: zero, ..hand },
        ..PhantomSettings::default()
    }
}

fn let_go() -> HandSettings {
    let zero = Vec3::zeros();
    HandSettings { stylus_stiffness: zero, stylus_damping: zero, ..HandSettings::default() }
}

/// Returns the orders of neighbouring errors under halved steps.
fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect()
}

fn plant(settings: &PhantomSettings, substeps: u32, target: TipPath) -> Plant {
    Plant { settings: PhantomSettings { substeps, ..*settings }, target }
}

/// Runs a motion of 20 ticks: the target turns at ticks, and the command changes with every tick.
fn driven(settings: &PhantomSettings, substeps: u32) -> (Plant, PlantState) {
    let target = path(&[(0.0, [0.0; 3]), (0.008, [0.002, -0.001, 0.001]), (0.02, [-0.001, -0.003, 0.004])]);
    let plant = plant(settings, substeps, target);
    let mut state = PlantState::at_rest(Vec3::zeros());
    for tick in 0..20 {
        let t = f64::from(tick);
        let command = Vec3::new((0.5 * t).sin(), (0.3 * t).cos(), (0.7 * t).sin()) * 0.3;
        state = plant.advance(&state, t * TICK, TICK, &command);
    }
    (plant, state)
}

fn distance(a: &PlantState, b: &PlantState) -> f64 {
    ((a.angles - b.angles).norm_squared() + (a.hand - b.hand).norm_squared()).sqrt()
}

/// With a hand without dampers that holds and lets go, nothing takes energy.
#[test]
fn a_motion_without_friction_keeps_its_energy() {
    let names = [(let_go(), "let go"), (HandSettings::default(), "held")];
    for (hand, name) in names {
        let settings = lossless(hand);
        let mut start = PlantState::at_rest(Vec3::new(0.1, 0.2, -0.1));
        start.rates = Vec3::new(3.0, -2.0, 2.5);
        let run = |substeps: u32| {
            let plant = plant(&settings, substeps, still());
            (plant.stored_energy(&start, 0.0), plant.advance(&start, 0.0, 0.2, &Vec3::zeros()), plant)
        };
        let (_, reference, _) = run(25_600);
        let (mut energies, mut distances) = (vec![], vec![]);
        for substeps in [200, 400, 800, 1600] {
            let (before, end, plant) = run(substeps);
            energies.push(((plant.stored_energy(&end, 0.2) - before) / before).abs());
            distances.push(distance(&end, &reference));
        }
        let (of_energy, of_motion) = (orders(&energies), orders(&distances));
        println!(
            "RESIDUAL | convergence | PHANTOM, {name}, lossless: orders of motion, of energy (4, 4 or more) | 0.1 | \
             {of_motion:.2?} {of_energy:.2?} (energy, relative: {:.0e})",
            energies[3]
        );
        assert!((of_motion[2] - 4.0).abs() <= 0.1, "{name}: {of_motion:?}");
        // The last order is affected by rounding.
        assert!(of_energy[1] >= 3.9, "{name}: {of_energy:?}");
    }
}

#[test]
fn the_whole_device_converges_with_order_4_and_keeps_its_books() {
    // Friction as by default, tanh over 0.01 rad/s.
    let settings = PhantomSettings::default();
    let (_, reference) = driven(&settings, 640);
    let throughput = reference.flows.from_motors.abs() + reference.flows.from_target.abs();
    let (mut distances, mut books) = (vec![], vec![]);
    for substeps in [10, 20, 40, 80] {
        let (plant, end) = driven(&settings, substeps);
        distances.push(distance(&end, &reference));
        let start = PlantState::at_rest(Vec3::zeros());
        let stored = plant.stored_energy(&end, 0.02) - plant.stored_energy(&start, 0.0);
        let flows = end.flows;
        books.push((flows.from_motors + flows.from_target - flows.dissipated - stored).abs() / throughput);
    }
    let (of_motion, of_books) = (orders(&distances), orders(&books));
    println!(
        "RESIDUAL | convergence | PHANTOM, held, driven: orders in the substep of motion, of the energy balance | 0.1 | \
         {of_motion:.2?} {of_books:.2?} (10 substeps: {:.0e} m, {:.0e} of the work)",
        distances[0], books[0]
    );
    assert!((of_motion[2] - 4.0).abs() <= 0.1, "{of_motion:?} {distances:?}");
    assert!((of_books[2] - 4.0).abs() <= 0.1, "{of_books:?} {books:?}");
    Worst::new("energy", "PHANTOM, 10 substeps: energy balance, relative to work", 1e-6).check(books[0]);
}

/// Without friction the joints pass to the hand the motors' energy that they do not keep.
#[test]
fn what_the_hand_gets_is_what_the_joints_give() {
    let worst = Worst::new("energy", "PHANTOM: energy to the hand, relative to its throughput", 1e-6);
    let settings = PhantomSettings { joints: lossless(let_go()).joints, ..PhantomSettings::default() };
    let (plant, end) = driven(&settings, 80);
    let joints = |state: &PlantState| plant.settings.joints.energy(&state.angles, &state.rates);
    let kept = joints(&end) - joints(&PlantState::at_rest(Vec3::zeros()));
    assert!(end.flows.to_hand.abs() > 1e-6, "nothing to compare: {:?}", end.flows);
    worst.check((end.flows.from_motors - kept - end.flows.to_hand).abs() / end.flows.from_motors.abs());
}

/// i̇ = 2π·1000 Hz (i_c − i) over 0.2 ms.
#[test]
fn amplifiers_lag_by_their_bandwidth() {
    let worst = Worst::new("algebra", "PHANTOM: current after a step of the command, relative", 1e-9);
    let plant = plant(&PhantomSettings::default(), 100, still());
    let command = Vec3::new(1.0, -2.0, 0.5);
    let end = plant.advance(&PlantState::at_rest(Vec3::zeros()), 0.0, 2e-4, &command);
    let expected = command * -(-std::f64::consts::TAU * 1000.0 * 2e-4).exp_m1();
    worst.check((end.current - expected).norm() / expected.norm());
}

/// Static balance of motors, gravity and the hand's two springs in series.
#[test]
fn a_constant_force_is_balanced_by_the_hand() {
    let worst = Worst::new("algebra", "PHANTOM: static balance after 8 s, N", 1e-8);
    let forces = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.5], [1.5, -1.0, 2.0]];
    let axes = Axes { offset: Vec3::new(0.01, -0.02, 0.005), ..Axes::default() };
    let settings = PhantomSettings { axes, ..PhantomSettings::default() };
    let start = Vec3::new(0.003, 0.004, -0.002);
    let mut ends = vec![];
    for force in forces.map(Vec3::from) {
        let mut phantom = Phantom::new(settings, &path(&[(0.0, start.into())]), TICK).expect("near home");
        assert!((phantom.tip() - start).norm() <= 1e-15, "{}", phantom.tip());
        for tick in 0..8000 {
            phantom.advance(f64::from(tick) * TICK).expect("within the workspace");
            // Later the command is constant: at the edge between two counts a new one may alternate by a step.
            if tick < 4000 {
                phantom.command(&force);
            }
        }
        let (angles, current) = (phantom.state().angles, phantom.state().current);
        let torque = settings.actuation.torque(&current) - gravity(&angles);
        let displaced = settings.axes.rotation * (phantom.tip() - start);
        let hand = settings.hand;
        let compliance = hand.stylus_stiffness.map(f64::recip) + hand.arm_stiffness.map(f64::recip);
        worst.check((tip_force(&angles, &torque) - displaced.component_div(&compliance)).norm());
        // An encoder count turns the force by 1e-4, and a step of the current is 2e-4 N.
        let exerted = settings.axes.rotation.tr_mul(&tip_force(&angles, &settings.actuation.torque(&current)));
        assert!((exerted - force).norm() <= 2e-3, "{exerted} instead of {force}");
        ends.push(phantom.tip());
    }
    // In scene axes, against 65, 201 and 88 N/m of the springs in series: with 1 N by 15 and 5 mm, with 1.5 N by 17 mm.
    for axis in 0..2 {
        assert!(ends[axis + 1][axis] - ends[0][axis] > 1e-3, "{ends:?}");
    }
    assert!(ends[0].z - ends[3].z > 1e-3, "{ends:?}");
}

#[test]
fn random_forces_and_paths_leave_it_finite_or_end_with_a_name() {
    let outcomes = std::cell::Cell::new([0; 2]);
    let component = prop_oneof![9 => -20.0..20.0f64, 1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, 1e300])];
    let forces = prop::collection::vec(prop::array::uniform3(component), 50);
    let ends = prop::array::uniform3(-0.2..0.2f64);
    let result = runner(100).run(&(forces, ends), |(forces, end)| {
        let settings = PhantomSettings::default();
        let mut phantom = Phantom::new(settings, &path(&[(0.0, [0.0; 3]), (0.2, end)]), TICK).expect("at home");
        for (tick, force) in (0..400).zip(forces.iter().cycle()) {
            let before = *phantom.state();
            match phantom.advance(f64::from(tick) * TICK) {
                Ok(measured) => {
                    // Half a count of θ₁, θ₂ and θ₃ moves the tip by 22, 15 and 12 µm at most.
                    prop_assert!((measured - phantom.tip()).norm() <= 5e-5, "{}", measured);
                }
                Err(DeviceError::Pose { .. }) => {
                    prop_assert_eq!(*phantom.state(), before);
                    outcomes.set([outcomes.get()[0], outcomes.get()[1] + 1]);
                    return Ok(());
                }
                Err(other) => return Err(TestCaseError::fail(other.to_string())),
            }
            let applied = phantom.command(&Vec3::from(*force));
            prop_assert!(applied.norm() <= 8.6, "{}", applied);
        }
        outcomes.set([outcomes.get()[0] + 1, outcomes.get()[1]]);
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    println!(
        "RESIDUAL | extremes | PHANTOM under random forces: runs completed, ended at a limit | - | {:?}",
        outcomes.get()
    );
    assert!(outcomes.get()[0] > 10, "{outcomes:?}");
}

/// A hand pulls the stylus out of reach.
#[test]
fn a_limit_that_is_hit_is_named_with_its_time() {
    let away = path(&[(0.0, [0.0; 3]), (1.0, [0.0, 0.6, 0.0])]);
    let mut phantom = Phantom::new(PhantomSettings::default(), &away, TICK).expect("at home");
    let error = (0..2000).find_map(|tick| phantom.advance(f64::from(tick) * TICK).err()).expect("beyond its limits");
    let text = error.to_string();
    assert!(matches!(error, DeviceError::Pose { time_s, .. } if time_s > 0.1 && time_s < 1.5), "{text}");
    assert!(text.contains("workspace") && text.contains("θ"), "{text}");
}

#[test]
fn sustained_forces_warn_and_are_not_limited() {
    let worst = Worst::new("algebra", "PHANTOM: mean force against its exponential, relative", 5e-14);
    let mut phantom = Phantom::new(PhantomSettings::default(), &still(), TICK).expect("at home");
    let mut warned = None;
    for tick in 1..=20_000 {
        let applied = phantom.command(&Vec3::new(0.0, 0.0, -2.0));
        assert!((applied.norm() - 2.0).abs() <= 1e-3 && !phantom.saturated());
        // The time constant τ is 10 s.
        let expected = applied.norm() * -(-f64::from(tick) * TICK / 10.0).exp_m1();
        worst.check((phantom.mean_force_n() - expected).abs() / expected);
        assert_eq!(phantom.overheats(), phantom.mean_force_n() > 1.4);
        warned = warned.or(phantom.overheats().then_some(tick));
    }
    // The time is 10 s · ln(2/(2 − 1.4)).
    assert!(warned.is_some_and(|tick| (12_000..12_080).contains(&tick)), "{warned:?}");
}
