//! Linear statics of a network: displacements under loads, by a sparse Cholesky factorisation of −∂f/∂x.

use faer::Side;
use faer::prelude::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMat, Triplet};

use super::sparse::SolveError;
use crate::model::network::Network;
use crate::model::springs::{TangentKind, spring_blocks};
use crate::{Mat3, Vec3};

/// Marks a component that is held.
const HELD: usize = usize::MAX;

/// The components of displacements that are solved for, and their elimination order.
///
/// ```
/// use stickslip::dynamics::statics::Statics;
/// use stickslip::model::{network::Network, springs::{Spring, TangentKind}};
/// use stickslip::Vec3;
///
/// // A bead on an upright spring of 100 N/m that may move along it only.
/// let spring = Spring { nodes: [0, 1], stiffness: 100.0, damping: 0.0, rest_length: 0.1 };
/// let rest = vec![Vec3::zeros(), Vec3::z() * 0.1];
/// let network = Network::from_parts(rest, vec![0.01; 2], vec![true, false], &[spring], vec![]);
/// let mut statics = Statics::new([[true; 3], [true, true, false]]);
/// let mut load = [Vec3::zeros(), Vec3::new(1.0, 0.0, -2.0)];
/// statics.free_part(&mut load);
/// assert_eq!(load[1], Vec3::z() * -2.0); // the support takes the rest
/// let u = statics.displacements(&network, &network.rest, TangentKind::Exact, 0.0, &load).expect("it resists");
/// assert!((u[1] - Vec3::z() * -0.02).norm() < 1e-15); // F/k
/// ```
#[derive(Debug, Clone)]
pub struct Statics {
    /// Index of each node's x, y and z among the unknowns, or [`HELD`].
    number: Vec<[usize; 3]>,
    unknowns: usize,
    symbolic: Option<SymbolicLlt<usize>>,
}

impl Statics {
    /// Prepares nodes whose components are held (`true`) or free.
    pub fn new(held: impl IntoIterator<Item = [bool; 3]>) -> Self {
        let mut unknowns = 0;
        let mut take = |held: bool| {
            if held {
                return HELD;
            }
            unknowns += 1;
            unknowns - 1
        };
        let number = held.into_iter().map(|node| node.map(&mut take)).collect();
        Self { number, unknowns, symbolic: None }
    }

    /// Sets the held components of a vector for each node to zero.
    pub fn free_part(&self, vectors: &mut [Vec3]) {
        for (vector, number) in vectors.iter_mut().zip(&self.number) {
            (0..3).filter(|&axis| number[axis] == HELD).for_each(|axis| vector[axis] = 0.0);
        }
    }

    /// Returns u with (−∂f/∂x + shift) u = load over the free components, m, from loads in N and a shift in N/m; zero
    /// where components are held.
    ///
    /// # Errors
    /// If the matrix is not positive definite, the result is not finite, or the factor does not fit into memory.
    pub fn displacements(
        &mut self,
        network: &Network,
        x: &[Vec3],
        kind: TangentKind,
        shift: f64,
        load: &[Vec3],
    ) -> Result<Vec<Vec3>, SolveError> {
        let mut u = vec![Vec3::zeros(); x.len()];
        if self.unknowns == 0 {
            return Ok(u);
        }
        let matrix = self.matrix(network, x, kind, shift)?;
        let symbolic = match &self.symbolic {
            Some(symbolic) => symbolic.clone(),
            None => SymbolicLlt::try_new(matrix.symbolic(), Side::Lower)
                .map_err(|error| SolveError::of_memory(error, self.unknowns))?,
        };
        self.symbolic = Some(symbolic.clone());
        let factor = Llt::try_new_with_symbolic(symbolic, matrix.as_ref(), Side::Lower)
            .map_err(|error| SolveError::of_llt(error, self.unknowns))?;
        let mut column = faer::Mat::<f64>::zeros(self.unknowns, 1);
        let places = || self.number.iter().enumerate().flat_map(|(node, of)| (0..3).map(move |a| (node, a, of[a])));
        places().filter(|place| place.2 != HELD).for_each(|(node, axis, i)| column[(i, 0)] = load[node][axis]);
        factor.solve_in_place(column.as_mut());
        places().filter(|place| place.2 != HELD).for_each(|(node, axis, i)| u[node][axis] = column[(i, 0)]);
        if u.iter().flat_map(|u| u.iter()).all(|u| u.is_finite()) { Ok(u) } else { Err(SolveError::Singular) }
    }

    fn matrix(
        &self,
        network: &Network,
        x: &[Vec3],
        kind: TangentKind,
        shift: f64,
    ) -> Result<SparseColMat<usize, f64>, SolveError> {
        let mut triplets = Vec::with_capacity(self.unknowns + 24 * network.springs.len());
        for number in &self.number {
            for &i in number.iter().filter(|&&i| i != HELD) {
                triplets.push(Triplet::new(i, i, shift));
            }
        }
        // Only the lower triangle is read.
        let mut add = |rows: [usize; 3], columns: [usize; 3], block: &Mat3, sign: f64| {
            for (a, b) in (0..9).map(|i| (i / 3, i % 3)) {
                if rows[a] != HELD && columns[b] != HELD && rows[a] >= columns[b] {
                    triplets.push(Triplet::new(rows[a], columns[b], sign * block[(a, b)]));
                }
            }
        };
        for spring in network.springs.iter() {
            let [i, j] = spring.nodes.map(|node| node as usize);
            let (block, _) = spring.jacobian(x[j] - x[i], Vec3::zeros(), kind);
            let blocks = spring_blocks([self.number[i], self.number[j]]);
            blocks.into_iter().for_each(|(row, column, sign)| add(row, column, &block, sign));
        }
        SparseColMat::try_new_from_triplets(self.unknowns, self.unknowns, &triplets)
            .map_err(|error| SolveError::of_creation(error, self.unknowns))
    }
}
