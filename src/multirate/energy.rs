//! The energy balance of a run: work of the instrument, stored energy, dissipated energy.

use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::massless::ContactEnergy;
use crate::contact::report::TickReport;
use crate::contact::simulation::LocalSimulation;

/// A slip shorter than this share of the tip's way is round-off: 1e6 ulps of a displacement of 10 µm at 0.1 m.
const HELD: f64 = 1e-9;

/// Energies of the local model's nodes and springs, and accumulated work and losses, J.
///
/// The geometric scheme moves nodes without work, so its energy balance does not close: [`residual`] is the energy
/// residual. Changes of the stored energy are counted within ticks; the change due to the exchange of the model at a
/// hand-over is omitted.
///
/// [`residual`]: EnergyBalance::residual
///
/// ```
/// use stickslip::{Vec3, contact::rules::Scheme, multirate::energy::EnergyBalance, pipeline::Simulation, scene::Scene};
///
/// let mut scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// scene.contact.scheme = Scheme::Velocity; // the scheme whose energy balance closes
/// let mut local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let mut balance = EnergyBalance::new(0.0);
/// balance.take_stock(&local);
/// let mut tip = Vec3::new(-0.03, 0.0013, 0.0005);
/// for _ in 0..100 {
///     let next = tip - Vec3::z() * 1e-5; // 10 mm/s
///     let report = local.tick(tip, next);
///     balance.add_tick(&local, &report, tip, next, scene.tick_s());
///     tip = next;
/// }
/// assert!(balance.work > 0.0 && balance.elastic > 0.0 && balance.damping_loss > 0.0);
/// assert!(balance.residual().abs() < 0.05 * balance.absolute_work);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct EnergyBalance {
    /// Kinetic energy ½ Σ m v², J.
    pub kinetic: f64,
    /// Elastic energy ½ Σ k(ℓ − L)², J.
    pub elastic: f64,
    /// Gravitational energy −Σ m g·x, J.
    pub gravitational: f64,
    /// Work of the instrument, −Σ f·(q₁ − q₀), J.
    pub work: f64,
    /// Sum of the magnitudes of the work, Σ |f·(q₁ − q₀)|, J.
    pub absolute_work: f64,
    /// Energy dissipated by dampers and drag, trapezoidal over a tick, J.
    pub damping_loss: f64,
    /// Energy dissipated by slipping, −f·(displacement of the tip − displacement of the contact point), J.
    pub friction_loss: f64,
    /// Energy dissipated by impacts, J: ½ Δvᵀ M Δv of every tick of the velocity scheme; under the massless one without
    /// the held velocity of the contact point. Where the tip meets the mesh,
    /// or changes its speed at once, masses start or stop inelastically; elsewhere the loss vanishes with the step.
    pub impact_loss: f64,
    /// Change of kinetic, elastic and gravitational energy within ticks, J.
    pub stored: f64,
    /// Energy of the contact point that the massless scheme holds, and what it exchanged with the mesh; zero under the
    /// other schemes.
    pub contact: ContactEnergy,
    /// Ticks in which friction pushed the tip along its motion over the surface.
    pub friction_assist_ticks: u64,
    /// Energy that friction gave to the instrument in those ticks, J.
    pub friction_assist: f64,
    power: f64,
    /// Potential energy of the fixed nodes, J.
    ground: f64,
}

impl EnergyBalance {
    /// Creates an empty balance; `ground` is the potential energy of fixed nodes to include, J.
    pub fn new(ground: f64) -> Self {
        Self { ground, ..Self::default() }
    }

    /// Records the energies of a model that has just come into use.
    pub fn take_stock(&mut self, local: &LocalSimulation) {
        let (model, state) = (local.model(), local.state());
        self.kinetic = model.kinetic_energy(&state.v);
        self.elastic = model.elastic_energy(&state.x);
        self.gravitational = self.ground + model.gravitational_energy(&state.x);
        self.power = model.dissipated_power(&state.x, &state.v);
    }

    /// Adds a tick of `tick_s` seconds that has just been completed.
    pub fn add_tick(&mut self, local: &LocalSimulation, report: &TickReport, q0: Vec3, q1: Vec3, tick_s: f64) {
        let (before, power_before) = (self.total(), self.power);
        self.take_stock(local);
        self.stored += self.total() - before;
        self.damping_loss += 0.5 * (power_before + self.power) * tick_s;
        self.impact_loss += local.impact_loss();
        let work = -report.force.dot(&(q1 - q0));
        self.work += work;
        self.absolute_work += work.abs();
        if let (Mode::Slip, Some(touch)) = (report.mode, report.touch) {
            let way = local.shape().position(&touch.point) - touch.position;
            let friction = report.force - touch.normal * report.normal_force;
            let over = (q1 - q0) - way;
            let loss = -friction.dot(&over);
            self.friction_loss += loss;
            // A contact that was held until the tick's end moved by round-off.
            if loss < 0.0 && over.norm() > HELD * (q1 - q0).norm() {
                self.friction_assist_ticks += 1;
                self.friction_assist -= loss;
            }
        }
        self.contact = local.contact_energy();
    }

    /// Returns whether every energy of the balance is finite.
    pub fn is_finite(&self) -> bool {
        self.total().is_finite() && self.residual().is_finite() && self.absolute_work.is_finite()
    }

    fn total(&self) -> f64 {
        self.kinetic + self.elastic + self.gravitational
    }

    /// Returns the energy residual: work − stored − dissipated, J. What the massless scheme moves without work is added
    /// to the work: the held contact point's kinetic energy, and what the mesh received from it.
    pub fn residual(&self) -> f64 {
        let of_tip = self.work - self.stored - self.damping_loss - self.friction_loss - self.impact_loss;
        of_tip + (self.contact.kinetic + self.contact.exchanged)
    }
}
