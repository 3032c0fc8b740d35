//! The local model that the global side hands over once a cycle, and the state that the haptic loop carries from tick
//! to tick.

use std::sync::Arc;

use super::condensation::{Condensation, CondensationCounts, CondensationOutcome, Condensed, CondensedSize, Condenser};
use super::error::ModelError;
use super::linearization::LinearForces;
use super::patch::{Extent, OUTSIDE, Patch, PatchSelector};
use super::step::{ContactResponse, LinearStep, LocalIntegrator};
use crate::Vec3;
use crate::model::network::Network;
use crate::model::springs::TangentKind;
use crate::model::state::{ExternalForce, State};
use crate::model::work::WorkCounts;
use crate::surface::geometry::{ContactGeometry, SurfaceModel};
use crate::surface::tree::{Boxes, TriangleTree};

/// Settings of the local model that the haptic loop runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LocalSettings {
    /// Extent of the patch.
    pub extent: Extent,
    /// Linear or nonlinear forces.
    pub linearization: Linearization,
    /// Model of the exterior between hand-overs.
    pub exterior: ExteriorKind,
}

impl LocalSettings {
    /// The reference `model = "full"`: the whole nonlinear network at the local rate.
    pub const FULL: Self =
        Self { extent: Extent::All, linearization: Linearization::None, exterior: ExteriorKind::Fixed };
}

impl Default for LocalSettings {
    /// Returns the paper's model: one ring with its exact tangent, in a fixed exterior.
    fn default() -> Self {
        Self {
            extent: Extent::Rings(1),
            linearization: Linearization::Tangent(TangentKind::default()),
            exterior: ExteriorKind::Fixed,
        }
    }
}

/// Computation of the forces on the patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Linearization {
    /// Tangent forces f₀ + K(x − x₀) + D(v − v₀), (3)–(4).
    Tangent(TangentKind),
    /// Nonlinear springs, without linearisation.
    None,
}

/// Model of the nodes outside the patch until the next hand-over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExteriorKind {
    /// Fixed at x₀ with velocity zero (the paper).
    Fixed,
    /// Drifting from x₀ at the velocity v_E₀.
    Drifting,
    /// Statically condensed: the exterior follows the patch quasi-statically.
    Condensed(Condensation),
}

/// The exterior as stored in a local model.
#[derive(Debug, Clone)]
pub struct Exterior {
    /// Position of each boundary node of the patch when the model was built, m.
    boundary: Vec<Vec3>,
    /// Position of every surface vertex when the model was built, m.
    vertices: Vec<Vec3>,
    motion: Motion,
}

#[derive(Debug, Clone)]
enum Motion {
    Still,
    /// Velocities of the boundary nodes and of the vertices, m/s, and the largest speed among the vertices.
    Drifting {
        boundary: Vec<Vec3>,
        vertices: Vec<Vec3>,
        fastest: f64,
    },
}

