//! The constraint operators in closed form, applied to the support nodes of a contact point only.
//!
//! With gᵢ = wᵢ (Euclidean) or wᵢ/mᵢ (mass metric) and s = Σ wᵢgᵢ over the free support nodes:
//!
//! - (10) P v = v − g (W v)/s and (13) P̃ f = Wᵀλ with λ = Σ gᵢfᵢ / s,
//! - (19) Q v = v − g n̂ (n̂·W v)/s and (21) Q̃ f = Wᵀ(λ·n̂)n̂.
//!
//! [`literal`](crate::contact::literal) builds the operators as the paper writes them; property tests compare the two.

use crate::Vec3;
use crate::word::words;

/// The inner product in which P and Q are orthogonal projectors.
///
/// ```
/// use stickslip::{Vec3, surface::support::{Metric, Support}};
///
/// // Two nodes of 1 kg and 10 g that share the contact point. Only the light one moves.
/// let inverse_mass = [1.0, 100.0];
/// let energy_after = |metric| {
///     let mut support = Support::with_capacity(2);
///     support.set(metric, [(0, 0.5, inverse_mass[0]), (1, 0.5, inverse_mass[1])]);
///     let mut v = [Vec3::zeros(), Vec3::x()];
///     support.project_sticking(&mut v);
///     0.5 * (v[0].norm_squared() / inverse_mass[0] + v[1].norm_squared() / inverse_mass[1])
/// };
/// let before = 0.5 * 0.01;
/// assert!(energy_after(Metric::Mass) < before); // as an inelastic impact should
/// assert!(energy_after(Metric::Euclidean) > 10.0 * before);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Metric {
    /// The paper's inner product. With unequal masses P can raise kinetic energy, and λ is not the Lagrange multiplier
    /// of the constraint.
    #[default]
    Euclidean,
    /// ⟨a, b⟩ = aᵀM b, equivalent to the Euclidean one for equal masses.
    Mass,
}

words!(Metric { Euclidean = "euclidean", Mass = "mass" });

/// A free node that carries part of the contact point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportNode {
    /// Index of the node in the arrays that the operators are applied to.
    pub slot: usize,
    /// Weight wᵢ.
    pub weight: f64,
    /// Response gᵢ.
    response: f64,
}

impl SupportNode {
    /// Returns gᵢ.
    pub fn response(&self) -> f64 {
        self.response
    }
}

/// W of one contact point: its free nodes and their weights.
///
/// ```
/// use stickslip::{Vec3, surface::support::{Metric, Support}};
///
/// let mut support = Support::with_capacity(3);
/// support.set(Metric::Euclidean, [(0, 0.5, 1.0), (1, 0.3, 1.0), (2, 0.2, 1.0)]);
/// let mut v = [Vec3::x(), Vec3::y(), Vec3::z()];
/// support.project_sticking(&mut v);
/// assert!(support.velocity(&v).norm() < 1e-15); // W P = 0
/// ```
///
/// The other operators, in the mass metric:
///
/// ```
/// use stickslip::{Vec3, surface::support::{Metric, Support}};
///
/// let mass = [0.01, 0.02];
/// let mut support = Support::with_capacity(2);
/// support.set(Metric::Mass, [(0, 0.25, 1.0 / mass[0]), (1, 0.75, 1.0 / mass[1])]);
/// let [first, second] = support.nodes() else { unreachable!("two free nodes") };
/// assert_eq!(support.free_weight(), 1.0);
/// assert_eq!(support.scale(), 0.25 * first.response() + 0.75 * second.response()); // s
/// assert_eq!(support.square_weight(), 0.25 * 0.25 + 0.75 * 0.75);
///
/// // An impulse of 1 N·s on the contact point changes the momentum by as much.
/// let mut v = [Vec3::zeros(); 2];
/// support.push(Vec3::x(), &mut v);
/// assert!((v[0] * mass[0] + v[1] * mass[1] - Vec3::x()).norm() < 1e-15);
///
/// // Q stops the normal part of the contact point's velocity and keeps the rest.
/// let mut v = [Vec3::new(1.0, 0.0, -1.0); 2];
/// support.project_sliding(Vec3::z(), &mut v);
/// assert!((support.velocity(&v) - Vec3::x()).norm() < 1e-15);
///
/// // With the force that holds the point subtracted, the node forces need no holding force.
/// let mut f = [Vec3::new(0.1, 0.0, 0.4), Vec3::new(0.0, 0.2, 0.6)];
/// support.subtract_contact_force(support.reaction(&f), &mut f);
/// assert!(support.reaction(&f).norm() < 1e-15);
/// ```
#[derive(Debug, Default)]
pub struct Support {
    nodes: Vec<SupportNode>,
    free_weight: f64,
    /// Scale s.
    scale: f64,
    /// Sum of squared weights Σ_free w².
    square_weight: f64,
}

