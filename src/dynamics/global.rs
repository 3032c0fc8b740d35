//! The global cycle: what comes up from the local side at a boundary, how the network catches up
//! with the cycle just past, and the model that goes down.

use std::sync::Arc;

use super::integrators::{Constraint, GlobalIntegrator, Stepper, Steps, Threads, Unconstrained};
use crate::Vec3;
use crate::contact::operators::{Metric, Support};
use crate::contact::subdivision::LARGEST_SUPPORT;
use crate::contact::surface::ContactPoint;
use crate::contact::tick::{Contact, Grip, RIGID_BELOW};
use crate::model::condensation::CondensationCounts;
use crate::model::local::{LocalModel, LocalModelBuilder, LocalState, ModelError};
use crate::model::network::{Network, State};
use crate::model::surface::Surface;
use crate::model::work::WorkCounts;
use crate::word::words;

/// How the network takes in what happened in the local model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SyncMode {
    /// The exterior is integrated with the patch prescribed along its recorded path.
    #[default]
    Replay,
    /// The whole network is integrated with the contact point of the cycle's start held still,
    /// then the patch is overwritten (the paper's words).
    Overwrite,
}

words!(SyncMode { Replay = "replay", Overwrite = "overwrite" });

/// The constant settings of the global side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleSettings {
    /// How it catches up.
    pub sync: SyncMode,
    /// How it integrates.
    pub integrator: GlobalIntegrator,
    /// Equal steps per cycle.
    pub substeps: u32,
    /// Threads that share them.
    pub threads: Threads,
    /// Ticks per cycle.
    pub ticks_per_cycle: u32,
    /// h, s.
    pub tick_s: f64,
    /// The inner product of P under [`SyncMode::Overwrite`].
    pub metric: Metric,
}

/// Goes up at a boundary.
#[derive(Debug, Clone)]
pub struct CycleMessage {
    /// Where the patch went.
    pub trajectory: Trajectory,
    /// The contact at the boundary.
    pub contact: Option<Contact>,
    /// The tip at the boundary, m.
    pub tip: Vec3,
}

/// Goes down at a boundary, or some ticks later.
#[derive(Debug, Clone)]
pub struct ModelMessage {
    /// The model of the next cycle.
    pub model: LocalModel,
    /// Its state, to be merged with that of the local side.
    pub state: LocalState,
}

/// The path of the patch through one cycle: a segment for each model that was in use.
///
/// ```
/// use stickslip::dynamics::global::{CycleMessage, Keep, Trajectory};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let (mut global, _) = Simulation::prepare(&scene)?.into_sides();
/// // A node of the block's top goes down by 1 mm in the cycle's 100 ticks.
/// let (node, speed) = (300, -Vec3::z() * 0.01);
/// let start = global.state().x[node as usize];
/// let mut trajectory = Trajectory::new(Keep::Path);
/// trajectory.begin_at(&[node], &[start], &[speed], 0, 100);
/// for tick in 1..=100 {
///     trajectory.record_at(&[start + speed * (f64::from(tick) * scene.tick_s())], &[speed]);
/// }
/// global.catch_up(&CycleMessage { trajectory, contact: None, tip: start })?;
/// let x = &global.state().x;
/// assert!((x[node as usize].z - (start.z - 0.001)).abs() < 1e-15);
/// assert!(x[node as usize + 1].z < start.z); // its neighbours were pulled along
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Trajectory {
    keep: Keep,
    segments: Vec<Segment>,
}

/// How much of the path the global side needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// Every tick.
    Path,
    /// The last tick: with nothing to replay, the path is not recorded.
    End,
}

#[derive(Debug, Clone)]
struct Segment {
    nodes: Vec<u32>,
    first_tick: usize,
    /// The state at the start of the first tick, then at the end of each: m values a time.
    x: Vec<Vec3>,
    v: Vec<Vec3>,
}

impl Trajectory {
    /// An empty path.
    pub fn new(keep: Keep) -> Self {
        Self { keep, segments: Vec::new() }
    }

    /// A model comes into use at the start of tick `tick` of the cycle, for at most `ticks` ticks.
    pub fn begin(&mut self, model: &LocalModel, state: &LocalState, tick: usize, ticks: usize) {
        let m = model.patch.len();
        self.begin_at(&model.patch.nodes, &state.x[..m], &state.v[..m], tick, ticks);
    }

