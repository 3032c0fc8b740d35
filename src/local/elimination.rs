//! Elimination of the first part of a sparse symmetric system: a nested-dissection order, and the Schur complement from
//! the trailing block of faer's factor.
//!
//! Unknowns come in *points* of three. The points to be eliminated are ordered first, those kept last; the trailing
//! block of the factor of \[E B; Bᵀ −σI\] is then that of −(σI + BᵀE⁻¹B), without a solve. The kept block −σI makes the
//! matrix quasi-definite wherever E is positive definite: LDLᵀ exists in every order, and the signs of D over E are the
//! inertia of E.

use std::sync::Arc;

use faer::Par;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::SymbolicSupernodalParams;
use faer::sparse::linalg::cholesky::simplicial::{
    prefactorize_symbolic_cholesky, prefactorize_symbolic_cholesky_scratch,
};
use faer::sparse::linalg::cholesky::supernodal::{
    SupernodalLdltRef, SymbolicSupernodalCholesky, factorize_supernodal_numeric_ldlt,
    factorize_supernodal_numeric_ldlt_scratch, factorize_supernodal_symbolic_cholesky,
    factorize_supernodal_symbolic_cholesky_scratch,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use nalgebra::DMatrix;

use crate::{Mat3, Vec3};

/// Pivots of E of at most this share of the stiffness scale count as zero. Round-off leaves 1e-15 times the growth of
/// the elimination; the softest relevant exterior, a million springs in a row, has 1e-6.
const ZERO_PIVOT: f64 = 1e-12;

/// Sets of fewer points than this are not divided further: their part of the factor is all but dense.
const LEAF: usize = 24;

/// The exterior block has no Cholesky factor: it is indefinite or singular.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotDefinite;

/// Place of a 3 × 3 block among the values: its first entry, and the step to the next column.
#[derive(Debug, Clone, Copy)]
pub struct BlockPlace {
    first: usize,
    column_step: usize,
}

/// The coupled points of each point.
///
/// ```
/// use stickslip::local::elimination::Couplings;
///
/// let chain = Couplings::new(4, [[0, 1], [2, 1], [2, 3], [3, 2]].into_iter());
/// assert_eq!((chain.of(0), chain.of(1), chain.of(2)), (&[1][..], &[0, 2][..], &[1, 3][..]));
/// ```
#[derive(Debug, Clone)]
pub struct Couplings {
    start: Vec<usize>,
    others: Vec<u32>,
}

impl Couplings {
    /// Builds the couplings from pairs in any order and number, each seen from both ends.
    pub fn new(points: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let key = |from: u32, to: u32| u64::from(from) << 32 | u64::from(to);
        let mut entries: Vec<u64> = pairs.flat_map(|[a, b]| [key(a, b), key(b, a)]).collect();
        entries.sort_unstable();
        entries.dedup();
        let mut start = vec![0; points + 1];
        entries.iter().for_each(|entry| start[(entry >> 32) as usize + 1] += 1);
        for i in 0..points {
            start[i + 1] += start[i];
        }
        Self { start, others: entries.into_iter().map(|entry| entry as u32).collect() }
    }

    /// Returns the points coupled to one, ascending.
    pub fn of(&self, point: u32) -> &[u32] {
        &self.others[self.start[point as usize]..self.start[point as usize + 1]]
    }
}

/// The part of the elimination that depends only on the pattern.
///
/// ```
/// use stickslip::{Mat3, local::elimination::{Elimination, NotDefinite}};
///
/// // Springs in a row, wall –k₁– point 0 –k₂– point 1: eliminating 0 leaves BᵀE⁻¹B = k₂²/(k₁ + k₂).
/// let (k1, k2) = (100.0, 300.0);
/// let elimination = Elimination::new(1, 1, [[0, 1]].into_iter());
/// let schur = |own: f64, between: f64| {
///     let mut values = vec![0.0; elimination.values_len()];
///     elimination.place(0, 0).add(&(Mat3::identity() * own), &mut values);
///     elimination.place(1, 0).add(&(Mat3::identity() * between), &mut values);
///     elimination.schur(&mut values, own.abs(), &mut Vec::new())
/// };
/// let c = schur(k1 + k2, -k2).expect("it is definite");
/// assert!((c - nalgebra::DMatrix::identity(3, 3) * (k2 * k2 / (k1 + k2))).amax() < 1e-9);
/// assert_eq!(schur(-1.0, -k2), Err(NotDefinite)); // negative stiffness
/// assert!(elimination.cost().entries > 0);
/// ```
#[derive(Debug, Clone)]
pub struct Elimination {
    /// Numbers of points eliminated and points kept.
    eliminated: usize,
    kept: usize,
    /// Block rows of each block column, in both triangles: the symbolic phase reads the upper and the numeric phase the
    /// lower one. Values are written only to the lower.
    blocks: Couplings,
    pattern: Arc<SymbolicSparseColMat<usize>>,
    symbolic: Arc<SymbolicSupernodalCholesky<usize>>,
}

/// Cost of a factorisation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FactorCost {
    /// Number of entries of the factor.
    pub entries: u64,
    /// Number of multiply–adds.
    pub multiply_adds: u64,
}

