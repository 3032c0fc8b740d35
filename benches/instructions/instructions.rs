//! Instruction counts of ticks of `fig5-stick-slip` and of the forces of a network, with upper limits.
//!
//! `cargo bench --package stickslip-instructions`; needs valgrind and
//! `cargo install gungraun-runner --version 0.20.0`. Counts depend on the compiler and the target
//! features, not on the load of the machine.

use std::hint::black_box;

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use stickslip::contact::local_renderer::LocalRenderer;
use stickslip::contact::simulation::LocalSimulation;
use stickslip::model::network::Network;
use stickslip::model::state::State;
use stickslip::pipeline::Simulation;
use stickslip::scene::Scene;
use stickslip::{OwnParts, Vec3};

const TICKS: u64 = 100;
/// Ratio of a limit to the measured count. Counts repeat on one compiler (measured with rustc 1.95 on x86-64 with AVX2); what
/// is above the limit does more work, or comes from another compiler, and then the counts are measured anew.
const MARGIN: f64 = 1.03;
const TICKS_IN_CONTACT: u64 = 678_551;
const TICKS_FREE: u64 = 486_651;
/// 6 % more than without the door: the local side checks the result, locates the contact point on its own surface, and reports
/// both once more.
const TICKS_BEHIND_THE_DOOR: u64 = 719_751;
const FORCES: u64 = 58_594;
const PRESSED: f64 = -0.003;
const HOVERING: f64 = 0.0005;

/// Local side, and a tip that moves back and forth by a millimetre at 50 mm/s.
struct Ticking {
    local: LocalSimulation,
    tick: u64,
    before: Vec3,
}

impl Ticking {
    fn step(&mut self, height: f64) -> bool {
        self.tick += 1;
        let phase = (self.tick % 80) as f64 / 40.0;
        let after = Vec3::new(-0.03 + 0.002 * if phase < 1.0 { phase } else { 2.0 - phase }, 0.0013, height);
        let report = self.local.tick(self.before, after);
        self.before = after;
        report.touch.is_some()
    }
}

fn simulation() -> Simulation {
    let scene = Scene::shipped("fig5-stick-slip").expect("a shipped scene");
    Simulation::prepare(&scene).expect("it starts outside")
}

/// The local side with the same local model behind the door for custom renderers.
fn through_the_door() -> LocalSimulation {
    let scene = Scene::shipped("fig5-stick-slip").expect("a shipped scene");
    let ours = LocalRenderer::new(scene.contact, scene.local(), scene.integrator);
    let own = OwnParts { renderer: Some(Box::new(ours)), ..OwnParts::default() };
    Simulation::prepare_with(&scene, own).expect("it starts outside").into_sides().servo.into_local()
}

/// Moves the tip down through the surface to a height, as a collision requires, until the press is over.
fn ticking(height: f64) -> (Ticking, f64) {
    pressed(simulation().into_sides().servo.into_local(), height)
}

fn ticking_through_the_door(height: f64) -> (Ticking, f64) {
    pressed(through_the_door(), height)
}

fn pressed(local: LocalSimulation, height: f64) -> (Ticking, f64) {
    let mut ticking = Ticking { local, tick: 0, before: Vec3::new(-0.03, 0.0013, 0.002) };
    for i in 0..80 {
        ticking.step(0.002 + (height - 0.002) * f64::from(i) / 79.0);
    }
    for _ in 0..TICKS {
        let touches = ticking.step(height);
        assert_eq!(touches, height < 0.0, "the tick is not the one that is measured");
    }
    (ticking, height)
}

fn network() -> (Network, State, Vec<Vec3>) {
    let network = simulation().network().clone();
    let mut state = network.rest_state();
    for (i, (x, v)) in state.x.iter_mut().zip(&mut state.v).enumerate() {
        let wave = |k: f64| (k * i as f64).sin();
        *x += Vec3::new(wave(1.1), wave(2.3), wave(3.7)) * 1e-3;
        *v = Vec3::new(wave(0.7), wave(1.9), wave(2.9)) * 1e-2;
    }
    let f = vec![Vec3::zeros(); network.node_count()];
    (network, state, f)
}

/// Builds a limit: a run fails if its count exceeds the measured one by the margin.
fn limit(measured: u64) -> LibraryBenchmarkConfig {
    let mut config = LibraryBenchmarkConfig::default();
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, (measured as f64 * MARGIN) as u64)]);
    config.tool(callgrind);
    config
}

#[library_benchmark]
#[bench::in_contact(args = (PRESSED), setup = ticking, config = limit(TICKS_IN_CONTACT))]
#[bench::free(args = (HOVERING), setup = ticking, config = limit(TICKS_FREE))]
// The same ticks behind the door for custom renderers.
#[bench::behind_the_door(args = (PRESSED), setup = ticking_through_the_door, config = limit(TICKS_BEHIND_THE_DOOR))]
fn hundred_ticks((mut ticking, height): (Ticking, f64)) -> Ticking {
    for _ in 0..TICKS {
        black_box(ticking.step(black_box(height)));
    }
    ticking
}

#[library_benchmark]
#[bench::springs_2195(setup = network, config = limit(FORCES))]
fn forces((network, state, mut f): (Network, State, Vec<Vec3>)) -> (Network, State, Vec<Vec3>) {
    network.forces(black_box(&state.x), black_box(&state.v), &mut f);
    (network, state, f)
}

library_benchmark_group!(name = instructions, benchmarks = [hundred_ticks, forces]);

main!(library_benchmark_groups = instructions);
