//! Stages between contact and device: passivity control, smoothing, a virtual coupling.

use nalgebra::Matrix2;
use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::device::coupling::{
    CouplingError, CouplingSettings, HandOverSmoothing, PassivityController, VirtualCoupling,
};
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::{Phantom, PhantomSettings};
use stickslip::verify::residual::{larger, largest};

use crate::check::{Worst, runner};

const TICK: f64 = 1e-3;

/// Active walls: delay in ticks, stiffness (N/m), and the share of the energy that passivity control may leave.
const ACTIVE_WALLS: [(usize, f64, f64); 2] = [(5, 2e3, 0.02), (0, 2e4, 0.2)];

fn vector(bound: f64) -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-bound..bound).prop_map(Vec3::from)
}

fn coupling() -> impl Strategy<Value = CouplingSettings> {
    // The masses range from 1.05 times the least mass on.
    (10.0..5000.0f64, 0.0..50.0f64, 1.05..20.0f64).prop_map(|(stiffness, damping, times)| {
        let least = 0.25 * TICK * (TICK * stiffness + 2.0 * damping);
        CouplingSettings { stiffness, damping, mass: times * least }
    })
}

/// Presses the device for a second into a wall with a delay of some ticks, and returns the largest energy that its
/// forces, as the motors held them, emitted, J.
fn press_into_wall(late: usize, stiffness: f64, mut controller: Option<PassivityController>) -> f64 {
    let waypoints = [(0.0, 0.002), (0.3, -0.02)].map(|(time, height)| Waypoint { time, position: Vec3::z() * height });
    let path = TipPath::new(waypoints.to_vec()).expect("ascending");
    let mut phantom = Phantom::new(PhantomSettings::default(), &path, TICK).expect("near home");
    let mut heights = vec![0.002; late + 1];
    let (mut before, mut applied) = (phantom.measured_tip(), Vec3::zeros());
    let (mut given, mut most) = (0.0, 0.0_f64);
    for tick in 0..1000 {
        let tip = phantom.advance(f64::from(tick) * TICK).expect("within the workspace");
        let moved = tip - before;
        given += applied.dot(&moved);
        most = larger(most, given);
        heights.rotate_left(1);
        heights[late] = tip.z;
        let mut force = Vec3::z() * (-stiffness * heights[0]).max(0.0);
        if let Some(controller) = &mut controller {
            force = controller.command(&force, &moved);
            assert!((controller.energy_j() + given).abs() <= 1e-12, "{} is not {given}", controller.energy_j());
        }
        applied = phantom.command(&force);
        if let Some(controller) = &mut controller {
            controller.hold(applied);
        }
        before = tip;
    }
    most
}

#[test]
fn passivity_control_keeps_a_wall_from_giving_energy() {
    for (late, stiffness, share) in ACTIVE_WALLS {
        let worst =
            Worst::new("energy", "passivity control at an active wall: energy given out over that without", share);
        let without = press_into_wall(late, stiffness, None);
        let with = press_into_wall(late, stiffness, Some(PassivityController::default()));
        println!(
            "RESIDUAL | energy | wall, {late} ticks late, without control: energy given out, J | > 1e-4 | {without:.1e}"
        );
        assert!(without > 1e-4, "the wall is not active: {without}");
        worst.check(with / without);
    }
}

