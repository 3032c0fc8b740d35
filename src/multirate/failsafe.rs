//! The fail-safe before the device: it passes on finite forces only, and latches a fault when the state diverges.

use thiserror::Error;

use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::renderer::RendererFault;
use crate::contact::report::TickReport;
use crate::contact::simulation::{Fold, LocalSimulation};
use crate::device::instrument::InstrumentFault;
use crate::device::phantom::DeviceError;
use crate::local::error::ModelError;
use crate::model::mesh::bounding_box;
use crate::model::state::State;

/// A node has diverged if its displacement exceeds this many diagonals of the rest mesh.
const RUNAWAY_DIAGONALS: f64 = 10.0;

/// The cause of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum FaultCause {
    /// The force to be commanded is NaN or infinite.
    #[error("the contact force is not finite")]
    ForceNotFinite,
    /// The force to be commanded is beyond the limit.
    #[error("the contact force of {newtons:.4e} N exceeds the limit of {limit_n} N")]
    ForceTooLarge {
        /// Magnitude of the force, N.
        newtons: f64,
        /// Largest force accepted, N.
        limit_n: f64,
    },
    /// A node's position or velocity is NaN or infinite.
    #[error("the state of node {node} is not finite")]
    StateNotFinite {
        /// Index of the node.
        node: u32,
    },
    /// An energy is NaN or infinite, though every position, velocity and force is finite.
    #[error("the energy balance is not finite: a mass, a stiffness or a velocity is out of any physical range")]
    EnergyNotFinite,
    /// The model of the next cycle cannot be built.
    #[error(transparent)]
    NoModel(ModelError),
    /// The instrument left the range in which it can be simulated.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A custom instrument failed.
    #[error(transparent)]
    Instrument(InstrumentFault),
    /// A custom renderer failed.
    #[error(transparent)]
    Renderer(RendererFault),
    /// A node is too far from its rest position.
    #[error("node {node} diverged: {distance_m:.3} m from its rest position, more than {limit_m:.3} m")]
    Runaway {
        /// Index of the node.
        node: u32,
        /// Distance from the rest position, m.
        distance_m: f64,
        /// Largest distance accepted, m.
        limit_m: f64,
    },
    /// The patch has folded over the tip.
    #[error(
        "the patch folded over the tip: it is {:.3} mm inside the surface while the contact pulls, more than {:.3} mm",
        1e3 * depth_m, 1e3 * limit_m
    )]
    PatchFolded {
        /// Depth of the tip inside the surface, m.
        depth_m: f64,
        /// Largest depth accepted, m.
        limit_m: f64,
    },
}

/// The fault that ended a run: its tick, its cause and the state.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "fault at tick {tick}: {cause} (mode {mode}, force [{:.4e}, {:.4e}, {:.4e}] N, tip [{:.6}, {:.6}, {:.6}] m, model {model_age} ticks old)",
    force.x, force.y, force.z, tip.x, tip.y, tip.z
)]
pub struct Fault {
    /// Number of the tick in which the fault occurred.
    pub tick: u64,
    /// Cause of the fault.
    pub cause: FaultCause,
    /// Contact mode of the tick.
    pub mode: &'static str,
    /// The contact force of the tick, N, which is not commanded.
    pub force: Vec3,
    /// Tip position at the end of the tick, m.
    pub tip: Vec3,
    /// Age of the local model, ticks.
    pub model_age: u64,
}

/// Bounds on the displacement of nodes, and on the contact force.
///
/// ```
/// use stickslip::multirate::failsafe::{Bounds, FaultCause};
/// use stickslip::{Vec3, model::state::State};
///
/// let rest = [Vec3::zeros(), Vec3::x() * 0.1]; // a diagonal of 0.1 m
/// let bounds = Bounds::new(&rest, 850.0);
/// let mut state = State { x: rest.to_vec(), v: vec![Vec3::zeros(); 2] };
/// assert_eq!(bounds.network_cause(&rest, &state), None);
/// state.x[1].x = 1.2;
/// assert!(matches!(bounds.network_cause(&rest, &state), Some(FaultCause::Runaway { node: 1, .. })));
/// state.v[0].z = f64::NAN;
/// assert_eq!(bounds.network_cause(&rest, &state), Some(FaultCause::StateNotFinite { node: 0 }));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    runaway_m: f64,
    force_n: f64,
}

