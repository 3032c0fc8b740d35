//! The velocity scheme: the laws at the end of a tick, the energy balance compared with that of the
//! geometric scheme, continuity of the force, order of convergence.

use stickslip::Vec3;
use stickslip::contact::law::{Law, Mode};
use stickslip::contact::rules::Scheme;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::pipeline::{self, TickView};
use stickslip::scene::Scene;
use stickslip::surface::geometry::ContactSurface;
use stickslip::verify::surfaces::{self, SurfaceMeasures};

use crate::check::{Worst, shipped};

/// Builds the whole network at 1000 Hz times `refinement`.
fn full(name: &str, surface: ContactSurface, scheme: Scheme, refinement: u32) -> Scene {
    let scene = surfaces::whole(&shipped(name), surface, scheme);
    let rate_hz = scene.local_rate_hz() * f64::from(refinement);
    scene.with_local_rate_hz(rate_hz).expect("a multiple")
}

fn completes(scene: &Scene, observe: impl FnMut(&TickView)) {
    pipeline::run(scene, observe).unwrap_or_else(|error| panic!("{}: {error}", scene.name));
}

/// Sticking takes the contact point to the tip, sliding into its tangent plane.
#[test]
fn the_contact_point_follows_the_tip() {
    // Round-off of positions up to 0.05 m. Measured: 2e-17 m.
    let sticks = Worst::new("velocity scheme", "sticking: p - q1 at the end of a tick, m", 1e-16);
    let slides = Worst::new("velocity scheme", "sliding: (p - q1).n at the end of a tick, m", 1e-16);
    for (_, surface) in surfaces::SURFACES {
        for name in ["deep-sliding", "deep-sticking", "deep-stick-slip"] {
            let mut touched = 0;
            completes(&full(name, surface, Scheme::Velocity, 1), |view| {
                let Some(touch) = view.report.touch.filter(|_| !view.report.rigid) else { return };
                touched += 1;
                let gap = view.local.shape().position(&touch.point) - view.tip;
                match view.report.mode {
                    Mode::Stick => sticks.check(gap.norm()),
                    Mode::Slide => slides.check(gap.dot(&touch.normal).abs()),
                    Mode::Slip | Mode::Free => {}
                }
            });
            assert!(touched > 1000, "{name} {surface:?}: {touched} ticks in contact");
        }
    }
}

/// Returns the energy residual over the total |work|.
fn energy_residual(scene: &Scene) -> f64 {
    let mut residual = f64::NAN;
    completes(scene, |view| residual = view.energy.residual() / view.energy.absolute_work);
    residual
}

/// The energy residual on the limit surface under the velocity scheme vanishes to first order or better with the
/// step; the residuals of the other surfaces and of the geometric scheme are printed beside it.
#[test]
fn energy_book_closes_on_the_limit_surface() {
    for name in ["deep-sliding", "deep-stick-slip"] {
        for (_, surface) in surfaces::SURFACES {
            for (scheme_name, scheme) in surfaces::SCHEMES {
                let residuals = [1, 2, 4].map(|refinement| energy_residual(&full(name, surface, scheme, refinement)));
                let [h, h2, h4] = residuals.map(|r| format!("{:+.4}", r));
                println!(
                    "RESIDUAL | energy | {name}, {surface:?}, {scheme_name}: residual / |work| at h, h/2, h/4 | - | {h} {h2} {h4}"
                );
                if surface == ContactSurface::Subdivision && scheme.is_impulsive() {
                    assert!(residuals[0].abs() <= 0.01, "{name}: {residuals:?}");
                    for pair in residuals.windows(2) {
                        // The bound is half, and a tenth more for a second-order remainder.
                        assert!(pair[1].abs() <= 0.55 * pair[0].abs(), "{name}: {residuals:?}");
                    }
                }
            }
        }
    }
}

/// The force is continuous over the mesh.
#[test]
fn force_does_not_jump_on_the_limit_surface() {
    for (name, allowed) in [("deep-sliding", 0.005), ("deep-stick-slip", 0.03)] {
        for (_, surface) in surfaces::SURFACES {
            for (scheme_name, scheme) in surfaces::SCHEMES {
                let measures = surfaces::measure(&full(name, surface, scheme, 1), |_| {}).expect("it starts outside");
                let SurfaceMeasures { jump_relative, contact_losses, mode_switches_per_s, .. } = measures;
                println!(
                    "RESIDUAL | continuity | {name}, {surface:?}, {scheme_name}: jump / force, losses, switches per s | - | {jump_relative:.4} {contact_losses} {mode_switches_per_s:.1}"
                );
                if surface == ContactSurface::Subdivision && scheme.is_impulsive() {
                    assert!(jump_relative <= allowed, "{name}: {jump_relative}");
                    assert_eq!(contact_losses, 0, "{name}");
                    // There is one stick and one slip a cycle; the block's slowest mode is 10 Hz.
                    assert!(mode_switches_per_s <= 20.0, "{name}: {mode_switches_per_s} per s");
                }
            }
        }
    }
}

/// Smooth press and drag, resolved far more finely than any step used.
fn smooth_path() -> TipPath {
    let blend = |t: f64| {
        let t = t.clamp(0.0, 1.0);
        t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    };
    let at = |i: u32| {
        let t = f64::from(i) / 32_000.0;
        let depth = 0.0005 - 0.0045 * blend(t / 0.3);
        Waypoint { time: t, position: Vec3::new(-0.01 + 0.01 * blend((t - 0.25) / 0.35), 0.0013, depth) }
    };
    TipPath::new((0..=19_200).map(at).collect()).expect("ascending times")
}

/// Halving the step halves the difference from the next finer run, in force and in state.
#[test]
fn velocity_scheme_is_of_first_order() {
    for (law, name) in [(Law::Sliding, "sliding"), (Law::Sticking, "sticking")] {
        let runs = [1, 2, 4, 8].map(|refinement| {
            let mut scene = full("deep-sliding", ContactSurface::Subdivision, Scheme::Velocity, refinement);
            scene.contact.law = law;
            scene.path = smooth_path();
            let half = scene.tick_count() / 2;
            let scene = scene.with_ticks(half);
            let (mut force, mut state) = (Vec3::zeros(), Vec::new());
            completes(&scene, |view| {
                force = view.force;
                if view.tick + 1 == scene.tick_count() {
                    state.clone_from(&view.local.state().x);
                }
            });
            (force, state)
        });
        let distance =
            |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>().sqrt();
        let of_force = |i: usize| (runs[i].0 - runs[i + 1].0).norm();
        let of_state = |i: usize| distance(&runs[i].1, &runs[i + 1].1);
        for (quantity, of) in [("force", &of_force as &dyn Fn(usize) -> f64), ("state", &of_state)] {
            let orders = [(of(0) / of(1)).log2(), (of(1) / of(2)).log2()];
            println!(
                "RESIDUAL | convergence | {name}, velocity: order in h of {quantity} | 0.85..1.3 | {:.2} {:.2}",
                orders[0], orders[1]
            );
            assert!(orders[1] >= 0.85 && orders[1] <= 1.3, "{name} {quantity}: {orders:?}");
        }
    }
}
