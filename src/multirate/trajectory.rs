//! The path of the patch through one cycle, recorded by the local side and replayed by the global side.

use crate::Vec3;
use crate::dynamics::constraint::Constraint;
use crate::local::model::{LocalModel, LocalState};
use crate::model::state::State;
use crate::surface::geometry::{ContactPoint, SurfaceModel};

/// The path of the patch through one cycle, with a segment for each model that was in use.
///
/// ```
/// use stickslip::{multirate::messages::CycleMessage, multirate::trajectory::{PathRecording, Trajectory}};
/// use stickslip::{Rendered, Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let mut global = Simulation::prepare(&scene)?.into_sides().global.into_simulation();
/// // A node of the block's top moves down by 1 mm in the cycle's 100 ticks.
/// let (node, speed) = (300, -Vec3::z() * 0.01);
/// let start = global.state().x[node as usize];
/// let mut trajectory = Trajectory::new(PathRecording::EveryTick);
/// trajectory.begin_at(&[node], &[start], &[speed], 0, 100);
/// for tick in 1..=100 {
///     trajectory.record_at(&[start + speed * (f64::from(tick) * scene.tick_s())], &[speed]);
/// }
/// global.catch_up(&CycleMessage { trajectory, contact: None, tip: start, rendered: Rendered::FREE })?;
/// let x = &global.state().x;
/// assert!((x[node as usize].z - (start.z - 0.001)).abs() < 1e-15);
/// assert!(x[node as usize + 1].z < start.z); // its neighbours were pulled along
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Trajectory {
    recording: PathRecording,
    segments: Vec<Segment>,
    /// Force of a custom renderer on the network in each tick.
    pushes: Vec<Option<Push>>,
}

/// Force on the network at a contact point over one tick.
#[derive(Debug, Clone, Copy)]
struct Push {
    point: ContactPoint,
    /// Force on the network, N.
    force: Vec3,
}

/// The part of the path that the global side needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathRecording {
    /// The path in every tick.
    EveryTick,
    /// The force on the network in every tick, at its contact point: a custom renderer moves no nodes.
    Forces,
    /// The last tick only: there is nothing to replay.
    LastTick,
}

#[derive(Debug, Clone)]
struct Segment {
    nodes: Vec<u32>,
    first_tick: usize,
    /// State at the start of the first tick, then at the end of each tick: m values each.
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    /// Whether the state at the start of the first tick is the network's, which was not at hand.
    starts_from_network: bool,
}

impl Segment {
    /// Sets the nodes to their final state.
    fn finish(&self, state: &mut State) {
        let last = self.x.len() - self.nodes.len();
        for (i, &node) in self.nodes.iter().enumerate() {
            state.x[node as usize] = self.x[last + i];
            state.v[node as usize] = self.v[last + i];
        }
    }
}

impl Trajectory {
    /// Creates an empty path.
    pub fn new(recording: PathRecording) -> Self {
        Self { recording, segments: Vec::new(), pushes: Vec::new() }
    }

    /// Returns which part of the path is recorded.
    pub fn recording(&self) -> PathRecording {
        self.recording
    }

    /// Begins a segment with a model that comes into use at the start of tick `tick` of the cycle, for at most `ticks`
    /// ticks.
    pub fn begin(&mut self, model: &LocalModel, state: &LocalState, tick: usize, ticks: usize) {
        let m = model.patch.len();
        self.begin_at(&model.patch.nodes, &state.x[..m], &state.v[..m], tick, ticks);
    }

    /// Begins a segment with the nodes of a custom renderer, as [`begin`](Self::begin) does. Where they start is known to
    /// the global side alone: [`with_starts`](Self::with_starts) adds it.
    pub fn begin_nodes(&mut self, nodes: &[u32], tick: usize, ticks: usize) {
        let unknown = vec![Vec3::zeros(); nodes.len()];
        self.begin_at(nodes, &unknown, &unknown, tick, ticks);
        self.segments.iter_mut().rev().take(1).for_each(|segment| segment.starts_from_network = true);
    }

    /// Returns the path with all starts: a node goes on from where the segment before has left it, or from the network's
    /// state at the start of the cycle if it enters. `None` if all starts were recorded.
    pub fn with_starts(&self, state: &State) -> Option<Self> {
        if !self.segments.iter().any(|segment| segment.starts_from_network) {
            return None;
        }
        let mut path = self.clone();
        let mut now = state.clone();
        for segment in &mut path.segments {
            if segment.starts_from_network {
                for (i, &node) in segment.nodes.iter().enumerate() {
                    (segment.x[i], segment.v[i]) = (now.x[node as usize], now.v[node as usize]);
                }
            }
            segment.finish(&mut now);
        }
        Some(path)
    }

    /// Begins a segment with given positions and velocities of the patch nodes, as [`begin`](Self::begin) does.
    pub fn begin_at(&mut self, nodes: &[u32], x: &[Vec3], v: &[Vec3], tick: usize, ticks: usize) {
        let samples = match self.recording {
            PathRecording::EveryTick => ticks + 1,
            PathRecording::LastTick | PathRecording::Forces => 1,
        };
        if self.recording == PathRecording::Forces {
            self.pushes.reserve(ticks);
        }
        let start = |values: &[Vec3]| {
            let mut all = Vec::with_capacity(samples * nodes.len());
            all.extend_from_slice(values);
            all
        };
        self.segments.push(Segment {
            nodes: nodes.to_vec(),
            first_tick: tick,
            x: start(x),
            v: start(v),
            starts_from_network: false,
        });
    }

