//! Extreme scenes end as the table of expected outcomes states, and the table itself is checked.

use stickslip::contact::law::{Law, Mode};
use stickslip::contact::rules::Scheme;
use stickslip::multirate::failsafe::{Fault, FaultCause};
use stickslip::multirate::messages::CycleMessage;
use stickslip::multirate::trajectory::{PathRecording, Trajectory};
use stickslip::pipeline::Simulation;
use stickslip::surface::geometry::ContactSurface;
use stickslip::verify::extremes::{EXTREMES, Expected, Extreme, FaultKind, Outcome, Quantity, Variant};
use stickslip::{Rendered, Vec3};

#[test]
fn every_extreme_ends_as_expected() {
    let mut differ = Vec::new();
    for extreme in EXTREMES {
        for variant in extreme.variants() {
            let expected = extreme.expected(variant);
            let outcome = extreme.run(variant, &expected);
            let (name, contact, word) = (extreme.name, extreme.contact(variant), outcome.name());
            println!("RESIDUAL | extremes | {name}, {contact} | {expected} | {outcome}");
            if !expected.is_met_by(&outcome) {
                differ.push(format!("{name}, {contact}: expected {expected}, got {word}: {outcome}"));
            }
        }
    }
    assert!(differ.is_empty(), "{}", differ.join("\n"));
}

/// No run is counted twice: each row of the table is a scene with a contact of its own, and names that contact.
#[test]
fn every_run_of_an_extreme_is_another_one() {
    for extreme in EXTREMES {
        let variants = extreme.variants();
        let contacts: Vec<String> = variants.iter().map(|&variant| extreme.contact(variant)).collect();
        assert!(contacts.iter().enumerate().all(|(i, contact)| !contacts[..i].contains(contact)), "{contacts:?}");
        let scene = extreme.scene(Variant::AsGiven).expect("a scene");
        let is_variant = (scene.surface, scene.contact.scheme) == (ContactSurface::Subdivision, Scheme::Velocity);
        assert_eq!(variants.len(), if is_variant { 1 } else { 2 }, "{}", extreme.name);
        // An expected outcome of a run that does not exist would never be checked.
        assert!(variants.len() == 2 || extreme.expected_of_variant.is_none(), "{}", extreme.name);
    }
    // The scene's own scheme, not the default.
    assert_eq!(extreme("masses-fine").contact(Variant::AsGiven), "velocity, faceted");
    assert_eq!(extreme("frozen").contact(Variant::AsGiven), "velocity, subdivision");
}

fn extreme(name: &str) -> &'static Extreme {
    EXTREMES.iter().find(|extreme| extreme.name == name).expect("an extreme of that name")
}

/// A table with wrong expectations is not met.
#[test]
fn a_wrong_expectation_is_not_met() {
    let wrong: [(&str, Expected); 7] = [
        ("rest-60s", Expected::Fault(FaultKind::Runaway)),
        ("rest-60s", Expected::Refused("tip")),
        ("stiffness-1e8", Expected::Completes(&[])),
        ("stiffness-1e8", Expected::Fault(FaultKind::ForceNotFinite)),
        // The spring's force is 0.34 N, not 0.35.
        ("one-free-node", Expected::Completes(&[(Quantity::Ends(0.35), 0.01)])),
        // What sticks differs from what slides, however recent its models are.
        ("friction-10", Expected::Completes(&[(Quantity::OrderInAge(|scene| scene.contact.law = Law::Sliding), 0.9)])),
        // No model fell back, because nothing is condensed.
        ("one-free-node", Expected::Completes(&[(Quantity::FellBack, 0.01)])),
    ];
    for (name, expected) in wrong {
        let outcome = extreme(name).run(Variant::AsGiven, &expected);
        assert!(!expected.is_met_by(&outcome), "{name}: {expected} by {outcome}");
    }
}

/// Only the expected outcome is accepted.
#[test]
fn no_expectation_is_met_by_a_panic_a_hang_or_nan() {
    let fault = Fault {
        tick: 1,
        cause: FaultCause::ForceNotFinite,
        mode: Mode::Free.name(),
        force: Vec3::zeros(),
        tip: Vec3::zeros(),
        model_age: 0,
    };
    let passed_through = Outcome::Completed { measured: Vec::new(), tunnelling_ticks: 1 };
    let expectations =
        [Expected::Completes(&[]), Expected::Fault(FaultKind::Runaway), Expected::Refused("inside the surface")];
    for expected in expectations {
        for outcome in [
            Outcome::Panicked,
            Outcome::Hung,
            passed_through.clone(),
            Outcome::Fault(fault),
            Outcome::Refused("no".into()),
        ] {
            assert!(!expected.is_met_by(&outcome), "{expected} by {outcome}");
        }
    }
    // These quantities are NaN: nothing slips without friction, and nothing is in balance without a force.
    let expected = Expected::Completes(&[(Quantity::Balance, f64::INFINITY)]);
    let outcome = extreme("rest-60s").run(Variant::AsGiven, &expected);
    assert!(matches!(&outcome, Outcome::Completed { measured, .. } if measured[0].value.is_nan()), "{outcome}");
    assert!(!expected.is_met_by(&outcome), "{outcome}");
}

/// Rest for 24 h need not be simulated at 1 kHz: a tick leaves every bit as it was, and so does a cycle
/// of the whole network; the next ones start from identical bits.
#[test]
fn rest_is_a_fixed_point_of_tick_and_cycle() {
    for variant in extreme("rest-60s").variants() {
        let scene = extreme("rest-60s").scene(variant).expect("a scene");
        let sides = Simulation::prepare(&scene).expect("it starts").into_sides();
        let (mut global, mut local) = (sides.global.into_simulation(), sides.servo.into_local());
        let tip = scene.path.at(0.0);
        let bits = |values: &[Vec3]| values.iter().flat_map(|v| v.iter().map(|c| c.to_bits())).collect::<Vec<_>>();
        let whole = |state: &stickslip::model::state::State| (bits(&state.x), bits(&state.v));
        let (start, network) = (local.state().clone(), whole(global.state()));
        for _ in 0..3 {
            let mut trajectory = Trajectory::new(PathRecording::EveryTick);
            trajectory.begin(local.model(), local.state(), 0, scene.ticks_per_cycle() as usize);
            for _ in 0..scene.ticks_per_cycle() {
                local.tick(tip, tip);
                assert_eq!(bits(&local.state().x), bits(&start.x));
                assert_eq!(bits(&local.state().v), bits(&start.v));
                trajectory.record(local.state());
            }
            global
                .catch_up(&CycleMessage { trajectory, contact: local.contact(), tip, rendered: Rendered::FREE })
                .expect("an explicit step has a solution");
            let message = global.build_model(tip).expect("an explicit model");
            assert!(whole(global.state()) == network, "a cycle changed a bit of the network");
            local.hand_over(message.model, message.state, 0, tip);
        }
    }
}
