//! The global cycle: it takes the past cycle from the local side, integrates the network over it, and builds the next
//! local model.

use std::sync::Arc;

use thiserror::Error;

use super::failsafe::{Bounds, FaultCause};
use super::messages::{CycleMessage, ModelMessage};
use super::trajectory::{PathRecording, PrescribedPatch, Pushed, Trajectory};
use crate::Vec3;
use crate::contact::renderer::{Body, BodyState, Rendered, Renderer, RendererFault, RendererModel, Setup};
use crate::contact::rules::RIGID_BELOW;
use crate::contact::state::{Contact, ContactState};
use crate::dynamics::constraint::{Constraint, Steps, Threads, Unconstrained};
use crate::dynamics::integrators::{GlobalIntegrator, Stepper};
use crate::local::condensation::CondensationCounts;
use crate::local::error::ModelError;
use crate::local::model::LocalModelBuilder;
use crate::model::network::Network;
use crate::model::state::State;
use crate::model::work::WorkCounts;
use crate::surface::geometry::ContactPoint;
use crate::surface::support::{Metric, Support};
use crate::word::words;

/// How the network takes over the local model's motion in a cycle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SyncMode {
    /// The exterior is integrated with the patch prescribed along its recorded path.
    #[default]
    Replay,
    /// The whole network is integrated with the contact point of the cycle's start held fixed,
    /// then the patch is overwritten, as in the paper's text.
    Overwrite,
}

words!(SyncMode { Replay = "replay", Overwrite = "overwrite" });

/// The constant settings of the global side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleSettings {
    /// How the network takes over the local model's motion.
    pub sync: SyncMode,
    /// Integrator of the network.
    pub integrator: GlobalIntegrator,
    /// Number of equal steps per cycle.
    pub substeps: u32,
    /// Number of threads that share the steps.
    pub threads: Threads,
    /// Number of ticks per cycle.
    pub ticks_per_cycle: u32,
    /// Local tick h, s.
    pub tick_s: f64,
    /// Inner product of P under [`SyncMode::Overwrite`].
    pub metric: Metric,
}

/// Constraint that holds the contact point fixed, by P on accelerations and velocities.
struct Held<'a> {
    support: &'a Support,
    nodes: &'a [u32],
}

impl Constraint for Held<'_> {
    fn nodes(&self, _: f64) -> &[u32] {
        self.nodes
    }

    fn accelerations(&self, a: &mut [Vec3]) {
        self.support.project_sticking(a);
    }

    fn state(&self, _: f64, state: &mut State) {
        self.support.project_sticking(&mut state.v);
    }

    fn held(&self) -> Option<&Support> {
        Some(self.support)
    }
}

/// Takes the place of a custom renderer's first model that could not be built: its first tick is the fault.
#[derive(Debug, Clone, Copy)]
struct NoFirstModel(RendererFault);

impl RendererModel for NoFirstModel {
    fn tick(&mut self, _: Vec3, _: Vec3) -> Result<Rendered, RendererFault> {
        Err(self.0)
    }
}

/// A reason why there is no model for the next cycle.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The local model cannot be built, or the network could not be integrated over the cycle.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A custom renderer has no model.
    #[error(transparent)]
    Renderer(#[from] RendererFault),
}

/// The global side: the network, its state, and the builder of local models.
///
/// ```
/// use stickslip::{multirate::messages::{CycleMessage, ModelMessage}, multirate::trajectory::{PathRecording, Trajectory}};
/// use stickslip::{Rendered, Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let sides = Simulation::prepare(&scene)?.into_sides();
/// let (mut global, mut local) = (sides.global.into_simulation(), sides.servo.into_local());
/// // In one cycle the tip moves 1 mm into the block.
/// let mut tip = Vec3::new(-0.03, 0.0013, 0.0);
/// let mut trajectory = Trajectory::new(PathRecording::EveryTick);
/// trajectory.begin(local.model(), local.state(), 0, 100);
/// for _ in 0..100 {
///     let next = tip - Vec3::z() * 1e-5;
///     local.tick(tip, next);
///     trajectory.record(local.state());
///     tip = next;
/// }
/// global.catch_up(&CycleMessage { trajectory, contact: local.contact(), tip, rendered: Rendered::FREE })?;
/// // The network's patch is where the local side left it,
/// let patch = &local.model().patch;
/// assert!((0..patch.len()).all(|slot| global.state().x[patch.nodes[slot] as usize] == local.state().x[slot]));
/// // and the next model starts there.
/// let ModelMessage { model, state, .. } = global.build_model(tip)?;
/// local.hand_over(model, state, 0, tip);
/// assert_eq!(local.model_age(), 0);
/// assert_eq!(global.work().models_built, 2);
/// assert!(global.condensation().is_none(), "the paper's exterior is fixed");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct GlobalSimulation {
    settings: CycleSettings,
    network: Arc<Network>,
    builder: LocalModelBuilder,
    state: State,
    stepper: Stepper,
    /// Contact at the start of the current cycle.
    contact: Option<Contact>,
    models_built: u64,
    /// Number of the tick that follows `state`.
    tick: u64,
    renderer: Option<Box<dyn Renderer>>,
    /// Result of that renderer's last tick before `state`.
    rendered: Rendered,
}

