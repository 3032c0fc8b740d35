//! Scenes built in Rust run like those from files, and pass the same checks.

use stickslip::contact::law::{Friction, Law};
use stickslip::contact::rules::Scheme;
use stickslip::device::coupled::CoupledSettings;
use stickslip::device::instrument::InstrumentKind;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::structure::StructureSettings;
use stickslip::dynamics::constraint::Threads;
use stickslip::dynamics::integrators::GlobalIntegrator;
use stickslip::local::model::{ExteriorKind, LocalSettings};
use stickslip::local::patch::Extent;
use stickslip::local::step::LocalIntegrator;
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::Material;
use stickslip::multirate::timeline::{Cost, Costs};
use stickslip::scene::{Problem, Scene, Schedule};
use stickslip::{Vec3, pipeline};

use crate::check::shipped;

const BLOCK: Block = Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear };

/// The paper's stick-slip experiment.
fn built() -> Scene {
    let at = |time, x, z| Waypoint { time, position: Vec3::new(x, 0.0013, z) };
    let path = TipPath::new(vec![at(0.0, -0.03, 0.002), at(0.2, -0.03, -0.003), at(1.2, 0.02, -0.003)]);
    let material = Material::uniform(324, 0.01, 100.0, 0.5);
    let law = Law::StickSlip { friction: Friction::single(1.0) };
    Scene::new("fig5-stick-slip", BLOCK, material, law, path.expect("ascending times")).expect("it goes together")
}

fn forces(scene: &Scene) -> Vec<[u64; 3]> {
    let mut forces = Vec::new();
    pipeline::run(scene, |view| forces.push(<[f64; 3]>::from(view.force).map(f64::to_bits))).expect("completes");
    forces
}

#[test]
fn a_built_scene_runs_as_the_file_does() {
    let (built, read) = (built(), shipped("fig5-stick-slip"));
    assert_eq!(built.tick_count(), read.tick_count());
    assert_eq!(built.parts(), read.parts());
    assert_eq!(forces(&built), forces(&read));
    assert!(built.text().is_none() && read.text().is_some());
}

#[test]
fn lengths_and_rates_follow_from_each_other() {
    let scene = built();
    assert_eq!((scene.tick_s(), scene.duration_s(), scene.global_rate_hz()), (0.001, 1.2, 10.0));
    let fast = scene.clone().with_local_rate_hz(4000.0).expect("a multiple");
    assert_eq!((fast.tick_count(), fast.ticks_per_cycle()), (4800, 400));
    assert_eq!((fast.duration_s(), fast.global_rate_hz(), fast.deadline.after), (1.2, 10.0, fast.tick_s()));
    let short = scene.clone().with_duration_s(0.3).expect("whole ticks");
    assert_eq!((short.tick_count(), short.ticks_per_cycle()), (300, 100));
    let slow = scene.clone().with_slower_time(10.0);
    assert_eq!((slow.tick_count(), slow.ticks_per_cycle(), slow.duration_s()), (1200, 100, 12.0));
    let full = scene.clone().with_full_model();
    assert!(full.is_full() && full.local() == LocalSettings::FULL);
    assert!(!full.with_local_model(scene.local()).is_full());
    for wrong in [0.0, -1.0, f64::NAN, 1.00005] {
        assert!(scene.clone().with_duration_s(wrong).is_err(), "{wrong} s");
    }
    for wrong in [0.0, -1.0, f64::NAN, 1005.0] {
        assert!(scene.clone().with_local_rate_hz(wrong).is_err(), "{wrong} Hz");
        assert!(scene.clone().with_global_rate_hz(wrong).is_err(), "{wrong} Hz");
    }
}

/// A change of a scene.
type Change = fn(Scene) -> Scene;
/// A change of a scene's fields.
type ChangeInPlace = fn(&mut Scene);

