//! The Loop limit surface of a triangle mesh: the basis functions of its control vertices and their
//! derivatives at any point of any triangle.
//!
//! A triangle whose neighbourhood is a part of the regular lattice carries a box spline; across a border the lattice is
//! completed by mirrored vertices, which is the cubic B-spline rule exactly. Any other triangle is divided into its
//! four children until the point lies in a regular one. Next to an extraordinary vertex every step yields the same
//! neighbourhood again, so that many steps are one product with a tabulated power of the step's matrix (after Stam
//! 1998).

mod box_spline;
mod combination;
mod neighborhood;

use std::collections::HashMap;

pub use combination::{DERIVATIVES, Jet, LARGEST_SUPPORT};

use crate::model::topology::{Surface, SurfaceError};
use box_spline::BoxSpline;
use combination::Combination;
use neighborhood::Neighborhood;

/// Largest number of halvings towards an extraordinary vertex. A point that is closer, 2⁻⁴⁸ of the triangle, is
/// evaluated at that distance in its direction; this moves it by less than the edge length times λ⁴⁸ with λ the
/// subdominant eigenvalue: 4e-15 for 6 neighbours, 2e-11 for 12.
const DEEPEST: usize = 48;

/// Squarings of the subdivision matrix after which it has converged: the second eigenvalue is at most
/// 5/8, and its 1024th power underflows.
const LIMIT_SQUARINGS: usize = 10;

/// The tables of one surface, which are constant; positions of the control vertices are stored elsewhere.
///
/// ```
/// use stickslip::surface::subdivision::{LARGEST_SUPPORT, LimitSurface};
/// use stickslip::{model::mesh::{Block, Stencil}, model::topology::Surface};
///
/// let mesh = Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear }.mesh();
/// let limit = LimitSurface::new(&Surface::new(&mesh)?)?;
/// assert!(limit.largest_support() <= LARGEST_SUPPORT);
///
/// // In the middle of the top, where six triangles meet at every vertex, it is a box spline of twelve vertices.
/// let jet = limit.jet(60, [0.2, 0.3, 0.5]);
/// assert_eq!((limit.support(60).len(), jet.entries().len()), (12, 12));
/// let sum = |derivative: usize| -> f64 { jet.entries().iter().map(|entry| entry[derivative]).sum() };
/// assert!((sum(0) - 1.0).abs() < 1e-14); // a partition of unity,
/// assert!((1..6).all(|derivative| sum(derivative).abs() < 1e-13)); // everywhere
/// # Ok::<(), stickslip::model::topology::SurfaceError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LimitSurface {
    /// End of each triangle's support in `vertices`.
    ends: Vec<u32>,
    vertices: Vec<u32>,
    /// Patch of each triangle.
    patch_of: Vec<u32>,
    patches: Vec<Patch>,
    box_spline: BoxSpline,
}

#[derive(Debug, Clone)]
enum Patch {
    /// The triangle is a box spline of its own vertices.
    Regular,
    /// The triangle is a box spline of these combinations of its vertices.
    Bordered(Combination),
    /// The triangle is evaluated on its children: those at the corners, then the middle one.
    Divided(Box<[Child; 4]>),
}

#[derive(Debug, Clone)]
struct Child {
    patch: u32,
    /// The child's vertices as combinations of those of the parent.
    refinement: Combination,
    /// Powers of the refinement, if the child is the same patch again.
    powers: Option<Powers>,
}

/// Powers of the matrix A of a corner child that equals its parent, without the part that does not decay:
/// Aⁿ = 1 lᵀ + Bⁿ. With that part separated, the small differences that determine tangents near the vertex keep all
/// their digits.
#[derive(Debug, Clone)]
struct Powers {
    /// Weights l of the limit of the vertex.
    limit: Vec<f64>,
    /// Powers B¹, B², …, each row by row.
    decaying: Vec<Vec<f64>>,
}

