//! One haptic tick, in the paper's six steps: predict, detect, deform, force, law and velocity, move.
//!
//! [`LocalSimulation::tick`] matches the scheme once; each scheme is one function that can be read top to bottom. The
//! geometric scheme is the paper's hybrid of a deformation and a constraint force; the velocity scheme constrains the
//! velocity alone; the massless scheme ([`super::massless`]) does so too, and does not let the instrument feel the
//! inertia of the contact point. A tick allocates nothing, locks nothing and does no I/O.

use super::collision::{Collision, first_collision};
use super::law::{Impulse, Interface, Mode};
use super::massless::Held;
use super::renderer::{MovedNodes, Rendered, RendererFault};
use super::report::TickReport;
use super::rules::{Deformation, RIGID_BELOW, Scheme, Wall};
use super::shape::{Projection, Shape, Touch};
use super::simulation::LocalSimulation;
use super::smooth_surface::MovingSurface;
use super::state::{Contact, ContactState};
use crate::local::model::LocalState;
use crate::model::state::snap_to_rest;
use crate::surface::geometry::{ContactGeometry, ContactPoint};
use crate::surface::support::Metric;
use crate::{Mat3, Vec3};

/// Result of step 2.
enum Detected {
    /// The tip passes through the surface in this tick.
    Collision(Collision),
    /// An earlier contact continues at this point.
    Contact(ContactPoint),
}

/// What detection leaves for a scheme without a rewind.
pub(super) enum WholeTick {
    /// A contact at the start of the tick, and the time of collision if it begins in this tick.
    Contact(Touch, Option<f64>),
    /// The tick is over: the tip is free, or the ground rigid.
    Over(TickReport),
}

