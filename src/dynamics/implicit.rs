//! Implicit Euler of the whole network: v = v₋ + hM⁻¹f(x₋ + hv, v) by Newton's method, with a sparse LU factorisation
//! of A = M − hD − h²K. K is not symmetric, since its damping part is not.

use faer::prelude::Solve;
use faer::sparse::linalg::solvers::{Lu, SymbolicLu};
use faer::sparse::{SparseColMat, Triplet};
use thiserror::Error;

use super::constraint::Constraint;
use super::sparse::SolveError;
use crate::model::network::Network;
use crate::model::springs::{TangentKind, spring_blocks};
use crate::model::state::{ExternalForce, State};
use crate::{Mat3, Vec3};

/// Convergence limit: the last change of velocities as a share of the largest speed. Newton's method squares it, so
/// that the remaining error is round-off.
const CONVERGED: f64 = 1e-10;
/// Share of the largest coordinate below which a change of position over the step is round-off of the forces.
const ROUND_OFF: f64 = 1e-14;
/// Iteration cap, far above the need of a step that has a solution nearby.
const ITERATIONS: u32 = 60;
/// Largest number of halvings of a change until the residual falls.
const HALVINGS: u32 = 10;
/// Marks a node that is not solved for.
const GIVEN: usize = usize::MAX;

/// A step that was not solved.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum NotSolved {
    /// Newton's method does not converge.
    #[error("implicit Euler of the network did not converge: velocities still change by {change:e} m/s")]
    NotConverged {
        /// Last change of velocity, m/s.
        change: f64,
    },
    /// The linear equations have no solution.
    #[error("implicit Euler of the network has no solution: {0}")]
    Equations(#[from] SolveError),
}

/// Newton's method for one network.
///
/// ```
/// use stickslip::{dynamics::constraint::Unconstrained, dynamics::implicit::Newton};
/// use stickslip::{Vec3, model::network::Network, model::springs::Spring};
///
/// // m = 1 kg on k = 10⁶ N/m, stretched by 1 mm: an explicit step of 0.1 s would be fifty times too long.
/// let spring = Spring { nodes: [0, 1], stiffness: 1e6, damping: 0.0, rest_length: 1.0 };
/// let rest = vec![Vec3::zeros(), Vec3::x()];
/// let network = Network::from_parts(rest, vec![1.0; 2], vec![true, false], &[spring], vec![]);
/// let mut state = network.rest_state();
/// state.x[1].x = 1.001;
/// let h = 0.1;
/// Newton::default().step(&network, &mut state, h, &Unconstrained)?;
/// let speed = -h * 1e6 * 0.001 / (1.0 + h * h * 1e6);
/// assert!((state.v[1].x - speed).abs() < 1e-9);
/// assert!((state.x[1].x - (1.001 + h * speed)).abs() < 1e-9);
/// # Ok::<(), stickslip::dynamics::implicit::NotSolved>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Newton {
    /// Index of each node among the unknowns, or [`GIVEN`].
    number: Vec<usize>,
    /// Elimination order of these unknowns.
    symbolic: Option<SymbolicLu<usize>>,
    f: Vec<Vec3>,
    start: State,
    /// The residual M(v − v₋) − hf, then the change of v.
    change: Vec<Vec3>,
}

impl Newton {
    /// Does one step of length h. Returns the number of evaluations of the network's forces.
    ///
    /// # Errors
    /// If the iterations do not converge, or the linear equations have no solution or do not fit into memory.
    pub fn step(
        &mut self,
        network: &Network,
        state: &mut State,
        h: f64,
        constraint: &impl Constraint,
    ) -> Result<u64, NotSolved> {
        constraint.state(0.0, state);
        self.start.clone_from(state);
        constraint.state(1.0, state);
        let prescribed = if constraint.held().is_none() { constraint.nodes(1.0) } else { &[] };
        self.choose(network, prescribed);
        self.f.resize(network.node_count(), Vec3::zeros());
        self.change.resize(network.node_count(), Vec3::zeros());

        let mut evaluations = 1;
        let mut residual = self.residual(network, state, h, constraint);
        let mut size = f64::INFINITY;
        for _ in 0..ITERATIONS {
            size = self.solve(network, state, h, constraint)?;
            let before = residual;
            let full = self.change.clone();
            let from = state.v.clone();
            let mut share = 1.0;
            for _ in 0..=HALVINGS {
                for ((v, from), change) in state.v.iter_mut().zip(&from).zip(&full) {
                    *v = from + change * share;
                }
                residual = self.residual(network, state, h, constraint);
                evaluations += 1;
                if residual < before {
                    break;
                }
                share *= 0.5;
            }
            let fastest = state.v.iter().map(|v| v.amax()).fold(0.0, f64::max);
            let furthest = state.x.iter().map(|x| x.amax()).fold(0.0, f64::max);
            if size <= CONVERGED * fastest + ROUND_OFF * furthest / h {
                return Ok(evaluations);
            }
        }
        Err(NotSolved::NotConverged { change: size })
    }

    /// Numbers the nodes that are neither fixed nor prescribed.
    fn choose(&mut self, network: &Network, prescribed: &[u32]) {
        let mut number = vec![0; network.node_count()];
        prescribed.iter().for_each(|&node| number[node as usize] = GIVEN);
        let mut next = 0;
        for (number, &inverse_mass) in number.iter_mut().zip(&network.inverse_mass) {
            if inverse_mass == 0.0 || *number == GIVEN {
                *number = GIVEN;
            } else {
                *number = next;
                next += 1;
            }
        }
        if number != self.number {
            (self.number, self.symbolic) = (number, None);
        }
    }

