//! One haptic tick of `fig5-stick-slip` (42 degrees of freedom), in contact and free, compared with
//! nalgebra's bare matrix–vector product of the same size.
//!
//! `cargo bench --bench tick` prints criterion's figures, then the ratios from one interleaved run:
//! on a shared machine only the ratios are comparable.

#[path = "interleaved.rs"]
mod interleaved;

use std::hint::black_box;
use std::time::Instant;

use criterion::Criterion;
use nalgebra::{DMatrix, DVector};
use stickslip::Vec3;
use stickslip::contact::law::Law;
use stickslip::contact::rules::Scheme;
use stickslip::contact::simulation::LocalSimulation;
use stickslip::local::model::LocalSettings;
use stickslip::pipeline::Simulation;
use stickslip::scene::Scene;
use stickslip::surface::geometry::ContactSurface;

fn local(change: impl FnOnce(&mut Scene)) -> LocalSimulation {
    let mut scene = Scene::shipped("fig5-stick-slip").expect("a shipped scene");
    change(&mut scene);
    Simulation::prepare(&scene).expect("it starts outside").into_sides().servo.into_local()
}

/// Returns a tip that moves back and forth by a millimetre at 50 mm/s, at a height over the rest surface.
fn tip(tick: u64, height: f64) -> Vec3 {
    let phase = (tick % 80) as f64 / 40.0;
    Vec3::new(-0.03 + 0.002 * if phase < 1.0 { phase } else { 2.0 - phase }, 0.0013, height)
}

/// Returns a closure that does one tick a call, already in contact (or free), and checks that it stays so.
fn ticking(mut local: LocalSimulation, height: f64) -> impl FnMut() {
    let (mut tick, mut before) = (0, tip(0, 0.002));
    let mut step = move |height: f64| {
        tick += 1;
        let after = tip(tick, height);
        let report = local.tick(before, after);
        before = after;
        report
    };
    // The tip moves down through the surface, as a collision requires.
    for i in 0..80 {
        step(0.002 + (height - 0.002) * f64::from(i) / 79.0);
    }
    for _ in 0..2000 {
        step(height);
    }
    move || {
        let report = black_box(step(black_box(height)));
        assert_eq!(report.touch.is_some(), height < 0.0, "the tick is not the one that is measured");
    }
}

const PRESSED: f64 = -0.003;
const HOVERING: f64 = 0.0005;

fn with_subdivision_and_velocity(scene: &mut Scene) {
    scene.surface = ContactSurface::Subdivision;
    scene.contact.scheme = Scheme::Velocity;
    scene.contact.law = Law::Sliding;
}

/// Times every single tick, the cases in turn, and prints percentiles. Reading the clock takes about 30 ns
/// of each.
fn print_percentiles(cases: &mut [interleaved::Case], ticks: usize) {
    let mut times = vec![Vec::with_capacity(ticks); cases.len()];
    for _ in 0..ticks / 2000 {
        for ((_, case), times) in cases.iter_mut().zip(&mut times) {
            for _ in 0..2000 {
                let start = Instant::now();
                case();
                times.push(start.elapsed().as_nanos());
            }
        }
    }
    println!("\n{:<50} {:>9} {:>9} {:>9} {:>9}", "single ticks, ns", "p50", "p99", "p99.9", "max");
    for ((name, _), times) in cases.iter().zip(&mut times) {
        times.sort_unstable();
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
        println!("{name:<50} {:>9} {:>9} {:>9} {:>9}", at(0.5), at(0.99), at(0.999), at(1.0));
    }
}

fn main() {
    let matrix = DMatrix::from_fn(42, 84, |i, j| ((i * 84 + j) as f64).sin());
    let vector = DVector::from_fn(84, |i, _| (i as f64).cos());
    let mut product = DVector::zeros(42);
    let bare = move || product.gemv(1.0, black_box(&matrix), black_box(&vector), 0.0);
    let mut cases: Vec<interleaved::Case> = vec![
        ("nalgebra 42 x 84 matrix-vector product", Box::new(bare)),
        ("tick in contact, stick-slip, faceted", Box::new(ticking(local(|_| {}), PRESSED))),
        ("tick free, 0.5 mm above", Box::new(ticking(local(|_| {}), HOVERING))),
        ("tick in contact, sliding, faceted", Box::new(ticking(local(|s| s.contact.law = Law::Sliding), PRESSED))),
        (
            "tick in contact, stick-slip, shaded",
            Box::new(ticking(local(|s| s.surface = ContactSurface::Shaded), PRESSED)),
        ),
        (
            "tick in contact, stick-slip, subdivision",
            Box::new(ticking(local(|s| s.surface = ContactSurface::Subdivision), PRESSED)),
        ),
        (
            "tick in contact, sliding, subdivision, velocity",
            Box::new(ticking(local(with_subdivision_and_velocity), PRESSED)),
        ),
        ("tick in contact, stick-slip, disc of 10 mm", Box::new(ticking(local(|s| s.contact_radius = 0.01), PRESSED))),
        (
            "the same, subdivision",
            Box::new(ticking(local(|s| (s.contact_radius, s.surface) = (0.01, ContactSurface::Subdivision)), PRESSED)),
        ),
        ("tick free, 0.5 mm above, disc of 10 mm", Box::new(ticking(local(|s| s.contact_radius = 0.01), HOVERING))),
        (
            "tick free, 0.5 mm above, subdivision",
            Box::new(ticking(local(|s| s.surface = ContactSurface::Subdivision), HOVERING)),
        ),
        (
            "tick in contact, full network of 324 nodes",
            Box::new(ticking(local(|s| *s = s.clone().with_local_model(LocalSettings::FULL)), PRESSED)),
        ),
    ];

    let mut criterion = Criterion::default().configure_from_args().sample_size(30);
    let mut group = criterion.benchmark_group("tick");
    for (name, case) in &mut cases {
        group.bench_function(*name, |bencher| bencher.iter(&mut *case));
    }
    group.finish();
    criterion.final_summary();
    interleaved::print_ratios(&mut cases, 2000);
    // The full network is not a haptic model.
    cases.pop();
    print_percentiles(&mut cases, 120_000);
}