/// The constant model of one cycle. Times count from the state it was built from, in s.
///
/// ```
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let (model, mut state) = (local.model(), local.state().clone());
/// model.evaluate_forces(0.0, &mut state);
/// assert!(state.f[..model.patch.len()].iter().all(|f| f.norm() < 1e-12)); // at rest
///
/// // If a node moves by 1 µm, the forces change by a column of K, and ½δᵀKδ is stored.
/// let moved = Vec3::z() * 1e-6;
/// state.x[0] += moved;
/// model.update_forces(0.0, &mut state, [(0, moved)].into_iter());
/// let updated = state.f[0];
/// model.evaluate_forces(0.0, &mut state);
/// assert!((updated - state.f[0]).norm() < 1e-15);
/// let k = model.linear_forces().expect("the scene says tangent").entry(2, 2);
/// assert!((state.f[0].z / (k * 1e-6) - 1.0).abs() < 1e-9 && k < 0.0);
/// assert!((model.elastic_energy(&state.x) / (-0.5 * k * 1e-12) - 1.0).abs() < 1e-3);
/// assert_eq!(model.reach(&state.x, 0.0), (state.x[0] - model.patch.rest[0]).norm());
/// assert_eq!((model.drift(1.0), model.gravitational_energy(&state.x)), (0.0, 0.0)); // fixed exterior, no gravity
///
/// // The dampers take up its kinetic energy.
/// state.v[0] = Vec3::z();
/// assert_eq!(model.kinetic_energy(&state.v), 0.5 * model.patch.mass[0]);
/// assert!(model.dissipated_power(&state.x, &state.v) > 0.0);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LocalModel {
    /// Nodes and springs of the patch.
    pub patch: Patch,
    /// Boxes around the surface's triangles when the model was built, narrower than boxes for a whole run would be.
    pub boxes: Boxes,
    /// Positions of the patch's nodes at time zero, m.
    start: Vec<Vec3>,
    exterior: Exterior,
    forces: LocalForces,
    /// One tick of an integrator that solves the linear model as a whole.
    pub step: Option<LinearStep>,
    external: Vec<ExternalForce>,
    /// Outcome of the static condensation, and size of its system.
    pub condensation: Option<(CondensationOutcome, CondensedSize)>,
}

#[derive(Debug, Clone)]
enum LocalForces {
    Tangent(LinearForces),
    Springs,
    /// Nonlinear springs, and C(x − x₀) of a condensed exterior.
    SpringsAnd(LinearForces),
}

/// State of a local model: one entry per patch slot, then one per boundary slot.
///
/// ```
/// use stickslip::local::{model::LocalSettings, patch::Extent};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// // A larger patch takes over from a smaller one; nodes of both go on from their positions.
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let before = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let two_rings = LocalSettings { extent: Extent::Rings(2), ..scene.local() };
/// let after = Simulation::prepare(&scene.with_local_model(two_rings))?.into_sides().servo.into_local();
/// let (small, large) = (&before.model().patch, &after.model().patch);
/// let (mut left, mut taken) = (before.state().clone(), after.state().clone());
/// left.x[5] += Vec3::z() * 1e-3;
/// taken.carry_over(large, &left, small);
/// let slot = large.nodes.iter().position(|&node| node == small.nodes[5]).expect("it is in both");
/// assert_eq!(taken.x[slot], left.x[5]);
/// assert!(large.nodes.iter().zip(&taken.x).filter(|(_, x)| **x == left.x[5]).count() == 1);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LocalState {
    /// Positions, m.
    pub x: Vec<Vec3>,
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Forces at the last evaluation, N.
    pub f: Vec<Vec3>,
    /// Predicted positions (11), m.
    pub x_predicted: Vec<Vec3>,
    /// Predicted velocities (11), m/s.
    pub v_predicted: Vec<Vec3>,
    /// Workspace of collision detection: positions within a tick, m. Empty if none is needed.
    pub x_between: Vec<Vec3>,
    /// Response of the patch to the contact, if the model has a [`LinearStep`].
    pub response: ContactResponse,
    /// Workspace of the linear forces.
    offset: Vec<f64>,
    /// Counts of the work done so far.
    pub work: WorkCounts,
}