impl Elimination {
    /// Analyses a pattern: `pairs` are the coupled points, numbered in the order of elimination; the first `eliminated`
    /// are eliminated, the last `kept` are kept.
    pub fn new(eliminated: usize, kept: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let points = eliminated + kept;
        let diagonal = (0..points as u32).map(|point| [point; 2]);
        let blocks = Couplings::new(points, pairs.chain(diagonal));
        let n = 3 * points;
        let mut column_start = Vec::with_capacity(n + 1);
        let mut rows = Vec::with_capacity(9 * blocks.others.len());
        column_start.push(0);
        for column in 0..n as u32 {
            for &row in blocks.of(column / 3) {
                rows.extend((0..3).map(|k| 3 * row as usize + k));
            }
            column_start.push(rows.len());
        }
        let pattern = SymbolicSparseColMat::new_checked(n, n, column_start, None, rows);
        let symbolic = analyse(&pattern);
        Self { eliminated, kept, blocks, pattern: Arc::new(pattern), symbolic: Arc::new(symbolic) }
    }

    /// Length of the values of the matrix.
    pub fn values_len(&self) -> usize {
        9 * self.blocks.others.len()
    }

    /// Returns the place of the block of a coupled pair of points; `row` is not before `column`.
    pub fn place(&self, row: u32, column: u32) -> BlockPlace {
        let rows = self.blocks.of(column);
        let at = rows.partition_point(|&other| other < row);
        BlockPlace { first: 9 * self.blocks.start[column as usize] + 3 * at, column_step: 3 * rows.len() }
    }

    /// Returns the cost of the factorisation.
    pub fn cost(&self) -> FactorCost {
        let symbolic = &self.symbolic;
        let mut multiply_adds = 0;
        for s in 0..symbolic.n_supernodes() {
            let columns = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
            let rows = columns + symbolic.supernode(s).pattern().len();
            multiply_adds += (0..columns).map(|column| ((rows - column) as u64).pow(2)).sum::<u64>() / 2;
        }
        FactorCost { entries: symbolic.len_val() as u64, multiply_adds }
    }

