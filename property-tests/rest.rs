//! At rest after a poke: nothing subnormal is left to slow arithmetic down.

use stickslip::contact::tick::LocalSimulation;
use stickslip::pipeline;

use crate::check::small_scene;

/// Numbers that a processor handles in microcode, in everything a tick reads and writes.
fn subnormals(local: &LocalSimulation) -> usize {
    let state = local.state();
    let arrays = [&state.x, &state.v, &state.f, &state.x_predicted, &state.v_predicted];
    arrays.into_iter().flatten().flat_map(|v| v.iter()).filter(|c| c.is_subnormal()).count()
}

/// 60 s after a poke, every tick is looked at: a subnormal number anywhere would mean that the time
/// per tick has stopped to be flat. The clock itself is left to the benches.
#[test]
fn nothing_subnormal_is_left_60_s_after_a_poke() {
    for local in ["rings = 1", "linearization = \"none\"", "model = \"full\""] {
        let poke = "[[0.0, 0.0, 0.001, 0.001], [0.05, 0.0, 0.001, -0.002], [0.1, 0.0, 0.001, 0.01]]";
        let mut scene = small_scene("law = \"sliding\"", local, poke);
        // More damping than the default, so that a minute of decay reaches any exponent there is.
        scene.material.damping = 2.0;
        scene.material.drag = 0.2;
        scene.tick_count = 60_000;
        let (mut seen, mut slowest_speed) = (0, f64::INFINITY);
        pipeline::run(&scene, |view| {
            seen += subnormals(view.local);
            let speeds = view.local.state().v.iter().flat_map(|v| v.iter()).map(|v| v.abs()).filter(|&v| v > 0.0);
            slowest_speed = speeds.fold(slowest_speed, f64::min);
        })
        .expect("completes");
        assert_eq!(seen, 0, "{local}: subnormal numbers in {seen} places");
        assert!(slowest_speed >= 1e-30, "{local}: {slowest_speed:e} m/s is not at rest");
    }
}
