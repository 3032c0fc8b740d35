//! The massless scheme: the contact point follows the tip, and the instrument feels the internal forces alone.
//!
//! The velocity scheme gives the instrument the whole impulse that moves the contact point, and with it the inertia of
//! the mass m_c = (WM⁻¹Wᵀ)⁻¹ under the tip: m_c v/h at first contact, and m_c Δ/h² for an encoder count Δ. Both grow
//! without bound with the rate. Here the tip prescribes the motion along the directions that the contact holds, and the
//! instrument feels the multiplier of the internal forces without the tip's acceleration, λ = m_c WM⁻¹f, at the tick's
//! end, where the contact point is at the tip. `reference/docs/massless.md` derives the scheme and says what it loses.

use super::law::{Interface, Law, Mode};
use super::report::TickReport;
use super::simulation::LocalSimulation;
use super::state::{Contact, ContactState};
use super::tick::WholeTick;
use crate::local::model::LocalState;
use crate::surface::support::Support;
use crate::{Mat3, Vec3};

/// Directions in which the contact point moves as the tip does.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Held {
    /// There is no contact.
    #[default]
    Nothing,
    /// The contact slides or slips: only the normal n̂ is held.
    Normal(Vec3),
    /// The contact sticks.
    Point,
}

impl Held {
    /// Returns the part of a vector along the held directions.
    pub fn part(self, vector: Vec3) -> Vec3 {
        match self {
            Held::Nothing => Vec3::zeros(),
            Held::Normal(normal) => normal * normal.dot(&vector),
            Held::Point => vector,
        }
    }

    /// Returns the impulse, N·s, that adds the held part of a velocity, m/s, to a point that responds with GΛ.
    fn impulse(self, g: &Mat3, velocity: Vec3) -> Vec3 {
        match self {
            Held::Nothing => Vec3::zeros(),
            Held::Normal(n) => n * (n.dot(&velocity) / n.dot(&(g * n))),
            // A response without inverse is no response: the NaN goes on to the fail-safe.
            Held::Point => g.try_inverse().map_or(Vec3::repeat(f64::NAN), |inverse| inverse * velocity),
        }
    }

    /// Kinetic energy of the contact point along the held directions, J: ½ m_c |V|² with V the held part of its velocity,
    /// m/s. The support needs the mass metric.
    ///
    /// ```
    /// use stickslip::{Vec3, contact::massless::Held, surface::support::{Metric, Support}};
    ///
    /// let mut support = Support::with_capacity(1);
    /// support.set(Metric::Mass, [(0, 1.0, 50.0)]); // one node of 20 g
    /// let velocity = Vec3::new(0.3, 0.0, 0.4);
    /// assert!((Held::Point.kinetic(&support, velocity) - 0.5 * 0.02 * 0.25).abs() < 1e-18);
    /// assert!((Held::Normal(Vec3::z()).kinetic(&support, velocity) - 0.5 * 0.02 * 0.16).abs() < 1e-18);
    /// assert_eq!(Held::Nothing.kinetic(&support, velocity), 0.0);
    /// ```
    pub fn kinetic(self, support: &Support, velocity: Vec3) -> f64 {
        match self {
            Held::Nothing => 0.0,
            Held::Normal(_) | Held::Point => 0.5 * self.part(velocity).norm_squared() / support.scale(),
        }
    }
}

/// Energy of the contact point, whose motion the tip prescribes: the instrument does no work for its changes.
///
/// Change of the mesh's energy + dissipation − work of the instrument = `kinetic` + `exchanged`, up to the integrator's
/// error.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactEnergy {
    /// ½ m_c |q̇|² over the held directions at the end of the last tick, J; 0 without a contact.
    pub kinetic: f64,
    /// Energy that the mesh received in all changes of the held directions or of the contact point, J. The onset of
    /// contact destroys the kinetic energy that the contact point had; a release leaves the tip's in the mesh.
    pub exchanged: f64,
    /// Sum of the positive parts of `exchanged`, J.
    pub created: f64,
}

impl ContactEnergy {
    /// Accounts for a change of the held directions or of the contact point: the mesh keeps the kinetic energy of the old
    /// ones, and loses that of the new ones, `captured`, J.
    fn change(&mut self, captured: f64) {
        let received = std::mem::take(&mut self.kinetic) - captured;
        self.exchanged += received;
        if !(received <= 0.0) {
            self.created += received;
        }
    }
}

