//! The twelve basis functions of a regular triangle: quartic box splines.

use super::combination::Jet;

/// Exponents (j, k) of the monomials v^j w^k with j + k ≤ 4, ascending in j + k.
const MONOMIALS: [(i32, i32); 15] = [
    (0, 0),
    (1, 0),
    (0, 1),
    (2, 0),
    (1, 1),
    (0, 2),
    (3, 0),
    (2, 1),
    (1, 2),
    (0, 3),
    (4, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 4),
];

/// A term of a basis function, times 12: its factor and the exponents of its three weights.
type Term = (f64, [i32; 3]);

/// Basis function of a corner with weight a, where the other two weights are b and c (Stam 1998, *Evaluation of Loop
/// subdivision surfaces*).
const CORNER: &[Term] = &[
    (6.0, [4, 0, 0]),
    (24.0, [3, 1, 0]),
    (24.0, [3, 0, 1]),
    (24.0, [2, 2, 0]),
    (60.0, [2, 1, 1]),
    (24.0, [2, 0, 2]),
    (8.0, [1, 3, 0]),
    (36.0, [1, 2, 1]),
    (36.0, [1, 1, 2]),
    (8.0, [1, 0, 3]),
    (1.0, [0, 4, 0]),
    (6.0, [0, 3, 1]),
    (12.0, [0, 2, 2]),
    (6.0, [0, 1, 3]),
    (1.0, [0, 0, 4]),
];
/// Basis function of the vertex across the edge of the corners with weights a and b.
const ACROSS: &[Term] = &[
    (1.0, [4, 0, 0]),
    (2.0, [3, 0, 1]),
    (6.0, [3, 1, 0]),
    (6.0, [2, 1, 1]),
    (12.0, [2, 2, 0]),
    (6.0, [1, 2, 1]),
    (6.0, [1, 3, 0]),
    (2.0, [0, 3, 1]),
    (1.0, [0, 4, 0]),
];
/// Basis function of a vertex that touches only the corner with weight a, on the side of b.
const BEYOND: &[Term] = &[(1.0, [4, 0, 0]), (2.0, [3, 1, 0])];

/// Kind of each vertex of [`LATTICE`](super::neighborhood::LATTICE), and the corners that act as a, b, c.
const FUNCTIONS: [(&[Term], [usize; 3]); 12] = [
    (CORNER, [0, 1, 2]),
    (CORNER, [1, 2, 0]),
    (CORNER, [2, 0, 1]),
    (ACROSS, [0, 2, 1]),
    (BEYOND, [0, 2, 1]),
    (BEYOND, [0, 1, 2]),
    (ACROSS, [0, 1, 2]),
    (BEYOND, [1, 0, 2]),
    (BEYOND, [1, 2, 0]),
    (ACROSS, [1, 2, 0]),
    (BEYOND, [2, 1, 0]),
    (BEYOND, [2, 0, 1]),
];

/// The basis functions as polynomials in the weights v and w of the second and third corner.
#[derive(Debug, Clone)]
pub struct BoxSpline {
    /// Coefficients in each function, per monomial.
    coefficients: [[f64; 12]; 15],
}

impl BoxSpline {
    /// Expands the first weight, u = 1 − v − w, into polynomials in v and w.
    pub fn new() -> Self {
        let mut coefficients = [[0.0; 12]; 15];
        for (function, (terms, roles)) in FUNCTIONS.iter().enumerate() {
            for (factor, exponents) in *terms {
                let mut powers = [0; 3];
                for (role, &exponent) in roles.iter().zip(exponents) {
                    powers[*role] = exponent;
                }
                let [pu, pv, pw] = powers;
                // (1 − v − w)^pu = Σ (−1)^(a+b) pu! / (a! b! (pu−a−b)!) v^a w^b
                for a in 0..=pu {
                    for b in 0..=pu - a {
                        let sign = if (a + b) % 2 == 0 { 1.0 } else { -1.0 };
                        let multinomial = factorial(pu) / (factorial(a) * factorial(b) * factorial(pu - a - b));
                        let place = MONOMIALS.iter().position(|&m| m == (pv + a, pw + b)).unwrap_or(0);
                        coefficients[place][function] += sign * multinomial * factor / 12.0;
                    }
                }
            }
        }
        Self { coefficients }
    }

    /// Evaluates the functions and their derivatives at weights v and w.
    pub fn evaluate(&self, v: f64, w: f64) -> Jet {
        let (v2, w2) = (v * v, w * w);
        let powers = |t: f64, t2: f64| [1.0, t, t2, t2 * t, t2 * t2];
        let (pv, pw) = (powers(v, v2), powers(w, w2));
        // d^n/dt^n t^k from the powers of t.
        let d = |p: &[f64; 5], k: i32, n: i32| match n {
            0 => p[k as usize],
            1 if k >= 1 => f64::from(k) * p[k as usize - 1],
            2 if k >= 2 => f64::from(k * (k - 1)) * p[k as usize - 2],
            _ => 0.0,
        };
        let mut columns = [[0.0; 12]; 6];
        for (&(j, k), coefficients) in MONOMIALS.iter().zip(&self.coefficients) {
            for (column, (nv, nw)) in columns.iter_mut().zip([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]) {
                let monomial = d(&pv, j, nv) * d(&pw, k, nw);
                column.iter_mut().zip(coefficients).for_each(|(sum, c)| *sum += c * monomial);
            }
        }
        let mut jet = Jet::zero(12);
        for (i, entry) in jet.entries_mut().iter_mut().enumerate() {
            *entry = std::array::from_fn(|derivative| columns[derivative][i]);
        }
        jet
    }
}

fn factorial(n: i32) -> f64 {
    (1..=n).map(f64::from).product()
}