    /// The same for patch nodes whose positions and velocities are given.
    pub fn begin_at(&mut self, nodes: &[u32], x: &[Vec3], v: &[Vec3], tick: usize, ticks: usize) {
        let samples = match self.keep {
            Keep::Path => ticks + 1,
            Keep::End => 1,
        };
        let start = |values: &[Vec3]| {
            let mut all = Vec::with_capacity(samples * nodes.len());
            all.extend_from_slice(values);
            all
        };
        self.segments.push(Segment { nodes: nodes.to_vec(), first_tick: tick, x: start(x), v: start(v) });
    }

    /// The state at the end of a tick. Allocates nothing.
    pub fn record(&mut self, state: &LocalState) {
        let m = self.segments.last().map_or(0, |segment| segment.nodes.len());
        self.record_at(&state.x[..m], &state.v[..m]);
    }

    /// The same where positions and velocities of the patch nodes are given; those of other nodes than the segment began
    /// with are not taken. Allocates nothing within the ticks that were announced.
    pub fn record_at(&mut self, x: &[Vec3], v: &[Vec3]) {
        if let Some(segment) = self.segments.last_mut().filter(|segment| segment.nodes.len() == x.len()) {
            if self.keep == Keep::End {
                segment.x.clear();
                segment.v.clear();
            }
            segment.x.extend_from_slice(x);
            segment.v.extend_from_slice(v);
        }
    }

    /// The patch in use in a tick.
    fn segment(&self, tick: usize) -> Option<&Segment> {
        self.segments.iter().rev().find(|segment| segment.first_tick <= tick)
    }

    /// Sets the nodes of the patch in use to where they were in a tick, at `time`, in ticks from the
    /// start of the cycle: linear between the tick's start and end. A tick that was not recorded (in real time, notes of it
    /// can be lost) leaves them where they were last.
    fn prescribe(&self, tick: usize, time: f64, state: &mut State) {
        let Some(segment) = self.segment(tick) else { return };
        let m = segment.nodes.len();
        let fraction = time - tick as f64;
        let at = (tick - segment.first_tick) * m;
        let between = |values: &[Vec3], i: usize| {
            let last = values.len() - m;
            let (start, end) = (values[at.min(last) + i], values[(at + m).min(last) + i]);
            if fraction == 1.0 { end } else { start + (end - start) * fraction }
        };
        for (i, &node) in segment.nodes.iter().enumerate() {
            state.x[node as usize] = between(&segment.x, i);
            state.v[node as usize] = between(&segment.v, i);
        }
    }

    /// Sets the nodes of the patch last in use to where they ended.
    fn finish(&self, state: &mut State) {
        let Some(segment) = self.segments.last() else { return };
        let last = segment.x.len() - segment.nodes.len();
        for (i, &node) in segment.nodes.iter().enumerate() {
            state.x[node as usize] = segment.x[last + i];
            state.v[node as usize] = segment.v[last + i];
        }
    }
}

/// The patch follows its recorded path.
struct Replayed<'a> {
    trajectory: &'a Trajectory,
    substep: u32,
    ticks: u32,
    substeps: u32,
}

impl Replayed<'_> {
    /// A time of the step, in ticks from the start of the cycle, and the tick it belongs to.
    fn time(&self, ahead: f64) -> (f64, usize) {
        // Product first: a substep that ends with a tick must come out as a whole number.
        let time = (f64::from(self.substep) + ahead) * f64::from(self.ticks) / f64::from(self.substeps);
        // A hand-over may come at a whole tick: the start of a step belongs to the tick it begins,
        // all later times to the tick they end.
        let tick = if ahead > 0.0 { time.ceil() - 1.0 } else { time.floor() };
        (time, tick as usize)
    }
}

impl Constraint for Replayed<'_> {
    fn nodes(&self, ahead: f64) -> &[u32] {
        self.trajectory.segment(self.time(ahead).1).map_or(&[], |segment| &segment.nodes)
    }

    fn acts_node_by_node(&self) -> bool {
        true
    }

    // What accelerations do to patch nodes is overwritten.
    fn accelerations(&self, _: &mut [Vec3]) {}

    fn state(&self, ahead: f64, state: &mut State) {
        let (time, tick) = self.time(ahead);
        self.trajectory.prescribe(tick, time, state);
    }
}

/// The contact point stands still: P on accelerations and velocities.
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

