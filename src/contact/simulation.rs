//! The local side between ticks: the model in use, its state, and the contact.

use super::collision::{Hits, START_TOLERANCE};
use super::massless::{ContactEnergy, Held, MasslessMemory};
use super::renderer::{MovedNodes, RendererFault, RendererModel, TickCost};
use super::rules::{ContactRules, Scheme};
use super::shape::{Shape, Visited};
use super::state::{Contact, ContactState};
use crate::Vec3;
use crate::local::model::{LocalModel, LocalState};
use crate::surface::geometry::{ContactPoint, SurfaceModel};
use crate::surface::support::Support;

/// Depth of the tip inside the surface while the contact is under tension, as a share of the longest edge of the
/// contact's triangle, above which the patch has folded. In shipped scenes a surface that tears off recoils by 0.01.
const FOLDED: f64 = 0.1;

/// A patch that has folded over the tip: the contact pulls, and so exerts no force, although the tip is deep inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fold {
    /// Depth of the tip inside the surface, m.
    pub depth_m: f64,
    /// Depth to which a surface that tears off may recoil, m.
    pub limit_m: f64,
}

/// The local side: the model in use, its state, and the contact.
///
/// ```
/// use stickslip::{Vec3, contact::law::Mode, contact::report::TickReport, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let mut local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// // From 1 mm above the block to 1 mm below its former top, in 20 ms.
/// let (mut tip, mut report) = (Vec3::new(-0.03, 0.0013, 0.001), TickReport::none());
/// for _ in 0..20 {
///     let next = tip - Vec3::z() * 1e-4;
///     report = local.tick(tip, next);
///     tip = next;
/// }
/// assert_eq!((report.mode, local.model_age()), (Mode::Stick, 20));
/// assert!(report.normal_force > 0.0); // it pushes back
/// let contact = local.contact().expect("the tip is in contact");
/// assert!((local.shape().position(&contact.point) - tip).norm() < 1e-12); // the mesh is where the tip is
/// assert_eq!(local.state().x.len(), local.model().patch.len() + local.model().patch.boundary.len());
/// assert_eq!(local.elapsed(), 20.0 * scene.tick_s());
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LocalSimulation {
    pub(super) rules: ContactRules,
    pub(super) surface: SurfaceModel,
    /// h, s.
    pub(super) tick_s: f64,
    pub(super) model: LocalModel,
    pub(super) state: LocalState,
    /// Ticks between the state that the model was built from and its first tick.
    pub(super) latency: u64,
    /// Ticks done with the model.
    pub(super) age: u64,
    pub(super) contact: Option<Contact>,
    /// Whether the contact was under tension before the last tick, which then took the nearest point.
    pub(super) was_under_tension: bool,
    /// Whether the last contact ended by a release, after which the tip has not left the box around the surface.
    is_released: bool,
    pub(super) support: Support,
    pub(super) visited: Visited,
    pub(super) hits: Hits,
    /// Λ·(the contact point's gap to the tip at the tick's end, before it is closed)/h of the last tick, J, where the
    /// model has a linear step.
    pub(super) work_left: f64,
    /// What the massless scheme knows of the contact.
    pub(super) massless: MasslessMemory,
    /// Velocity of the tip at the end of the next tick as the instrument estimates it, m/s, if it does.
    pub(super) tip_velocity: Option<Vec3>,
    /// Whether `state.f` holds the forces of the present state, so that the next tick need not evaluate them.
    pub(super) forces_are_current: bool,
    /// The model of a custom renderer, which then renders the ticks.
    pub(super) renderer: Option<Box<dyn RendererModel>>,
    /// Reason why that renderer cannot go on.
    pub(super) renderer_fault: Option<RendererFault>,
}

impl LocalSimulation {
    /// Starts with a first model; `tick_s` is h. All memory that ticks need is allocated here.
    pub fn new(rules: ContactRules, tick_s: f64, surface: SurfaceModel, model: LocalModel, state: LocalState) -> Self {
        let triangles = surface.topology.triangles.len();
        Self {
            rules,
            support: Support::with_capacity(surface.geometry.largest_support()),
            surface,
            tick_s,
            model,
            state,
            latency: 0,
            age: 0,
            contact: None,
            was_under_tension: false,
            is_released: false,
            visited: Visited::new(triangles),
            hits: Hits::new(triangles),
            work_left: 0.0,
            massless: MasslessMemory::default(),
            tip_velocity: None,
            forces_are_current: false,
            renderer: None,
            renderer_fault: None,
        }
    }

