//! One haptic tick: predict, find the contact, constrain, integrate. The geometric scheme is the paper's
//! hybrid of a deformation and a constraint force, in its order; the velocity scheme constrains the
//! velocity alone. Allocates nothing, locks nothing, does no I/O.

use super::collision::{Collision, Hits, START_TOLERANCE, first_collision};
use super::law::{Impulse, Law, Mode};
use super::limit::MovingLimit;
use super::operators::{Metric, Support};
use super::subdivision::LARGEST_SUPPORT;
use super::surface::{ContactGeometry, ContactPoint, Projection, Shape, Touch, Visited};
use crate::Vec3;
use crate::model::local::{LocalModel, LocalState};
use crate::model::network::snap_to_rest;
use crate::word::words;

/// Below this share of its weight on free patch nodes a contact point is rigid.
pub const RIGID_BELOW: f64 = 0.5;

/// How the mesh is moved out of (or back to) the tip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Deformation {
    /// Every free support node by d/Σ_free w: the triangle is pushed (the paper).
    #[default]
    Rigid,
    /// Node i by wᵢd/s: the smallest displacement that brings the contact point to the tip.
    LeastNorm,
}

words!(Deformation { Rigid = "rigid", LeastNorm = "least-norm" });

/// What a surface that cannot yield answers with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// N/m.
    pub stiffness: f64,
    /// N·s/m.
    pub damping: f64,
}

impl Default for Wall {
    /// 1 kN/m, without damping.
    fn default() -> Self {
        Self { stiffness: 1000.0, damping: 0.0 }
    }
}

/// How a contact constrains the mesh.
///
/// ```
/// use stickslip::contact::{operators::Metric, tick::{Deformation, Scheme}};
///
/// let paper = Scheme::Geometric { deformation: Deformation::Rigid, metric: Metric::Euclidean };
/// assert_eq!((paper, paper.metric()), (Scheme::default(), Metric::Euclidean));
/// // An impulse acts through the masses, whatever P of the global cycle does.
/// assert_eq!(Scheme::Velocity.metric(), Metric::Mass);
/// assert_eq!(Scheme::Velocity.overwrite_metric(), Metric::Euclidean);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scheme {
    /// The mesh is moved to the tip, and stopped there (the paper). Moving it takes no work.
    Geometric {
        /// How the mesh is moved to the tip.
        deformation: Deformation,
        /// The inner product of P and Q.
        metric: Metric,
    },
    /// An impulse makes the contact point follow the tip. Keeps the books of momentum and energy.
    Velocity,
}

impl Default for Scheme {
    /// The paper's.
    fn default() -> Self {
        Scheme::Geometric { deformation: Deformation::default(), metric: Metric::default() }
    }
}

impl Scheme {
    /// The inner product in which a tick projects. An impulse acts through the masses.
    pub fn metric(self) -> Metric {
        match self {
            Scheme::Geometric { metric, .. } => metric,
            Scheme::Velocity => Metric::Mass,
        }
    }

    /// That of the P with which a cycle holds the contact point under
    /// [`SyncMode::Overwrite`](crate::dynamics::global::SyncMode::Overwrite): the paper's, unless the scene
    /// says otherwise.
    pub fn overwrite_metric(self) -> Metric {
        match self {
            Scheme::Geometric { metric, .. } => metric,
            Scheme::Velocity => Metric::Euclidean,
        }
    }
}

/// Everything a scene decides about contact but the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactRules {
    /// The constraint.
    pub law: Law,
    /// How it is put on the mesh.
    pub scheme: Scheme,
    /// Rigid contact.
    pub wall: Wall,
}

/// A contact between two ticks: where, and what it did last. The latter decides where the next tick
/// looks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The material point.
    pub point: ContactPoint,
    /// What it did last.
    pub grip: Grip,
}

/// What a contact did last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grip {
    /// Held its point.
    Stick,
    /// Slid without friction, or over rigid ground.
    Slide,
    /// Slipped at the Coulomb bound.
    Slip,
    /// Pulled at the tip: no force, but kept.
    Tension,
}

impl Grip {
    fn of(mode: Mode) -> Self {
        match mode {
            Mode::Stick => Grip::Stick,
            Mode::Slip => Grip::Slip,
            Mode::Slide | Mode::Free => Grip::Slide,
        }
    }
}

