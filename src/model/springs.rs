//! Damped springs: forces, Jacobians, energy, dissipation.
//!
//! Between nodes i and j with d = x_j − x_i, ℓ = |d|, u = d/ℓ, ω = v_j − v_i:
//! f_i = \[k(ℓ − L) + c(ω·u)\] u and f_j = −f_i.

use crate::{Mat3, Vec3};

/// Added to ℓ² so that a spring of no length has a direction of zero, hence no force, instead of
/// NaN. Below half an ulp of ℓ² for every spring longer than 1e-7 m: there it changes no bit.
const LENGTH_SQUARED_FLOOR: f64 = 1e-30;

/// One spring, as a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// The two nodes.
    pub nodes: [u32; 2],
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// L, m.
    pub rest_length: f64,
}

/// Many springs, one array per quantity, grouped by their lower node: a force sweep keeps that
/// node in registers and reads parameters in order. The order also fixes the order of summation,
/// and with it the bits of the result.
#[derive(Debug, Clone, Default)]
pub struct Springs {
    /// Springs of lower node i are `row[i]..row[i + 1]`.
    row: Vec<u32>,
    upper: Vec<u32>,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
    rest_length: Vec<f64>,
    /// Whether any spring has a damper; without, the damping term is not computed.
    damped: bool,
}

/// How the geometric part of the elastic Jacobian is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TangentKind {
    /// As it is: a compressed spring pushes sideways, and K may be indefinite.
    Exact,
    /// With 1 − L/ℓ clamped at zero, so that the elastic K stays negative semidefinite.
    Stabilised,
}

impl Springs {
    /// Sorts springs over nodes `0..node_count`.
    pub fn new(node_count: usize, springs: &[Spring]) -> Self {
        let mut sorted: Vec<Spring> = springs
            .iter()
            .map(|spring| {
                let [i, j] = spring.nodes;
                Spring { nodes: [i.min(j), i.max(j)], ..*spring }
            })
            .collect();
        sorted.sort_by_key(|spring| spring.nodes);
        let mut row = vec![0; node_count + 1];
        for spring in &sorted {
            row[spring.nodes[0] as usize + 1] += 1;
        }
        for i in 1..row.len() {
            row[i] += row[i - 1];
        }
        Self {
            row,
            upper: sorted.iter().map(|s| s.nodes[1]).collect(),
            stiffness: sorted.iter().map(|s| s.stiffness).collect(),
            damping: sorted.iter().map(|s| s.damping).collect(),
            rest_length: sorted.iter().map(|s| s.rest_length).collect(),
            damped: sorted.iter().any(|s| s.damping != 0.0),
        }
    }

    /// Number of springs.
    pub fn len(&self) -> usize {
        self.upper.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.upper.is_empty()
    }

    /// Whether any spring has a damper.
    pub fn is_damped(&self) -> bool {
        self.damped
    }

    /// Every spring in the order of summation.
    pub fn iter(&self) -> impl Iterator<Item = Spring> + '_ {
        self.rows().flat_map(move |(i, range)| {
            range.map(move |s| Spring {
                nodes: [i as u32, self.upper[s]],
                stiffness: self.stiffness[s],
                damping: self.damping[s],
                rest_length: self.rest_length[s],
            })
        })
    }

    fn rows(&self) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + '_ {
        self.row.windows(2).enumerate().map(|(i, row)| (i, row[0] as usize..row[1] as usize))
    }

    /// Adds every spring's force on its two nodes, N.
    pub fn add_forces(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        if self.damped { self.sweep::<true>(x, v, f) } else { self.sweep::<false>(x, v, f) }
    }

    fn sweep<const DAMPED: bool>(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        for (i, range) in self.rows() {
            if range.is_empty() {
                continue;
            }
            let (xi, vi) = (x[i], v[i]);
            let mut fi = Vec3::zeros();
            // Zipped slices: no bounds check is left but those of the upper node.
            let parameters = self.stiffness[range.clone()]
                .iter()
                .zip(&self.damping[range.clone()])
                .zip(&self.rest_length[range.clone()])
                .zip(&self.upper[range]);
            for (((&k, &c), &rest), &upper) in parameters {
                let j = upper as usize;
                let d = x[j] - xi;
                let length = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
                let u = d * (1.0 / length);
                let mut tension = k * (length - rest);
                if DAMPED {
                    tension += c * (v[j] - vi).dot(&u);
                }
                let force = u * tension;
                fi += force;
                f[j] -= force;
            }
            f[i] += fi;
        }
    }

    /// ½ Σ k(ℓ − L)², J.
    pub fn elastic_energy(&self, x: &[Vec3]) -> f64 {
        self.iter()
            .map(|s| {
                let d = x[s.nodes[1] as usize] - x[s.nodes[0] as usize];
                let stretch = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt() - s.rest_length;
                0.5 * s.stiffness * stretch * stretch
            })
            .sum()
    }

    /// Power the dampers take out, Σ c(ω·u)² ≥ 0, W.
    pub fn damper_power(&self, x: &[Vec3], v: &[Vec3]) -> f64 {
        if !self.damped {
            return 0.0;
        }
        self.iter()
            .map(|s| {
                let [i, j] = s.nodes.map(|node| node as usize);
                let d = x[j] - x[i];
                let rate = (v[j] - v[i]).dot(&d) / (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
                s.damping * rate * rate
            })
            .sum()
    }
}

impl Spring {
    /// (∂f_i/∂d, ∂f_i/∂ω) of (4), with Π = I − uuᵀ:
    /// k\[uuᵀ + (1 − L/ℓ)Π\] + c\[u(Πω)ᵀ + (ω·u)Π\]/ℓ and c uuᵀ.
    ///
    /// The damping part of the first is not symmetric. By the chain rule ∂f_i/∂x_j is the first
    /// block itself, ∂f_i/∂x_i its negative, and f_j's are the negatives of f_i's.
    pub fn jacobian(&self, d: Vec3, omega: Vec3, kind: TangentKind) -> (Mat3, Mat3) {
        let length = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
        let u = d * (1.0 / length);
        let uu = u * u.transpose();
        let across = Mat3::identity() - uu;
        let stretch = 1.0 - self.rest_length / length;
        let geometric = match kind {
            TangentKind::Exact => stretch,
            TangentKind::Stabilised => stretch.max(0.0),
        };
        let elastic = (uu + across * geometric) * self.stiffness;
        let damping = (u * (across * omega).transpose() + across * omega.dot(&u)) * (self.damping / length);
        (elastic + damping, uu * self.damping)
    }
}
