//! The modelled device in the loop: every scene in fixtures/closed-loop, and the stages between contact and device.

use std::path::{Path, PathBuf};

use stickslip::Vec3;
use stickslip::contact::law::Mode;
use stickslip::device::coupled::DeviceView;
use stickslip::device::instrument::InstrumentKind;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::dynamics::JointSettings;
use stickslip::device::phantom::kinematics::{FORE_LINK, UPPER_LINK, inverse};
use stickslip::device::phantom::{Axes, Phantom, PhantomSettings};
use stickslip::multirate::timeline::{Cost, Costs, OverrunPolicy};
use stickslip::pipeline::Simulation;
use stickslip::scene::{Problem, Scene};
use stickslip::verify::residual;
use stickslip::verify::residual::larger;

use crate::check::Worst;

/// Maximum force of the device as published, N.
const LARGEST_FORCE: f64 = 8.5;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/closed-loop")
}

fn scene(name: &str) -> Scene {
    Scene::load(&folder().join(format!("{name}.toml"))).expect("a scene")
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Tick {
    tip: Vec3,
    force: Vec3,
    contact_force: Vec3,
    is_free: bool,
    model_age: u64,
    device: Option<DeviceView>,
}

impl Tick {
    fn device(&self) -> DeviceView {
        self.device.expect("a scene with a device")
    }
}

fn run(scene: &Scene) -> Vec<Tick> {
    let mut ticks = Vec::new();
    let simulation = Simulation::prepare(scene).expect("it starts outside, within the workspace");
    simulation
        .run(|view| {
            ticks.push(Tick {
                tip: view.tip,
                force: view.force,
                contact_force: view.report.force,
                is_free: view.report.mode == Mode::Free,
                model_age: view.model_age,
                device: view.device,
            });
        })
        .unwrap_or_else(|fault| panic!("{}: {fault}", scene.name));
    assert_eq!(ticks.len() as u64, scene.tick_count());
    ticks
}

fn last_energy(ticks: &[Tick]) -> f64 {
    ticks.last().expect("there are ticks").device().energy_to_hand_j
}

#[test]
fn every_closed_loop_scene_completes_and_again_bit_for_bit() {
    let files = std::fs::read_dir(folder()).expect("the folder is there");
    let mut names: Vec<String> =
        files.map(|file| file.expect("a file").path().file_stem().expect("a name").display().to_string()).collect();
    names.sort();
    assert_eq!(names.len(), 9, "{names:?}");
    let mut saturated = Vec::new();
    for name in &names {
        let ticks = run(&scene(name));
        // All numbers are finite, so that equal numbers have equal bits, but for the sign of 0.
        for (at, tick) in ticks.iter().enumerate() {
            let device = tick.device();
            let numbers = [tick.force.norm(), tick.tip.norm(), device.tip.norm(), device.energy_to_hand_j];
            assert!(numbers.iter().all(|number| number.is_finite()), "{name}, tick {at}: {tick:?}");
            assert!(tick.force.norm() <= LARGEST_FORCE || device.is_saturated, "{name}, tick {at}: {tick:?}");
        }
        assert_eq!(ticks, run(&scene(name)), "{name}");
        assert!(ticks.iter().filter(|tick| !tick.is_free).count() > 150, "{name} is hardly ever in contact");
        if ticks.iter().any(|tick| tick.device().is_saturated) {
            saturated.push(name.as_str());
        }
    }
    assert_eq!(saturated, ["hard-wall"]);
}

/// Upper bound of the energy from the motors to the hand: E + V(θ) − V(θ₀) = W_motors − friction − kinetic energy,
/// where V is the potential of the links' weight, which the motors do not carry.
fn given_by_motors(scene: &Scene, ticks: &[Tick]) -> f64 {
    let axes = Axes::default();
    let joints = JointSettings::default();
    let potential = |tip: Vec3| {
        let angles = inverse(&(axes.rotation * tip + axes.offset)).expect("within the workspace");
        joints.energy(&angles, &Vec3::zeros())
    };
    let start = potential(scene.path.at(0.0));
    let given = ticks.iter().map(|tick| tick.device().energy_to_hand_j + potential(tick.device().tip) - start);
    given.fold(f64::NEG_INFINITY, larger)
}

#[test]
fn soft_contact_gives_the_hand_nothing() {
    // Six orders of magnitude below the work of the drags: rounding, RK4 and the inverse of the pose.
    let worst = Worst::new("energy", "closed loop, soft contact: energy given to the hand, J", 1e-10);
    for name in ["sliding-by-hand", "sticking-by-hand", "stick-slip-by-hand", "tap", "smoothing", "virtual-wall"] {
        let scene = scene(name);
        let ticks = run(&scene);
        worst.check(given_by_motors(&scene, &ticks));
        assert!(last_energy(&ticks) < -1e-3, "{name}: the hand gives {} J only", -last_energy(&ticks));
    }
}

/// Contact is never lost once the tip has met the surface and settled.
#[test]
fn drags_by_hand_keep_contact() {
    for name in ["sliding-by-hand", "sticking-by-hand", "stick-slip-by-hand"] {
        let ticks = run(&scene(name));
        let first = ticks.iter().position(|tick| !tick.is_free).expect("contact");
        let free = ticks[first + 50..].iter().filter(|tick| tick.is_free).count();
        assert_eq!(free, 0, "{name}");
    }
}

#[test]
fn a_hard_wall_gives_energy_and_a_soft_one_does_not() {
    let [hard, soft] = ["hard-wall", "virtual-wall"].map(|name| run(&scene(name)));
    let half = hard.len() / 2;
    let [early, late] = [hard[half].device().energy_to_hand_j, last_energy(&hard)];
    println!("RESIDUAL | energy | hard wall: energy given to the hand, J | > 1e-2 | {late:.1e}");
    assert!(early > 1e-2 && late > early + 1e-2, "{early} J, then {late} J");
    let bounces = |ticks: &[Tick]| ticks.windows(2).filter(|pair| pair[0].is_free != pair[1].is_free).count();
    assert!(bounces(&hard) > 20 && bounces(&soft) == 1, "{} and {} changes", bounces(&hard), bounces(&soft));
}

/// A wall of 2 N/mm is active if its forces come two and a half ticks late.
fn late_wall(is_controlled: bool) -> Scene {
    let mut scene = scene("hard-wall");
    scene.contact.wall.stiffness = 2000.0;
    scene.deadline.overrun = OverrunPolicy::Skip;
    scene.costs = Some(Costs { tick: Cost::Constant(2.5e-3), model: Cost::Constant(0.0), seed: 0 });
    controlled(scene, is_controlled)
}

fn controlled(mut scene: Scene, is_controlled: bool) -> Scene {
    let InstrumentKind::Phantom(settings) = &mut scene.instrument else { panic!("a scene with a device") };
    settings.passivity_control = is_controlled;
    scene
}

#[test]
fn passivity_control_takes_what_it_counts() {
    let [without, with] = [false, true].map(|is_controlled| run(&late_wall(is_controlled)));
    let [uncontrolled, left] = [&without, &with].map(|ticks| last_energy(ticks));
    println!(
        "RESIDUAL | energy | late wall, passivity control over none: energy given | < 0.6 | {:.2}",
        left / uncontrolled
    );
    assert!(uncontrolled > 0.1 && left < 0.6 * uncontrolled, "{left} J of {uncontrolled} J");
    assert!(with.iter().any(|tick| tick.device().is_damped));
    // A wall without delay emits the energy of a force that motors hold over the next tick.
    let [without, with] = [false, true].map(|is_controlled| run(&controlled(scene("hard-wall"), is_controlled)));
    let [uncontrolled, left] = [&without, &with].map(|ticks| last_energy(ticks));
    println!(
        "RESIDUAL | energy | hard wall, passivity control over none: energy given | < 0.2 | {:.3}",
        left / uncontrolled
    );
    assert!(uncontrolled > 1e-2 && left < 0.2 * uncontrolled, "{left} J of {uncontrolled} J");
    // A coupling that runs in ticks emits energy too.
    let [without, with] =
        [false, true].map(|is_controlled| run(&controlled(scene("passivity-control"), is_controlled)));
    assert!(last_energy(&with) < last_energy(&without) - 1e-4, "{} J", last_energy(&with));
}

#[test]
fn smoothing_divides_the_jump_at_a_hand_over() {
    let smooth = scene("smoothing");
    let n = f64::from(smooth.smoothing_ticks);
    let mut raw = smooth.clone();
    raw.smoothing_ticks = 0;
    let hand_overs = |ticks: &[Tick]| -> Vec<usize> {
        (1..ticks.len()).filter(|&tick| ticks[tick].model_age < ticks[tick - 1].model_age).collect()
    };
    let (smoothed, raw) = (run(&smooth), run(&raw));
    let worst = Worst::new("algebra", "smoothing in the loop: jump over (contact − last command)/(n + 1), N", 1e-14);
    let ticks = hand_overs(&smoothed);
    assert_eq!(ticks.len(), 11);
    for &tick in &ticks {
        let before = smoothed[tick - 1].force;
        let jump = (smoothed[tick].force - before).norm();
        worst.check((jump - (smoothed[tick].contact_force - before).norm() / (n + 1.0)).abs());
    }
    // A fade ends after n ticks.
    let since = |tick: usize| tick - ticks.iter().copied().rfind(|&first| first <= tick).unwrap_or(0);
    for (tick, done) in smoothed.iter().enumerate().filter(|&(tick, _)| since(tick) >= smooth.smoothing_ticks as usize)
    {
        assert_eq!(done.force, done.contact_force, "tick {tick}");
    }
    let largest = |run: &[Tick]| {
        let jumps = hand_overs(run).into_iter().map(|tick| (run[tick].force - run[tick - 1].force).norm());
        residual::largest(jumps)
    };
    assert!(largest(&raw) > 0.03 && largest(&smoothed) < largest(&raw) / 10.0, "{}", largest(&smoothed));
}

#[test]
fn smoothing_changes_nothing_but_the_command_to_a_path() {
    let plain = Scene::shipped("fig5-stick-slip").expect("shipped");
    let mut smooth = plain.clone();
    smooth.smoothing_ticks = 10;
    let (plain, smooth) = (run(&plain), run(&smooth));
    assert!(plain.iter().zip(&smooth).any(|(a, b)| a.force != b.force));
    assert!(plain.iter().all(|tick| tick.force == tick.contact_force && tick.device.is_none()));
    let contact = |ticks: &[Tick]| ticks.iter().map(|tick| (tick.tip, tick.contact_force)).collect::<Vec<_>>();
    assert_eq!(contact(&plain), contact(&smooth));
}

#[test]
fn missed_deadlines_move_the_device_each_policy_its_way() {
    let late = |overrun| {
        let mut scene = scene("virtual-wall");
        scene.deadline.overrun = overrun;
        let tick = Cost::Rare { usual: 1e-4, rare: 2.5e-3, share: 0.1 };
        scene.costs = Some(Costs { tick, model: Cost::Constant(0.0), seed: 3 });
        scene
    };
    let mut runs = vec![run(&scene("virtual-wall"))];
    for overrun in [OverrunPolicy::Hold, OverrunPolicy::Zero, OverrunPolicy::Skip] {
        let ticks = run(&late(overrun));
        assert_eq!(ticks, run(&late(overrun)), "{overrun:?}");
        for before in &runs {
            assert!(before.iter().zip(&ticks).any(|(a, b)| a.device().tip != b.device().tip), "{overrun:?}");
        }
        runs.push(ticks);
    }
}

#[test]
fn what_cannot_start_or_has_no_effect_is_refused() {
    let text = scene("virtual-wall").text().expect("it was read").to_owned();
    let parse = |text: &str| Scene::parse(text, "wall.toml".as_ref());
    // The path is the hand's aim: the device makes the tip start there.
    let inside = parse(&text.replace("[0.0, 0.001, 0.0013, 0.003]", "[0.0, 0.001, 0.0013, -0.003]")).expect("a scene");
    let error = Simulation::prepare(&inside).expect_err("the tip is inside");
    assert!(matches!(error.problem(), Problem::TipInside { depth_m } if *depth_m > 2.9e-3), "{error}");
    let full = text.replace("[instrument]", "[local]\nmodel = \"full\"\n[instrument]\nsmoothing_ticks = 5");
    let error = parse(&full).expect_err("no hand-overs");
    assert!(matches!(error.problem(), Problem::NoEffect { key: "instrument.smoothing_ticks", .. }), "{error}");
    // A hand that leaves the workspace ends the run, with a time.
    let away = parse(&text.replace("[0.8, 0.001, 0.0013, -0.02]", "[0.8, 0.001, 0.0013, 0.6]")).expect("a scene");
    let fault = Simulation::prepare(&away).expect("it starts").run(|_| ()).expect_err("out of reach");
    assert!(fault.to_string().contains("workspace"), "{fault}");
}

#[test]
fn wall_bounds_at_home_are_those_of_the_joints() {
    let path = TipPath::new(vec![Waypoint { time: 0.0, position: Vec3::zeros() }]).expect("a path");
    let phantom = Phantom::new(PhantomSettings::default(), &path, 1e-3).expect("at home");
    let worst = Worst::new("Colgate, Schenkel; Abbott, Okamura", "bounds of a virtual wall at home, relative", 2e-15);
    // At home J is diagonal. The scene's x, z, −y are the device's x, y, z.
    let levers = [UPPER_LINK, UPPER_LINK, FORE_LINK];
    let (friction, ratio) = ([0.0086, 0.0086, 0.0068], [13.3, 11.2, 11.2]);
    for (joint, normal) in [Vec3::x(), Vec3::z(), -Vec3::y()].into_iter().enumerate() {
        let (lever, wall_damping) = (levers[joint], 0.002);
        let bounds = phantom.wall_bounds(&normal, wall_damping);
        let by_damping = 2.0 * (0.0005 / (lever * lever) - wall_damping) / 1e-3;
        let step = lever * std::f64::consts::TAU / (ratio[joint] * 4096.0);
        let by_friction = 2.0 * friction[joint] / lever / step;
        worst.check((bounds.by_damping_n_per_m / by_damping - 1.0).abs());
        worst.check((bounds.by_friction_n_per_m / by_friction - 1.0).abs());
        assert!(bounds.passive_n_per_m() == bounds.by_damping_n_per_m);
        assert!(phantom.wall_bounds(&normal, 1.0).passive_n_per_m() == 0.0);
    }
}