    /// Puts a new model to use, `latency` ticks after the state it was built from. Nodes of both patches go on from
    /// where they are; nodes that enter start at the new model's state. Returns the old model and state, so that their
    /// builder can dispose of them.
    ///
    /// The exterior jumps to its position in the new model. If that puts a free tip inside, no motion within a tick
    /// will ever show it to collision detection: the tip is taken to be in contact with the nearest point, as after
    /// tension.
    pub fn hand_over(
        &mut self,
        model: LocalModel,
        mut state: LocalState,
        latency: u64,
        tip: Vec3,
    ) -> (LocalModel, LocalState) {
        state.carry_over(&model.patch, &self.state, &self.model.patch);
        self.latency = latency;
        self.age = 0;
        self.forces_are_current = false;
        let before = (std::mem::replace(&mut self.model, model), std::mem::replace(&mut self.state, state));
        self.take_up_if_inside(tip);
        before
    }

    /// Takes a free tip inside the surface to be in contact with the nearest point, as after tension.
    pub(super) fn take_up_if_inside(&mut self, tip: Vec3) {
        let shape = self.shape();
        if self.contact.is_none() && shape.signed_distance(tip) < -START_TOLERANCE {
            self.contact = shape.nearest(tip).map(|point| Contact { point, state: ContactState::Tension });
        }
    }

    /// Follows a released tip. Where a patch folds, its surface intersects itself, and a tip that is inside may count as outside when it
    /// is released; as the surface unfolds, the tip is inside without having passed through it, which collision detection does not
    /// see.
    pub(super) fn follow_release(&mut self, tip: Vec3) {
        self.is_released |= self.was_under_tension;
        if self.is_released {
            self.is_released = self.contact.is_none() && self.renderer.is_none() && self.shape().may_contain(tip);
        }
        if self.is_released {
            self.take_up_if_inside(tip);
        }
    }

    /// Puts the model of a custom renderer to use, which goes on from the one before. Returns the old one, so that its
    /// builder can dispose of it.
    pub fn take_over(&mut self, mut renderer: Option<Box<dyn RendererModel>>) -> Option<Box<dyn RendererModel>> {
        if let Some(new) = &mut renderer {
            new.take_over(self.renderer.as_deref_mut());
        }
        std::mem::replace(&mut self.renderer, renderer)
    }

    /// Tells the next tick the instrument's estimate of the tip's velocity at its end, m/s. The massless scheme moves the
    /// contact point at that velocity; `None` derives it from the tip's displacement, which encoders quantise.
    pub fn set_tip_velocity(&mut self, estimate: Option<Vec3>) {
        self.tip_velocity = estimate;
    }

    /// Returns the scheme by which the contact constrains the mesh.
    pub fn scheme(&self) -> Scheme {
        self.rules.scheme
    }

    /// Energy of the contact point that the massless scheme holds, and what it exchanged with the mesh; zero under the
    /// other schemes.
    pub fn contact_energy(&self) -> ContactEnergy {
        self.massless.energy
    }

    /// Whether a custom renderer renders the ticks.
    pub fn is_rendered_by_another(&self) -> bool {
        self.renderer.is_some()
    }

