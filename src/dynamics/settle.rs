//! Static equilibrium of the full network under gravity: f(x, 0) = 0 by Newton's method, downhill in the energy.

use thiserror::Error;

use super::sparse::SolveError;
use super::statics::Statics;
use crate::Vec3;
use crate::model::network::Network;
use crate::model::search::breadth_first;
use crate::model::springs::TangentKind;
use crate::model::state::ExternalForce;

/// Largest force accepted on a free node, as a share of the largest weight of one.
pub const RESIDUAL: f64 = 1e-12;
/// Alternative limit of this force, as a share of the largest k L of a spring: round-off of positions.
pub const ROUND_OFF: f64 = 1e-14;
/// Iteration cap; hanging and standing networks need few iterations, buckling ones dozens.
const ITERATIONS: u32 = 200;
/// Armijo condition: a step is halved, at most [`HALVINGS`] times, until the energy falls by this share of the decrease
/// that the slope predicts.
const SUFFICIENT: f64 = 1e-4;
const HALVINGS: u32 = 40;
/// Shifts added in turn to a stabilised tangent that is singular, as shares of the largest stiffness.
const SHIFTS: [f64; 5] = [0.0, 1e-6, 1e-4, 1e-2, 1.0];

/// A reason why there is no equilibrium to start from.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum SettleError {
    /// A piece of the network has no fixed node.
    #[error("node {node} is connected to no fixed node, so it falls and never settles")]
    Floating {
        /// First node of the piece.
        node: u32,
    },
    /// The equations do not fit into memory.
    #[error("no equilibrium was computed: {0}")]
    Memory(SolveError),
    /// Newton's method does not converge.
    #[error("no equilibrium was found: a force of {residual_n:e} N remains on a node, more than {tolerance_n:e} N")]
    NotSettled {
        /// Largest remaining force, N.
        residual_n: f64,
        /// Largest force accepted, N.
        tolerance_n: f64,
    },
}

/// Finds positions at which no free node has a force on it, m, from rest. The tangent is the exact one, or the
/// stabilised one where that is not definite, so that every step goes downhill: the result is a minimum of the energy
/// or, at worst, a flat place in it.
///
/// # Errors
/// If a piece of the network has no fixed node, or no equilibrium is found.
///
/// ```
/// use stickslip::dynamics::settle::{SettleError, settle};
/// use stickslip::{model::network::Network, model::springs::Spring, model::state::ExternalForce};
/// use stickslip::Vec3;
///
/// // A mass of 1 kg hangs by a spring of 10 cm and 100 N/m.
/// let hanging = |is_held: bool| {
///     let spring = Spring { nodes: [0, 1], stiffness: 100.0, damping: 0.0, rest_length: 0.1 };
///     let (rest, gravity) = (vec![Vec3::zeros(), Vec3::z() * -0.1], ExternalForce::Gravity(Vec3::z() * -9.81));
///     Network::from_parts(rest, vec![1.0; 2], vec![is_held, false], &[spring], vec![gravity])
/// };
/// let x = settle(&hanging(true))?;
/// assert!((x[1] - Vec3::z() * (-0.1 - 9.81 / 100.0)).norm() < 1e-12); // mg/k lower
/// assert_eq!(settle(&hanging(false)), Err(SettleError::Floating { node: 0 }));
/// # Ok::<(), SettleError>(())
/// ```
pub fn settle(network: &Network) -> Result<Vec<Vec3>, SettleError> {
    if let Some(node) = floating(network) {
        return Err(SettleError::Floating { node });
    }
    let mut statics = Statics::new(network.fixed.iter().map(|&fixed| [fixed; 3]));
    let largest = |of: &mut dyn Iterator<Item = f64>| of.fold(0.0, f64::max);
    let stiffest = largest(&mut network.springs.iter().map(|spring| spring.stiffness));
    let tightest = largest(&mut network.springs.iter().map(|spring| spring.stiffness * spring.rest_length));
    let heaviest = largest(&mut network.mass.iter().zip(&network.fixed).map(|(mass, &fixed)| {
        let weight: f64 = network.external.iter().map(|force| weight(force, *mass)).sum();
        if fixed { 0.0 } else { weight }
    }));
    let tolerance_n = (RESIDUAL * heaviest).max(ROUND_OFF * tightest);

    let mut x = network.rest.clone();
    let mut residual = Residual::at(network, &statics, &x);
    for _ in 0..ITERATIONS {
        if residual.largest <= tolerance_n && tolerance_n.is_finite() {
            return Ok(x);
        }
        let tangents = std::iter::once((TangentKind::Exact, 0.0))
            .chain(SHIFTS.map(|share| (TangentKind::Stabilised, share * stiffest)));
        let mut step = None;
        for (kind, shift) in tangents {
            match statics.displacements(network, &x, kind, shift, &residual.force) {
                Ok(found) => step = Some(found),
                Err(SolveError::Singular) => continue,
                Err(error @ SolveError::OutOfMemory { .. }) => return Err(SettleError::Memory(error)),
            }
            break;
        }
        let Some(step) = step else { break };
        // The direction is downhill, since the matrix is definite.
        let slope: f64 = residual.force.iter().zip(&step).map(|(force, step)| -force.dot(step)).sum();
        let mut share = 1.0;
        let next = (0..HALVINGS).find_map(|_| {
            let trial: Vec<Vec3> = x.iter().zip(&step).map(|(x, step)| x + step * share).collect();
            let at = Residual::at(network, &statics, &trial);
            // Near the minimum, round-off hides which energy is lower; the forces still decrease.
            let falls = at.energy <= residual.energy + SUFFICIENT * share * slope;
            let level = at.energy <= residual.energy + ROUND_OFF * residual.size && at.largest < residual.largest;
            share *= 0.5;
            (falls || level).then_some((trial, at))
        });
        let Some((trial, at)) = next else { break };
        (x, residual) = (trial, at);
    }
    Err(SettleError::NotSettled { residual_n: residual.largest, tolerance_n })
}