#[test]
fn a_damper_takes_along_the_motion_what_is_missing_and_nothing_else() {
    let exact =
        Worst::new("algebra", "passivity control, random: correction along the motion over what is missing", 3e-15);
    let steps = prop::collection::vec((vector(5.0), vector(1e-3)), 200);
    let corrected = std::cell::Cell::new([0; 2]);
    let result = runner(100).run(&steps, |steps| {
        let mut controller = PassivityController::default();
        let (mut energy, mut held) = (0.0, Vec3::zeros());
        for (force, displacement) in steps {
            energy -= held.dot(&displacement);
            let commanded = controller.command(&force, &displacement);
            prop_assert_eq!(controller.energy_j(), energy);
            prop_assert_eq!(energy >= 0.0, commanded == force);
            let correction = commanded - force;
            let missing = energy.min(0.0);
            let size = force.norm() * displacement.norm() + missing.abs();
            exact.case((correction.dot(&displacement) - missing).abs() / size)?;
            exact.case(correction.cross(&displacement).norm() / size)?;
            corrected
                .set([corrected.get()[0] + u32::from(energy < 0.0), corrected.get()[1] + u32::from(energy >= 0.0)]);
            held = commanded;
            controller.hold(commanded);
        }
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    assert!(corrected.get().iter().all(|&count| count > 1000), "{corrected:?}");
    // At rest and for NaN it leaves forces unchanged and keeps its account.
    let mut controller = PassivityController::default();
    assert_eq!(controller.command(&Vec3::x(), &Vec3::zeros()), Vec3::x());
    assert!(controller.command(&Vec3::repeat(f64::NAN), &Vec3::x()).x.is_nan());
    assert_eq!(controller.energy_j(), 0.0);
}

#[test]
fn smoothing_bounds_the_jump_at_a_hand_over() {
    let jump = Worst::new("algebra", "smoothing over n ticks: jump over 1/(n + 1) of the raw one, N", 2e-14);
    let fade = Worst::new("algebra", "smoothing: fade against its formula, N", 2e-14);
    let cases = (vector(5.0), vector(5.0), vector(5.0), 1..50u32, 0..50u32);
    let result = runner(500).run(&cases, |(first, second, third, ticks, until_next)| {
        let mut smoothing = HandOverSmoothing::new(ticks);
        // The first fade starts from no force.
        let begun = smoothing.command(&first, true);
        fade.case((begun - first / f64::from(ticks + 1)).norm())?;
        for _ in 0..ticks {
            smoothing.command(&first, false);
        }
        let mut before = smoothing.command(&first, false);
        prop_assert_eq!(before, first);
        // The second hand-over may fall into the fade of the first.
        for (force, length) in [(second, until_next), (third, ticks + 5)] {
            let (from, raw) = (before, (force - before).norm());
            for j in 0..=length {
                let commanded = smoothing.command(&force, j == 0);
                // Under a constant force each step is like the first.
                jump.case((commanded - before).norm() - raw / f64::from(ticks + 1))?;
                let share = (1.0 - f64::from(j + 1) / f64::from(ticks + 1)).max(0.0);
                fade.case((commanded - force - (from - force) * share).norm())?;
                before = commanded;
            }
        }
        prop_assert_eq!(before, third);
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    let mut none = HandOverSmoothing::new(0);
    assert_eq!(none.command(&Vec3::x(), false), Vec3::x());
    assert_eq!(none.command(&Vec3::y(), true), Vec3::y());
}

#[test]
fn a_coupling_at_rest_transmits_the_contact_force() {
    let constant = Worst::new("algebra", "virtual coupling at rest: force against that of contact, relative", 1e-15);
    let result = runner(200).run(&(vector(5.0), 10.0..5000.0f64, 1.0..50.0f64), |(contact, stiffness, damping)| {
        // Critically damped or more, and slow compared with the tick: at rest after 40 of its slowest time constants.
        let mass = (0.25 * damping * damping / stiffness).max(TICK * (TICK * stiffness + 2.0 * damping));
        let settings = CouplingSettings { stiffness, damping, mass };
        let start = Vec3::new(0.01, -0.02, 0.03);
        let mut coupling = VirtualCoupling::new(settings, TICK, start).expect("heavy enough");
        let measured = start + Vec3::new(1e-3, 2e-3, -1e-3);
        let slowest = (2.0 * mass / damping).max(2.0 * damping / stiffness).max(TICK);
        for _ in 0..(40.0 * slowest / TICK) as u32 + 200 {
            coupling.advance(&measured, &contact);
        }
        constant.case((coupling.force() - contact).norm() / (contact.norm() + stiffness * start.norm()))
    });
    result.unwrap_or_else(|error| panic!("{error}"));
}

/// The simulated tip leans on a wall: the device meets its spring in series with the coupling's.
#[test]
fn a_coupling_softens_a_wall_in_series() {
    let worst = Worst::new("algebra", "virtual coupling at a wall of 800 N/m: force, relative", 2e-15);
    let settings = CouplingSettings { stiffness: 500.0, damping: 5.0, mass: 0.05 };
    let mut coupling = VirtualCoupling::new(settings, TICK, Vec3::zeros()).expect("heavy enough");
    let measured = Vec3::z() * -0.004;
    let mut contact = Vec3::zeros();
    for _ in 0..5000 {
        let tip = coupling.advance(&measured, &contact);
        contact = Vec3::z() * (-800.0 * tip.z).max(0.0);
    }
    let expected = 0.004 / (1.0 / 500.0 + 1.0 / 800.0);
    worst.check((coupling.force() - Vec3::z() * expected).norm() / expected);
}

/// Returns one tick of x and v about a measured tip at rest, as a matrix.
#[test]
fn couplings_are_refused_from_where_their_step_is_unstable() {
    let result = runner(500).run(&coupling(), |settings| {
        let CouplingSettings { stiffness: k, damping: b, mass } = settings;
        let least = 0.25 * TICK * (TICK * k + 2.0 * b);
        let radius = |mass: f64| {
            let (by_x, by_v) = (-TICK * k / mass, 1.0 - TICK * b / mass);
            let step = Matrix2::new(1.0 + TICK * by_x, TICK * by_v, by_x, by_v);
            largest(step.complex_eigenvalues().iter().map(|value| value.norm()))
        };
        prop_assert!(settings.check(TICK).is_ok() && radius(mass) <= 1.0 + 1e-9);
        let light = CouplingSettings { mass: 0.99 * least, ..settings };
        let least_mass = CouplingError::TooLight { mass: light.mass, least };
        prop_assert!(light.check(TICK) == Err(least_mass) && radius(light.mass) > 1.0, "{}", least);
        // The simulation itself, started with a kick, stays within the energy of the kick.
        let mut coupling = VirtualCoupling::new(settings, TICK, Vec3::zeros()).expect("stable");
        coupling.advance(&Vec3::zeros(), &(Vec3::x() * (mass / TICK)));
        let mut farthest = 0.0_f64;
        for _ in 0..2000 {
            farthest = larger(farthest, coupling.advance(&Vec3::zeros(), &Vec3::zeros()).norm());
        }
        prop_assert!(farthest <= 100.0 * (TICK + (mass / k).sqrt()), "{}", farthest);
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let good = CouplingSettings { stiffness: 500.0, damping: 5.0, mass: 0.05 };
        let bads = [CouplingSettings { stiffness: bad, ..good }, CouplingSettings { mass: bad, ..good }];
        for settings in bads {
            assert!(matches!(settings.check(TICK), Err(CouplingError::Setting { .. })), "{settings:?}");
        }
        assert!(good.check(bad).is_err());
        assert!(bad == 0.0 || CouplingSettings { damping: bad, ..good }.check(TICK).is_err());
    }
}