/// Builds local models of one network.
///
/// ```
/// use std::sync::Arc;
/// use stickslip::surface::geometry::{ContactGeometry, SurfaceModel};
/// use stickslip::local::model::{ExteriorKind, Linearization, LocalModelBuilder, LocalSettings};
/// use stickslip::{local::patch::Extent, local::step::LocalIntegrator, model::springs::TangentKind};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let (network, surface) = (simulation.network(), Arc::new(simulation.surface().clone()));
/// let settings = LocalSettings {
///     extent: Extent::Rings(2),
///     linearization: Linearization::Tangent(TangentKind::Exact),
///     exterior: ExteriorKind::Drifting,
/// };
/// let surface = SurfaceModel::faceted(surface);
/// let mut builder = LocalModelBuilder::new(network, surface, settings)
///     .with_integrator(LocalIntegrator::ImplicitEuler, scene.tick_s());
///
/// // The whole network sinks at 10 mm/s, and with it the exterior of its model.
/// let mut sinking = network.rest_state();
/// sinking.v.fill(Vec3::new(0.0, 0.0, -0.01));
/// let (model, mut state) = builder.build(network, &sinking, Vec3::zeros(), None)?;
/// assert!((model.drift(0.1) - 0.001).abs() < 1e-15);
/// let boundary = model.patch.len();
/// model.place_boundary(0.1, &mut state.x);
/// assert!((state.x[boundary].z - (network.rest[model.patch.node(boundary) as usize].z - 0.001)).abs() < 1e-15);
/// let step = model.step.as_ref().expect("an implicit step is prepared with the model");
/// model.predict(step, 0.0, &mut state);
/// assert!(state.v_predicted[..boundary].iter().all(|v| (v.z + 0.01).abs() < 1e-9)); // and nothing is stretched
/// assert!(builder.condensation().is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct LocalModelBuilder {
    settings: LocalSettings,
    surface: SurfaceModel,
    tree: Arc<TriangleTree>,
    selector: PatchSelector,
    condenser: Option<Condenser>,
    integrator: LocalIntegrator,
    /// Tick length h, s.
    tick_s: f64,
    /// Whether models have no patch.
    is_without_patch: bool,
}

impl LocalModelBuilder {
    /// Prepares the parts that every cycle shares.
    pub fn new(network: &Network, surface: SurfaceModel, settings: LocalSettings) -> Self {
        let tree = Arc::new(TriangleTree::new(&surface.topology, &network.rest));
        let selector = PatchSelector::new(network, &surface.topology);
        let condenser = match settings.exterior {
            ExteriorKind::Condensed(condensation) => Some(Condenser::new(network, condensation)),
            ExteriorKind::Fixed | ExteriorKind::Drifting => None,
        };
        let integrator = LocalIntegrator::SemiImplicitEuler;
        Self { settings, surface, tree, selector, condenser, integrator, tick_s: 0.0, is_without_patch: false }
    }

    /// Sets the integrator and its tick length, s. By default models are built for the explicit integrator.
    pub fn with_integrator(self, integrator: LocalIntegrator, tick_s: f64) -> Self {
        Self { integrator, tick_s, ..self }
    }

    /// Builds models without a patch: they locate the surface, and nothing moves. A custom renderer does the rest.
    pub fn without_patch(self) -> Self {
        let settings = LocalSettings::FULL;
        let integrator = LocalIntegrator::SemiImplicitEuler;
        Self { settings, condenser: None, integrator, is_without_patch: true, ..self }
    }

    /// Returns the contact surface.
    pub fn surface(&self) -> &SurfaceModel {
        &self.surface
    }

    /// Returns the condensation outcomes so far, if the exterior is condensed.
    pub fn condensation(&self) -> Option<CondensationCounts> {
        self.condenser.as_ref().map(Condenser::counts)
    }

