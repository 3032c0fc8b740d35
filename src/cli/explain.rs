//! `stickslip explain`: a scene's parts, sizes, costs and stability limits, before it runs.

use std::path::Path;

use serde::Serialize;

use super::renderer::RendererArguments;
use super::terminal::{hand_out, say, significant};
use super::{Changes, PASS, read};
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::CondensationOutcome;
use crate::local::model::Linearization;
use crate::local::step::LinearStep;
use crate::output::device_facts::DeviceFacts;
use crate::output::recording_facts::RecordingFacts;
use crate::output::time_steps::{TimeStep, TimeSteps};
use crate::output::warnings::before_run;
use crate::pipeline::Simulation;
use crate::scene::{Scene, Warning};

#[derive(Serialize)]
struct Explanation {
    scene: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<String>,
    sizes: Sizes,
    needed: Vec<String>,
    left_out: Vec<String>,
    cost_per_tick: TickCost,
    cost_per_cycle: CycleCost,
    local_step: TimeStep,
    global_step: TimeStep,
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<DeviceFacts>,
    /// The recorded motion; absent if the path is not recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<RecordingFacts>,
    warnings: Vec<Warning>,
}

#[derive(Serialize)]
struct Sizes {
    nodes: usize,
    fixed_nodes: usize,
    springs: usize,
    surface_triangles: usize,
    ticks: u64,
    ticks_per_cycle: u32,
    patch_nodes: usize,
    patch_springs: usize,
    /// Estimated memory of a run, MiB.
    memory_estimate_mib: f64,
    /// Stiffness of the softest and of the stiffest spring.
    stiffness_n_per_m: [f64; 2],
    /// Damping of the least and of the most damped spring.
    damping_n_s_per_m: [f64; 2],
}

#[derive(Serialize)]
struct TickCost {
    /// Rows and columns of [K D], or of the matrix that advances (x, v) by a tick, if the forces are linear; those of C
    /// if they are springs and the exterior is condensed.
    matrix: Option<[usize; 2]>,
    /// Products with the matrix in a free tick.
    products: u64,
    /// Rows and columns of A⁻¹, some of whose columns are read in contact; absent if it is not used.
    response: Option<[usize; 2]>,
    /// Springs evaluated, if the forces are not linear.
    springs: Option<usize>,
    /// Largest number of nodes that a contact point rests on.
    contact_nodes: usize,
    /// Radius of the disc over which a contact is spread, m; 0 for a point.
    contact_radius_m: f64,
}

#[derive(Serialize)]
struct CycleCost {
    force_evaluations: u32,
    springs: usize,
    new_models: u32,
    /// Static condensation of the first model.
    condensation: Option<CondensationCost>,
}

#[derive(Serialize)]
struct CondensationCost {
    outcome: &'static str,
    nodes: usize,
    coarse_vertices: usize,
    factor_entries: u64,
    factor_multiply_adds: u64,
}

pub fn explain(scene: &Path, changes: &Changes, renderer: &RendererArguments) -> miette::Result<u8> {
    let explanation = explanation(&renderer.apply(read(scene, changes)?.0))?;
    hand_out(&explanation)?;
    say(text(&explanation))?;
    Ok(PASS)
}

fn explanation(scene: &Scene) -> miette::Result<Explanation> {
    let simulation = Simulation::prepare(scene)?;
    let parts = scene.parts();
    let named = |needed: bool| parts.iter().filter(|part| part.needed == needed).map(ToString::to_string).collect();
    let steps = TimeSteps::new(scene, &simulation);
    let warnings = before_run(scene, &simulation, &steps);
    let TimeSteps { local: local_step, global: global_step, integrates } = steps;
    let device = DeviceFacts::new(scene, &simulation);
    Ok(Explanation {
        scene: scene.name.clone(),
        changes: scene.changes(),
        sizes: sizes(scene, &simulation),
        needed: named(true),
        left_out: named(false),
        cost_per_tick: tick_cost(scene, &simulation),
        cost_per_cycle: cycle_cost(scene, &simulation, integrates),
        local_step,
        global_step,
        device,
        recording: RecordingFacts::new(scene),
        warnings,
    })
}

fn sizes(scene: &Scene, simulation: &Simulation) -> Sizes {
    let network = simulation.network();
    let patch = &simulation.local().model().patch;
    Sizes {
        nodes: network.node_count(),
        fixed_nodes: network.fixed.iter().filter(|&&fixed| fixed).count(),
        springs: network.springs.len(),
        surface_triangles: simulation.surface().triangles.len(),
        ticks: scene.tick_count(),
        ticks_per_cycle: scene.ticks_per_cycle(),
        patch_nodes: patch.len(),
        patch_springs: patch.springs.len(),
        memory_estimate_mib: scene.memory_estimate() as f64 / f64::from(1 << 20),
        stiffness_n_per_m: scene.material.stiffness.range(),
        damping_n_s_per_m: scene.material.damping.range(),
    }
}

fn tick_cost(scene: &Scene, simulation: &Simulation) -> TickCost {
    let model = simulation.local().model();
    let patch = &model.patch;
    let linear = matches!(scene.local().linearization, Linearization::Tangent(_));
    let rows = 3 * patch.len();
    let step = model.step.as_ref();
    let columns = if step.is_some() || patch.springs.is_damped() || scene.material.drag != 0.0 { 6 } else { 3 };
    let condenses = model.condensation.is_some_and(|(outcome, _)| outcome != CondensationOutcome::Held);
    TickCost {
        matrix: if linear { Some([rows, columns * patch.len()]) } else { condenses.then_some([rows; 2]) },
        products: step.map_or(1, LinearStep::products),
        response: step.is_some().then_some([rows, rows]),
        springs: (!linear).then_some(patch.springs.len()),
        contact_nodes: simulation.local().surface().geometry.largest_support(),
        contact_radius_m: scene.contact_radius,
    }
}