/// State of the massless scheme between ticks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MasslessMemory {
    /// Normal force F_N at the end of the last tick, N, which bounds the friction of the next; not used after tension.
    normal_force: f64,
    /// Velocity of the tip over the surface in the last tick, m/s, if a contact of [`Law::Sticking`] slid in it.
    slid: Option<Vec3>,
    /// Directions that the last tick held.
    pub(super) held: Held,
    /// Energy of the contact point along the held directions.
    pub(super) energy: ContactEnergy,
}

/// How the contact point moves in a tick, decided by its motion before.
#[derive(Debug, Clone, Copy)]
enum Motion {
    /// It follows the tip.
    Sticks,
    /// It follows the tip along the normal, without friction.
    Slides,
    /// It follows the tip along the normal, and friction drags it along the surface.
    Slips {
        /// Direction of the tip's motion over the surface.
        direction: Vec3,
        /// Force that would stop that motion within the tick, N.
        stopping: f64,
        /// Friction on the mesh, N.
        friction: f64,
    },
}

/// Velocities of the tip relative to the predicted mesh, m/s.
struct Lack {
    /// Change of the contact point's predicted velocity that takes it to the tip by the tick's end.
    r: Vec3,
    /// Velocity of the tip over the surface without friction.
    u: Vec3,
}

impl LocalSimulation {
    /// One tick: an impulse, whether it pushes or pulls, makes the contact point follow the tip along the held
    /// directions. The forces at the tick's end decide what the instrument feels, and whether the contact sticks, slips or
    /// is under tension from then on.
    pub(super) fn massless_tick(&mut self, q0: Vec3, q1: Vec3) -> TickReport {
        // 1. Predict, with the forces that the last tick ended with.
        let is_linear = self.model.step.is_some();
        if is_linear {
            self.predict_linear_step();
        } else {
            if !std::mem::take(&mut self.forces_are_current) {
                self.model.evaluate_forces(self.elapsed(), &mut self.state);
            }
            self.predict();
        }

        // 2. Detect.
        let before = self.contact.map(|contact| contact.state);
        let (touch, collision_time) = match self.touch_of_whole_tick(q0, q1) {
            WholeTick::Contact(touch, collision_time) => (touch, collision_time),
            WholeTick::Over(report) => {
                self.let_go();
                return report;
            }
        };
        let n = touch.normal;
        let [g, gx] = if is_linear { self.respond() } else { [Mat3::identity() * self.support.scale(); 2] };

        // 3. Choose the held directions by the motion of tip and surface.
        let predicted = self.support.velocity(&self.state.v_predicted);
        let over = (q1 - q0) / self.tick_s - predicted;
        let lack = Lack { r: (q1 - touch.position) / self.tick_s - predicted, u: over - n * n.dot(&over) };
        let motion = self.motion(before, &g, &lack, n);
        let (held, impulse) = match motion {
            Motion::Sticks => (Held::Point, Held::Point.impulse(&g, lack.r)),
            Motion::Slides => (Held::Normal(n), Held::Normal(n).impulse(&g, lack.r)),
            Motion::Slips { direction, friction, .. } => {
                let friction = direction * (friction * self.tick_s);
                (Held::Normal(n), Held::Normal(n).impulse(&g, lack.r - g * friction) + friction)
            }
        };
        self.massless.slid = match (self.rules.law, motion) {
            (Law::Sticking, Motion::Slides) => Some(lack.u),
            _ => None,
        };
        let captured = held.kinetic(&self.support, self.support.velocity(&self.state.v));
        self.massless.energy.change(captured);

        // 4. Move. An instrument with encoders estimates the tip's velocity better than the displacement of one tick does.
        let wanted = self.tip_velocity;
        if is_linear {
            self.move_by_linear_step(held, impulse, &gx, q1 - touch.position);
        } else {
            let LocalState { x, v, v_predicted, .. } = &mut self.state;
            self.support.push(impulse, v_predicted);
            std::mem::swap(v, v_predicted);
            for (x, v) in x.iter_mut().zip(v).take(self.model.patch.len()) {
                *x += *v * self.tick_s;
            }
        }
        if let Some(wanted) = wanted {
            let correction =
                held.impulse(&(Mat3::identity() * self.support.scale()), wanted - self.support.velocity(&self.state.v));
            self.support.push(correction, &mut self.state.v);
        }
        self.massless.energy.kinetic = held.kinetic(&self.support, self.support.velocity(&self.state.v));
        self.massless.held = held;

        // 5. Evaluate the force at the tick's end, and apply the law.
        let end = (self.latency + self.age + 1) as f64 * self.tick_s;
        self.model.place_boundary(end, &mut self.state.x);
        self.model.evaluate_forces(end, &mut self.state);
        self.forces_are_current = !is_linear;
        let reaction = self.support.reaction(&self.state.f);
        self.massless.normal_force = n.dot(&reaction);
        // A NaN reaction is no tension: it goes on to the fail-safe.
        if self.massless.normal_force <= -self.rules.adhesion_n {
            self.massless.energy.change(0.0);
            self.contact = Some(Contact { point: touch.point, state: ContactState::Tension });
            return TickReport { collision_time, ..TickReport::free(false) };
        }
        let (mode, force) = self.massless_force(motion, reaction, n);
        let state = match (mode, self.massless.slid) {
            // Under `Law::Sticking` a sliding contact is located like a slipping one, where the tip was.
            (Mode::Slide, Some(_)) => ContactState::Slip,
            (mode, _) => ContactState::after(mode),
        };
        self.contact = Some(Contact { point: touch.point, state });
        TickReport { collision_time, ..TickReport::touching(mode, force, touch) }
    }