impl LimitSurface {
    /// Prepares the tables of a surface.
    ///
    /// # Errors
    /// If a triangle has more than [`LARGEST_SUPPORT`] vertices around it.
    pub fn new(surface: &Surface) -> Result<Self, SurfaceError> {
        let mut limit = Self {
            ends: Vec::with_capacity(surface.triangles.len()),
            vertices: Vec::new(),
            patch_of: Vec::with_capacity(surface.triangles.len()),
            patches: Vec::new(),
            box_spline: BoxSpline::new(),
        };
        let mut known = HashMap::new();
        for (triangle, &corners) in surface.triangles.iter().enumerate() {
            let touching: Vec<[u32; 3]> = corners
                .iter()
                .flat_map(|&vertex| surface.incident(vertex))
                .map(|&t| surface.triangles[t as usize])
                .collect();
            let (neighborhood, order) = Neighborhood::around(corners, &touching);
            let patch = limit.patch(&neighborhood, &mut known).ok_or(SurfaceError::Crowded {
                triangle,
                nodes: surface.triangle_nodes(triangle as u32),
                around: order.len(),
                most: LARGEST_SUPPORT,
            })?;
            limit.patch_of.push(patch);
            limit.vertices.extend(order);
            limit.ends.push(limit.vertices.len() as u32);
        }
        Ok(limit)
    }

    /// Returns the patch of a neighbourhood, built if there is none yet; `None` if it is too large.
    fn patch(&mut self, neighborhood: &Neighborhood, known: &mut HashMap<Neighborhood, u32>) -> Option<u32> {
        if let Some(&patch) = known.get(neighborhood) {
            return Some(patch);
        }
        if neighborhood.vertex_count() > LARGEST_SUPPORT {
            return None;
        }
        let index = self.patches.len() as u32;
        known.insert(neighborhood.clone(), index);
        // This holds the place while the children are built, of which one may be this patch again.
        self.patches.push(Patch::Regular);
        self.patches[index as usize] = match neighborhood.regular() {
            Some(combination) if combination.is_identity() => Patch::Regular,
            Some(combination) => Patch::Bordered(combination),
            None => {
                let split = neighborhood.split();
                let mut children = Vec::with_capacity(4);
                for (child, refinement) in split.children.iter().zip(split.refinement) {
                    let patch = self.patch(child, known)?;
                    let powers = (patch == index).then(|| Powers::new(&refinement, neighborhood.vertex_count()));
                    children.push(Child { patch, refinement, powers });
                }
                Patch::Divided(children.try_into().ok()?)
            }
        };
        Some(index)
    }

    /// Returns the control vertices that determine the surface over a triangle, its own first.
    #[inline]
    pub fn support(&self, triangle: u32) -> &[u32] {
        let t = triangle as usize;
        let start = if t == 0 { 0 } else { self.ends[t - 1] };
        &self.vertices[start as usize..self.ends[t] as usize]
    }

    /// Largest number of vertices in a [`support`](Self::support).
    pub fn largest_support(&self) -> usize {
        (0..self.ends.len() as u32).map(|triangle| self.support(triangle).len()).max().unwrap_or(0)
    }

    /// Returns the basis functions of the [`support`](Self::support) at barycentric weights of the triangle.
    pub fn jet(&self, triangle: u32, weights: [f64; 3]) -> Jet {
        self.patch_jet(self.patch_of[triangle as usize], weights)
    }

