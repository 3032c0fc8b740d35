//! The structural mode of the modelled device: its frequency, its energy, and how far it bends.

use std::f64::consts::{PI, TAU};

use stickslip::Vec3;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::dynamics::{JointSettings, gravity};
use stickslip::device::phantom::hand::HandSettings;
use stickslip::device::phantom::kinematics::{forward, tip_force};
use stickslip::device::phantom::plant::{Plant, PlantState};
use stickslip::device::phantom::structure::StructureSettings;
use stickslip::device::phantom::{DeviceError, Phantom, PhantomSettings};

use crate::check::Worst;

fn still() -> TipPath {
    TipPath::new(vec![Waypoint { time: 0.0, position: Vec3::zeros() }]).expect("one waypoint")
}

/// Joints, structure and hand without friction and dampers.
fn lossless(hand: HandSettings) -> PhantomSettings {
    let zero = Vec3::zeros();
    PhantomSettings {
        joints: JointSettings { damping: zero, friction: zero, ..JointSettings::default() },
        structure: Some(StructureSettings { damping_ratio: 0.0, ..StructureSettings::default() }),
        hand: HandSettings { stylus_damping: zero, arm_damping: zero, ..hand },
        ..PhantomSettings::default()
    }
}

fn let_go() -> HandSettings {
    let zero = Vec3::zeros();
    HandSettings { stylus_stiffness: zero, stylus_damping: zero, ..HandSettings::default() }
}

fn stretch(state: &PlantState) -> Vec3 {
    state.stylus().position - state.links().position
}

/// The frequency is √(k(1/M + 1/m)) along each axis, with the apparent mass M of the links at home, where each axis has a
/// joint of its own.
#[test]
fn the_free_mode_has_its_frequency() {
    // The weight of the links turns them meanwhile, which couples θ₂ and θ₃. Measured: 2e-5.
    let worst = Worst::new("closed form", "PHANTOM with a structure: frequency of the free mode, relative", 1e-4);
    let settings = lossless(let_go());
    let device = Phantom::new(settings, &still(), 1e-3).expect("at home");
    let expected = device.structure_frequency_hz().expect("a structure");
    let plant = Plant { settings, target: still() };
    for axis in 0..3 {
        let apparent = device.apparent_mass_kg()[axis];
        let formula = (3500.0 * (1.0 / apparent + 1.0 / 0.01)).sqrt() / TAU;
        assert!((expected[axis] - formula).abs() <= 1e-12 * formula);
        let mut state = plant.at_rest(Vec3::zeros());
        state.tip.as_mut().expect("a structure").position[axis] += 1e-4;
        // Times at which the stretch passes zero, by linear interpolation between ticks of 10 µs.
        let (h, mut crossings) = (1e-5, Vec::new());
        for tick in 0..3000_u32 {
            let next = plant.advance(&state, f64::from(tick) * h, h, &Vec3::zeros());
            let [before, after] = [&state, &next].map(|state| stretch(state)[axis]);
            if before * after < 0.0 {
                crossings.push((f64::from(tick) + before / (before - after)) * h);
            }
            state = next;
        }
        // Whole periods: the links' weight shifts the middle of the swing by 3 µm.
        assert!(crossings.len() >= 5, "{crossings:?}");
        let measured = 2.0 / (crossings[4] - crossings[0]);
        worst.check((measured / formula - 1.0).abs());
    }
}

/// Without dampers nothing takes energy, whether the hand holds or lets go: the error falls with the order of the method.
#[test]
fn a_structure_without_damping_keeps_the_energy() {
    for (hand, name) in [(let_go(), "let go"), (HandSettings::default(), "held")] {
        let settings = lossless(hand);
        let errors = [400, 800, 1600].map(|substeps| {
            let plant = Plant { settings: PhantomSettings { substeps, ..settings }, target: still() };
            let mut start = plant.at_rest(Vec3::new(0.1, 0.2, -0.1));
            start.rates = Vec3::new(3.0, -2.0, 2.5);
            let before = plant.stored_energy(&start, 0.0);
            let end = plant.advance(&start, 0.0, 0.2, &Vec3::zeros());
            ((plant.stored_energy(&end, 0.2) - before) / before).abs()
        });
        println!("RESIDUAL | energy | PHANTOM with a structure, {name}, lossless, relative | 1e-6 | {:.0e}", errors[2]);
        assert!(errors[2] <= 1e-6 && (errors[0] / errors[1]).log2() >= 3.9, "{name}: {errors:?}");
    }
}

