//! The constraint operators as the paper writes them: T, U₀, U by Gram–Schmidt (7)–(8), (16)–(18), their inverses, and
//! the 3m × 3m matrices (10), (13), (19), (21). They are never on the servo path: tests compare the [closed
//! form](crate::surface::support) with them.

use nalgebra::{DMatrix, DVector};

use crate::Vec3;
use crate::surface::support::Metric;

/// A contact point over all m nodes of a model: weights (zero outside the support and for fixed nodes), masses and the
/// normal.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::contact::literal::ContactFrame;
/// use stickslip::surface::support::{Metric, Support};
///
/// let weights = [0.5, 0.3, 0.2, 0.0];
/// let metric = Metric::Euclidean;
/// let frame = ContactFrame { weights: weights.to_vec(), mass: vec![0.01; 4], normal: Vec3::z(), metric };
/// let operators = frame.operators(&[]).expect("a node carries weight");
/// let (p, q) = (&operators.p, &operators.q);
/// assert!((p * p - p).amax() < 1e-14 && (q * q - q).amax() < 1e-14); // projectors
/// assert!((p.trace() - 9.0).abs() < 1e-14); // three of 12 degrees of freedom are constrained,
/// assert!((q.trace() - 11.0).abs() < 1e-14); // or one of them
/// let identity = nalgebra::DMatrix::identity(12, 12);
/// assert!((&operators.p_tilde + p.transpose() - identity).amax() < 1e-14); // P̃ = 1 − Pᵀ
///
/// // The closed form gives the same velocities.
/// let mut v = [Vec3::x(), Vec3::y(), Vec3::z(), Vec3::x()];
/// let held = p * nalgebra::DVector::from_iterator(12, v.iter().flat_map(|v| [v.x, v.y, v.z]));
/// let mut support = Support::with_capacity(4);
/// support.set(metric, weights.iter().enumerate().map(|(slot, &weight)| (slot, weight, 100.0)));
/// support.project_sticking(&mut v);
/// assert!((0..12).all(|i| (held[i] - v[i / 3][i % 3]).abs() < 1e-14));
/// ```
#[derive(Debug, Clone)]
pub struct ContactFrame {
    /// Weights wᵢ, one per node.
    pub weights: Vec<f64>,
    /// Masses, kg, one per node.
    pub mass: Vec<f64>,
    /// Outward unit normal n̂.
    pub normal: Vec3,
    /// Inner product of the Gram–Schmidt completion.
    pub metric: Metric,
}

/// The operators P, Q, P̃, Q̃, each 3m × 3m.
#[derive(Debug, Clone)]
pub struct LiteralOperators {
    /// P (10).
    pub p: DMatrix<f64>,
    /// Q (19).
    pub q: DMatrix<f64>,
    /// P̃ (13).
    pub p_tilde: DMatrix<f64>,
    /// Q̃ (21).
    pub q_tilde: DMatrix<f64>,
}

/// Candidates whose part orthogonal to the rows found so far is below this share of their length are skipped: they add
/// no direction.
const DEPENDENT: f64 = 1e-6;

impl ContactFrame {
    /// Builds the operators, with the empty rows of T and U₀ completed from `candidates` (3m-vectors in any order), and
    /// from the unit vectors where these do not suffice. P and Q do not depend on the completion.
    ///
    /// Returns `None` if T or U cannot be inverted, as when no node carries weight.
    pub fn operators(&self, candidates: &[DVector<f64>]) -> Option<LiteralOperators> {
        let dof = 3 * self.weights.len();
        let t = self.t(candidates);
        let mut u11 = DMatrix::identity(dof, dof);
        u11.view_mut((0, 0), (3, 3)).copy_from(&self.u0());
        let u = u11 * &t;
        let (t_inverse, u_inverse) = (t.clone().try_inverse()?, u.clone().try_inverse()?);
        let keep = |first: usize| DMatrix::from_fn(dof, dof, |i, j| if i == j && i >= first { 1.0 } else { 0.0 });
        let drop = |first: usize| DMatrix::from_fn(dof, dof, |i, j| if i == j && i < first { 1.0 } else { 0.0 });
        Some(LiteralOperators {
            p: &t_inverse * keep(3) * &t,
            q: &u_inverse * keep(1) * &u,
            p_tilde: t.transpose() * drop(3) * t_inverse.transpose(),
            q_tilde: u.transpose() * drop(1) * u_inverse.transpose(),
        })
    }

    /// T of (8): first the rows of W, not normalised, then rows orthogonal to them in the inner product of the metric's
    /// dual (M⁻¹ for the mass metric), not normalised either.
    fn t(&self, candidates: &[DVector<f64>]) -> DMatrix<f64> {
        let dof = 3 * self.weights.len();
        let dual: DVector<f64> = DVector::from_fn(dof, |i, _| match self.metric {
            Metric::Euclidean => 1.0,
            Metric::Mass => 1.0 / self.mass[i / 3],
        });
        let inner = |a: &DVector<f64>, b: &DVector<f64>| a.component_mul(&dual).dot(b);
        let mut rows: Vec<DVector<f64>> = (0..3)
            .map(|axis| DVector::from_fn(dof, |i, _| if i % 3 == axis { self.weights[i / 3] } else { 0.0 }))
            .collect();
        let units = (0..dof).map(|i| DVector::from_fn(dof, |j, _| f64::from(u8::from(i == j))));
        for candidate in candidates.iter().cloned().chain(units) {
            if rows.len() == dof {
                break;
            }
            let length = inner(&candidate, &candidate).sqrt();
            let mut row = candidate;
            // Two passes are enough: the second removes the round-off of the first.
            for _ in 0..2 {
                for other in &rows {
                    row -= other * (inner(&row, other) / inner(other, other));
                }
            }
            if inner(&row, &row).sqrt() > DEPENDENT * length {
                rows.push(row);
            }
        }
        DMatrix::from_fn(dof, dof, |i, j| rows.get(i).map_or(0.0, |row| row[j]))
    }

    /// U₀ of (16): n̂ and two directions perpendicular to it.
    fn u0(&self) -> nalgebra::Matrix3<f64> {
        let n = self.normal;
        let mut across = Vec3::zeros();
        across[n.iamin()] = 1.0;
        let a = (across - n * n.dot(&across)).normalize();
        nalgebra::Matrix3::from_rows(&[n.transpose(), a.transpose(), n.cross(&a).transpose()])
    }
}
