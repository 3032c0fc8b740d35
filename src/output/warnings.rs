//! Warnings about a run: before it, from the scene and its first local model; after it, from what happened.

use super::device_facts::DeviceFacts;
use super::time_steps::TimeSteps;
use crate::Vec3;
use crate::dynamics::constraint::Threads;
use crate::local::patch::OUTSIDE;
use crate::local::step::LocalIntegrator;
use crate::model::mesh::bounding_box;
use crate::pipeline::Simulation;
use crate::scene::{Scene, Warning};

/// Distance of the tip from the body's centre above which there is a warning, in diagonals of the body.
const FAR_DIAGONALS: f64 = 10.0;
/// Largest number of points of a path that are compared with the surface at rest.
const PATH_POINTS: u64 = 2000;

/// Returns the warnings that follow from a scene and its first local model.
///
/// ```
/// use stickslip::output::{time_steps::TimeSteps, warnings};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let codes = |scene: &Scene| -> Result<Vec<_>, stickslip::SceneError> {
///     let simulation = Simulation::prepare(scene)?;
///     let found = warnings::before_run(scene, &simulation, &TimeSteps::where_in_doubt(scene, &simulation));
///     Ok(found.iter().map(|warning| warning.code).collect())
/// };
/// assert_eq!(codes(&scene)?, [""; 0]);
/// // In a wrong unit, the tip passes the body at a distance, and fast.
/// let path = scene.path.transformed(1.0, |tip| tip * 2e3);
/// let wrong = scene.clone().with_instrument(scene.instrument.clone(), path);
/// assert_eq!(codes(&wrong)?, ["tip-speed", "patch-speed", "tip-far", "never-touches"]);
/// # Ok::<(), stickslip::SceneError>(())
/// ```
pub fn before_run(scene: &Scene, simulation: &Simulation, steps: &TimeSteps) -> Vec<Warning> {
    let mut warnings = scene.warnings();
    let TimeSteps { local, global, integrates } = steps;
    if local.is_beyond() {
        let way_out = "give a higher `local.rate` or an implicit `local.integrator`";
        warnings.push(Warning::new(
            "local-step-limit",
            format!("the local tick is beyond its stability limit: {}; {way_out}", local.text()),
        ));
    }
    if *integrates && global.is_beyond() {
        let way_out = "give more `global.substeps` or `global.integrator = \"implicit-euler\"`";
        warnings.push(Warning::new(
            "global-step-limit",
            format!("the global substep is beyond its stability limit: {}; {way_out}", global.text()),
        ));
    }
    if scene.global.threads == Threads::Two && simulation.network().springs.halves().is_none() {
        let springs = simulation.network().springs.len();
        warnings.push(Warning::new(
            "threads-no-effect",
            format!(
                "`global.threads = 2` has no effect: {springs} springs are too few to divide, or most of them cross any cut"
            ),
        ));
    }
    let turn = local.step_s * local.omega_max_rad_s;
    if scene.integrator == LocalIntegrator::Exponential && turn > std::f64::consts::PI {
        warnings.push(Warning::new(
            "exponential-phase",
            format!(
                "the phase of the fastest mode advances by {turn:.1} rad per tick: the contact's response may vanish, \
                 and a run in contact may end in a fault; `local.integrator = \"implicit-euler\"` has no such bound"
            ),
        ));
    }
    warnings.extend(patch_speed(scene, simulation));
    warnings.extend(distance(scene, simulation));
    warnings.extend(DeviceFacts::new(scene, simulation).iter().flat_map(DeviceFacts::warnings));
    warnings
}

/// Warns of a tip that leaves the patch within a cycle.
fn patch_speed(scene: &Scene, simulation: &Simulation) -> Option<Warning> {
    let patch = &simulation.local().model().patch;
    let is_rendered_by_another = simulation.local().is_rendered_by_another();
    if is_rendered_by_another || patch.len() >= simulation.network().fixed.iter().filter(|&&fixed| !fixed).count() {
        return None;
    }
    // Distance at rest from the centre of the patch to its furthest surface node.
    let on_surface: Vec<_> = (simulation.surface().vertex_node.iter().zip(&patch.vertex_slot))
        .filter(|&(_, &slot)| slot != OUTSIDE)
        .map(|(&node, _)| simulation.network().rest[node as usize])
        .collect();
    let middle = on_surface.iter().sum::<Vec3>() / on_surface.len().max(1) as f64;
    let reach = on_surface.iter().map(|x| (x - middle).norm()).fold(0.0, f64::max);
    let way = scene.path.top_speed() / scene.global_rate_hz();
    (way > reach).then(|| {
        Warning::new(
            "patch-speed",
            format!(
                "the tip moves by up to {:.1} mm per global cycle and the patch reaches {:.1} mm: contact may leave \
                 the patch and become rigid; give more `local.rings` or a higher `global.rate`",
                1e3 * way,
                1e3 * reach
            ),
        )
    })
}

/// Warns of a path far from the body, and of one that never meets its surface at rest.
fn distance(scene: &Scene, simulation: &Simulation) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let (lowest, extents) = bounding_box(simulation.network().rest.iter().copied());
    let (centre, diagonal) = (lowest + extents / 2.0, extents.norm());
    let points = scene.tick_count().clamp(1, PATH_POINTS);
    let tips = || (0..=points).map(|point| scene.path.at(scene.duration_s() * point as f64 / points as f64));
    let furthest = tips().map(|tip| (tip - centre).norm()).fold(0.0, f64::max);
    if !(furthest <= FAR_DIAGONALS * diagonal) {
        warnings.push(Warning::new(
            "tip-far",
            format!(
                "the tip is up to {furthest:.3} m from the centre of the body, whose diagonal is {diagonal:.3} m: positions \
                 are in m; `instrument.scale` converts a recording, `mesh.scale` a mesh"
            ),
        ));
    }
    // The shape at the start of the run: a surface that has settled under its weight is not where its nodes were.
    let shape = simulation.local().shape();
    let nearest = tips().map(|tip| shape.signed_distance(tip)).fold(f64::INFINITY, f64::min);
    if nearest > 0.0 {
        warnings.push(never_touches(nearest));
    }
    warnings
}

fn never_touches(nearest_m: f64) -> Warning {
    let message = format!(
        "the path stays {nearest_m:.1e} m or more above the surface at rest: contact is not tested; lower the path, or check its \
         unit and times"
    );
    Warning::new(NEVER_TOUCHES, message)
}

/// Code of the warning of a path without contact.
const NEVER_TOUCHES: &str = "never-touches";

/// Returns the foreseen warnings, corrected by whether the tip touched the body in the run.
pub fn after_run(foreseen: &[Warning], contact_ticks: u64) -> Vec<Warning> {
    let mut warnings = foreseen.to_vec();
    if contact_ticks > 0 {
        warnings.retain(|warning| warning.code != NEVER_TOUCHES);
    } else if !warnings.iter().any(|warning| warning.code == NEVER_TOUCHES) {
        warnings.push(Warning::new(
            NEVER_TOUCHES,
            "the tip never touched the body: contact is not tested; lengthen the run, or lower the path".to_owned(),
        ));
    }
    warnings
}