/// The global side: the network, its state, and the builder of local models.
///
/// ```
/// use stickslip::dynamics::global::{CycleMessage, Keep, ModelMessage, Trajectory};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let (mut global, mut local) = Simulation::prepare(&scene)?.into_sides();
/// // One cycle: the tip goes 1 mm into the block.
/// let mut tip = Vec3::new(-0.03, 0.0013, 0.0);
/// let mut trajectory = Trajectory::new(Keep::Path);
/// trajectory.begin(local.model(), local.state(), 0, 100);
/// for _ in 0..100 {
///     let next = tip - Vec3::z() * 1e-5;
///     local.tick(tip, next);
///     trajectory.record(local.state());
///     tip = next;
/// }
/// global.catch_up(&CycleMessage { trajectory, contact: local.contact(), tip })?;
/// // The network's patch is where the local side left it,
/// let patch = &local.model().patch;
/// assert!((0..patch.len()).all(|slot| global.state().x[patch.nodes[slot] as usize] == local.state().x[slot]));
/// // and the next model starts there.
/// let ModelMessage { model, state } = global.build_model(tip)?;
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
    surface: Arc<Surface>,
    builder: LocalModelBuilder,
    state: State,
    stepper: Stepper,
    /// At the start of the cycle that runs now.
    contact: Option<Contact>,
    models_built: u64,
}

impl GlobalSimulation {
    /// The network in the state in which it starts.
    pub fn new(
        settings: CycleSettings,
        network: Arc<Network>,
        surface: Arc<Surface>,
        builder: LocalModelBuilder,
        state: State,
    ) -> Self {
        let stepper = Stepper::new(&network);
        Self { settings, network, surface, builder, state, stepper, contact: None, models_built: 0 }
    }

    /// The network's state at the last boundary.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// What it has computed so far.
    pub fn work(&self) -> WorkCounts {
        WorkCounts {
            cycle_springs: self.stepper.evaluations() * self.network.springs.len() as u64,
            models_built: self.models_built,
            ..WorkCounts::default()
        }
    }

    /// What became of the models so far, if their exterior is condensed.
    pub fn condensation(&self) -> Option<CondensationCounts> {
        self.builder.condensation()
    }

    /// Brings the network over the cycle just past.
    ///
    /// # Errors
    /// If an implicit step has no solution.
    pub fn catch_up(&mut self, message: &CycleMessage) -> Result<(), ModelError> {
        match self.settings.sync {
            SyncMode::Replay => self.replay(&message.trajectory),
            SyncMode::Overwrite => self.overwrite(&message.trajectory),
        }
        if let Some(error) = self.stepper.failure() {
            return Err(ModelError::NotSolved(error));
        }
        self.contact = message.contact;
        Ok(())
    }

    /// The model of the network as it is, around the contact point, or around the tip where there is none.
    ///
    /// # Errors
    /// If it cannot be built.
    pub fn build_model(&mut self, tip: Vec3) -> Result<ModelMessage, ModelError> {
        let point = self.contact.map(|contact| contact.point);
        let around = point.map_or(tip, |point| self.position(&point));
        let touched = point.map(|point| point.triangle);
        self.models_built += 1;
        let (model, state) = self.builder.build(&self.network, &self.state, around, touched)?;
        Ok(ModelMessage { model, state })
    }

    /// The nodes that a contact point rests on, with their weights.
    fn support(&self, point: &ContactPoint) -> impl Iterator<Item = (usize, f64)> {
        let vertices = self.builder.geometry().weights(&self.surface, point);
        vertices.map(|(vertex, weight)| (self.surface.vertex_node[vertex as usize] as usize, weight))
    }

    fn position(&self, point: &ContactPoint) -> Vec3 {
        self.support(point).map(|(node, weight)| self.state.x[node] * weight).sum()
    }

    fn replay(&mut self, trajectory: &Trajectory) {
        if trajectory.keep == Keep::Path {
            let CycleSettings { ticks_per_cycle: ticks, substeps, .. } = self.settings;
            self.integrate(|substep| Replayed { trajectory, substep, ticks, substeps });
        }
        trajectory.finish(&mut self.state);
    }

    fn overwrite(&mut self, trajectory: &Trajectory) {
        // Under tension and on rigid ground the instrument exerts no force on the mesh.
        let held = self.contact.filter(|contact| contact.grip != Grip::Tension);
        let mut support = Support::with_capacity(LARGEST_SUPPORT);
        if let Some(Contact { point, .. }) = held {
            let inverse_mass = &self.network.inverse_mass;
            let free = self
                .support(&point)
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