impl Clone for Support {
    /// Clones with the same capacity, so that a copy allocates as little as the original.
    fn clone(&self) -> Self {
        let mut nodes = Vec::with_capacity(self.nodes.capacity());
        nodes.extend_from_slice(&self.nodes);
        Self { nodes, ..*self }
    }
}

impl Support {
    /// Returns an empty support that can hold this many nodes without allocating.
    pub fn with_capacity(nodes: usize) -> Self {
        Self { nodes: Vec::with_capacity(nodes), ..Self::default() }
    }

    /// Sets the free nodes of a contact point, each as (slot, weight, inverse mass in 1/kg).
    pub fn set(&mut self, metric: Metric, free_nodes: impl IntoIterator<Item = (usize, f64, f64)>) {
        self.nodes.clear();
        self.nodes.extend(free_nodes.into_iter().map(|(slot, weight, inverse_mass)| {
            let response = match metric {
                Metric::Euclidean => weight,
                Metric::Mass => weight * inverse_mass,
            };
            SupportNode { slot, weight, response }
        }));
        self.free_weight = self.nodes.iter().map(|node| node.weight).sum();
        self.scale = self.nodes.iter().map(|node| node.weight * node.response).sum();
        self.square_weight = self.nodes.iter().map(|node| node.weight * node.weight).sum();
    }

    /// Returns the free nodes.
    pub fn nodes(&self) -> &[SupportNode] {
        &self.nodes
    }

    /// Free weight Σ_free w: 1 unless a support node is fixed or outside the patch.
    pub fn free_weight(&self) -> f64 {
        self.free_weight
    }

    /// Scale s = Σ wᵢgᵢ; zero if no node of the support is free.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Sum of squared weights Σ_free w², the s of the Euclidean metric whichever metric is in use.
    pub fn square_weight(&self) -> f64 {
        self.square_weight
    }

    /// Velocity of the contact point W v, m/s, with the exterior at rest.
    pub fn velocity(&self, v: &[Vec3]) -> Vec3 {
        self.nodes.iter().map(|node| v[node.slot] * node.weight).sum()
    }

    /// Force on the instrument that holds the point, N: λ of (14) per unit of free weight. The paper's sum of node
    /// forces is λ Σ_free w.
    pub fn reaction(&self, f: &[Vec3]) -> Vec3 {
        self.nodes.iter().map(|node| f[node.slot] * node.response).sum::<Vec3>() / self.scale
    }

    /// Stops the contact point: v ← P v (12).
    pub fn project_sticking(&self, v: &mut [Vec3]) {
        let change = self.velocity(v) / self.scale;
        self.nodes.iter().for_each(|node| v[node.slot] -= change * node.response);
    }

    /// Stops the contact point along the normal: v ← Q v (20).
    pub fn project_sliding(&self, normal: Vec3, v: &mut [Vec3]) {
        let change = normal * (normal.dot(&self.velocity(v)) / self.scale);
        self.nodes.iter().for_each(|node| v[node.slot] -= change * node.response);
    }

    /// Applies an impulse Λ, N·s, to the contact point: v ← v + M⁻¹Wᵀ Λ. Valid for the mass metric.
    pub fn push(&self, impulse: Vec3, v: &mut [Vec3]) {
        self.nodes.iter().for_each(|node| v[node.slot] += impulse * node.response);
    }

    /// Subtracts the instrument's force on the mesh, shared out by weight: f ← f − Wᵀ f̂ (25).
    pub fn subtract_contact_force(&self, force: Vec3, f: &mut [Vec3]) {
        self.nodes.iter().for_each(|node| f[node.slot] -= force * node.weight);
    }
}
