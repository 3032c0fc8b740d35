//! Steps of the whole network under a constraint that the caller imposes.

use super::explicit::{Worker, run_by_two};
use super::implicit::{Newton, NotSolved};
use crate::Vec3;
use crate::contact::operators::Support;
use crate::model::network::{Network, State, snap_to_rest};
use crate::word::words;

/// How the full model is integrated between boundaries.
///
/// ```
/// use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper, Unconstrained};
/// use stickslip::{Vec3, model::network::Network, model::springs::Spring};
///
/// // ω = 1 rad/s, amplitude 1: E = ½. How much of it is left after 100 steps of 0.1 s?
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
/// assert!((left(GlobalIntegrator::SemiImplicitEuler).0 - 1.0).abs() < 0.1); // swings about it, for ever
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

/// Something imposed on the network while it is integrated.
///
/// ```
/// use stickslip::dynamics::integrators::{Constraint, GlobalIntegrator, Stepper};
/// use stickslip::{Vec3, model::network::{Network, State}, model::springs::Spring};
///
/// /// A hand that leads node 1 along x with 1 m/s.
/// struct Led {
///     since: f64,
///     h: f64,
/// }
/// impl Constraint for Led {
///     fn nodes(&self, _: f64) -> &[u32] {
///         &[1]
///     }
///     fn accelerations(&self, a: &mut [Vec3]) {
///         a[1] = Vec3::zeros();
///     }
///     fn state(&self, ahead: f64, state: &mut State) {
///         state.x[1] = Vec3::x() * (1.0 + self.since + ahead * self.h);
///         state.v[1] = Vec3::x();
///     }
/// }
/// let spring = |i, j| Spring { nodes: [i, j], stiffness: 10.0, damping: 1.0, rest_length: 1.0 };
/// let rest = vec![Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0];
/// let springs = [spring(0, 1), spring(1, 2)];
/// let network = Network::from_parts(rest, vec![0.1; 3], vec![true, false, false], &springs, vec![]);
/// let (mut state, mut stepper, h) = (network.rest_state(), Stepper::new(&network), 0.01);
/// for step in 0..500 {
///     let led = Led { since: f64::from(step) * h, h };
///     stepper.step(GlobalIntegrator::Rk4, &network, &mut state, h, &led);
/// }
/// assert!((state.x[1].x - 6.0).abs() < 1e-12); // where the hand is,
/// assert!((state.x[2].x - 7.0).abs() < 1e-3 && (state.v[2].x - 1.0).abs() < 1e-3); // and the other node follows
/// ```
pub trait Constraint {
    /// The nodes that it acts on at this fraction of the step. It looks at no others.
    fn nodes(&self, ahead: f64) -> &[u32];
    /// Makes accelerations respect it.
    fn accelerations(&self, a: &mut [Vec3]);
    /// Makes a state respect it, at a fraction `ahead` of the step that is being done: 0 as the step
    /// begins, 1 as it ends.
    fn state(&self, ahead: f64, state: &mut State);
    /// Whether it does with each node what it does, whatever the others do. Two threads share a network under such
    /// constraints only: each sees the nodes of its own half.
    fn acts_node_by_node(&self) -> bool {
        false
    }
    /// The contact point that [`accelerations`](Self::accelerations) holds by its P; without one,
    /// [`state`](Self::state) puts its nodes where it wants them.
    fn held(&self) -> Option<&Support> {
        None
    }
}

impl<C: Constraint> Constraint for &C {
    fn nodes(&self, ahead: f64) -> &[u32] {
        (**self).nodes(ahead)
    }
    fn accelerations(&self, a: &mut [Vec3]) {
        (**self).accelerations(a);
    }
    fn state(&self, ahead: f64, state: &mut State) {
        (**self).state(ahead, state);
    }
    fn acts_node_by_node(&self) -> bool {
        (**self).acts_node_by_node()
    }
    fn held(&self) -> Option<&Support> {
        (**self).held()
    }
}

