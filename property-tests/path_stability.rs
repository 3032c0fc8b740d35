//! Stability of local models along a path.

use nalgebra::DMatrix;
use stickslip::local::model::LocalModel;
use stickslip::output::verdict::Verdict;
use stickslip::pipeline::Simulation;
use stickslip::scene::Scene;
use stickslip::verify::path_stability::PathStability;

fn shipped(name: &str) -> Scene {
    Scene::shipped(name).expect("shipped with the program")
}

/// Largest |eigenvalue| of the explicit tick of a linear model, from the entries of its K and D.
fn spectral_radius(model: &LocalModel, h: f64) -> f64 {
    let (n, forces) = (3 * model.patch.len(), model.linear_forces().expect("a tangent"));
    let mut tick = DMatrix::<f64>::identity(2 * n, 2 * n);
    for row in 0..n {
        let step = h / model.patch.mass[row / 3];
        for column in 0..n {
            let (k, d) = (step * forces.entry(row, column), step * forces.entry(row, n + column));
            tick[(n + row, column)] += k;
            tick[(n + row, n + column)] += d;
            tick[(row, column)] += h * k;
            tick[(row, n + column)] += h * d;
        }
        tick[(row, n + row)] += h;
    }
    tick.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max)
}

/// The growth of the first model, which is free, agrees between Arnoldi's method on its ticks and all eigenvalues of its
/// matrices: at the scene's tick, close to the stability limit on both sides of it, and beyond.
#[test]
fn growth_is_that_of_the_largest_eigenvalue() {
    // Measured 2e-11: rounding in a difference of two ticks, relative to the perturbation.
    const TOLERANCE: f64 = 1e-8;
    let mut largest = 0.0_f64;
    for tick_ms in [1.0, 3.45, 3.6, 5.0] {
        let mut scene = shipped("fig5-stick-slip").with_slower_time(tick_ms).with_ticks(1);
        scene.deadline.after = scene.tick_s();
        let found = PathStability::of(&scene, &mut |_| ()).expect("it starts");
        let simulation = Simulation::prepare(&scene).expect("it starts");
        let radius = spectral_radius(simulation.local().model(), scene.tick_s());
        let expected = radius.ln() / scene.tick_s();
        let off = (found.models[0].growth_rate_per_s - expected).abs() * scene.tick_s();
        assert!(off <= TOLERANCE, "{tick_ms} ms: {} and {expected} 1/s", found.models[0].growth_rate_per_s);
        largest = largest.max(off);
        // The limit is that of the same matrices.
        let limit = found.models[0].limit_s.expect("explicit");
        assert_eq!(radius > 1.0, scene.tick_s() > limit, "{tick_ms} ms: {radius}, limit {limit}");
    }
    println!("RESIDUAL | stability | growth per tick, Arnoldi and eigenvalues | {TOLERANCE:.0e} | {largest:.1e}");
}

/// The shipped scene that diverges does so in the model with an indefinite tangent, and no earlier model grows.
#[test]
fn the_model_that_diverges_is_named() {
    let found = PathStability::of(&shipped("deep-stick-slip-faceted"), &mut |_| ()).expect("it starts");
    assert_eq!(found.verdict, Verdict::Fail);
    let growing: Vec<u64> = found.models.iter().filter(|m| m.growth_per_cycle > 1.0).map(|m| m.tick).collect();
    assert_eq!(growing, [800]); // it diverges at tick 884
    assert!(found.reason.contains("tick 800") && found.reason.contains("stabilised"), "{}", found.reason);
}

/// A tip that sticks holds its point: no model of the drag grows, under every scheme and integrator.
#[test]
fn shipped_drags_are_stable_along_their_paths() {
    for name in ["fig4-sticking", "deep-stick-slip", "fig5-stick-slip-subdivision"] {
        let found = PathStability::of(&shipped(name), &mut |_| ()).expect("it starts");
        assert_eq!((found.verdict, found.models.len()), (Verdict::Pass, 12), "{name}: {}", found.reason);
    }
}
