//! Errors of local models as `stickslip accuracy` computes them, and the status of models that fail.

use stickslip::local::condensation::{Condensation, Reach};
use stickslip::local::model::{ExteriorKind, Linearization, LocalSettings};
use stickslip::local::patch::Extent;
use stickslip::local::step::LocalIntegrator;
use stickslip::model::springs::TangentKind;
use stickslip::scene::{LocalModelName, Rings, SHIPPED, Scene};
use stickslip::verify::accuracy::{
    Assessment, Coverage, Grid, Method, PAPER, PAPER_RATE_HZ, REFINEMENT, Reference, Status, Touching, grid,
};

use crate::check::{PRESS_AND_DRAG, Worst, shipped, small_scene};

fn touching(scene: &Scene) -> Touching {
    Method::of(scene).touching
}

fn assess(scene: &Scene, reference: &Reference, local: LocalSettings) -> Assessment {
    let method = Method {
        model: LocalModelName::Patch,
        local,
        integrator: LocalIntegrator::SemiImplicitEuler,
        global_rate: PAPER_RATE_HZ,
        touching: reference.touching,
    };
    Assessment::of(scene, &method, reference).expect("it starts outside")
}

fn condensed(rings: u32, linearization: Linearization, tangent: TangentKind) -> LocalSettings {
    let exterior = ExteriorKind::Condensed(Condensation { tangent, reach: Reach::All });
    LocalSettings { extent: Extent::Rings(rings), linearization, exterior }
}

/// Relative force errors on deep-sliding, -sticking and -stick-slip from an independent program in Python,
/// to three decimals.
#[test]
fn errors_on_the_deep_drags_are_those_of_another_program() {
    let worst = Worst::new("numpy trial", "relative force error of local models on the deep drags", 0.002);
    let exact = Linearization::Tangent(TangentKind::Exact);
    let table = [
        (PAPER, [0.100, 0.252, 0.149]),
        (LocalSettings { extent: Extent::Rings(2), ..PAPER }, [0.039, 0.133, 0.067]),
        (condensed(1, exact, TangentKind::Exact), [0.033, 0.024, 0.056]),
        (condensed(1, Linearization::None, TangentKind::Stabilised), [0.012, 0.026, 0.037]),
        (condensed(2, Linearization::None, TangentKind::Stabilised), [0.002, 0.013, 0.018]),
    ];
    for (drag, name) in ["deep-sliding", "deep-sticking", "deep-stick-slip"].into_iter().enumerate() {
        let scene = shipped(name);
        let reference = Reference::of(&scene, touching(&scene)).expect("it starts outside");
        for (local, expected) in &table {
            let found = assess(&scene, &reference, *local);
            worst.check((found.errors.force_error_rms_rel - expected[drag]).abs());
            assert_eq!(found.status(true), Status::Ok, "{name}, {local:?}");
            assert_eq!(found.status(false), Status::Overrun, "{name}, {local:?}");
        }
    }
}

/// A local model with all springs of all nodes is the network itself: every error is 0, and the status is unresolved.
#[test]
fn the_network_itself_has_no_error_and_is_unresolved() {
    let scene = small_scene("law = \"stick-slip\"\nfriction = 0.5", "rings = 1", PRESS_AND_DRAG);
    let reference = Reference::of(&scene, touching(&scene)).expect("it starts outside");
    assert!(reference.floor > 0.0);
    let all = LocalSettings { extent: Extent::All, linearization: Linearization::None, ..PAPER };
    let found = assess(&scene, &reference, all);
    let errors = &found.errors;
    assert_eq!((errors.force_error_rms_rel, errors.force_error_max_n, errors.handover_jump_rel), (0.0, 0.0, 0.0));
    assert_eq!((errors.mode_agreement, errors.mode_agreement_worst), (1.0, 1.0));
    assert_eq!((errors.contact_point_error_max_m, errors.slip_onset_error_s), (Some(0.0), Some(0.0)));
    assert_eq!(errors.force_error_rms_rel_fine > 0.0, reference.floor > 0.0);
    assert!(errors.force_error_per_100_ms.len() == 4 && errors.force_error_per_100_ms.iter().all(|e| e.force == 0.0));
    assert_eq!((found.is_unresolved, found.status(true)), (true, Status::Unresolved));
}

/// A diverged extreme stays in the comparison, with its results before the fault and no force after it.
#[test]
fn what_runs_away_is_diverged_and_kept() {
    let scene = shipped("deep-stick-slip-faceted");
    let own = Method::of(&scene);
    assert!(grid(&scene, Coverage::Default).expect("a grid").methods.contains(&own));
    let reference = Reference::of(&scene, own.touching).expect("it starts outside");
    let found = assess(&scene, &reference, scene.local());
    assert!(found.record.fault.as_ref().is_some_and(|fault| fault.contains("diverged: ")), "{:?}", found.record.fault);
    assert_eq!((found.status(true), found.status(false)), (Status::Diverged, Status::Diverged));
    assert_eq!(found.record.samples().len(), 1200);
    assert!(found.record.samples().last().is_some_and(|last| last.force.norm() == 0.0));
    assert!(found.errors.force_error_rms_rel.is_finite());
}