    /// Decides whether the contact point follows the tip.
    fn motion(&self, before: Option<ContactState>, g: &Mat3, lack: &Lack, n: Vec3) -> Motion {
        let law = self.rules.law;
        if law.follows_along_normal_only() {
            return Motion::Slides;
        }
        let is_held_again = match before {
            None | Some(ContactState::Stick) => return Motion::Sticks,
            Some(ContactState::Slip) => false,
            // A contact under tension exerted no force, and that of rigid ground says nothing about friction.
            Some(ContactState::Tension | ContactState::Slide) => true,
        };
        if law == Law::Sticking {
            // It sticks at the moment at which the surface stops under the tip.
            return match self.massless.slid {
                Some(slid) if !is_held_again && !(slid.dot(&lack.u) > 0.0) => Motion::Sticks,
                _ => Motion::Slides,
            };
        }
        let speed = lack.u.norm();
        let stop = Held::Point.impulse(g, n * n.dot(&lack.r) + lack.u) / self.tick_s;
        let stopping = (stop - n * n.dot(&stop)).norm();
        let direction = if speed > 0.0 { lack.u / speed } else { Vec3::zeros() };
        let normal_force = if is_held_again { 0.0 } else { self.massless.normal_force };
        match self.friction(normal_force, direction, stopping, n) {
            None if is_held_again => Motion::Slips { direction, stopping, friction: stopping },
            None => Motion::Sticks,
            Some(friction) => Motion::Slips { direction, stopping, friction },
        }
    }

    /// Friction of a slipping contact, N; `None` if it may stop the motion within the tick, which takes the force
    /// `stopping`, N.
    fn friction(&self, normal_force: f64, direction: Vec3, stopping: f64, n: Vec3) -> Option<f64> {
        let interface = Interface { slipped: true, adhesion_n: self.rules.adhesion_n };
        match self.rules.law.contact_force(n * normal_force - direction * stopping, n, interface) {
            (Mode::Stick, _) => None,
            (_, force) => Some(-force.dot(&direction)),
        }
    }

    /// Force on the instrument at the end of a tick, N, and the mode from then on.
    fn massless_force(&self, motion: Motion, reaction: Vec3, n: Vec3) -> (Mode, Vec3) {
        let Self { rules, massless: MasslessMemory { normal_force, .. }, .. } = self;
        let interface = Interface { slipped: false, adhesion_n: rules.adhesion_n };
        match motion {
            Motion::Sticks => rules.law.contact_force(reaction, n, interface),
            Motion::Slides => Law::Sliding.contact_force(reaction, n, interface),
            // The instrument feels no more friction than what stops the slip: in a re-established contact the slip, and so
            // its direction, may be round-off.
            Motion::Slips { direction, stopping, .. } => {
                let at_end = self.friction(*normal_force, direction, stopping, n).unwrap_or(stopping);
                (Mode::Slip, n * *normal_force - direction * at_end)
            }
        }
    }

    /// Ends the contact: the kinetic energy of the contact point is left in the mesh.
    fn let_go(&mut self) {
        self.massless.energy.change(0.0);
        self.massless = MasslessMemory { energy: self.massless.energy, ..MasslessMemory::default() };
    }
}
