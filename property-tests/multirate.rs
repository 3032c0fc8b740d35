//! The global cycle: hand-overs, latency, replay and overwrite, and the limits in which the local
//! model equals the network.

use stickslip::dynamics::integrators::GlobalIntegrator;
use stickslip::local::model::{Linearization, LocalSettings};
use stickslip::model::springs::TangentKind;
use stickslip::multirate::global::SyncMode;
use stickslip::multirate::messages::CycleMessage;
use stickslip::multirate::trajectory::{PathRecording, Trajectory};
use stickslip::pipeline::{self, Simulation};
use stickslip::scene::Scene;
use stickslip::{Rendered, Vec3};

use crate::check::{PRESS_AND_DRAG, Worst, relative_rms, run, small_scene};

const LAWS: [&str; 3] = ["law = \"sliding\"", "law = \"sticking\"", "law = \"stick-slip\"\nfriction = 0.5"];

#[test]
fn a_patch_of_all_springs_is_the_full_network() {
    // The arithmetic and its order are identical, but the cycle rebuilds the model around it.
    let worst = Worst::new("full network", "rings = all, linearization = none: force, relative", 0.0);
    for law in LAWS {
        let full = run(&small_scene(law, "model = \"full\"", PRESS_AND_DRAG));
        let all = run(&small_scene(law, "rings = \"all\"\nlinearization = \"none\"", PRESS_AND_DRAG));
        worst.check(relative_rms(&all.force, &full.force));
    }
}

#[test]
fn more_rings_and_shorter_cycles_come_closer_to_the_full_network() {
    let scene = |local: &str| {
        small_scene("law = \"sticking\"\nsurface = \"shaded\"\ndeformation = \"least-norm\"", local, PRESS_AND_DRAG)
    };
    let reference = run(&scene("model = \"full\"")).force;
    let error = |scene: &Scene| relative_rms(&run(scene).force, &reference);
    let [one, two, all] = ["rings = 1", "rings = 2", "rings = \"all\""].map(|rings| error(&scene(rings)));
    assert!(two < one && all < two, "rings 1, 2, all: {one:.4}, {two:.4}, {all:.4}");
    // Linearised at every tick with all rings, only the tangent's error within one tick is left.
    let mut every_tick = scene("rings = \"all\"").with_ticks_per_cycle(1);
    every_tick.global.substeps = 1;
    let at_once = error(&every_tick);
    println!("RESIDUAL | full network | rings = all, a new tangent each tick: force, relative | 1e-3 | {at_once:.1e}");
    assert!(at_once <= 1e-3, "{at_once}");
}

#[test]
fn model_ages_say_when_models_come() {
    let mut scene = small_scene(LAWS[0], "rings = 1", PRESS_AND_DRAG);
    scene.global.latency_ticks = 37;
    let mut ages = vec![];
    pipeline::run(&scene, |view| ages.push(view.model_age)).expect("completes");
    // The first model serves until the second, built at tick 100, arrives at tick 137.
    let expected: Vec<u64> = (0..400).map(|tick| if tick < 137 { tick } else { (tick - 37) % 100 }).collect();
    assert_eq!(ages, expected);
}

/// A full-size patch in every cycle leaves replay and overwrite without effect, so both must agree;
/// with one ring they differ.
#[test]
fn replay_and_overwrite_differ_only_in_the_exterior() {
    let forces = |rings: &str, sync: SyncMode| {
        let mut scene = small_scene(LAWS[1], rings, PRESS_AND_DRAG);
        scene.global.sync = sync;
        run(&scene).force
    };
    let difference = |rings: &str| relative_rms(&forces(rings, SyncMode::Overwrite), &forces(rings, SyncMode::Replay));
    assert_eq!(difference("rings = \"all\""), 0.0);
    assert!(difference("rings = 1") > 1e-3);
}

/// Without a contact gravity makes the block sag: the network that replay integrates around a drifting
/// patch must come down with the full one.
#[test]
fn replay_follows_the_network_where_the_patch_is_exact() {
    let mut scene = small_scene(
        LAWS[0],
        "rings = 1\nlinearization = \"none\"\nexterior = \"drifting\"",
        "[[0.0, 0.0, 0.001, 0.02]]",
    );
    scene.material.gravity = Vec3::new(0.0, 0.0, -1.0);
    let full = scene.clone().with_full_model();
    let sag = |scene: &Scene| {
        let mut lowest = vec![];
        pipeline::run(scene, |view| {
            let patch = &view.local.model().patch;
            let middle = patch.nodes.iter().position(|&node| node == 62).expect("the middle of the top");
            lowest.push(view.local.state().x[middle].z);
        })
        .expect("completes");
        lowest
    };
    let (patch, full) = (sag(&scene), sag(&full));
    let largest = full.iter().copied().fold(0.0, |a: f64, z| a.max(-z));
    let off = |cycle: usize| (patch[100 * cycle] - full[100 * cycle]).abs() / largest;
    // A drifting exterior ignores its own acceleration for a cycle; the effect after three
    // cycles is small compared with the sag. Measured: 0.04.
    println!("RESIDUAL | full network | sag of a drifting patch without contact, relative | 0.1 | {:.2}", off(3));
    assert!(largest > 1e-4, "the block sags by {largest} m");
    assert!(off(3) <= 0.1, "{}", off(3));
}