/// Returns the weight |m g|, N.
fn weight(force: &ExternalForce, mass: f64) -> f64 {
    match force {
        ExternalForce::Gravity(g) => mass * g.norm(),
        ExternalForce::Drag(_) => 0.0,
    }
}

/// Finds a free node from which no fixed one is reached along springs.
fn floating(network: &Network) -> Option<u32> {
    let fixed = (0..).zip(&network.fixed).filter(|(_, is)| **is).map(|(node, _)| node);
    let (_, is_held) = breadth_first(network.node_count(), fixed, u32::MAX, |node| network.neighbours(node));
    (0..).zip(is_held).find(|(_, is)| !is).map(|(node, _)| node)
}

/// Forces on free nodes, and the energy of which they are the negative gradient.
struct Residual {
    force: Vec<Vec3>,
    /// Largest force, N; NaN is kept.
    largest: f64,
    /// Energy of springs and gravity relative to rest, J.
    energy: f64,
    /// Sum of the magnitudes of the energy's terms, J: the scale of its round-off.
    size: f64,
}

impl Residual {
    fn at(network: &Network, statics: &Statics, x: &[Vec3]) -> Self {
        let still = vec![Vec3::zeros(); x.len()];
        let mut force = still.clone();
        network.forces(x, &still, &mut force);
        statics.free_part(&mut force);
        let larger = |a: f64, b: f64| if b <= a || a.is_nan() { a } else { b };
        let largest = force.iter().map(Vec3::norm).fold(0.0, larger);
        let elastic = network.springs.elastic_energy(x);
        let fallen = |force: &ExternalForce| -> f64 {
            let nodes = network.mass.iter().zip(x).zip(&network.rest);
            nodes.map(|((mass, x), rest)| force.potential(*mass, &(x - rest))).sum()
        };
        let gravity: f64 = network.external.iter().map(fallen).sum();
        Self { force, largest, energy: elastic + gravity, size: elastic + gravity.abs() }
    }
}