impl GlobalSimulation {
    /// Creates the global side with the network in its initial state.
    pub fn new(settings: CycleSettings, network: Arc<Network>, builder: LocalModelBuilder, state: State) -> Self {
        let stepper = Stepper::new(&network);
        Self {
            settings,
            network,
            builder,
            state,
            stepper,
            contact: None,
            models_built: 0,
            tick: 0,
            renderer: None,
            rendered: Rendered::FREE,
        }
    }

    /// Uses a custom renderer in place of the local model.
    ///
    /// # Errors
    /// If the renderer does not take the body or the setup.
    pub fn with_renderer(self, mut renderer: Box<dyn Renderer>, setup: &Setup) -> Result<Self, RendererFault> {
        renderer.create(Body { network: &self.network, surface: self.builder.surface() }, setup)?;
        Ok(Self { builder: self.builder.without_patch(), renderer: Some(renderer), ..self })
    }

    /// Returns the network's state at the last boundary.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns the counts of computed operations so far.
    pub fn work(&self) -> WorkCounts {
        WorkCounts {
            cycle_springs: self.stepper.evaluations() * self.network.springs.len() as u64,
            models_built: self.models_built,
            ..WorkCounts::default()
        }
    }

    /// Returns counts of the condensations so far; `None` if the exterior is not condensed.
    pub fn condensation(&self) -> Option<CondensationCounts> {
        self.builder.condensation()
    }

    /// Integrates the network over the past cycle.
    ///
    /// # Errors
    /// If an implicit step has no solution.
    pub fn catch_up(&mut self, message: &CycleMessage) -> Result<(), BuildError> {
        if self.renderer.is_some() {
            message.trajectory.patches().try_for_each(|nodes| self.check_moved(nodes))?;
        }
        let completed = message.trajectory.with_starts(&self.state);
        let trajectory = completed.as_ref().unwrap_or(&message.trajectory);
        match self.settings.sync {
            SyncMode::Replay => self.replay(trajectory),
            SyncMode::Overwrite => self.overwrite(trajectory),
        }
        if let Some(error) = self.stepper.failure() {
            return Err(ModelError::NotSolved(error).into());
        }
        self.contact = message.contact;
        self.rendered = message.rendered;
        self.tick += u64::from(self.settings.ticks_per_cycle);
        Ok(())
    }

    /// Builds the model of the network in its present state, around the contact point, or around the tip without
    /// contact.
    ///
    /// # Errors
    /// If the model cannot be built.
    pub fn build_model(&mut self, tip: Vec3) -> Result<ModelMessage, BuildError> {
        let point = self.contact.map(|contact| contact.point);
        let around = point.map_or(tip, |point| self.position(&point));
        let touched = point.map(|point| point.triangle);
        self.models_built += 1;
        let (model, state) = self.builder.build(&self.network, &self.state, around, touched)?;
        Ok(ModelMessage { model, state, renderer: self.build_rendered(tip)? })
    }

    /// Builds the model of a custom renderer, if there is one.
    fn build_rendered(&mut self, tip: Vec3) -> Result<Option<Box<dyn RendererModel>>, BuildError> {
        let Some(renderer) = &mut self.renderer else { return Ok(None) };
        let body = Body { network: &self.network, surface: self.builder.surface() };
        let state = BodyState { tick: self.tick, x: &self.state.x, v: &self.state.v, tip, last: self.rendered };
        match renderer.build(body, state) {
            // The scene can start: the fault belongs to the run, as that of any later model does.
            Err(fault) if self.models_built == 1 => Ok(Some(Box::new(NoFirstModel(fault)))),
            model => Ok(Some(model?)),
        }
    }

    /// Refuses nodes of a custom renderer that do not exist or never move.
    fn check_moved(&self, nodes: &[u32]) -> Result<(), RendererFault> {
        if nodes.iter().all(|&node| self.network.fixed.get(node as usize) == Some(&false)) {
            Ok(())
        } else {
            Err(RendererFault("it moves nodes that are fixed or that the body does not have"))
        }
    }

    fn position(&self, point: &ContactPoint) -> Vec3 {
        self.builder.surface().node_weights(point).map(|(node, weight)| self.state.x[node] * weight).sum()
    }

