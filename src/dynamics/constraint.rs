//! What a caller may impose on the network while it is integrated.

use crate::Vec3;
use crate::model::state::State;
use crate::surface::support::Support;

/// Something imposed on the network while it is integrated.
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