/// Cost of a global cycle; `integrates` says whether the network is integrated over it.
fn cycle_cost(scene: &Scene, simulation: &Simulation, integrates: bool) -> CycleCost {
    let stages = match scene.global.integrator {
        GlobalIntegrator::SemiImplicitEuler => 1,
        // Two or three Newton iterations where the motion is smooth, each with a sparse factorisation.
        GlobalIntegrator::ImplicitEuler => 3,
        GlobalIntegrator::Rk4 => 4,
    };
    CycleCost {
        force_evaluations: if integrates { stages * scene.global.substeps } else { 0 },
        springs: simulation.network().springs.len(),
        new_models: u32::from(!scene.is_full()),
        condensation: simulation.local().model().condensation.map(|(outcome, size)| CondensationCost {
            outcome: match outcome {
                CondensationOutcome::AsAsked => "as asked",
                CondensationOutcome::Stabilised => "stabilised: it is indefinite with the exact tangent",
                CondensationOutcome::Held => "held: it can move without a force",
            },
            nodes: size.nodes,
            coarse_vertices: size.vertices,
            factor_entries: size.factor.entries,
            factor_multiply_adds: size.factor.multiply_adds,
        }),
    }
}

fn text(e: &Explanation) -> String {
    let mut lines = Vec::new();
    let mut line = |text: String| lines.push(text);
    let Sizes { nodes, fixed_nodes, springs, surface_triangles, .. } = e.sizes;
    line(e.scene.clone());
    line("\nSizes".to_owned());
    line(format!(
        "  network   {nodes} nodes ({fixed_nodes} fixed), {springs} springs, {surface_triangles} surface triangles"
    ));
    let range = |[least, most]: [f64; 2]| {
        if least == most { significant(least) } else { format!("{} to {}", significant(least), significant(most)) }
    };
    line(format!(
        "  springs   k = {} N/m, c = {} N·s/m",
        range(e.sizes.stiffness_n_per_m),
        range(e.sizes.damping_n_s_per_m)
    ));
    line(format!(
        "  patch     {} free nodes, {} springs (the first local model; the patch follows the contact)",
        e.sizes.patch_nodes, e.sizes.patch_springs
    ));
    line(format!("  time      {} ticks, {} per global cycle", e.sizes.ticks, e.sizes.ticks_per_cycle));
    line(format!("  memory    about {:.0} MiB", e.sizes.memory_estimate_mib));
    line("\nParts of the pipeline (the setting that decides)".to_owned());
    e.needed.iter().for_each(|part| line(format!("  + {part}")));
    line("\nOmitted".to_owned());
    e.left_out.iter().for_each(|part| line(format!("  - {part}")));
    line("\nCost per tick".to_owned());
    if let Some([rows, columns]) = e.cost_per_tick.matrix {
        let count = if e.cost_per_tick.products == 1 { "one" } else { "two" };
        let multiply_adds = e.cost_per_tick.products as usize * rows * columns;
        let plural = if e.cost_per_tick.products == 1 { "" } else { "s" };
        let twice = if e.cost_per_tick.springs.is_some() { ", two evaluations in contact" } else { "" };
        line(format!(
            "  {count} {rows} × {columns} matrix–vector product{plural} ({multiply_adds} multiply–adds){twice}"
        ));
    }
    if let Some([rows, columns]) = e.cost_per_tick.response {
        line(format!("  in contact: three columns of A⁻¹ ({rows} × {columns}) per node of the contact point"));
    }
    if let Some(springs) = e.cost_per_tick.springs {
        line(format!("  {springs} springs, evaluated twice in contact"));
    }
    line("  free: the triangles near the tip (bounding-box tree); in contact: the triangle below it".to_owned());
    let nodes = e.cost_per_tick.contact_nodes;
    line(match e.cost_per_tick.contact_radius_m {
        0.0 => format!("  a contact point rests on up to {nodes} nodes"),
        radius => format!("  contacts within a triangle spread over up to {nodes} nodes, by a radius of {radius} m"),
    });
    line("\nCost per global cycle".to_owned());
    let CycleCost { force_evaluations, springs, new_models, condensation } = &e.cost_per_cycle;
    line(format!("  {force_evaluations} evaluations of {springs} springs, {new_models} new local model"));
    if let Some(cost) = condensation {
        line(format!(
            "  static condensation of {} exterior nodes and {} coarse ones: a factor of {} entries, {} million \
             multiply–adds, and its analysis for each new patch (first model: {})",
            cost.nodes,
            cost.coarse_vertices,
            cost.factor_entries,
            cost.factor_multiply_adds.div_ceil(1_000_000),
            cost.outcome
        ));
    }
    line("\nTime steps".to_owned());
    line(format!("  local tick      {}", e.local_step.text()));
    if condensation.is_some() {
        line("                  (with a fixed exterior; a condensed one is softer)".to_owned());
    }
    line(format!("  global substep  {}", e.global_step.text()));
    if let Some(device) = &e.device {
        line("\nInstrument".to_owned());
        device.lines().into_iter().for_each(&mut line);
    }
    if let Some(recording) = &e.recording {
        line("\nRecording".to_owned());
        recording.lines().into_iter().for_each(&mut line);
    }
    for warning in &e.warnings {
        line(format!("\nWarning: {warning}"));
    }
    lines.join("\n")
}