    /// Builds the model of the network at `state` around `point` (the contact point, or the tip if there is no
    /// contact), and that model's own state.
    ///
    /// # Errors
    /// If the integrator's equations have no solution.
    pub fn build(
        &mut self,
        network: &Network,
        state: &State,
        point: Vec3,
        touched: Option<u32>,
    ) -> Result<(LocalModel, LocalState), ModelError> {
        let surface = &*self.surface.topology;
        let support = touched.map_or_else(|| self.support_below(state, point), |t| self.surface.support(t).to_vec());
        let patch = if self.is_without_patch {
            self.selector.none(network, surface)
        } else {
            self.selector.select(network, surface, &state.x, point, &support, self.settings.extent)
        };
        let of = |values: &[Vec3], nodes: &[u32]| nodes.iter().map(|&node| values[node as usize]).collect::<Vec<_>>();
        let motion = match self.settings.exterior {
            // For collision and normals a condensed exterior stays at its initial position.
            ExteriorKind::Fixed | ExteriorKind::Condensed(_) => Motion::Still,
            ExteriorKind::Drifting => {
                let vertices = of(&state.v, &surface.vertex_node);
                let fastest = vertices.iter().map(Vec3::norm).fold(0.0, f64::max);
                Motion::Drifting { boundary: of(&state.v, &patch.boundary), vertices, fastest }
            }
        };
        let exterior =
            Exterior { boundary: of(&state.x, &patch.boundary), vertices: of(&state.x, &surface.vertex_node), motion };

        let mut x = of(&state.x, &patch.nodes);
        x.extend_from_slice(&exterior.boundary);
        let mut v = of(&state.v, &patch.nodes);
        match &exterior.motion {
            Motion::Still => v.resize(x.len(), Vec3::zeros()),
            Motion::Drifting { boundary, .. } => v.extend_from_slice(boundary),
        }
        let condensed = self.condenser.as_mut().map(|condenser| condenser.condense(network, &patch, &state.x));
        let stiffness = condensed.as_ref().and_then(|condensed| condensed.stiffness.as_ref());
        let forces = match (self.settings.linearization, stiffness) {
            (Linearization::None, None) => LocalForces::Springs,
            (Linearization::None, Some(c)) => LocalForces::SpringsAnd(LinearForces::following(&x[..patch.len()], c)),
            (Linearization::Tangent(kind), _) => {
                let drift = match &exterior.motion {
                    Motion::Still => None,
                    Motion::Drifting { boundary, .. } => Some(boundary.as_slice()),
                };
                // K uses the same kind of tangent as C.
                let kind = condensed.as_ref().map_or(kind, |condensed| condensed.tangent);
                let mut linear = LinearForces::new(&patch, &network.external, &x, &v, drift, kind);
                stiffness.into_iter().for_each(|c| linear.add_stiffness(c));
                LocalForces::Tangent(linear)
            }
        };
        let boxes = Boxes::new(self.tree.clone(), surface, &self.surface.geometry, &exterior.vertices);
        let state = LocalState {
            f: vec![Vec3::zeros(); x.len()],
            x_predicted: x.clone(),
            v_predicted: v.clone(),
            x_between: match self.surface.geometry {
                ContactGeometry::Faceted | ContactGeometry::Shaded => Vec::new(),
                ContactGeometry::Smooth(_) => x.clone(),
            },
            x,
            v,
            response: ContactResponse::default(),
            offset: Vec::new(),
            work: WorkCounts::default(),
        };
        let model = LocalModel {
            start: state.x[..patch.len()].to_vec(),
            patch,
            boxes,
            exterior,
            forces,
            step: None,
            external: network.external.clone(),
            condensation: condensed.map(|Condensed { outcome, size, .. }| (outcome, size)),
        };
        model.integrated(state, self.integrator, self.tick_s)
    }

    /// Returns the vertices that a contact which begins below a free tip spreads over. A point needs none besides the patch's
    /// own; a disc may be larger than the patch.
    fn support_below(&self, state: &State, tip: Vec3) -> Vec<u32> {
        let (surface, geometry) = (&self.surface.topology, &self.surface.geometry);
        if geometry.overhang() == 0.0 {
            return Vec::new();
        }
        let distance = |vertex: u32| (state.x[surface.vertex_node[vertex as usize] as usize] - tip).norm_squared();
        let nearest = (0..surface.vertex_node.len() as u32).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        let around = nearest.map_or(&[][..], |vertex| surface.incident(vertex));
        around.iter().flat_map(|&triangle| geometry.support(surface, triangle)).copied().collect()
    }
}

