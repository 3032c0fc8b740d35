//! Time steps of the whole network under a constraint of the caller.

use super::constraint::{Constraint, Steps, Threads};
use super::explicit::{Worker, run_by_two};
use super::implicit::{Newton, NotSolved};
use super::rk4::Rk4;
use crate::model::network::Network;
use crate::model::state::{State, snap_to_rest};
use crate::word::words;

/// Integrators of the full network between boundaries.
///
/// ```
/// use stickslip::{dynamics::constraint::Unconstrained, dynamics::integrators::{GlobalIntegrator, Stepper}};
/// use stickslip::{Vec3, model::network::Network, model::springs::Spring};
///
/// // ω = 1 rad/s, amplitude 1: E = ½. Which share of it is left after 100 steps of 0.1 s?
/// let spring = Spring { nodes: [0, 1], stiffness: 1.0, damping: 0.0, rest_length: 2.0 };
/// let rest = vec![Vec3::zeros(), Vec3::x() * 2.0];
/// let network = Network::from_parts(rest, vec![1.0; 2], vec![true, false], &[spring], vec![]);
/// let left = |integrator: GlobalIntegrator| {
///     let (mut state, mut stepper) = (network.rest_state(), Stepper::new(&network));
///     state.x[1].x = 3.0;
///     (0..100).for_each(|_| stepper.step(integrator, &network, &mut state, 0.1, &Unconstrained));
///     assert!(stepper.failure().is_none(), "{}", integrator.name());
///     let energy = 0.5 * state.v[1].norm_squared() + network.springs.elastic_energy(&state.x);
///     (energy / 0.5, stepper.evaluations())
/// };
/// assert!((left(GlobalIntegrator::ImplicitEuler).0 * 1.01_f64.powi(100) - 1.0).abs() < 1e-6); // (1 + h²)⁻ⁿ
/// assert!((left(GlobalIntegrator::SemiImplicitEuler).0 - 1.0).abs() < 0.1); // oscillates about it without decay
/// let (rk4, evaluations) = left(GlobalIntegrator::Rk4);
/// assert!((rk4 - 1.0).abs() < 1e-4 && evaluations == 400);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum GlobalIntegrator {
    /// (11): v ← v + h M⁻¹f, x ← x + h v. First order, symplectic without damping.
    #[default]
    SemiImplicitEuler,
    /// v ← v + h M⁻¹f(x + hv, v) with the new v, x ← x + h v. First order, stable at every step, dissipative.
    ImplicitEuler,
    /// The classical fourth-order Runge–Kutta method.
    Rk4,
}

words!(GlobalIntegrator { SemiImplicitEuler = "semi-implicit-euler", ImplicitEuler = "implicit-euler", Rk4 = "rk4" });

/// Integrator of one network, with the scratch of its stages.
///
/// ```
/// use stickslip::{dynamics::constraint::Unconstrained, dynamics::integrators::{GlobalIntegrator, Stepper}};
/// use stickslip::{Vec3, model::network::Network, model::springs::Spring};
///
/// // A mass on a spring, stretched by 1: x(t) = 2 + cos t.
/// let spring = Spring { nodes: [0, 1], stiffness: 1.0, damping: 0.0, rest_length: 2.0 };
/// let network = Network::from_parts(vec![Vec3::zeros(), Vec3::x() * 2.0], vec![1.0; 2], vec![true, false], &[spring], vec![]);
/// let mut state = network.rest_state();
/// state.x[1].x = 3.0;
/// let mut stepper = Stepper::new(&network);
/// for _ in 0..1000 {
///     stepper.step(GlobalIntegrator::Rk4, &network, &mut state, 1e-3, &Unconstrained);
/// }
/// assert!((state.x[1].x - (2.0 + 1.0_f64.cos())).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct Stepper {
    worker: Worker,
    /// Scratch of the second thread, once there is one.
    second: Option<Box<Worker>>,
    rk4: Rk4,
    /// Number of evaluations of the network's forces so far.
    evaluations: u64,
    newton: Newton,
    /// First step that was not solved. No step is done after it.
    failure: Option<NotSolved>,
}

impl Stepper {
    /// Creates an integrator for networks of this size.
    pub fn new(network: &Network) -> Self {
        Self {
            worker: Worker::new(network),
            second: None,
            rk4: Rk4::default(),
            evaluations: 0,
            newton: Newton::default(),
            failure: None,
        }
    }

    /// Returns the number of evaluations of a network's forces so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Returns the implicit step that could not be solved, if there is one.
    pub fn failure(&self) -> Option<NotSolved> {
        self.failure
    }

    /// Does one step of length h. Fixed nodes do not move.
    pub fn step(
        &mut self,
        integrator: GlobalIntegrator,
        network: &Network,
        state: &mut State,
        h: f64,
        constraint: &impl Constraint,
    ) {
        match integrator {
            GlobalIntegrator::SemiImplicitEuler => {
                let steps = Steps { length: h, count: 1, threads: Threads::One };
                self.semi_implicit_euler(network, state, steps, |_| constraint);
            }
            GlobalIntegrator::ImplicitEuler if self.failure.is_some() => {}
            GlobalIntegrator::ImplicitEuler => match self.newton.step(network, state, h, constraint) {
                Ok(evaluations) => self.evaluations += evaluations,
                Err(error) => self.failure = Some(error),
            },
            GlobalIntegrator::Rk4 => self.evaluations += self.rk4.step(network, state, h, constraint),
        }
        snap_to_rest(&mut state.v);
    }

    /// Does steps under a constraint for each; equal to single steps to the last bit, and faster.
    pub fn steps<C: Constraint>(
        &mut self,
        integrator: GlobalIntegrator,
        network: &Network,
        state: &mut State,
        steps: Steps,
        constraint: impl Fn(u32) -> C + Sync,
    ) {
        match (integrator, steps.threads) {
            (GlobalIntegrator::SemiImplicitEuler, Threads::Two) => self.by_two(network, state, steps, constraint),
            (GlobalIntegrator::SemiImplicitEuler, Threads::One) => {
                self.semi_implicit_euler(network, state, steps, constraint);
            }
            (GlobalIntegrator::ImplicitEuler | GlobalIntegrator::Rk4, _) => {
                (0..steps.count)
                    .for_each(|step| self.step(integrator, network, state, steps.length, &constraint(step)));
            }
        }
    }

    /// Evaluates forces at the start, then moves positions by the new velocities.
    fn semi_implicit_euler<C: Constraint>(
        &mut self,
        network: &Network,
        state: &mut State,
        steps: Steps,
        constraint: impl Fn(u32) -> C,
    ) {
        self.evaluations += u64::from(steps.count);
        self.worker.run(network, state, steps, constraint);
    }

    fn by_two<C: Constraint>(
        &mut self,
        network: &Network,
        state: &mut State,
        steps: Steps,
        constraint: impl Fn(u32) -> C + Sync,
    ) {
        if let Some(halves) = network.springs.halves()
            && (0..steps.count).all(|step| constraint(step).acts_node_by_node())
        {
            let second = self.second.get_or_insert_with(|| Box::new(Worker::new(network)));
            if run_by_two([&mut self.worker, second], network, halves, state, steps, &constraint) {
                self.evaluations += u64::from(steps.count);
                return;
            }
        }
        self.semi_implicit_euler(network, state, steps, constraint);
    }
}
