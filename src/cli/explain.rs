//! `stickslip explain`: a scene's parts, sizes, costs and stability limits, before it runs.

pub(super) mod device;

use std::path::Path;

use serde::Serialize;

use self::device::DeviceFacts;
use super::terminal::{hand_out, say, significant};
use super::{PASS, read};
use crate::Vec3;
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::dynamics::stability::{StepLimit, explicit_step_limit};
use crate::local::condensation::CondensationOutcome;
use crate::local::model::Linearization;
use crate::local::step::{LinearStep, LocalIntegrator};
use crate::multirate::global::SyncMode;
use crate::pipeline::Simulation;
use crate::scene::Scene;

#[derive(Serialize)]
struct Explanation {
    scene: String,
    sizes: Sizes,
    needed: Vec<String>,
    left_out: Vec<String>,
    cost_per_tick: TickCost,
    cost_per_cycle: CycleCost,
    local_step: Step,
    global_step: Step,
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<DeviceFacts>,
    warnings: Vec<String>,
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

#[derive(Serialize)]
struct Step {
    step_s: f64,
    limit_s: Option<f64>,
    omega_max_rad_s: f64,
    /// The integrator, if it is stable at every stiffness.
    unlimited: Option<&'static str>,
}

impl Step {
    /// Describes the step of an integrator that is stable at every step unless K is indefinite.
    fn unlimited(step_s: f64, limit: StepLimit, integrator: &'static str) -> Self {
        Self { limit_s: None, unlimited: Some(integrator), ..Self::new(step_s, limit) }
    }

    fn new(step_s: f64, limit: StepLimit) -> Self {
        let limit_s = limit.step.is_finite().then_some(limit.step);
        Self { step_s, limit_s, omega_max_rad_s: limit.omega, unlimited: None }
    }

    fn is_beyond(&self) -> bool {
        self.limit_s.is_some_and(|limit| self.step_s > limit)
    }

    fn text(&self) -> String {
        if let Some(integrator) = self.unlimited {
            let turn = self.step_s * self.omega_max_rad_s;
            return format!("{:.3} ms; no stability limit ({integrator}; ω_max h = {turn:.2})", 1e3 * self.step_s);
        }
        match self.limit_s {
            Some(limit) => format!(
                "{:.3} ms; stable up to {:.3} ms ({:.3} ms without damping, 2/ω_max)",
                1e3 * self.step_s,
                1e3 * limit,
                2e3 / self.omega_max_rad_s
            ),
            None => format!("{:.3} ms; no stability limit", 1e3 * self.step_s),
        }
    }
}

pub fn explain(scene: &Path) -> miette::Result<u8> {
    let explanation = explanation(&read(scene)?.0)?;
    hand_out(&explanation)?;
    say(text(&explanation))?;
    Ok(PASS)
}

fn explanation(scene: &Scene) -> miette::Result<Explanation> {
    let simulation = Simulation::prepare(scene)?;
    let parts = scene.parts();
    let named = |needed: bool| parts.iter().filter(|part| part.needed == needed).map(ToString::to_string).collect();
    let integrates = parts.iter().any(|part| part.name == "replay of the patch's path" && part.needed)
        || (scene.global.sync == SyncMode::Overwrite && !scene.is_full());
    let (local_step, global_step) = time_steps(scene, &simulation);
    let device = DeviceFacts::new(scene, &simulation);
    let mut warnings = warnings(scene, &simulation, &local_step, integrates.then_some(&global_step));
    warnings.extend(device.iter().flat_map(DeviceFacts::warnings));
    Ok(Explanation {
        scene: scene.name.clone(),
        sizes: sizes(scene, &simulation),
        needed: named(true),
        left_out: named(false),
        cost_per_tick: tick_cost(scene, &simulation),
        cost_per_cycle: cycle_cost(scene, &simulation, integrates),
        local_step,
        global_step,
        device,
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

/// The local tick and the global substep with their stability limits.
fn time_steps(scene: &Scene, simulation: &Simulation) -> (Step, Step) {
    let (network, patch, drag) = (simulation.network(), &simulation.local().model().patch, scene.material.drag);
    let mut held = patch.inverse_mass.clone();
    held.resize(patch.len() + patch.boundary.len(), 0.0);
    let local_limit = explicit_step_limit(&patch.springs, &simulation.local().state().x, &held, drag);
    let global_limit =
        explicit_step_limit(&network.springs, &simulation.global().state().x, &network.inverse_mass, drag);
    let local = match scene.integrator {
        LocalIntegrator::SemiImplicitEuler => Step::new(scene.tick_s(), local_limit),
        implicit => Step::unlimited(scene.tick_s(), local_limit, implicit.name()),
    };
    let substep = 1.0 / (scene.global_rate_hz() * f64::from(scene.global.substeps));
    let global = match scene.global.integrator {
        GlobalIntegrator::ImplicitEuler => Step::unlimited(substep, global_limit, "implicit-euler"),
        GlobalIntegrator::SemiImplicitEuler | GlobalIntegrator::Rk4 => Step::new(substep, global_limit),
    };
    (local, global)
}

fn warnings(scene: &Scene, simulation: &Simulation, local: &Step, global: Option<&Step>) -> Vec<String> {
    let mut warnings = scene.warnings();
    if local.is_beyond() {
        warnings.push(format!("the local tick is beyond its stability limit: {}", local.text()));
    }
    if let Some(global) = global.filter(|global| global.is_beyond()) {
        warnings.push(format!("the global substep is beyond its stability limit: {}", global.text()));
    }
    if scene.global.threads == Threads::Two && simulation.network().springs.halves().is_none() {
        let springs = simulation.network().springs.len();
        warnings.push(format!(
            "`global.threads = 2` has no effect: {springs} springs are too few to divide, or most of them cross any cut"
        ));
    }
    let turn = local.step_s * local.omega_max_rad_s;
    if scene.integrator == LocalIntegrator::Exponential && turn > std::f64::consts::PI {
        warnings.push(format!(
            "the phase of the fastest mode advances by {turn:.1} rad per tick: the contact's response may vanish, \
             and a run in contact may end in a fault; `local.integrator = \"implicit-euler\"` has no such bound"
        ));
    }
    let model = simulation.local().model();
    let patch = &model.patch;
    if patch.len() < simulation.network().fixed.iter().filter(|&&fixed| !fixed).count() {
        // Distance at rest from the centre of the patch to its furthest surface node.
        let on_surface: Vec<_> = (simulation.surface().vertex_node.iter().zip(&patch.vertex_slot))
            .filter(|&(_, &slot)| slot != crate::local::patch::OUTSIDE)
            .map(|(&node, _)| simulation.network().rest[node as usize])
            .collect();
        let middle = on_surface.iter().sum::<Vec3>() / on_surface.len().max(1) as f64;
        let reach = on_surface.iter().map(|x| (x - middle).norm()).fold(0.0, f64::max);
        let way = scene.path.top_speed() / scene.global_rate_hz();
        if way > reach {
            warnings.push(format!(
                "the tip moves by up to {:.1} mm per global cycle and the patch reaches {:.1} mm: contact may leave \
                 the patch and become rigid",
                1e3 * way,
                1e3 * reach
            ));
        }
    }
    warnings
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
    for warning in &e.warnings {
        line(format!("\nWarning: {warning}"));
    }
    lines.join("\n")
}