    /// Computes BᵀE⁻¹B for a matrix of [`values_len`](Self::values_len) values, in which the kept block is zero and
    /// entries are of the order of `scale`. `factor` is a workspace that grows as needed.
    ///
    /// # Errors
    /// If E is not positive definite.
    pub fn schur(&self, values: &mut [f64], scale: f64, factor: &mut Vec<f64>) -> Result<DMatrix<f64>, NotDefinite> {
        for point in self.eliminated..self.eliminated + self.kept {
            let place = self.place(point as u32, point as u32);
            for k in 0..3 {
                values[place.first + k * place.column_step + k] = -scale;
            }
        }
        factor.resize(self.symbolic.len_val(), 0.0);
        // One thread: with several, sums would depend on their number.
        let scratch =
            factorize_supernodal_numeric_ldlt_scratch::<usize, f64>(&self.symbolic, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        factorize_supernodal_numeric_ldlt(
            factor,
            SparseColMatRef::new(self.pattern.as_ref().as_ref(), values),
            LdltRegularization::default(),
            &self.symbolic,
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|_| NotDefinite)?;
        self.trailing(SupernodalLdltRef::new(&self.symbolic, factor), scale)
    }

    /// Checks from the factor that E is definite, and computes BᵀE⁻¹B from L|D|Lᵀ − σI of the kept block.
    fn trailing(&self, factor: SupernodalLdltRef<usize, f64>, scale: f64) -> Result<DMatrix<f64>, NotDefinite> {
        let first_kept = 3 * self.eliminated;
        let mut root = DMatrix::zeros(3 * self.kept, 3 * self.kept);
        for s in 0..self.symbolic.n_supernodes() {
            let supernode = factor.supernode(s);
            let (start, values) = (supernode.start(), supernode.val());
            for column in 0..values.ncols() {
                let pivot = values[(column, column)];
                if start + column < first_kept {
                    if !(pivot > ZERO_PIVOT * scale) {
                        return Err(NotDefinite);
                    }
                    continue;
                }
                // The matrix is quasi-definite: after a definite E the pivots of the kept block are negative.
                let stretch = (-pivot).sqrt();
                let at = start + column - first_kept;
                root[(at, at)] = stretch;
                for row in column + 1..values.ncols() {
                    root[(start + row - first_kept, at)] = values[(row, column)] * stretch;
                }
                for (below, &row) in supernode.pattern().iter().enumerate() {
                    root[(row - first_kept, at)] = values[(values.ncols() + below, column)] * stretch;
                }
            }
        }
        let mut schur = &root * root.transpose();
        schur.fill_upper_triangle_with_lower_triangle();
        for i in 0..schur.nrows() {
            schur[(i, i)] -= scale;
        }
        Ok(schur)
    }
}

impl BlockPlace {
    /// Adds the values of a block.
    pub fn add(&self, block: &Mat3, values: &mut [f64]) {
        for column in 0..3 {
            let at = self.first + column * self.column_step;
            for (value, entry) in values[at..at + 3].iter_mut().zip(block.column(column).iter()) {
                *value += entry;
            }
        }
    }
}

fn analyse(pattern: &SymbolicSparseColMat<usize>) -> SymbolicSupernodalCholesky<usize> {
    let n = pattern.nrows();
    let mut parents = vec![0_isize; n];
    let mut counts = vec![0_usize; n];
    let scratch = prefactorize_symbolic_cholesky_scratch::<usize>(n, pattern.compute_nnz())
        .or(factorize_supernodal_symbolic_cholesky_scratch::<usize>(n));
    let mut memory = MemBuffer::new(scratch);
    let tree = prefactorize_symbolic_cholesky(&mut parents, &mut counts, pattern.as_ref(), MemStack::new(&mut memory));
    let params = SymbolicSupernodalParams::default();
    factorize_supernodal_symbolic_cholesky(pattern.as_ref(), tree, &counts, MemStack::new(&mut memory), params)
        .expect("the scene was checked to fit the memory, and 2⁶³ indices do not overflow")
}

/// Returns an order of elimination that keeps the factor sparse: points are divided in two along their longest axis by
/// a layer of points, which comes last, and both halves are ordered likewise.
///
/// ```
/// use stickslip::{Vec3, local::elimination::{Couplings, Elimination, nested_dissection}};
///
/// // A sheet of 60 × 60 points.
/// let points: Vec<Vec3> = (0..3600).map(|i| Vec3::new(f64::from(i % 60), f64::from(i / 60), 0.0)).collect();
/// let along = (0..3600_u32).filter(|i| i % 60 < 59).map(|i| [i, i + 1]);
/// let pairs: Vec<[u32; 2]> = along.chain((0..3540).map(|i| [i, i + 60])).collect();
/// let order = nested_dissection(&points, &Couplings::new(3600, pairs.iter().copied()));
/// let mut number = vec![u32::MAX; 3600];
/// (0..).zip(&order).for_each(|(at, &point)| number[point as usize] = at);
/// assert!(number.iter().all(|&at| at < 3600)); // every point once
///
/// // This order takes less work than row by row.
/// let reordered = pairs.iter().map(|pair| pair.map(|point| number[point as usize]));
/// let by_rows = Elimination::new(3600, 0, pairs.iter().copied()).cost();
/// assert!(Elimination::new(3600, 0, reordered).cost().multiply_adds < by_rows.multiply_adds);
/// ```
pub fn nested_dissection(positions: &[Vec3], couplings: &Couplings) -> Vec<u32> {
    let count = positions.len();
    let mut points: Vec<u32> = (0..count as u32).collect();
    let mut dissection =
        Dissection { positions, couplings, in_first: vec![false; count], order: Vec::with_capacity(count) };
    dissection.divide(&mut points);
    dissection.order
}

struct Dissection<'a> {
    positions: &'a [Vec3],
    couplings: &'a Couplings,
    in_first: Vec<bool>,
    order: Vec<u32>,
}

impl Dissection<'_> {
    fn divide(&mut self, points: &mut [u32]) {
        let cut = if points.len() > LEAF { self.sort_and_cut(points) } else { 0 };
        if cut == 0 {
            self.order.extend_from_slice(points);
            return;
        }
        let (first, second) = points.split_at_mut(cut);
        first.iter().for_each(|&point| self.in_first[point as usize] = true);
        let touches_first = |point: u32| self.couplings.of(point).iter().any(|&other| self.in_first[other as usize]);
        let (layer, mut rest): (Vec<u32>, Vec<u32>) = second.iter().partition(|&&point| touches_first(point));
        first.iter().for_each(|&point| self.in_first[point as usize] = false);
        self.divide(first);
        self.divide(&mut rest);
        self.order.extend_from_slice(&layer);
    }

    /// Sorts along the longest axis and cuts near the middle, but not through points of one coordinate: on a lattice
    /// that would make the layer two deep. Returns 0 if there is no cut.
    fn sort_and_cut(&self, points: &mut [u32]) -> usize {
        let at = |point: u32| self.positions[point as usize];
        let (low, high) = points
            .iter()
            .fold((at(points[0]), at(points[0])), |(low, high), &point| (low.inf(&at(point)), high.sup(&at(point))));
        let axis = (high - low).imax();
        points.sort_unstable_by(|&a, &b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(&b)));
        let middle = at(points[points.len() / 2])[axis];
        match points.partition_point(|&point| at(point)[axis] < middle) {
            0 => points.partition_point(|&point| at(point)[axis] <= middle) % points.len(),
            cut => cut,
        }
    }
}