/// What a tick did.
///
/// ```
/// use stickslip::{contact::{law::Mode, tick::TickReport}, pipeline, scene::Scene};
///
/// assert_eq!(TickReport::none().mode, Mode::Free);
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program"); // μ = 1
/// let mut excess_n = 0.0_f64;
/// pipeline::run(&scene, |tick| {
///     let report = tick.report;
///     excess_n = excess_n.max(report.tangential_force() - report.normal_force);
/// })?;
/// assert!(excess_n < 1e-12); // Coulomb's bound, F_T ≤ μF_N
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickReport {
    /// Free, or what the contact did.
    pub mode: Mode,
    /// Force commanded to the instrument, before device limits, N.
    pub force: Vec3,
    /// f·n̂, N; 0 when free.
    pub normal_force: f64,
    /// Where the contact was; `None` when free.
    pub touch: Option<Touch>,
    /// τ, if the contact began in this tick.
    pub collision_time: Option<f64>,
    /// Whether a contact ended in this tick.
    pub released: bool,
    /// Whether the contact was rigid.
    pub rigid: bool,
    /// Whether the law had no solution for the contact's response, and sliding was solved in its place.
    pub fell_back: bool,
}

impl TickReport {
    /// Before the first tick.
    pub fn none() -> Self {
        Self::free(false)
    }

    fn free(released: bool) -> Self {
        Self {
            mode: Mode::Free,
            force: Vec3::zeros(),
            normal_force: 0.0,
            touch: None,
            collision_time: None,
            released,
            rigid: false,
            fell_back: false,
        }
    }

    fn touching(mode: Mode, force: Vec3, touch: Touch) -> Self {
        let normal_force = force.dot(&touch.normal);
        Self { mode, force, normal_force, touch: Some(touch), ..Self::free(false) }
    }

    /// |f − (f·n̂) n̂|, N; 0 when free.
    pub fn tangential_force(&self) -> f64 {
        self.touch.map_or(0.0, |touch| (self.force - touch.normal * self.normal_force).norm())
    }
}

/// Where a tick meets the surface, and how much of it is left.
struct Meeting {
    point: ContactPoint,
    elapsed: f64,
    rest: f64,
    collision_time: Option<f64>,
}

/// The local side: the model in use, its state, and the contact.
///
/// ```
/// use stickslip::{Vec3, contact::{law::Mode, tick::TickReport}, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let (_, mut local) = Simulation::prepare(&scene)?.into_sides();
/// // From 1 mm above the block to 1 mm below where its top was, in 20 ms.
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
    rules: ContactRules,
    step: f64,
    model: LocalModel,
    state: LocalState,
    /// Ticks between the state that the model was built from and its first tick.
    latency: u64,
    age: u64,
    contact: Option<Contact>,
    support: Support,
    visited: Visited,
    hits: Hits,
    /// Λ·(what was left of the way to the tip)/h of the last tick, J, where the model has a [`LinearStep`].
    work_left: f64,
}

impl LocalSimulation {
    /// Starts with a first model; `step` is h. All that ticks need is allocated here.
    pub fn new(rules: ContactRules, step: f64, model: LocalModel, state: LocalState) -> Self {
        let triangles = model.surface.triangles.len();
        Self {
            rules,
            step,
            model,
            state,
            latency: 0,
            age: 0,
            contact: None,
            support: Support::with_capacity(LARGEST_SUPPORT),
            visited: Visited::new(triangles),
            hits: Hits::new(triangles),
            work_left: 0.0,
        }
    }