impl LocalModel {
    /// Returns this model and its state for ticks of `tick_s` seconds by this integrator. Nonlinear forces allow only the
    /// explicit one.
    ///
    /// # Errors
    /// If the integrator's equations have no solution.
    ///
    /// ```
    /// use stickslip::{Vec3, local::step::LocalIntegrator, pipeline::Simulation, scene::Scene};
    ///
    /// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
    /// let local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
    /// let (model, mut state) = (local.model().clone(), local.state().clone());
    /// state.v[0] = Vec3::z();
    /// // With one second per tick, implicit Euler brings it to rest; an explicit step would diverge.
    /// let (model, mut state) = model.integrated(state, LocalIntegrator::ImplicitEuler, 1.0)?;
    /// let step = model.step.as_ref().expect("it has one now");
    /// model.predict(step, 0.0, &mut state);
    /// assert!(model.kinetic_energy(&state.v_predicted) < 1e-6 * model.kinetic_energy(&state.v));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn integrated(
        mut self,
        mut state: LocalState,
        integrator: LocalIntegrator,
        tick_s: f64,
    ) -> Result<(Self, LocalState), ModelError> {
        let (step, offset) = match &self.forces {
            LocalForces::Tangent(linear) => {
                let step = LinearStep::new(integrator, linear, &self.patch.mass, tick_s)?;
                let offset = step.as_ref().map_or(linear.offset_len(), LinearStep::offset_len);
                (step, offset)
            }
            LocalForces::SpringsAnd(linear) => (None, linear.offset_len()),
            LocalForces::Springs => (None, 0),
        };
        state.response =
            step.as_ref().map_or_else(ContactResponse::default, |_| ContactResponse::new(self.patch.len()));
        state.offset = vec![0.0; offset];
        self.step = step;
        Ok((self, state))
    }

    /// Returns K and D of a model with linear forces.
    pub fn linear_forces(&self) -> Option<&LinearForces> {
        match &self.forces {
            LocalForces::Tangent(linear) => Some(linear),
            LocalForces::Springs | LocalForces::SpringsAnd(_) => None,
        }
    }

    /// Evaluates f(x, v) into `state.f`, N, at `elapsed` seconds.
    pub fn evaluate_forces(&self, elapsed: f64, state: &mut LocalState) {
        let LocalState { x, v, f, offset, work, .. } = state;
        match &self.forces {
            LocalForces::Tangent(linear) => {
                linear.evaluate(elapsed, x, v, offset, f);
                work.matrix_products += 1;
            }
            LocalForces::Springs => {
                f.fill(Vec3::zeros());
                self.add_spring_forces(elapsed, state);
            }
            LocalForces::SpringsAnd(linear) => {
                f[self.patch.len()..].fill(Vec3::zeros());
                linear.evaluate(elapsed, x, v, offset, f);
                work.matrix_products += 1;
                self.add_spring_forces(elapsed, state);
            }
        }
    }

    fn add_spring_forces(&self, elapsed: f64, state: &mut LocalState) {
        let LocalState { x, v, f, work, .. } = state;
        self.place_boundary(elapsed, x);
        self.patch.springs.add_forces(x, v, f);
        work.tick_springs += self.patch.springs.len() as u64;
        for force in &self.external {
            force.add(&self.patch.mass, v, f);
        }
    }

    /// Predicts x* and v* of a free tick by the model's own step, from a tick's start at `elapsed` seconds.
    pub fn predict(&self, step: &LinearStep, elapsed: f64, state: &mut LocalState) {
        let LocalState { x, v, x_predicted, v_predicted, offset, work, .. } = state;
        step.predict(elapsed, [x, v], offset, [x_predicted, v_predicted]);
        work.matrix_products += step.products();
    }

    /// Updates `state.f` after the nodes in `moved` were displaced by the given amounts, m.
    pub fn update_forces(&self, elapsed: f64, state: &mut LocalState, moved: impl Iterator<Item = (usize, Vec3)>) {
        match &self.forces {
            LocalForces::Tangent(linear) => {
                let LocalState { f, work, .. } = state;
                linear.add_displacements(moved.inspect(|_| work.displaced_nodes += 1), f);
            }
            LocalForces::Springs | LocalForces::SpringsAnd(_) => self.evaluate_forces(elapsed, state),
        }
    }

    /// Moves the boundary entries of `x` to the exterior's positions at `elapsed` seconds.
    pub fn place_boundary(&self, elapsed: f64, x: &mut [Vec3]) {
        if let Motion::Drifting { boundary, .. } = &self.exterior.motion {
            let positions = self.exterior.boundary.iter().zip(boundary);
            for (x, (start, velocity)) in x[self.patch.len()..].iter_mut().zip(positions) {
                *x = start + velocity * elapsed;
            }
        }
    }

    /// Returns the position of a surface vertex, m, from the patch's positions at `elapsed` seconds.
    #[inline]
    pub fn vertex(&self, vertex: u32, x: &[Vec3], elapsed: f64) -> Vec3 {
        let slot = self.patch.vertex_slot[vertex as usize];
        if slot != OUTSIDE {
            return x[slot as usize];
        }
        let start = self.exterior.vertices[vertex as usize];
        match &self.exterior.motion {
            Motion::Still => start,
            Motion::Drifting { vertices, .. } => start + vertices[vertex as usize] * elapsed,
        }
    }

    /// Largest possible distance of a vertex from its position when the model was built, m, from the patch's positions
    /// at `elapsed` seconds.
    pub fn reach(&self, x: &[Vec3], elapsed: f64) -> f64 {
        let moved = self.start.iter().zip(x).map(|(start, x)| (x - start).norm_squared()).fold(0.0, f64::max).sqrt();
        moved.max(self.drift(elapsed))
    }

    /// Largest motion of the exterior's surface in `time` seconds, m.
    pub fn drift(&self, time: f64) -> f64 {
        match &self.exterior.motion {
            Motion::Still => 0.0,
            Motion::Drifting { fastest, .. } => fastest * time,
        }
    }

    /// Elastic energy of the patch's springs, ½ Σ k(ℓ − L)², J.
    pub fn elastic_energy(&self, x: &[Vec3]) -> f64 {
        self.patch.springs.elastic_energy(x)
    }

    /// Gravitational energy of the patch's nodes, J, zero at z = 0 for a downward g.
    pub fn gravitational_energy(&self, x: &[Vec3]) -> f64 {
        let nodes = || self.patch.mass.iter().zip(x);
        // `sum()` of nothing would be −0.
        let of = |force: &ExternalForce| nodes().fold(0.0, |sum, (mass, x)| sum + force.potential(*mass, x));
        self.external.iter().fold(0.0, |sum, force| sum + of(force))
    }

    /// Kinetic energy ½ Σ m v², J.
    pub fn kinetic_energy(&self, v: &[Vec3]) -> f64 {
        self.patch.mass.iter().zip(v).map(|(m, v)| 0.5 * m * v.norm_squared()).sum()
    }

    /// Power dissipated by dampers and drag, W.
    pub fn dissipated_power(&self, x: &[Vec3], v: &[Vec3]) -> f64 {
        let drag = |force: &ExternalForce| match force {
            ExternalForce::Gravity(_) => 0.0,
            ExternalForce::Drag(b) => b * v[..self.patch.len()].iter().map(Vec3::norm_squared).sum::<f64>(),
        };
        self.patch.springs.damper_power(x, v) + self.external.iter().map(drag).sum::<f64>()
    }
}

impl LocalState {
    /// Takes over positions and velocities of the nodes that the state before also had, and the counts of its work.
    pub fn carry_over(&mut self, patch: &Patch, before: &LocalState, patch_before: &Patch) {
        self.work = before.work;
        let mut old = 0;
        for (slot, &node) in patch.nodes.iter().enumerate() {
            while old < patch_before.len() && patch_before.nodes[old] < node {
                old += 1;
            }
            if old < patch_before.len() && patch_before.nodes[old] == node {
                self.x[slot] = before.x[old];
                self.v[slot] = before.v[old];
            }
        }
    }
}