/// Cases: (change of the scene, key that it makes invalid).
const WRONG: &[(Change, &str)] = &[
    (|scene| renamed(scene, "../up"), "name"),
    (|scene| scene.with_ticks(0), "duration"),
    (|scene| scene.with_ticks(u64::MAX), "mesh.nodes"),
    (|scene| scene.with_fixed(vec![true; 3]), "mesh.fixed"),
    (|scene| scene.with_ticks_per_cycle(0), "sync.latency_ticks"),
    (|scene| scene.with_law(Law::StickSlip { friction: Friction::single(f64::NAN) }), "contact.friction"),
    (|scene| scene.with_local_integrator(LocalIntegrator::Exponential), "local.integrator"),
    (|scene| scene.with_full_model().with_local_integrator(LocalIntegrator::ImplicitEuler), "local.integrator"),
    (
        |scene| scene.with_local_model(LocalSettings { extent: Extent::Rings(0), ..LocalSettings::default() }),
        "local.rings",
    ),
    (
        |scene| {
            let exterior = ExteriorKind::Drifting;
            scene.with_local_model(LocalSettings { extent: Extent::All, exterior, ..LocalSettings::default() })
        },
        "local.exterior",
    ),
];

/// Fields that are set in place are checked like built ones.
const WRONG_IN_PLACE: &[(ChangeInPlace, &str)] = &[
    (|scene| scene.mesh = Block { nodes: [9, 9, 1], ..BLOCK }.into(), "mesh.nodes"),
    (|scene| scene.mesh = Block { spacing: f64::NAN, ..BLOCK }.into(), "mesh.spacing"),
    (|scene| scene.material.node_mass[7] = -1.0, "material.node_mass"),
    (|scene| scene.material.stiffness = 0.0.into(), "material.stiffness"),
    (|scene| scene.material.damping = f64::INFINITY.into(), "material.damping"),
    (|scene| scene.material.gravity.z = f64::NAN, "material.gravity"),
    (|scene| scene.settle = true, "settle"),
    (|scene| scene.contact.wall.stiffness = -1.0, "contact.wall_stiffness"),
    (|scene| scene.global.substeps = 0, "global.substeps"),
    (|scene| scene.global.latency_ticks = 100, "sync.latency_ticks"),
    (|scene| scene.deadline.after = 0.002, "timing.deadline"),
    (|scene| scene.costs = Some(costs(Cost::Constant(-1.0))), "timing.tick_cost"),
    (
        |scene| {
            scene.schedule = Schedule::Threads;
            scene.costs = Some(costs(Cost::Constant(0.0)));
        },
        "timing.tick_cost",
    ),
    (
        |scene| {
            scene.global.threads = Threads::Two;
            scene.global.integrator = GlobalIntegrator::Rk4;
        },
        "global.threads",
    ),
    (
        |scene| {
            let mut settings = CoupledSettings::default();
            settings.phantom.actuation.largest_current = 0.0;
            scene.instrument = InstrumentKind::Phantom(Box::new(settings));
        },
        "instrument.device.largest_current",
    ),
    (
        |scene| {
            let mut settings = CoupledSettings::default();
            let structure = StructureSettings { damping_ratio: -0.1, ..StructureSettings::default() };
            settings.phantom.structure = Some(structure);
            scene.instrument = InstrumentKind::Phantom(Box::new(settings));
        },
        "instrument.device.structure.damping_ratio",
    ),
];

fn renamed(mut scene: Scene, name: &str) -> Scene {
    scene.name = name.to_owned();
    scene
}

fn costs(tick: Cost) -> Costs {
    Costs { tick, model: Cost::Constant(0.0), seed: 0 }
}

#[test]
fn what_is_wrong_is_named_by_its_key_before_a_run() {
    let found = |scene: &Scene| {
        let error = pipeline::Simulation::prepare(scene).expect_err("it does not go together");
        assert_eq!(error.problem().key(), scene.check().expect_err("the same").problem().key());
        error.problem().key()
    };
    for (i, (change, key)) in WRONG.iter().enumerate() {
        assert_eq!(found(&change(built())), Some(*key), "change {i}");
    }
    for (i, (change, key)) in WRONG_IN_PLACE.iter().enumerate() {
        let mut scene = built();
        change(&mut scene);
        assert_eq!(found(&scene), Some(*key), "change {i} in place");
    }
}

/// The order of calls does not matter: a scheme that an integrator needs may come after it.
#[test]
fn settings_that_need_each_other_come_in_any_order() {
    let scene = built().with_local_integrator(LocalIntegrator::ImplicitEuler);
    assert!(matches!(scene.check().expect_err("no velocity yet").problem(), Problem::Needs { .. }));
    scene.with_scheme(Scheme::Velocity).check().expect("now it goes together");
}