impl LocalSimulation {
    /// Runs one tick, in which the tip moves from q₀ to q₁, m.
    pub fn tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        self.was_under_tension = self.is_under_tension();
        let report = match self.rules.scheme {
            _ if self.renderer.is_some() => self.rendered_tick(q0, q1),
            Scheme::Geometric { deformation, metric } => self.geometric_tick(deformation, metric, q0, q1),
            Scheme::Velocity if self.model.step.is_some() => self.linear_step_tick(q0, q1),
            Scheme::Velocity => self.velocity_tick(q0, q1),
            Scheme::Massless => self.massless_tick(q0, q1),
        };
        self.age += 1;
        snap_to_rest(&mut self.state.v[..self.model.patch.len()]);
        self.model.place_boundary(self.elapsed(), &mut self.state.x);
        self.follow_release(q1);
        report
    }

    /// The paper's hybrid scheme: moves the mesh to the tip and constrains its velocity, over the rest of the tick
    /// after a collision.
    fn geometric_tick(&mut self, deformation: Deformation, metric: Metric, q0: Vec3, q1: Vec3) -> TickReport {
        // 1. Predict.
        self.model.evaluate_forces(self.elapsed(), &mut self.state);
        self.predict();

        // 2. Detect. After a collision, the rest of the tick goes on from there.
        let (point, collision_time) = match self.detect(q0, q1) {
            None => return self.release(),
            Some(Detected::Contact(point)) => (point, None),
            Some(Detected::Collision(Collision { point, time })) => (point, Some(time)),
        };
        let passed = collision_time.map_or(0.0, |time| self.rewind(time));
        let (elapsed, rest) = (self.elapsed() + passed, self.tick_s - passed);
        let shape = Shape { surface: &self.surface, model: &self.model, x: &self.state.x, elapsed };
        let touch = shape.touch(metric, &point, &mut self.support);
        if self.support.free_weight() < RIGID_BELOW {
            return self.respond_rigidly(touch, collision_time, q0, q1);
        }

        // 3. Deform.
        self.deform(deformation, touch, elapsed, q1);

        // 4. Force.
        let reaction = self.support.reaction(&self.state.f);
        // A NaN reaction is no tension: it goes on to the fail-safe.
        if reaction.dot(&touch.normal) <= -self.rules.adhesion_n {
            return self.keep_under_tension(point, collision_time);
        }

        // 5. Law and velocity; 6. move.
        let (mode, force) = self.rules.law.contact_force(reaction, touch.normal, self.interface());
        self.constrain_and_move(mode, touch.normal, force, rest);
        self.keep(TickReport { collision_time, ..TickReport::touching(mode, force, touch) })
    }

    /// The velocity scheme: an impulse makes the contact point follow the tip over the whole tick, without a rewind.
    fn velocity_tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        // 1. Predict.
        self.model.evaluate_forces(self.elapsed(), &mut self.state);
        self.predict();

        // 2. Detect.
        let (touch, collision_time) = match self.touch_of_whole_tick(q0, q1) {
            WholeTick::Contact(touch, collision_time) => (touch, collision_time),
            WholeTick::Over(report) => return report,
        };

        // 4. Force: −Λ/h with the impulse Λ = G⁻¹r on the mesh, G = WM⁻¹Wᵀ, r = (q₁ − p)/h − W v*.
        let r = (q1 - touch.position) / self.tick_s - self.support.velocity(&self.state.v_predicted);
        let reaction = r * (-1.0 / (self.support.scale() * self.tick_s));
        if reaction.dot(&touch.normal) <= -self.rules.adhesion_n {
            return self.keep_under_tension(touch.point, collision_time);
        }

        // 5. Law. G is a multiple of the identity, so the law turns G⁻¹r into n̂(n̂·r)/(n̂·Gn̂), and into a(−n̂ + μt̂)
        // beyond the Coulomb bound. Velocity: v ← v* + M⁻¹WᵀΛ.
        let (mode, force) = self.rules.law.contact_force(reaction, touch.normal, self.interface());
        let LocalState { x, v, v_predicted, .. } = &mut self.state;
        self.support.push(force * -self.tick_s, v_predicted);
        std::mem::swap(v, v_predicted);

        // 6. Move.
        for (x, v) in x.iter_mut().zip(v).take(self.model.patch.len()) {
            *x += *v * self.tick_s;
        }
        self.keep(TickReport { collision_time, ..TickReport::touching(mode, force, touch) })
    }

    /// The velocity scheme where an impulse moves the whole patch: v = v* + A⁻¹WᵀΛ with Λ by the law for G = WA⁻¹Wᵀ and
    /// r = (q₁ − p)/h − W v*, so that the constraint holds for the velocity at the tick's end.
    ///
    /// The integrator's own position update is x = x* + XWᵀΛ. It ends at the tip if x advances by h v. Under the
    /// midpoint rule and the exact solution the contact point misses the tip by its velocity error before the tick's
    /// end: h W(v − v₋)/2 for the midpoint rule, zero as long as the tip keeps its velocity. Constraining the mean
    /// velocity instead would leave no gap, but alternate: 2u, 0, 2u … after a jump to u. The gap is closed along XWᵀ,
    /// in the directions that the mode holds, as if the velocity at the tick's start had met the constraint too.
    fn linear_step_tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        // 1. Predict.
        self.work_left = 0.0;
        self.predict_linear_step();

        // 2. Detect.
        let (touch, collision_time) = match self.touch_of_whole_tick(q0, q1) {
            WholeTick::Contact(touch, collision_time) => (touch, collision_time),
            WholeTick::Over(report) => return report,
        };

        // 4. and 5. Force and law.
        let (n, way, h) = (touch.normal, q1 - touch.position, self.tick_s);
        let r = way / h - self.support.velocity(&self.state.v_predicted);
        let adhesion = self.rules.adhesion_n * h;
        // Without adhesion the sign of r·n̂ decides; otherwise the push that it takes does. NaN is no tension: it goes on to
        // the fail-safe.
        if adhesion == 0.0 && r.dot(&n) >= 0.0 {
            return self.keep_under_tension(touch.point, collision_time);
        }
        let [g, gx] = self.respond();
        if r.dot(&n) >= adhesion * n.dot(&(g * n)) {
            return self.keep_under_tension(touch.point, collision_time);
        }
        let Impulse { mode, value, fell_back } = self.rules.law.impulse(&g, r, n, h, self.interface());
        // An exact step whose modes turn within the tick may respond to a push in the opposite direction: then nothing
        // can be pushed.
        if value.dot(&n) >= adhesion {
            return self.keep_under_tension(touch.point, collision_time);
        }

        // 6. Move, and close the gap between the contact point and the tip.
        let held = if mode == Mode::Stick { Held::Point } else { Held::Normal(n) };
        let left = self.move_by_linear_step(held, value, &gx, way);
        self.work_left = value.dot(&left) / h;
        let force = value * (-1.0 / h);
        self.keep(TickReport { collision_time, fell_back, ..TickReport::touching(mode, force, touch) })
    }

    /// Step 1 of a model that one linear step integrates: x* and v* of a free tick.
    pub(super) fn predict_linear_step(&mut self) {
        let elapsed = self.elapsed();
        if let Some(step) = &self.model.step {
            self.model.predict(step, elapsed, &mut self.state);
        }
    }

    /// Response of a linear step to an impulse at the contact: G = WA⁻¹Wᵀ, 1/kg, and WXWᵀ, s/kg.
    pub(super) fn respond(&mut self) -> [Mat3; 2] {
        if let Some(step) = &self.model.step {
            step.respond(&self.support, &mut self.state.response);
        }
        self.state.response.at_contact(&self.support)
    }

    /// Moves the patch by a linear step and an impulse, N·s, and closes the gap that is left between the contact point and
    /// the tip along the held directions. `way` leads from the contact point to the tip, m. Returns that gap, m.
    pub(super) fn move_by_linear_step(&mut self, held: Held, impulse: Vec3, gx: &Mat3, way: Vec3) -> Vec3 {
        let LocalState { x, v_predicted, x_predicted, response, .. } = &mut self.state;
        let left = way - (self.support.velocity(x_predicted) - self.support.velocity(x)) - gx * impulse;
        let (left, closing) = match held {
            Held::Nothing => (Vec3::zeros(), Vec3::zeros()),
            Held::Point => (left, gx.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * left)),
            Held::Normal(n) => {
                let left = n.dot(&left);
                (n * left, n * (left / n.dot(&(gx * n))))
            }
        };
        response.push([impulse + closing, impulse], x_predicted, v_predicted);
        self.accept_prediction();
        left
    }

    /// State and adhesion of the touching surfaces, as the bound of friction needs them.
    fn interface(&self) -> Interface {
        let moves = |contact: Contact| matches!(contact.state, ContactState::Slip | ContactState::Slide);
        let slipped = self.contact.is_some_and(moves);
        Interface { slipped, adhesion_n: self.rules.adhesion_n }
    }

    /// A tick of a custom renderer. Checks that the contact point it reports lies on the surface.
    fn rendered_tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        let Some(renderer) = &mut self.renderer else { return self.release() };
        let triangles = self.surface.topology.triangles.len();
        let is_on_surface = |point: &ContactPoint| {
            (point.triangle as usize) < triangles && point.weights.iter().all(|weight| weight.is_finite())
        };
        let is_complete = |moved: MovedNodes| moved.nodes.len() == moved.x.len() && moved.x.len() == moved.v.len();
        let rendered = match renderer.tick(q0, q1) {
            Ok(_) if !renderer.moved().is_none_or(is_complete) => {
                self.renderer_fault =
                    Some(RendererFault("it does not give a position and a velocity for each node it moves"));
                Rendered::FREE
            }
            Ok(rendered) if rendered.contact.is_none_or(|(point, _)| is_on_surface(&point)) => rendered,
            Ok(_) => {
                self.renderer_fault = Some(RendererFault("its contact point is not on the surface"));
                Rendered::FREE
            }
            Err(fault) => {
                self.renderer_fault = Some(fault);
                Rendered::FREE
            }
        };
        let Rendered { force, mode, contact } = rendered;
        let released = self.contact.is_some() && contact.is_none();
        let state = ContactState::after(mode);
        self.contact = contact.map(|(point, _)| Contact { point, state });
        match contact {
            None => TickReport { mode, force, ..TickReport::free(released) },
            Some((point, normal)) => {
                let position = self.shape().position(&point);
                TickReport::touching(mode, force, Touch { point, position, normal })
            }
        }
    }

    /// Step 1 (11): v* = v + h M⁻¹f, x* = x + h v*.
    pub(super) fn predict(&mut self) {
        let LocalState { x, v, f, x_predicted, v_predicted, .. } = &mut self.state;
        for (i, inverse_mass) in self.model.patch.inverse_mass.iter().enumerate() {
            v_predicted[i] = v[i] + f[i] * (self.tick_s * inverse_mass);
            x_predicted[i] = x[i] + v_predicted[i] * self.tick_s;
        }
    }

    fn accept_prediction(&mut self) {
        let LocalState { x, v, x_predicted, v_predicted, .. } = &mut self.state;
        std::mem::swap(x, x_predicted);
        std::mem::swap(v, v_predicted);
    }

    /// The surface at the end of a tick without contact.
    fn predicted_shape(&self) -> Shape<'_> {
        let elapsed = self.elapsed() + self.tick_s;
        Shape { surface: &self.surface, model: &self.model, x: &self.state.x_predicted, elapsed }
    }

    /// Step 2: returns the point where the tip meets the surface in this tick; `None` if there is none.
    fn detect(&mut self, q0: Vec3, q1: Vec3) -> Option<Detected> {
        let elapsed = self.elapsed();
        let now = Shape { surface: &self.surface, model: &self.model, x: &self.state.x, elapsed };
        let predicted = Shape { x: &self.state.x_predicted, elapsed: elapsed + self.tick_s, ..now };
        let Some(Contact { point, state }) = self.contact else {
            let tested = &mut self.state.work.triangles_tested;
            let collision = match &self.surface.geometry {
                ContactGeometry::Faceted | ContactGeometry::Shaded => {
                    first_collision(&now, &predicted, q0, q1, &mut self.hits, tested)
                }
                ContactGeometry::Smooth(smooth) => {
                    let between = &mut self.state.x_between;
                    MovingSurface { smooth, start: now, end: predicted, between, q0, q1 }.first_collision(tested)
                }
            };
            return collision.map(Detected::Collision);
        };
        let found = match state {
            ContactState::Stick => Projection::Found(point),
            ContactState::Slide => now.project(&point, q1, &mut self.visited),
            // The mesh slid under a tip that stood at q₀.
            ContactState::Slip => now.project(&point, q0, &mut self.visited),
            ContactState::Tension if predicted.is_outside(q1) => return None,
            ContactState::Tension => Projection::Found(now.nearest(q0).unwrap_or(point)),
        };
        match found {
            Projection::Found(point) => Some(Detected::Contact(point)),
            Projection::OverBorder => None,
        }
    }

    /// Steps 1 and 2 of a scheme without a rewind: returns the contact at the start of the tick, or the report of a
    /// tick that is already over because the tip is free or the ground rigid.
    pub(super) fn touch_of_whole_tick(&mut self, q0: Vec3, q1: Vec3) -> WholeTick {
        let (point, collision_time) = match self.detect(q0, q1) {
            None => return WholeTick::Over(self.release()),
            Some(Detected::Contact(point)) => (point, None),
            Some(Detected::Collision(Collision { point, time })) => (point, Some(time)),
        };
        let shape = Shape { surface: &self.surface, model: &self.model, x: &self.state.x, elapsed: self.elapsed() };
        let touch = shape.touch(Metric::Mass, &point, &mut self.support);
        if self.support.free_weight() < RIGID_BELOW {
            return WholeTick::Over(self.respond_rigidly(touch, collision_time, q0, q1));
        }
        WholeTick::Contact(touch, collision_time)
    }

    /// Goes back to the time of collision, a fraction of the tick: x ← x + τ h v*, v ← v + τ h M⁻¹f. Returns τ h, s.
    fn rewind(&mut self, time: f64) -> f64 {
        let passed = time * self.tick_s;
        let LocalState { x, v, f, v_predicted, .. } = &mut self.state;
        for (i, inverse_mass) in self.model.patch.inverse_mass.iter().enumerate() {
            x[i] += v_predicted[i] * passed;
            v[i] += f[i] * (passed * inverse_mass);
        }
        self.model.evaluate_forces(self.elapsed() + passed, &mut self.state);
        passed
    }

    /// Step 3: moves the contact point to the tip (for sliding, along the normal only), and updates the forces.
    fn deform(&mut self, deformation: Deformation, touch: Touch, elapsed: f64, q1: Vec3) {
        let mut d = q1 - touch.position;
        if self.rules.law.follows_along_normal_only() {
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

    /// Steps 5 and 6 of the geometric scheme: constrains the velocities, then moves x ← x + h v over the rest of the
    /// tick.
    fn constrain_and_move(&mut self, mode: Mode, normal: Vec3, force: Vec3, rest: f64) {
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

    /// Keeps the contact after a tick in which it exerted a force.
    fn keep(&mut self, report: TickReport) -> TickReport {
        let state = ContactState::after(report.mode);
        self.contact = report.touch.map(|touch| Contact { point: touch.point, state });
        report
    }

    /// Keeps a contact that pulls at the tip: it exerts no force, and ends once the tip is outside the surface.
    fn keep_under_tension(&mut self, point: ContactPoint, collision_time: Option<f64>) -> TickReport {
        self.contact = Some(Contact { point, state: ContactState::Tension });
        self.accept_prediction();
        TickReport { collision_time, ..TickReport::free(false) }
    }

    /// Accepts the prediction, without a contact.
    fn release(&mut self) -> TickReport {
        let released = self.contact.take().is_some();
        self.accept_prediction();
        TickReport::free(released)
    }

    /// Applies the force of rigid ground, max(0, k(p − q₁)·n̂ − b q̇·n̂) n̂, without a force on the mesh, until the tip
    /// is outside.
    fn respond_rigidly(&mut self, touch: Touch, collision_time: Option<f64>, q0: Vec3, q1: Vec3) -> TickReport {
        if self.predicted_shape().is_outside(q1) {
            return self.release();
        }
        let Wall { stiffness, damping } = self.rules.wall;
        let depth = (touch.position - q1).dot(&touch.normal);
        let speed = ((q1 - q0) / self.tick_s).dot(&touch.normal);
        let push = stiffness * depth - damping * speed;
        // This form passes NaN on to the fail-safe; max(0, …) would turn it into zero.
        let push = if push <= 0.0 { 0.0 } else { push };
        self.accept_prediction();
        self.keep(TickReport {
            collision_time,
            rigid: true,
            ..TickReport::touching(Mode::Slide, touch.normal * push, touch)
        })
    }
}