/// A force that is worse than none counts like a fault.
#[test]
fn a_force_worse_than_none_is_diverged() {
    let scene = small_scene("law = \"sliding\"", "rings = 1", PRESS_AND_DRAG);
    let reference = Reference::of(&scene, touching(&scene)).expect("it starts outside");
    let mut deeper = scene.clone();
    deeper.material.stiffness *= 4.0;
    let found = assess(&deeper, &reference, PAPER);
    assert!(found.record.fault.is_none() && found.errors.force_error_rms_rel > 1.0);
    assert_eq!(found.status(true), Status::Diverged);
}

/// The parts of the error, and the errors of the windows, add up to the whole.
#[test]
fn errors_add_up() {
    let worst = Worst::new("sum of its parts", "square of the relative force error", 1e-16);
    let scene = small_scene("law = \"stick-slip\"\nfriction = 0.5", "rings = 1", PRESS_AND_DRAG);
    let reference = Reference::of(&scene, touching(&scene)).expect("it starts outside");
    let errors = assess(&scene, &reference, PAPER).errors;
    let square = errors.force_error_rms_rel.powi(2);
    assert!(square > 1e-6 && errors.normal_error_rms_rel > 0.0 && errors.tangential_error_rms_rel > 0.0);
    worst.check((errors.normal_error_rms_rel.powi(2) + errors.tangential_error_rms_rel.powi(2) - square).abs());
    let windows = &errors.force_error_per_100_ms;
    worst.check((windows.iter().map(|e| e.force * e.force).sum::<f64>() / windows.len() as f64 - square).abs());
}

#[test]
fn grids_hold_the_paper_the_scene_and_nothing_twice() {
    let own = "rings = 5\nlinearization = \"none\"\nexterior = \"drifting\"";
    for local in ["rings = 1", own, "model = \"full\"", "rings = \"all\""] {
        let scene = small_scene("law = \"sliding\"\nscheme = \"velocity\"", local, PRESS_AND_DRAG);
        let few = grid(&scene, Coverage::Default).expect("a grid");
        let many = grid(&scene, Coverage::All).expect("a grid");
        for grid in [&few, &many] {
            let methods = &grid.methods;
            let touching = touching(&scene);
            let paper = Method {
                model: LocalModelName::Patch,
                local: PAPER,
                integrator: LocalIntegrator::SemiImplicitEuler,
                global_rate: PAPER_RATE_HZ,
                touching,
            };
            assert!(methods.contains(&paper) && methods.contains(&Method::of(&scene)), "{local}");
            assert!(methods.iter().enumerate().all(|(i, method)| !methods[..i].contains(method)), "{local}");
            assert!(methods.iter().all(|method| grid.contacts.contains(&method.touching)));
            assert_eq!((grid.contacts[0], grid.omitted.len()), (touching, 0));
        }
        assert!(few.methods.iter().all(|method| many.methods.contains(method)), "{local}");
    }
    // A latency of 50 ticks does not fit into a cycle of 20.
    let mut late = small_scene("law = \"sliding\"", "rings = 1", PRESS_AND_DRAG);
    late.global.latency_ticks = 50;
    let late = grid(&late, Coverage::Default).expect("a grid");
    assert!(late.methods.iter().all(|method| method.global_rate == 10.0));
    assert!(late.omitted.len() == 1 && late.omitted[0].contains("50 Hz"), "{:?}", late.omitted);
}

/// A method's scene has its settings, and the length of the global side's substeps is unchanged.
#[test]
fn methods_become_scenes() {
    let scene = small_scene("law = \"sliding\"", "rings = 1", PRESS_AND_DRAG);
    let method = Method { global_rate: 50.0, ..Method::of(&scene) };
    let often = method.scene(&scene);
    assert_eq!((often.global_rate_hz(), often.ticks_per_cycle(), often.global.substeps), (50.0, 20, 20));
    assert_eq!(Method::of(&often), method);
    let names = method.names();
    assert_eq!((names.rings, names.exterior, names.tangent), (Some(Rings::Count(1)), Some("fixed"), Some("exact")));
    assert_eq!(method.to_string(), "1 ring, tangent, fixed, exact, 50 Hz");
}

/// Every scene of the study passes the check of scenes, for each shipped scene with which the study is possible.
#[test]
fn every_scene_of_the_accuracy_passes_its_check() {
    for entry in SHIPPED {
        let scene = shipped(entry.name);
        let Grid { methods, contacts, .. } = grid(&scene, Coverage::All).expect("a grid");
        let references = contacts.iter().flat_map(|&touching| {
            let coarse = Reference::scene(&scene, touching);
            let rate_hz = coarse.local_rate_hz() * f64::from(REFINEMENT);
            [coarse.clone(), coarse.with_local_rate_hz(rate_hz).expect("a rate")]
        });
        for own in methods.iter().map(|method| method.scene(&scene)).chain(references) {
            assert!(own.check().is_ok(), "{}, {}: {:?}", entry.name, Method::of(&own), own.check());
        }
    }
}