    /// Puts a new model to use, `latency` ticks after the state it was built from. Nodes of both
    /// patches go on from where they are; nodes that enter start at the new model's state. The old
    /// model comes back, so that whoever built it can dispose of it.
    ///
    /// The exterior jumps to where the new model has it. If that puts a free tip inside, no motion
    /// within a tick will ever show it to collision detection: the tip is taken to be in contact
    /// with the nearest point, as after tension.
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
        let before = (std::mem::replace(&mut self.model, model), std::mem::replace(&mut self.state, state));
        if self.contact.is_none() && self.shape().signed_distance(tip) < -START_TOLERANCE {
            self.contact = self.shape().nearest(tip).map(|point| Contact { point, grip: Grip::Tension });
        }
        before
    }

    /// The model in use.
    pub fn model(&self) -> &LocalModel {
        &self.model
    }

    /// Its state.
    pub fn state(&self) -> &LocalState {
        &self.state
    }

    /// The contact, if there is one.
    pub fn contact(&self) -> Option<Contact> {
        self.contact
    }

    /// Puts the contact at a point, as after a tick that stuck there.
    pub fn hold(&mut self, point: ContactPoint) {
        self.contact = Some(Contact { point, grip: Grip::Stick });
    }

    /// Ticks done with this model.
    pub fn model_age(&self) -> u64 {
        self.age
    }

    /// Seconds since the state that the model was built from.
    pub fn elapsed(&self) -> f64 {
        (self.latency + self.age) as f64 * self.step
    }

    /// The surface now.
    pub fn shape(&self) -> Shape<'_> {
        Shape { model: &self.model, x: &self.state.x, elapsed: self.elapsed() }
    }

    /// ½ Δvᵀ M Δv of the last tick, J, under the velocity scheme. The geometric one has no such term: it
    /// changes velocities in several places and keeps no energy book. Nor have steps whose impulse acts over the
    /// whole tick: they lose the work of Λ over what `follow` closes.
    ///
    /// ```
    /// use stickslip::{Vec3, contact::tick::Scheme, pipeline::Simulation, scene::Scene};
    ///
    /// let mut scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
    /// scene.contact.scheme = Scheme::Velocity;
    /// let (_, mut local) = Simulation::prepare(&scene)?.into_sides();
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
            // Prediction and state changed places: the predicted velocities are those before the tick.
            Scheme::Velocity => {
                let velocities = self.state.v.iter().zip(&self.state.v_predicted);
                let changes = self.model.patch.mass.iter().zip(velocities);
                changes.map(|(mass, (now, before))| 0.5 * mass * (now - before).norm_squared()).sum()
            }
        }
    }

    /// One tick, in which the tip goes from q₀ to q₁.
    pub fn tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        match &self.model.step {
            None => {
                self.model.evaluate_forces(self.elapsed(), &mut self.state);
                self.predict();
            }
            Some(step) => {
                self.work_left = 0.0;
                self.model.predict(step, self.elapsed(), &mut self.state);
            }
        }
        let report = match self.meet(q0, q1) {
            None => self.release(),
            Some(meeting) => self.respond(meeting, q0, q1),
        };
        self.age += 1;
        snap_to_rest(&mut self.state.v[..self.model.patch.len()]);
        self.model.place_boundary(self.elapsed(), &mut self.state.x);
        report
    }

    /// Accepts the prediction without a contact.
    fn release(&mut self) -> TickReport {
        let released = self.contact.take().is_some();
        self.accept_prediction();
        TickReport::free(released)
    }

    /// Step 1 (11): v* = v + h M⁻¹f, x* = x + h v*.
    fn predict(&mut self) {
        let LocalState { x, v, f, x_predicted, v_predicted, .. } = &mut self.state;
        for (i, inverse_mass) in self.model.patch.inverse_mass.iter().enumerate() {
            v_predicted[i] = v[i] + f[i] * (self.step * inverse_mass);
            x_predicted[i] = x[i] + v_predicted[i] * self.step;
        }
    }

    fn accept_prediction(&mut self) {
        let LocalState { x, v, x_predicted, v_predicted, .. } = &mut self.state;
        std::mem::swap(x, x_predicted);
        std::mem::swap(v, v_predicted);
    }

    /// Step 2: where the tip meets the surface in this tick; `None` where it does not, or no longer.
    fn meet(&mut self, q0: Vec3, q1: Vec3) -> Option<Meeting> {
        let elapsed = self.elapsed();
        let now = Shape { model: &self.model, x: &self.state.x, elapsed };
        let predicted = Shape { model: &self.model, x: &self.state.x_predicted, elapsed: elapsed + self.step };
        let Some(Contact { point, grip }) = self.contact else {
            let tested = &mut self.state.work.triangles_tested;
            let collision = match &self.model.geometry {
                ContactGeometry::Faceted | ContactGeometry::Shaded => {
                    first_collision(&now, &predicted, q0, q1, &mut self.hits, tested)
                }
                ContactGeometry::Limit(limit) => {
                    let between = &mut self.state.x_between;
                    MovingLimit { limit, start: now, end: predicted, between, q0, q1 }.first_collision(tested)
                }
            }?;
            return Some(match self.rules.scheme {
                Scheme::Geometric { .. } => self.rewind(collision),
                Scheme::Velocity => {
                    Meeting { point: collision.point, elapsed, rest: self.step, collision_time: Some(collision.time) }
                }
            });
        };
        let found = match grip {
            Grip::Stick => Projection::Found(point),
            Grip::Slide => now.project(&point, q1, &mut self.visited),
            // The mesh slid under a tip that stood at q₀.
            Grip::Slip => now.project(&point, q0, &mut self.visited),
            Grip::Tension if predicted.is_outside(q1) => return None,
            Grip::Tension => Projection::Found(now.nearest(q0).unwrap_or(point)),
        };
        match found {
            Projection::Found(point) => Some(Meeting { point, elapsed, rest: self.step, collision_time: None }),
            Projection::OverBorder => None,
        }
    }

    /// Back to the time of collision: x ← x + τ h v*, v ← v + τ h M⁻¹f.
    fn rewind(&mut self, collision: Collision) -> Meeting {
        let passed = collision.time * self.step;
        let LocalState { x, v, f, v_predicted, .. } = &mut self.state;
        for (i, inverse_mass) in self.model.patch.inverse_mass.iter().enumerate() {
            x[i] += v_predicted[i] * passed;
            v[i] += f[i] * (passed * inverse_mass);
        }
        let elapsed = self.elapsed() + passed;
        self.model.evaluate_forces(elapsed, &mut self.state);
        let rest = self.step - passed;
        Meeting { point: collision.point, elapsed, rest, collision_time: Some(collision.time) }
    }

    /// What is left of the tick, for a contact point.
    fn respond(&mut self, meeting: Meeting, q0: Vec3, q1: Vec3) -> TickReport {
        let Meeting { point, elapsed, rest, collision_time } = meeting;
        let shape = Shape { model: &self.model, x: &self.state.x, elapsed };
        let touch = shape.touch(self.rules.scheme.metric(), &point, &mut self.support);
        if self.support.free_weight() < RIGID_BELOW {
            return self.respond_rigidly(touch, collision_time, q0, q1);
        }
        if self.model.step.is_some() {
            return self.follow(touch, collision_time, q1);
        }

        let reaction = match self.rules.scheme {
            Scheme::Geometric { deformation, .. } => {
                self.deform(deformation, touch, elapsed, q1);
                self.support.reaction(&self.state.f)
            }
            Scheme::Velocity => self.following_force(touch, q1),
        };
        // A reaction that is not a number is no tension: it goes on to the fail-safe.
        if reaction.dot(&touch.normal) <= 0.0 {
            self.contact = Some(Contact { point, grip: Grip::Tension });
            self.accept_prediction();
            return TickReport { collision_time, ..TickReport::free(false) };
        }
        let (mode, force) = self.rules.law.contact_force(reaction, touch.normal);
        match self.rules.scheme {
            Scheme::Geometric { .. } => self.integrate(mode, touch.normal, force, rest),
            Scheme::Velocity => self.integrate_pushed(force),
        }
        self.contact = Some(Contact { point, grip: Grip::of(mode) });
        TickReport { collision_time, ..TickReport::touching(mode, force, touch) }
    }

    /// The force on the instrument, N, under which the contact point would end the tick at the tip:
    /// −Λ/h with the impulse Λ = G⁻¹r on the mesh, G = WM⁻¹Wᵀ, r = (q₁ − p)/h − W v*.
    fn following_force(&self, touch: Touch, q1: Vec3) -> Vec3 {
        let r = (q1 - touch.position) / self.step - self.support.velocity(&self.state.v_predicted);
        r * (-1.0 / (self.support.scale() * self.step))
    }

    /// v ← v* + M⁻¹WᵀΛ, x ← x + h v, for the force −Λ/h on the instrument. G is a multiple of the identity:
    /// Λ = n̂(n̂·r)/(n̂·Gn̂), and a(−n̂ + μt̂) beyond the Coulomb bound, are what the law makes of G⁻¹r.
    fn integrate_pushed(&mut self, force: Vec3) {
        let LocalState { x, v, v_predicted, .. } = &mut self.state;
        self.support.push(force * -self.step, v_predicted);
        std::mem::swap(v, v_predicted);
        for (x, v) in x.iter_mut().zip(v).take(self.model.patch.len()) {
            *x += *v * self.step;
        }
    }

    /// The velocity scheme where an impulse moves the whole patch: v = v* + A⁻¹WᵀΛ with Λ by the law for G = WA⁻¹Wᵀ and
    /// r = (q₁ − p)/h − W v*, so that the constraint holds for the velocity at the tick's end.
    ///
    /// x = x* + XWᵀΛ is the integrator's own way. It ends at the tip if x advances by h v. Otherwise, the midpoint rule
    /// and the exact solution, the contact point misses the tip by what its velocity was off before the tick's end:
    /// h W(v − v₋)/2 for the midpoint rule, nothing as long as the tip keeps its velocity. Constraining the mean
    /// velocity instead would leave no gap, but alternate: 2u, 0, 2u … after a jump to u. The gap is closed along XWᵀ, in
    /// the directions that the mode holds: as if the velocity of the tick's start had met the constraint too.
    fn follow(&mut self, touch: Touch, collision_time: Option<f64>, q1: Vec3) -> TickReport {
        let Self { model, state, support, step: h, .. } = self;
        let LocalState { x, v_predicted, x_predicted, response, .. } = state;
        let (n, way) = (touch.normal, q1 - touch.position);
        let r = way / *h - support.velocity(v_predicted);
        // What is not a number is no tension: it goes on to the fail-safe.
        let impulse = model.step.as_ref().filter(|_| !(r.dot(&n) >= 0.0)).map(|step| {
            step.respond(support, response);
            let [g, gx] = response.at_contact(support);
            (self.rules.law.impulse(&g, r, n), gx)
        });
        // An exact step whose modes turn within the tick may answer a push the other way: nothing can be pushed then.
        let Some((Impulse { mode, value, fell_back }, gx)) = impulse.filter(|(push, _)| !(push.value.dot(&n) >= 0.0))
        else {
            self.contact = Some(Contact { point: touch.point, grip: Grip::Tension });
            self.accept_prediction();
            return TickReport { collision_time, ..TickReport::free(false) };
        };
        let left = way - (support.velocity(x_predicted) - support.velocity(x)) - gx * value;
        let (left, closing) = match mode {
            Mode::Stick => (left, gx.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * left)),
            Mode::Slide | Mode::Slip | Mode::Free => {
                let left = n.dot(&left);
                (n * left, n * (left / n.dot(&(gx * n))))
            }
        };
        response.push([value + closing, value], x_predicted, v_predicted);
        self.work_left = value.dot(&left) / *h;
        self.accept_prediction();
        self.contact = Some(Contact { point: touch.point, grip: Grip::of(mode) });
        TickReport { collision_time, fell_back, ..TickReport::touching(mode, value * (-1.0 / self.step), touch) }
    }

    /// Step 3: moves the contact point to the tip (for sliding, along the normal only), and brings
    /// the forces up to date for step 4.
    fn deform(&mut self, deformation: Deformation, touch: Touch, elapsed: f64, q1: Vec3) {
        let mut d = q1 - touch.position;
        if self.rules.law == Law::Sliding {
            d = touch.normal * d.dot(&touch.normal);
        }
        let support = &self.support;
        let moved = support.nodes().iter().map(|node| {
            let share = match deformation {
                Deformation::Rigid => 1.0 / support.free_weight(),
                Deformation::LeastNorm => node.weight / support.square_weight(),
            };
            (node.slot, d * share)
        });
        for (slot, delta) in moved.clone() {
            self.state.x[slot] += delta;
        }
        self.model.update_forces(elapsed, &mut self.state, moved);
    }

    /// Steps 5 and 6: velocities under the constraint, then x ← x + h v over the rest of the tick.
    fn integrate(&mut self, mode: Mode, normal: Vec3, force: Vec3, rest: f64) {
        let LocalState { x, v, f, .. } = &mut self.state;
        if mode == Mode::Slip {
            self.support.subtract_contact_force(force, f);
        }
        for (i, inverse_mass) in self.model.patch.inverse_mass.iter().enumerate() {
            v[i] += f[i] * (rest * inverse_mass);
        }
        mode.project_velocity(&self.support, normal, v);
        for (x, v) in x.iter_mut().zip(v).take(self.model.patch.len()) {
            *x += *v * rest;
        }
    }

    /// A wall's answer, max(0, k(p − q₁)·n̂ − b q̇·n̂) n̂, without a force on the mesh, until the tip is
    /// outside.
    fn respond_rigidly(&mut self, touch: Touch, collision_time: Option<f64>, q0: Vec3, q1: Vec3) -> TickReport {
        let end = self.elapsed() + self.step;
        let predicted = Shape { model: &self.model, x: &self.state.x_predicted, elapsed: end };
        if predicted.is_outside(q1) {
            return self.release();
        }
        let Wall { stiffness, damping } = self.rules.wall;
        let depth = (touch.position - q1).dot(&touch.normal);
        let speed = ((q1 - q0) / self.step).dot(&touch.normal);
        let push = stiffness * depth - damping * speed;
        // Written so that NaN is passed on to the fail-safe instead of becoming zero.
        let push = if push <= 0.0 { 0.0 } else { push };
        self.contact = Some(Contact { point: touch.point, grip: Grip::Slide });
        self.accept_prediction();
        TickReport { collision_time, rigid: true, ..TickReport::touching(Mode::Slide, touch.normal * push, touch) }
    }
}
