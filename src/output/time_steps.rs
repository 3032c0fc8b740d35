//! The time steps of a scene, with their stability limits.

use serde::Serialize;

use crate::Vec3;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::dynamics::stability::{StepLimit, explicit_step_bound, explicit_step_limit};
use crate::local::step::LocalIntegrator;
use crate::model::springs::Springs;
use crate::multirate::global::SyncMode;
use crate::pipeline::Simulation;
use crate::scene::Scene;

/// The local tick and the global substep, with their stability limits at the start of the run.
#[derive(Debug, Clone, Serialize)]
pub struct TimeSteps {
    /// Local tick; its limit is that of a fixed exterior.
    pub local: TimeStep,
    /// Global substep.
    pub global: TimeStep,
    /// Whether the network is integrated at all. It is not under `full`, nor where the path of a patch of all nodes is
    /// replayed.
    pub integrates: bool,
}

/// A time step with its stability limit.
#[derive(Debug, Clone, Serialize)]
pub struct TimeStep {
    /// Length of the step, s.
    pub step_s: f64,
    /// Largest stable step, s; absent if there is none.
    pub limit_s: Option<f64>,
    /// Angular frequency of the fastest mode, rad/s.
    pub omega_max_rad_s: f64,
    /// Name of the integrator, if it is stable at every stiffness.
    pub unlimited: Option<&'static str>,
}

impl TimeSteps {
    /// Computes the stability limits of both steps.
    pub fn new(scene: &Scene, simulation: &Simulation) -> Self {
        Self::by(scene, simulation, |springs, x, inverse_mass, drag, _| {
            explicit_step_limit(springs, x, inverse_mass, drag)
        })
    }

    /// Computes the limit of a step only where a lower bound on it does not already show that the step is stable; elsewhere
    /// the bound stands for the limit. The bound takes one pass over the springs, the limit up to a thousand.
    pub fn where_in_doubt(scene: &Scene, simulation: &Simulation) -> Self {
        Self::by(scene, simulation, |springs, x, inverse_mass, drag, step_s| {
            let bound = explicit_step_bound(springs, x, inverse_mass, drag);
            if step_s <= bound.step { bound } else { explicit_step_limit(springs, x, inverse_mass, drag) }
        })
    }

    fn by(
        scene: &Scene,
        simulation: &Simulation,
        limit: impl Fn(&Springs, &[Vec3], &[f64], f64, f64) -> StepLimit,
    ) -> Self {
        let (network, patch, drag) = (simulation.network(), &simulation.local().model().patch, scene.material.drag);
        let (tick_s, substeps) = (scene.tick_s(), f64::from(scene.global.substeps));
        let substep_s = 1.0 / (scene.global_rate_hz() * substeps);
        let replays = scene.parts().iter().any(|part| part.name == "replay of the patch's path" && part.needed);
        let integrates = replays || (scene.global.sync == SyncMode::Overwrite && !scene.is_full());
        let mut held = patch.inverse_mass.clone();
        held.resize(patch.len() + patch.boundary.len(), 0.0);
        let local = limit(&patch.springs, &simulation.local().state().x, &held, drag, tick_s);
        let global = limit(&network.springs, &simulation.global().state().x, &network.inverse_mass, drag, substep_s);
        let local = match scene.integrator {
            LocalIntegrator::SemiImplicitEuler => TimeStep::new(tick_s, local),
            implicit => TimeStep::unlimited(tick_s, local, implicit.name()),
        };
        let global = match scene.global.integrator {
            GlobalIntegrator::ImplicitEuler => TimeStep::unlimited(substep_s, global, "implicit-euler"),
            GlobalIntegrator::SemiImplicitEuler | GlobalIntegrator::Rk4 => TimeStep::new(substep_s, global),
        };
        Self { local, global, integrates }
    }
}

impl TimeStep {
    fn new(step_s: f64, limit: StepLimit) -> Self {
        let limit_s = limit.step.is_finite().then_some(limit.step);
        Self { step_s, limit_s, omega_max_rad_s: limit.omega, unlimited: None }
    }

    /// Describes the step of an integrator that is stable at every step unless K is indefinite.
    fn unlimited(step_s: f64, limit: StepLimit, integrator: &'static str) -> Self {
        Self { limit_s: None, unlimited: Some(integrator), ..Self::new(step_s, limit) }
    }

    /// Returns whether the step is beyond its limit.
    pub fn is_beyond(&self) -> bool {
        self.limit_s.is_some_and(|limit| !(self.step_s <= limit))
    }

    /// Describes the step and its limit in words.
    pub fn text(&self) -> String {
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