    fn replay(&mut self, trajectory: &Trajectory) {
        let CycleSettings { ticks_per_cycle: ticks, substeps, .. } = self.settings;
        match trajectory.recording() {
            PathRecording::EveryTick => {
                self.integrate(|substep| PrescribedPatch { trajectory, substep, ticks, substeps })
            }
            PathRecording::Forces => {
                let (surface, network) = (self.builder.surface().clone(), self.network.clone());
                let pushed =
                    |substep| Pushed::new(trajectory, &surface, &network.inverse_mass, substep, ticks, substeps);
                self.integrate(pushed);
            }
            PathRecording::LastTick => {}
        }
        trajectory.finish(&mut self.state);
    }

    fn overwrite(&mut self, trajectory: &Trajectory) {
        // Under tension and on rigid ground the instrument exerts no force on the mesh.
        let held = self.contact.filter(|contact| contact.state != ContactState::Tension);
        let mut support = Support::with_capacity(self.builder.surface().geometry.largest_support());
        if let Some(Contact { point, .. }) = held {
            let inverse_mass = &self.network.inverse_mass;
            let free = self
                .builder
                .surface()
                .node_weights(&point)
                .map(|(node, weight)| (node, weight, inverse_mass[node]))
                .filter(|&(_, _, inverse_mass)| inverse_mass > 0.0);
            support.set(self.settings.metric, free);
        }
        if support.free_weight() >= RIGID_BELOW {
            support.project_sticking(&mut self.state.v);
            let nodes: Vec<u32> = support.nodes().iter().map(|node| node.slot as u32).collect();
            self.integrate(|_| Held { support: &support, nodes: &nodes });
        } else {
            self.integrate(|_| Unconstrained);
        }
        trajectory.finish(&mut self.state);
    }

    fn integrate<C: Constraint>(&mut self, constraint: impl Fn(u32) -> C + Sync) {
        let CycleSettings { integrator, substeps, ticks_per_cycle, tick_s, threads, .. } = self.settings;
        let steps =
            Steps { length: f64::from(ticks_per_cycle) * tick_s / f64::from(substeps), count: substeps, threads };
        self.stepper.steps(integrator, &self.network, &mut self.state, steps, constraint);
    }
}

/// Stages of the schedule, for time measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// The network is about to be integrated over the past cycle.
    CycleBegins,
    /// The network has been integrated; its next local model is about to be built.
    ModelBegins,
    /// The model is complete.
    ModelEnds,
    /// The local side is about to compute a tick.
    TickBegins,
    /// The tick is complete.
    TickEnds,
}

/// The global side with its fault check: the result of a cycle is a model or a fault's cause.
///
/// ```
/// use stickslip::{multirate::global::Moment, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let mut global = Simulation::prepare(&scene)?.into_sides().global;
/// // No cycle has passed: the next model, below a tip at the origin, is built from the initial state.
/// let mut moments = Vec::new();
/// let message = global.next_model([], &mut |moment| moments.push(moment))?;
/// assert_eq!(moments, [Moment::CycleBegins, Moment::ModelBegins, Moment::ModelEnds]);
/// let (start, patch) = (global.simulation().state(), &message.model.patch);
/// assert!(patch.nodes.iter().zip(&message.state.x).all(|(&node, x)| *x == start.x[node as usize]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct GlobalSide {
    simulation: GlobalSimulation,
    network: Arc<Network>,
    bounds: Bounds,
}

impl GlobalSide {
    /// Adds the fault check to a global simulation of this network.
    pub fn new(simulation: GlobalSimulation, network: Arc<Network>, bounds: Bounds) -> Self {
        Self { simulation, network, bounds }
    }

    /// Returns the global simulation.
    pub fn simulation(&self) -> &GlobalSimulation {
        &self.simulation
    }

    /// Returns the global simulation, without the fault check.
    pub fn into_simulation(self) -> GlobalSimulation {
        self.simulation
    }

    /// Integrates the network over the past cycles and builds the next local model. `mark` is called at the begin and
    /// end of each stage.
    ///
    /// # Errors
    /// If the network has diverged, or the integration or the model fails.
    pub fn next_model(
        &mut self,
        passed: impl IntoIterator<Item = CycleMessage>,
        mark: &mut impl FnMut(Moment),
    ) -> Result<ModelMessage, FaultCause> {
        let mut tip = Vec3::zeros();
        mark(Moment::CycleBegins);
        let caught_up = passed.into_iter().try_for_each(|message| {
            tip = message.tip;
            self.simulation.catch_up(&message)
        });
        mark(Moment::ModelBegins);
        let model = caught_up.and_then(|()| self.simulation.build_model(tip));
        mark(Moment::ModelEnds);
        // A diverged network has no model either: the divergence is the cause to report.
        match self.bounds.network_cause(&self.network.rest, self.simulation.state()) {
            Some(cause) => Err(cause),
            None => model.map_err(|error| match error {
                BuildError::Model(error) => FaultCause::NoModel(error),
                BuildError::Renderer(fault) => FaultCause::Renderer(fault),
            }),
        }
    }
}
