//! Constraints on the network during integration.

use crate::Vec3;
use crate::model::state::State;
use crate::surface::support::Support;

/// A constraint imposed on the network during integration.
///
/// ```
/// use stickslip::{dynamics::constraint::Constraint, dynamics::integrators::{GlobalIntegrator, Stepper}};
/// use stickslip::{Vec3, model::network::Network, model::springs::Spring, model::state::State};
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
/// assert!((state.x[1].x - 6.0).abs() < 1e-12); // at the hand,
/// assert!((state.x[2].x - 7.0).abs() < 1e-3 && (state.v[2].x - 1.0).abs() < 1e-3); // and the other node follows
/// ```
pub trait Constraint {
    /// Returns the nodes that the constraint acts on at this fraction of the step.
    fn nodes(&self, ahead: f64) -> &[u32];
    /// Makes accelerations satisfy the constraint.
    fn accelerations(&self, a: &mut [Vec3]);
    /// Makes a state satisfy the constraint, at a fraction `ahead` of the current step: 0 as the step begins, 1 as it
    /// ends.
    fn state(&self, ahead: f64, state: &mut State);
    /// Returns whether the constraint acts on each node independently of the others. Two threads share a network under
    /// such constraints only: each sees the nodes of its own half.
    fn acts_node_by_node(&self) -> bool {
        false
    }
    /// Returns the contact point that [`accelerations`](Self::accelerations) holds by its P. Without one,
    /// [`state`](Self::state) prescribes the nodes.
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

/// The absence of constraints.
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

/// A number of equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Length h of a step, s.
    pub length: f64,
    /// Number of steps.
    pub count: u32,
    /// Number of threads that share the steps.
    pub threads: Threads,
}

/// The number of threads that share a network. It changes no bit of a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// The calling thread alone.
    One,
    /// The calling thread and a second one. This takes semi-implicit Euler, a network that has
    /// [`halves`](crate::model::springs::Springs::halves), and constraints that
    /// [act node by node](Constraint::acts_node_by_node); otherwise one thread does the steps.
    Two,
}
