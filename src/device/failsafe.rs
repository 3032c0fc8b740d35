//! The last station before the device: what reaches it is finite and within its limit, and a state
//! that has run away latches a fault.

use thiserror::Error;

use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::tick::{LocalSimulation, TickReport};
use crate::model::local::ModelError;
use crate::model::network::State;

/// A node further from its rest place than this many diagonals of the rest mesh has run away.
const RUNAWAY_DIAGONALS: f64 = 10.0;

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Cause {
    /// The force to be commanded is NaN or infinite.
    #[error("the contact force is not finite")]
    ForceNotFinite,
    /// A node's position or velocity is NaN or infinite.
    #[error("the state of node {node} is not finite")]
    StateNotFinite {
        /// The node.
        node: u32,
    },
    /// The model of the next cycle cannot be built.
    #[error(transparent)]
    NoModel(ModelError),
    /// A node is too far from its rest place.
    #[error("node {node} ran away: {distance_m:.3} m from its rest place, more than {limit_m:.3} m")]
    Runaway {
        /// The node.
        node: u32,
        /// How far it is.
        distance_m: f64,
        /// How far it may be.
        limit_m: f64,
    },
}

/// The end of a run: when, why, and in which state.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "fault at tick {tick}: {cause} (mode {mode}, force [{:e}, {:e}, {:e}] N, tip [{}, {}, {}] m, model {model_age} ticks old)",
    force.x, force.y, force.z, tip.x, tip.y, tip.z
)]
pub struct Fault {
    /// The tick that was being done.
    pub tick: u64,
    /// Why.
    pub cause: Cause,
    /// Its mode.
    pub mode: &'static str,
    /// The force it would have commanded, N.
    pub force: Vec3,
    /// The tip at its end, m.
    pub tip: Vec3,
    /// Age of the local model.
    pub model_age: u64,
}

/// Checks every tick; once it has found a fault it commands zero for good.
#[derive(Debug, Clone)]
pub struct FailSafe {
    rest: Vec<Vec3>,
    runaway_m: f64,
    latched: Option<Fault>,
}

impl FailSafe {
    /// For a mesh at rest at these positions.
    pub fn new(rest: &[Vec3]) -> Self {
        let lower = rest.iter().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let upper = rest.iter().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        Self { rest: rest.to_vec(), runaway_m: RUNAWAY_DIAGONALS * (upper - lower).norm(), latched: None }
    }

    /// The force to command after a tick.
    ///
    /// # Errors
    /// With the fault, in this tick and every later one.
    pub fn command(
        &mut self,
        tick: u64,
        tip: Vec3,
        local: &LocalSimulation,
        report: &TickReport,
    ) -> Result<Vec3, Fault> {
        if self.latched.is_none()
            && let Some(cause) = self.cause(local, report)
        {
            let force = report.force;
            let model_age = local.model_age().saturating_sub(1);
            self.latched = Some(Fault { tick, cause, mode: report.mode.name(), force, tip, model_age });
        }
        match self.latched {
            None => Ok(report.force),
            Some(fault) => Err(fault),
        }
    }

    fn cause(&self, local: &LocalSimulation, report: &TickReport) -> Option<Cause> {
        if !report.force.norm().is_finite() {
            return Some(Cause::ForceNotFinite);
        }
        let patch = &local.model().patch;
        let state = local.state();
        let mut nodes = patch.nodes.iter().zip(&patch.rest).zip(state.x.iter().zip(&state.v));
        nodes.find_map(|((&node, rest), (x, v))| self.node_cause(node, rest, x, v))
    }

    /// The exterior moves only at boundaries: checks every node of the network there.
    ///
    /// # Errors
    /// With the fault.
    pub fn check_network(&mut self, tick: u64, tip: Vec3, state: &State) -> Result<(), Fault> {
        let mut nodes = (0..).zip(&self.rest).zip(state.x.iter().zip(&state.v));
        if let Some(cause) = nodes.find_map(|((node, rest), (x, v))| self.node_cause(node, rest, x, v)) {
            return Err(self.at_boundary(tick, tip, cause));
        }
        Ok(())
    }

    /// The fault of a boundary at which no model could be built.
    pub fn no_model(&mut self, tick: u64, tip: Vec3, error: ModelError) -> Fault {
        self.at_boundary(tick, tip, Cause::NoModel(error))
    }

    fn at_boundary(&mut self, tick: u64, tip: Vec3, cause: Cause) -> Fault {
        let fault = Fault { tick, cause, mode: Mode::Free.name(), force: Vec3::zeros(), tip, model_age: 0 };
        *self.latched.get_or_insert(fault)
    }

    fn node_cause(&self, node: u32, rest: &Vec3, x: &Vec3, v: &Vec3) -> Option<Cause> {
        let distance_m = (x - rest).norm();
        if !(distance_m.is_finite() && v.iter().all(|v| v.is_finite())) {
            Some(Cause::StateNotFinite { node })
        } else if distance_m > self.runaway_m {
            Some(Cause::Runaway { node, distance_m, limit_m: self.runaway_m })
        } else {
            None
        }
    }
}