/// The free network.
#[derive(Debug, Clone, Copy)]
pub struct Unconstrained;

impl Constraint for Unconstrained {
    fn nodes(&self, _: f64) -> &[u32] {
        &[]
    }
    fn acts_node_by_node(&self) -> bool {
        true
    }
    fn accelerations(&self, _: &mut [Vec3]) {}
    fn state(&self, _: f64, _: &mut State) {}
}

/// Equal steps, one after the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// h, s.
    pub length: f64,
    /// How many.
    pub count: u32,
    /// Who does them.
    pub threads: Threads,
}

/// Threads that share a network. They change no bit of a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// The one that calls.
    One,
    /// That and another. Only semi-implicit Euler of a network that has
    /// [`halves`](crate::model::springs::Springs::halves), under constraints that
    /// [act node by node](Constraint::acts_node_by_node): else one.
    Two,
}

/// Integrates one network; holds the arrays that stages need.
///
/// ```
/// use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper, Unconstrained};
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
    /// The second thread's, from the first time that there is one.
    second: Option<Box<Worker>>,
    f: Vec<Vec3>,
    stage: State,
    sum: State,
    /// Evaluations of the network's forces so far.
    evaluations: u64,
    newton: Newton,
    /// The first step that was not solved. No step is done after it.
    failure: Option<NotSolved>,
}

impl Stepper {
    /// For networks of this size.
    pub fn new(network: &Network) -> Self {
        let zeros = vec![Vec3::zeros(); network.node_count()];
        let state = State { x: zeros.clone(), v: zeros.clone() };
        Self {
            worker: Worker::new(network),
            second: None,
            f: zeros,
            stage: state.clone(),
            sum: state,
            evaluations: 0,
            newton: Newton::default(),
            failure: None,
        }
    }

    /// How often it evaluated a network's forces.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Why an implicit step was not done, if one was not.
    pub fn failure(&self) -> Option<NotSolved> {
        self.failure
    }

    /// One step of length h. Fixed nodes do not move.
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
            GlobalIntegrator::Rk4 => self.rk4(network, state, h, constraint),
        }
        snap_to_rest(&mut state.v);
    }

    /// Steps under a constraint of each; the same to the last bit as one by one, and quicker.
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

    /// Forces at the start, then positions by the new velocities.
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

    fn rk4(&mut self, network: &Network, state: &mut State, h: f64, constraint: &impl Constraint) {
        // (how far the stage looks ahead, its weight)
        const STAGES: [(f64, f64); 4] = [(0.0, 1.0 / 6.0), (0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0)];
        constraint.state(0.0, state);
        self.sum.clone_from(state);
        self.stage.clone_from(state);
        for (i, (ahead, weight)) in STAGES.into_iter().enumerate() {
            if i > 0 {
                // self.stage.v and self.f still hold the slope of the stage before.
                for ((x, v), start) in self.stage.x.iter_mut().zip(&self.stage.v).zip(&state.x) {
                    *x = start + v * (ahead * h);
                }
                for ((v, a), start) in self.stage.v.iter_mut().zip(&self.f).zip(&state.v) {
                    *v = start + a * (ahead * h);
                }
                constraint.state(ahead, &mut self.stage);
            }
            network.forces(&self.stage.x, &self.stage.v, &mut self.f);
            self.evaluations += 1;
            accelerate(network, &mut self.f);
            constraint.accelerations(&mut self.f);
            add_scaled(&mut self.sum.x, &self.stage.v, weight * h);
            add_scaled(&mut self.sum.v, &self.f, weight * h);
        }
        std::mem::swap(state, &mut self.sum);
        constraint.state(1.0, state);
    }
}

/// a = M⁻¹f.
fn accelerate(network: &Network, f: &mut [Vec3]) {
    f.iter_mut().zip(&network.inverse_mass).for_each(|(f, w)| *f *= *w);
}

fn add_scaled(to: &mut [Vec3], from: &[Vec3], scale: f64) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from * scale);
}