    fn unknowns(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.number.iter().copied().enumerate().filter(|&(_, number)| number != GIVEN)
    }

    /// Sets x = x₋ + hv and the residual M(v − v₋) − hf there. Returns the norm of the part of M⁻¹ times the residual
    /// that the constraint admits, m/s.
    fn residual(&mut self, network: &Network, state: &mut State, h: f64, constraint: &impl Constraint) -> f64 {
        for (x, ((start, v), number)) in state.x.iter_mut().zip(self.start.x.iter().zip(&state.v).zip(&self.number)) {
            if *number != GIVEN {
                *x = start + v * h;
            }
        }
        network.forces(&state.x, &state.v, &mut self.f);
        let velocities = state.v.iter().zip(&self.start.v);
        for (node, ((residual, f), (v, start))) in self.change.iter_mut().zip(&self.f).zip(velocities).enumerate() {
            let given = self.number[node] == GIVEN;
            *residual = if given { Vec3::zeros() } else { (v - start) * network.mass[node] - f * h };
        }
        let mut free: Vec<Vec3> = self.change.iter().zip(&network.inverse_mass).map(|(r, w)| r * *w).collect();
        constraint.accelerations(&mut free);
        free.iter().map(Vec3::norm_squared).sum::<f64>().sqrt()
    }

    /// Solves for the change of v from the residual. Returns its largest component.
    ///
    /// Under P = I − gW/s the change obeys Wδ = 0 and Aδ = −ρ + Mgν: both parts are solved for, then ν.
    ///
    /// # Errors
    /// If A is singular or its factor does not fit into memory.
    fn solve(
        &mut self,
        network: &Network,
        state: &State,
        h: f64,
        constraint: &impl Constraint,
    ) -> Result<f64, SolveError> {
        let count = 3 * self.unknowns().count();
        if count == 0 {
            return Ok(0.0);
        }
        let matrix = self.matrix(network, state, h, count)?;
        let symbolic = match &self.symbolic {
            Some(symbolic) => symbolic.clone(),
            None => SymbolicLu::try_new(matrix.symbolic()).map_err(|error| SolveError::of_memory(error, count))?,
        };
        self.symbolic = Some(symbolic.clone());
        let lu =
            Lu::try_new_with_symbolic(symbolic, matrix.as_ref()).map_err(|error| SolveError::of_lu(error, count))?;

        let held = constraint.held();
        let mut rhs = faer::Mat::<f64>::zeros(count, if held.is_some() { 4 } else { 1 });
        for (node, number) in self.unknowns() {
            (0..3).for_each(|axis| rhs[(3 * number + axis, 0)] = -self.change[node][axis]);
        }
        for node in held.iter().flat_map(|support| support.nodes()) {
            let row = 3 * self.number[node.slot];
            (0..3).for_each(|axis| rhs[(row + axis, 1 + axis)] = network.mass[node.slot] * node.response());
        }
        lu.solve_in_place(rhs.as_mut());
        let at = |column: usize, number: usize| Vec3::from_fn(|axis, _| rhs[(3 * number + axis, column)]);
        let force = match held {
            None => Vec3::zeros(),
            Some(support) => {
                let of = |column: usize| -> Vec3 {
                    support.nodes().iter().map(|node| at(column, self.number[node.slot]) * node.weight).sum()
                };
                let held = Mat3::from_columns(&[of(1), of(2), of(3)]).try_inverse();
                held.ok_or(SolveError::Singular)? * -of(0)
            }
        };
        let mut largest = 0.0_f64;
        let mut change = std::mem::take(&mut self.change);
        for (node, number) in self.unknowns() {
            change[node] = at(0, number);
            if held.is_some() {
                change[node] += at(1, number) * force.x + at(2, number) * force.y + at(3, number) * force.z;
            }
            // `max` alone would pass over NaN.
            largest = if change[node].iter().all(|c| c.is_finite()) {
                largest.max(change[node].amax())
            } else {
                f64::INFINITY
            };
        }
        self.change = change;
        if largest.is_finite() { Ok(largest) } else { Err(SolveError::Singular) }
    }

    /// A = M − hD − h²K over the nodes that are solved for.
    fn matrix(
        &self,
        network: &Network,
        state: &State,
        h: f64,
        count: usize,
    ) -> Result<SparseColMat<usize, f64>, SolveError> {
        let mut triplets = Vec::with_capacity(9 * (self.number.len() + 4 * network.springs.len()));
        let mut add = |row: usize, column: usize, block: Mat3| {
            for (a, b) in (0..9).map(|i| (i / 3, i % 3)) {
                triplets.push(Triplet::new(3 * row + a, 3 * column + b, block[(a, b)]));
            }
        };
        let drag: f64 = network
            .external
            .iter()
            .map(|force| match force {
                ExternalForce::Drag(b) => *b,
                ExternalForce::Gravity(_) => 0.0,
            })
            .sum();
        for (node, number) in self.unknowns() {
            add(number, number, Mat3::identity() * (network.mass[node] + h * drag));
        }
        for spring in network.springs.iter() {
            let [i, j] = spring.nodes.map(|node| node as usize);
            let (k, d) = spring.jacobian(state.x[j] - state.x[i], state.v[j] - state.v[i], TangentKind::Exact);
            let block = (k * h + d) * h;
            for (row, column, sign) in spring_blocks([self.number[i], self.number[j]]) {
                if row != GIVEN && column != GIVEN {
                    add(row, column, block * sign);
                }
            }
        }
        SparseColMat::try_new_from_triplets(count, count, &triplets)
            .map_err(|error| SolveError::of_creation(error, count))
    }
}