    /// Returns the nodes that a custom renderer has moved.
    pub fn moved(&self) -> Option<MovedNodes<'_>> {
        self.renderer.as_ref().and_then(|renderer| renderer.moved())
    }

    /// Returns what the last tick of a custom renderer in another process cost there.
    pub fn renderer_cost(&self) -> Option<TickCost> {
        self.renderer.as_ref().and_then(|renderer| renderer.own_cost())
    }

    /// Reason why a custom renderer cannot go on, if it cannot.
    pub fn renderer_fault(&self) -> Option<RendererFault> {
        self.renderer_fault
    }

    /// Returns the contact surface of the whole body.
    pub fn surface(&self) -> &SurfaceModel {
        &self.surface
    }

    /// Returns the model in use.
    pub fn model(&self) -> &LocalModel {
        &self.model
    }

    /// Returns the state of the model in use.
    pub fn state(&self) -> &LocalState {
        &self.state
    }

    /// Returns the contact, if there is one.
    pub fn contact(&self) -> Option<Contact> {
        self.contact
    }

    /// Whether the contact is under tension.
    pub(super) fn is_under_tension(&self) -> bool {
        self.contact.is_some_and(|contact| contact.state == ContactState::Tension)
    }

    /// Returns the fold of the patch over the tip, if there is one. A surface that tears off recoils from the tip; if
    /// the nearest point pulls although the tip is inside by more than a tenth of an edge, the patch has folded. The
    /// first tick under tension does not count, since its contact point is not the nearest one: the tip may have jumped
    /// away from it. A depth that is not a number is a fold.
    pub fn fold(&self, tip: Vec3) -> Option<Fold> {
        let contact = self.contact.filter(|_| self.was_under_tension && self.is_under_tension())?;
        let shape = self.shape();
        let [a, b, c] = shape.corners(contact.point.triangle);
        let limit_m = FOLDED * (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let depth_m = -shape.signed_distance(tip);
        (!(depth_m <= limit_m)).then_some(Fold { depth_m, limit_m })
    }

    /// Puts the contact at a point, as after a tick of sticking there.
    pub fn hold(&mut self, point: ContactPoint) {
        self.contact = Some(Contact { point, state: ContactState::Stick });
    }

    /// Ticks done with the model in use.
    pub fn model_age(&self) -> u64 {
        self.age
    }

    /// Time since the state that the model was built from, s.
    pub fn elapsed(&self) -> f64 {
        (self.latency + self.age) as f64 * self.tick_s
    }

    /// Returns the surface at this instant.
    pub fn shape(&self) -> Shape<'_> {
        Shape { surface: &self.surface, model: &self.model, x: &self.state.x, elapsed: self.elapsed() }
    }

    /// Energy lost in the velocity jump of the last tick, ½ Δvᵀ M Δv, J, under the velocity scheme; under the massless
    /// scheme without the velocity that the contact holds. The geometric scheme has no such term: it changes velocities
    /// in several places and does not satisfy an energy balance. A step whose impulse acts over the whole tick has none
    /// either: it loses the work of Λ over the gap that the tick closes at its end.
    ///
    /// ```
    /// use stickslip::{Vec3, contact::rules::Scheme, pipeline::Simulation, scene::Scene};
    ///
    /// let mut scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
    /// scene.contact.scheme = Scheme::Velocity;
    /// let mut local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
    /// let above = Vec3::new(-0.03, 0.0013, 0.0005);
    /// let inside = above - Vec3::z() * 0.001; // at 1 m/s
    /// local.tick(above, above);
    /// assert_eq!(local.impact_loss(), 0.0); // nothing was hit
    /// local.tick(above, inside);
    /// assert!(local.impact_loss() > 0.0); // the masses under the tip started at once
    /// # Ok::<(), stickslip::scene::SceneError>(())
    /// ```
    pub fn impact_loss(&self) -> f64 {
        match self.rules.scheme {
            Scheme::Geometric { .. } => 0.0,
            Scheme::Velocity if self.model.step.as_ref().is_some_and(|step| !step.dissipates()) => self.work_left,
            Scheme::Massless if self.model.step.as_ref().is_some_and(|step| !step.dissipates()) => 0.0,
            // Prediction and state changed places: the predicted velocities are those before the tick.
            Scheme::Velocity | Scheme::Massless => {
                let velocities = self.state.v.iter().zip(&self.state.v_predicted);
                let changes = self.model.patch.mass.iter().zip(velocities);
                let of_all: f64 = changes.map(|(mass, (now, before))| 0.5 * mass * (now - before).norm_squared()).sum();
                // What the tip moves is no part of the mesh's own motion.
                match self.massless.held {
                    Held::Nothing => of_all,
                    held => {
                        let change = |v: &[Vec3]| self.support.velocity(v);
                        of_all - held.kinetic(&self.support, change(&self.state.v) - change(&self.state.v_predicted))
                    }
                }
            }
        }
    }
}