    /// Records the state at the end of a tick. Allocates nothing.
    pub fn record(&mut self, state: &LocalState) {
        let m = self.segments.last().map_or(0, |segment| segment.nodes.len());
        self.record_at(&state.x[..m], &state.v[..m]);
    }

    /// Records given positions and velocities of the patch nodes; ignores them if their number differs from the
    /// segment's. Allocates nothing within the ticks that were announced.
    pub fn record_at(&mut self, x: &[Vec3], v: &[Vec3]) {
        if let Some(segment) =
            self.segments.last_mut().filter(|segment| segment.nodes.len() == x.len() && x.len() == v.len())
        {
            if self.recording == PathRecording::LastTick {
                segment.x.clear();
                segment.v.clear();
            }
            segment.x.extend_from_slice(x);
            segment.v.extend_from_slice(v);
        }
    }

    /// Records a tick's force on the network, minus the contact force, N, at its contact point. Allocates nothing
    /// within the ticks that were announced.
    pub fn record_push(&mut self, force: Vec3, point: Option<ContactPoint>) {
        self.pushes.push(point.map(|point| Push { point, force: -force }));
    }

    /// Returns the nodes of each patch that was in use.
    pub fn patches(&self) -> impl Iterator<Item = &[u32]> {
        self.segments.iter().map(|segment| segment.nodes.as_slice())
    }

    /// Returns the segment of the patch in use in a tick.
    fn segment(&self, tick: usize) -> Option<&Segment> {
        self.segments.iter().rev().find(|segment| segment.first_tick <= tick)
    }

    /// Sets the nodes of the patch in use to their recorded positions at `time`, in ticks from the start of the cycle:
    /// linear between the tick's start and end. In a tick that was not recorded (in real time, notes of it can be lost)
    /// they keep their last recorded position.
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

    /// Sets the nodes of the patch last in use to their final state.
    pub(super) fn finish(&self, state: &mut State) {
        self.segments.iter().rev().take(1).for_each(|segment| segment.finish(state));
    }
}

/// Constraint that moves the patch along its recorded path.
pub(super) struct PrescribedPatch<'a> {
    pub trajectory: &'a Trajectory,
    /// Number of the substep in the cycle, from 0.
    pub substep: u32,
    /// Number of ticks per cycle.
    pub ticks: u32,
    /// Number of substeps per cycle.
    pub substeps: u32,
}

impl PrescribedPatch<'_> {
    /// Returns a time of the step, in ticks from the start of the cycle, and the tick it belongs to.
    fn time(&self, ahead: f64) -> (f64, usize) {
        // Product first: a substep that ends with a tick must come out as a whole number.
        let time = (f64::from(self.substep) + ahead) * f64::from(self.ticks) / f64::from(self.substeps);
        // A hand-over may come at a whole tick: the start of a step belongs to the tick it begins,
        // all later times to the tick they end.
        let tick = if ahead > 0.0 { time.ceil() - 1.0 } else { time.floor() };
        (time, tick as usize)
    }
}

impl Constraint for PrescribedPatch<'_> {
    fn nodes(&self, ahead: f64) -> &[u32] {
        self.trajectory.segment(self.time(ahead).1).map_or(&[], |segment| &segment.nodes)
    }

    fn acts_node_by_node(&self) -> bool {
        true
    }

    // The accelerations of patch nodes have no effect: their states are overwritten.
    fn accelerations(&self, _: &mut [Vec3]) {}

    fn state(&self, ahead: f64, state: &mut State) {
        let (time, tick) = self.time(ahead);
        self.trajectory.prescribe(tick, time, state);
    }
}

/// Forces of a custom renderer on the network, each over the part of its tick that lies within the substep: no momentum
/// is lost, however ticks and substeps lie.
pub(super) struct Pushed {
    nodes: Vec<u32>,
    /// Acceleration added to each of these nodes, m/s².
    accelerations: Vec<Vec3>,
}

impl Pushed {
    /// Collects the forces in one substep of a cycle.
    pub fn new(
        trajectory: &Trajectory,
        surface: &SurfaceModel,
        inverse_mass: &[f64],
        substep: u32,
        ticks: u32,
        substeps: u32,
    ) -> Self {
        let time = |substep: u32| f64::from(substep) * f64::from(ticks) / f64::from(substeps);
        let (begin, end) = (time(substep), time(substep + 1));
        let mut pushed = Self { nodes: Vec::new(), accelerations: Vec::new() };
        for tick in begin.floor() as usize..(end.ceil() as usize).min(trajectory.pushes.len()) {
            let Some(Push { point, force }) = trajectory.pushes[tick] else { continue };
            let share = (end.min(tick as f64 + 1.0) - begin.max(tick as f64)) / (end - begin);
            for (node, weight) in surface.node_weights(&point) {
                pushed.nodes.push(node as u32);
                pushed.accelerations.push(force * (share * weight * inverse_mass[node]));
            }
        }
        pushed
    }
}

impl Constraint for Pushed {
    fn nodes(&self, _: f64) -> &[u32] {
        &self.nodes
    }

    fn accelerations(&self, a: &mut [Vec3]) {
        for (&node, acceleration) in self.nodes.iter().zip(&self.accelerations) {
            a[node as usize] += acceleration;
        }
    }

    fn state(&self, _: f64, _: &mut State) {}
}