impl Bounds {
    /// Sets bounds for a mesh with these rest positions, and for contact forces up to `force_n`.
    pub fn new(rest: &[Vec3], force_n: f64) -> Self {
        let (_, extents) = bounding_box(rest.iter().copied());
        Self { runaway_m: RUNAWAY_DIAGONALS * extents.norm(), force_n }
    }

    /// Finds a fault of the network at a boundary. The exterior moves only there, so every node is checked.
    pub fn network_cause(self, rest: &[Vec3], state: &State) -> Option<FaultCause> {
        let mut nodes = (0..).zip(rest).zip(state.x.iter().zip(&state.v));
        nodes.find_map(|((node, rest), (x, v))| self.node_cause(node, rest, x, v))
    }

    /// Finds a fault of a tick.
    fn tick_cause(self, tip: Vec3, local: &LocalSimulation, report: &TickReport) -> Option<FaultCause> {
        if let Some(fault) = local.renderer_fault() {
            return Some(FaultCause::Renderer(fault));
        }
        let newtons = report.force.norm();
        if !newtons.is_finite() {
            return Some(FaultCause::ForceNotFinite);
        }
        if !(newtons <= self.force_n) {
            return Some(FaultCause::ForceTooLarge { newtons, limit_n: self.force_n });
        }
        let patch = &local.model().patch;
        let state = local.state();
        let mut nodes = patch.nodes.iter().zip(&patch.rest).zip(state.x.iter().zip(&state.v));
        nodes.find_map(|((&node, rest), (x, v))| self.node_cause(node, rest, x, v)).or_else(|| {
            let Fold { depth_m, limit_m } = local.fold(tip)?;
            Some(FaultCause::PatchFolded { depth_m, limit_m })
        })
    }

    fn node_cause(self, node: u32, rest: &Vec3, x: &Vec3, v: &Vec3) -> Option<FaultCause> {
        let distance_m = (x - rest).norm();
        if !(distance_m.is_finite() && v.iter().all(|v| v.is_finite())) {
            Some(FaultCause::StateNotFinite { node })
        } else if distance_m > self.runaway_m {
            Some(FaultCause::Runaway { node, distance_m, limit_m: self.runaway_m })
        } else {
            None
        }
    }
}

/// The fail-safe: it checks every tick, and after the first fault commands zero for good.
///
/// ```
/// use stickslip::multirate::failsafe::{Bounds, FaultCause, FailSafe};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let bounds = Bounds::new(&simulation.network().rest, scene.largest_contact_force_n());
/// let mut local = simulation.into_sides().servo.into_local();
/// let tip = scene.path.at(0.0);
/// let mut report = local.tick(tip, tip);
///
/// let mut fail_safe = FailSafe::new(bounds);
/// assert_eq!(fail_safe.command(0, tip, &local, &report), Ok(Vec3::zeros()));
/// report.force.x = f64::NAN;
/// let fault = fail_safe.command(1, tip, &local, &report).expect_err("NaN must not reach a device");
/// assert_eq!((fault.tick, fault.cause), (1, FaultCause::ForceNotFinite));
/// report.force.x = 0.0;
/// assert_eq!(fail_safe.command(2, tip, &local, &report).map_err(|fault| fault.tick), Err(1)); // for good
/// assert_eq!(fail_safe.latch(3, tip, FaultCause::StateNotFinite { node: 0 }).tick, 1); // the first is reported
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct FailSafe {
    bounds: Bounds,
    latched: Option<Fault>,
}

impl FailSafe {
    /// Creates a fail-safe without a fault.
    pub fn new(bounds: Bounds) -> Self {
        Self { bounds, latched: None }
    }

    /// Returns the force to command after a tick, N.
    ///
    /// # Errors
    /// If a fault occurs in this tick or has occurred in an earlier one.
    pub fn command(
        &mut self,
        tick: u64,
        tip: Vec3,
        local: &LocalSimulation,
        report: &TickReport,
    ) -> Result<Vec3, Fault> {
        if self.latched.is_none()
            && let Some(cause) = self.bounds.tick_cause(tip, local, report)
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

    /// Latches a fault found outside of ticks, as at a boundary.
    pub fn latch(&mut self, tick: u64, tip: Vec3, cause: FaultCause) -> Fault {
        let fault = Fault { tick, cause, mode: Mode::Free.name(), force: Vec3::zeros(), tip, model_age: 0 };
        *self.latched.get_or_insert(fault)
    }
}