    fn patch_jet(&self, patch: u32, weights: [f64; 3]) -> Jet {
        let [_, v, w] = weights;
        let children = match &self.patches[patch as usize] {
            Patch::Regular => return self.box_spline.evaluate(v, w),
            Patch::Bordered(combination) => return combination.pull(&self.box_spline.evaluate(v, w)),
            Patch::Divided(children) => children,
        };
        let from_corner = |k: usize| weights[(k + 1) % 3] + weights[(k + 2) % 3];
        let Some(corner) = (0..3).find(|&k| from_corner(k) <= 0.5) else {
            let middle = &children[3];
            let mut jet = self.patch_jet(middle.patch, weights.map(|w| 1.0 - 2.0 * w));
            jet.scale(-2.0);
            return middle.refinement.pull(&jet);
        };
        let child = &children[corner];
        match &child.powers {
            None => {
                let mut jet = self.patch_jet(child.patch, towards(weights, corner, 2.0));
                jet.scale(2.0);
                child.refinement.pull(&jet)
            }
            Some(powers) => {
                let (steps, weights) = descend(weights, corner);
                let mut jet = self.patch_jet(patch, weights);
                jet.scale((steps as f64).exp2());
                powers.pull(steps, &jet)
            }
        }
    }
}

/// Weights in the child at a corner: the other two are multiplied by `factor`.
fn towards(mut weights: [f64; 3], corner: usize, factor: f64) -> [f64; 3] {
    let (i, j) = ((corner + 1) % 3, (corner + 2) % 3);
    weights[i] *= factor;
    weights[j] *= factor;
    weights[corner] = 1.0 - weights[i] - weights[j];
    weights
}

/// Returns how many times the child at a corner is divided again until the point is no longer in its corner child, and
/// the weights there.
fn descend(weights: [f64; 3], corner: usize) -> (usize, [f64; 3]) {
    let (i, j) = ((corner + 1) % 3, (corner + 2) % 3);
    let mut rest = weights[i] + weights[j];
    let (mut steps, mut factor) = (0, 1.0);
    while steps < DEEPEST && rest <= 0.5 {
        rest *= 2.0;
        factor *= 2.0;
        steps += 1;
    }
    let mut weights = towards(weights, corner, factor);
    if rest <= 0.5 {
        // The point is nearer than the deepest table: it is moved out to the ring that the table covers.
        if rest > 0.0 {
            weights = towards(weights, corner, 0.75 / rest);
        } else {
            (weights[i], weights[j], weights[corner]) = (0.375, 0.375, 0.25);
        }
    }
    (steps, weights)
}

impl Powers {
    fn new(refinement: &Combination, size: usize) -> Self {
        let mut step = vec![0.0; size * size];
        for (i, row) in refinement.rows().enumerate() {
            row.iter().for_each(|&(j, factor)| step[i * size + j as usize] += factor);
        }
        let mut settled = step.clone();
        for _ in 0..LIMIT_SQUARINGS {
            settled = product(&settled, &settled, size);
            // Each row is rescaled to the sum 1, since squaring would amplify its round-off.
            for row in settled.chunks_mut(size) {
                let sum: f64 = row.iter().sum();
                row.iter_mut().for_each(|entry| *entry /= sum);
            }
        }
        let limit = settled[..size].to_vec();
        let decaying: Vec<f64> = step.iter().zip(limit.iter().cycle()).map(|(entry, l)| entry - l).collect();
        let mut powers = vec![decaying.clone()];
        for n in 1..DEEPEST {
            powers.push(product(&powers[n - 1], &decaying, size));
        }
        Self { limit, decaying: powers }
    }

    /// Returns the basis functions after `steps` ≥ 1 divisions from those of the last child.
    fn pull(&self, steps: usize, jet: &Jet) -> Jet {
        let size = self.limit.len();
        let rows = self.decaying[steps - 1].chunks(size);
        let mut pulled = Jet::zero(size);
        for (row, from) in rows.zip(jet.entries()) {
            for (to, factor) in pulled.entries_mut().iter_mut().zip(row) {
                to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
            }
        }
        // Values sum to 1 and derivatives to 0, so derivatives have no part that does not decay.
        pulled.entries_mut().iter_mut().zip(&self.limit).for_each(|(to, l)| to[0] += l);
        pulled
    }
}

fn product(a: &[f64], b: &[f64], size: usize) -> Vec<f64> {
    let entry = |i: usize, j: usize| (0..size).map(|k| a[i * size + k] * b[k * size + j]).sum();
    (0..size * size).map(|at| entry(at / size, at % size)).collect()
}