/// With all losses the energy balance closes at the default ten substeps, which are fine enough for the mode.
#[test]
fn ten_substeps_resolve_the_mode() {
    let run = |substeps: u32| {
        let settings =
            PhantomSettings { structure: Some(StructureSettings::default()), substeps, ..PhantomSettings::default() };
        let plant = Plant { settings, target: still() };
        let start = plant.at_rest(Vec3::zeros());
        let end = (0..20).fold(start, |state, tick| {
            let t = f64::from(tick);
            let command = Vec3::new((0.5 * t).sin(), (0.3 * t).cos(), (0.7 * t).sin()) * 0.3;
            plant.advance(&state, t * 1e-3, 1e-3, &command)
        });
        let flows = end.flows;
        let stored = plant.stored_energy(&end, 0.02) - plant.stored_energy(&start, 0.0);
        let missing = flows.from_motors + flows.from_target - flows.dissipated - stored;
        (end, missing.abs() / flows.from_motors.abs())
    };
    let ((coarse, missing), (fine, _)) = (run(10), run(320));
    // The net work of commands that change sign is small. Measured: 3e-5.
    Worst::new("energy", "PHANTOM with a structure, 10 substeps: energy balance, relative to work", 1e-4)
        .check(missing);
    // A thousandth of an encoder count. Measured: 9e-11.
    Worst::new("convergence", "PHANTOM with a structure: tip at 10 and 320 substeps apart, m", 3e-8)
        .check((coarse.stylus().position - fine.stylus().position).norm());
}

/// The hand holds the tip against a constant force of the motors, which bends the structure by F/k.
#[test]
fn a_force_bends_it_by_its_compliance() {
    let worst = Worst::new("closed form", "PHANTOM with a structure: static deflection against F/k, relative", 1e-6);
    let structure = StructureSettings::default();
    let settings = PhantomSettings { structure: Some(structure), ..PhantomSettings::default() };
    for force in [[1.5, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, -1.0, 1.5]].map(Vec3::from) {
        let mut phantom = Phantom::new(settings, &still(), 1e-3).expect("at home");
        for tick in 0..8000 {
            phantom.advance(f64::from(tick) * 1e-3).expect("within the workspace");
            if tick < 3000 {
                phantom.command(&force);
            }
        }
        let state = phantom.state();
        let torque = settings.actuation.torque(&state.current) - gravity(&state.angles);
        let exerted = tip_force(&state.angles, &torque);
        let bent = -stretch(state);
        worst.check((bent - exerted / structure.stiffness).norm() / bent.norm());
        // The encoders do not see the deflection, since they measure the links.
        let measured = settings.axes.rotation * phantom.measured_tip();
        assert!((measured - forward(&state.angles)).norm() < 5e-5 && bent.norm() > 3e-4, "{bent}");
    }
}

#[test]
fn a_tip_too_light_for_the_steps_is_refused_with_a_way_out() {
    let with = |tip_mass: f64, substeps: u32| {
        let structure = Some(StructureSettings { tip_mass, ..StructureSettings::default() });
        PhantomSettings { structure, substeps, ..PhantomSettings::default() }
    };
    with(0.01, 10).check(1e-3).expect("the default is fine enough");
    let error = with(1e-6, 10).check(1e-3).expect_err("too coarse");
    let DeviceError::Substeps { least, rate, .. } = error else { panic!("{error}") };
    // The tip alone swings at √(k/m).
    assert!(rate > (3500.0_f64 / 1e-6).sqrt() && least > 10.0, "{error}");
    with(1e-6, least as u32).check(1e-3).expect("the way out");
    let plant = Plant { settings: with(1e-6, least as u32), target: still() };
    let mut start = plant.at_rest(Vec3::zeros());
    start.tip.as_mut().expect("a structure").position.x += 1e-5;
    let end = (0..50).fold(start, |state, tick| plant.advance(&state, f64::from(tick) * 1e-3, 1e-3, &Vec3::zeros()));
    assert!(end.is_finite() && stretch(&end).norm() < 1e-4, "{}", stretch(&end));
    for structure in [
        StructureSettings { stiffness: f64::NAN, ..StructureSettings::default() },
        StructureSettings { tip_mass: 0.0, ..StructureSettings::default() },
        StructureSettings { damping_ratio: -PI, ..StructureSettings::default() },
    ] {
        let settings = PhantomSettings { structure: Some(structure), ..PhantomSettings::default() };
        assert!(matches!(settings.check(1e-3), Err(DeviceError::Setting { .. })), "{structure:?}");
    }
}