#[test]
fn integrators_of_the_global_side_agree_when_steps_are_short() {
    let forces = |integrator, substeps| {
        let mut scene = small_scene(LAWS[1], "rings = 1", PRESS_AND_DRAG);
        scene.global.integrator = integrator;
        scene.global.substeps = substeps;
        run(&scene).force
    };
    let reference = forces(GlobalIntegrator::Rk4, 1600);
    let errors = [100, 200, 400].map(|n| relative_rms(&forces(GlobalIntegrator::SemiImplicitEuler, n), &reference));
    let order = (errors[1] / errors[2]).log2();
    println!(
        "RESIDUAL | RK4, 1600 substeps | order of the Euler replay in the substep, distance from 1 | 0.3 | {:.2}",
        (order - 1.0).abs()
    );
    assert!(errors[2] < errors[0] && (order - 1.0).abs() <= 0.3, "{errors:?}, order {order}");
}

#[test]
fn traces_repeat_bit_for_bit() {
    for local in ["rings = 1", "rings = 2\nlinearization = \"none\"\nexterior = \"drifting\"", "model = \"full\""] {
        let once = || {
            let mut bits = vec![];
            pipeline::run(&small_scene(LAWS[2], local, PRESS_AND_DRAG), |view| {
                bits.extend(view.force.iter().map(|f| f.to_bits()));
                bits.push(view.energy.elastic.to_bits());
            })
            .expect("completes");
            bits
        };
        assert_eq!(once(), once(), "{local}");
    }
}

#[test]
fn stabilised_tangent_differs_only_under_compression() {
    let forces = |kind| {
        let local = LocalSettings { linearization: Linearization::Tangent(kind), ..LocalSettings::default() };
        run(&small_scene(LAWS[1], "rings = 1", PRESS_AND_DRAG).with_local_model(local)).force
    };
    let (exact, stabilised) = (forces(TangentKind::Exact), forces(TangentKind::Stabilised));
    // The first model is built at rest, where no spring is compressed.
    assert_eq!(exact[..100], stabilised[..100]);
    assert_ne!(exact[100..], stabilised[100..]);
}

/// In real time, notes of ticks are lost when the global side is late by cycles: the patch then stays in place.
#[test]
fn a_path_with_gaps_is_replayed_as_far_as_it_goes() {
    let scene = small_scene(LAWS[0], "rings = 1", PRESS_AND_DRAG);
    let ticks = scene.ticks_per_cycle() as usize;
    for keep in [PathRecording::EveryTick, PathRecording::LastTick] {
        for recorded in [0, 1, ticks - 1] {
            let sides = Simulation::prepare(&scene).expect("it starts").into_sides();
            let (mut global, local) = (sides.global.into_simulation(), sides.servo.into_local());
            let m = local.model().patch.len();
            let mut trajectory = Trajectory::new(keep);
            trajectory.begin(local.model(), local.state(), 0, ticks);
            let moved: Vec<Vec3> = local.state().x[..m].iter().map(|x| x + Vec3::z() * 1e-3).collect();
            let v = vec![Vec3::zeros(); m];
            (0..recorded).for_each(|_| trajectory.record_at(&moved, &v));
            // These notes are of another patch, whose beginning was lost.
            trajectory.record_at(&moved[1..], &v[1..]);
            global
                .catch_up(&CycleMessage { trajectory, contact: None, tip: Vec3::zeros(), rendered: Rendered::FREE })
                .expect("explicit steps");
            let expected = if recorded == 0 { &local.state().x[..m] } else { &moved[..] };
            for (&node, expected) in local.model().patch.nodes.iter().zip(expected) {
                assert_eq!(global.state().x[node as usize], *expected, "{keep:?}, {recorded} ticks");
            }
            assert!(global.state().x.iter().all(|x| x.iter().all(|x| x.is_finite())));
        }
    }
}
