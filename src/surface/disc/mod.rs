//! Contact over a disc instead of a point: the weights of a Hertzian pressure, and the surface that is felt under it.
//!
//! Contact at a point does not converge on finer meshes, since the stiffness under it vanishes with the spacing. The
//! pressure of a rigid sphere, √(1 − |y − P|²/a²) around a point P of the surface at rest, spreads the contact over a radius
//! a that does not depend on the mesh. Its weights are wᵢ ∝ ∫ φᵢ √(1 − |y − P|²/a²) dA with φᵢ the surface's basis functions
//! and Σ wᵢ = 1, over the part of the surface at rest that is connected to P within the distance a. They depend on P alone,
//! so that a contact remains a list of nodes and weights.
//!
//! The surface that is felt is p = P + Σ wᵢ (xᵢ − Xᵢ), with X the positions at rest: at rest it is the surface itself.

pub mod faces;
pub mod moments;
mod neighborhood;

use std::sync::Arc;

use nalgebra::SVD;
use thiserror::Error;

use super::geometry::ContactPoint;
use super::subdivision::LimitSurface;
use crate::model::topology::Surface;
use crate::{Mat3, Vec3};
use faces::Faces;
use neighborhood::Neighborhood;

/// Largest number of vertices that the contacts of one triangle may spread over: the weights of an evaluation are on the
/// stack, 16 KiB at most.
pub const MOST_VERTICES: usize = 512;
/// Largest number of flat faces that the contacts of one triangle may spread over. A surface has twice as many triangles as
/// vertices, and a subdivision surface up to 64 faces for each.
pub const MOST_FACES: usize = 4096;

/// Why a contact cannot be spread over a disc.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum DiscError {
    /// The disc is too large for the mesh.
    #[error(
        "a radius of {radius} m would spread contacts over {vertices} nodes and {faces} faces: at most {MOST_VERTICES} and \
         {MOST_FACES} are allowed"
    )]
    TooWide {
        /// Radius, m.
        radius: f64,
        /// Number of nodes that the contacts of one triangle would spread over.
        vertices: usize,
        /// Number of faces that they would spread over.
        faces: usize,
    },
    /// The disc is too small for the flat faces that stand for a limit surface.
    #[error("a radius of {radius} m is too small for this mesh: a subdivision surface needs at least {least} m")]
    TooNarrow {
        /// Radius, m.
        radius: f64,
        /// Smallest radius, m.
        least: f64,
    },
}

/// The surface at rest, on which the discs lie.
#[derive(Debug, Clone)]
pub enum RestSurface {
    /// The triangles with their face normals.
    Faceted,
    /// The triangles with normals interpolated between these, one per vertex.
    Shaded(Vec<Vec3>),
    /// The Loop limit surface.
    Limit(Arc<LimitSurface>),
}

/// A contact surface felt over a disc, with its tables, which are constant.
#[derive(Debug, Clone)]
pub struct DiscSurface {
    /// Radius a, m.
    radius: f64,
    /// Whether the body can turn, and with it the offset of P from the weighted mean of the vertices at rest.
    turns: bool,
    topology: Arc<Surface>,
    /// Position of each vertex at rest, m.
    rest: Vec<Vec3>,
    kind: RestSurface,
    faces: Faces,
    /// Neighbourhood of each triangle.
    neighborhoods: Vec<Neighborhood>,
}

/// A point of the surface at rest.
#[derive(Debug, Clone)]
struct Place {
    /// Position P, m.
    position: Vec3,
    /// Tangents ∂P/∂β and ∂P/∂γ, m.
    tangents: [Vec3; 2],
    /// Tangents perpendicular to the normal at rest, which differ from `tangents` if the surface is shaded.
    shaded: [Vec3; 2],
}

/// A point of the surface that is felt.
#[derive(Debug, Clone, Copy)]
pub struct Felt {
    /// Position p, m.
    pub position: Vec3,
    /// Tangents ∂p/∂β and ∂p/∂γ, m.
    pub tangents: [Vec3; 2],
    /// Outward unit normal n̂: of the felt surface, or interpolated if it is shaded.
    pub normal: Vec3,
}

/// Weights of the vertices of a triangle's [`support`](DiscSurface::support) at one point, with their derivatives.
#[derive(Debug, Clone)]
pub struct DiscWeights {
    place: Place,
    entries: [Entry; MOST_VERTICES],
    len: usize,
}

/// Weight of a vertex, and its derivative by the point P, 1/m.
type Entry = (f64, Vec3);

impl DiscSurface {
    /// Prepares discs of radius a, m, on the surface of these vertices at rest, m. `turns` says whether the body can turn.
    ///
    /// # Errors
    /// If the disc spreads over too many vertices, or is too small for the faces of a limit surface.
    pub fn new(
        kind: RestSurface,
        topology: Arc<Surface>,
        rest: Vec<Vec3>,
        radius: f64,
        turns: bool,
    ) -> Result<Self, DiscError> {
        let faces = Faces::new(&kind, &topology, &rest, radius)?;
        let triangles = 0..topology.triangles.len() as u32;
        let around = |triangle| {
            let around = Neighborhood::new(&faces, triangle, radius);
            let (vertices, faces) = (around.vertices.len(), around.faces.len());
            let fits = vertices <= MOST_VERTICES && faces <= MOST_FACES;
            if fits { Ok(around) } else { Err(DiscError::TooWide { radius, vertices, faces }) }
        };
        let neighborhoods = triangles.map(around).collect::<Result<_, _>>()?;
        Ok(Self { radius, turns, topology, rest, kind, faces, neighborhoods })
    }

    /// Radius a, m.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Whether the offset of the surface at rest turns with the body.
    pub fn turns(&self) -> bool {
        self.turns
    }

    /// Returns the surface at rest.
    pub fn kind(&self) -> &RestSurface {
        &self.kind
    }

    /// Returns the vertices that the contacts of a triangle may spread over.
    #[inline]
    pub fn support(&self, triangle: u32) -> &[u32] {
        &self.neighborhoods[triangle as usize].vertices
    }

    /// Largest number of vertices in a [`support`](Self::support).
    pub fn largest_support(&self) -> usize {
        self.neighborhoods.iter().map(|around| around.vertices.len()).max().unwrap_or(0)
    }

    /// Returns a point of the surface at rest.
    fn place(&self, point: &ContactPoint) -> Place {
        let vertices = self.topology.triangles[point.triangle as usize];
        match &self.kind {
            RestSurface::Faceted => {
                let (position, tangents) = self.on_triangle(point, vertices);
                Place { position, tangents, shaded: tangents }
            }
            RestSurface::Shaded(normals) => {
                let (position, tangents) = self.on_triangle(point, vertices);
                let normal = ContactPoint::position(point, vertices.map(|v| normals[v as usize])).normalize();
                Place { position, tangents, shaded: tangents.map(|t| t - normal * normal.dot(&t)) }
            }
            RestSurface::Limit(limit) => {
                let jet = limit.jet(point.triangle, point.weights);
                let mut sums = [Vec3::zeros(); 3];
                for (&vertex, entry) in limit.support(point.triangle).iter().zip(jet.entries()) {
                    let x = self.rest[vertex as usize];
                    sums.iter_mut().zip(entry).for_each(|(sum, weight)| *sum += x * *weight);
                }
                let [position, b, g] = sums;
                Place { position, tangents: [b, g], shaded: [b, g] }
            }
        }
    }

    fn on_triangle(&self, point: &ContactPoint, vertices: [u32; 3]) -> (Vec3, [Vec3; 2]) {
        let [a, b, c] = vertices.map(|vertex| self.rest[vertex as usize]);
        (point.position([a, b, c]), [b - a, c - a])
    }

    /// Returns the weights at a point, for the vertices of its triangle's [`support`](Self::support).
    pub fn weights(&self, point: &ContactPoint) -> DiscWeights {
        let around = &self.neighborhoods[point.triangle as usize];
        let place = self.place(point);
        let first = self.faces.in_triangle(point.weights);
        let mut weights =
            DiscWeights { place, entries: [(0.0, Vec3::zeros()); MOST_VERTICES], len: around.vertices.len() };
        around.integrate(&self.faces, first, weights.place.position, self.radius, weights.entries_mut());
        let sum = weights.entries().iter().fold((0.0, Vec3::zeros()), |sum, (w, g)| (sum.0 + w, sum.1 + g));
        for (weight, gradient) in weights.entries_mut() {
            *weight /= sum.0;
            *gradient = (*gradient - sum.1 * *weight) / sum.0;
        }
        weights
    }

    /// Returns the point that is felt where the weights were taken, from the positions of the vertices, m.
    pub fn felt(&self, triangle: u32, weights: &DiscWeights, position: impl Fn(u32) -> Vec3) -> Felt {
        let Place { position: at_rest, tangents, shaded } = &weights.place;
        let (mut mean, mut slope) = (Vec3::zeros(), Mat3::zeros());
        for (&vertex, (weight, gradient)) in self.support(triangle).iter().zip(weights.entries()) {
            let moved = position(vertex) - self.rest[vertex as usize];
            mean += moved * *weight;
            slope += moved * gradient.transpose();
        }
        let (position, along) = if self.turns {
            self.turned(triangle, weights, position, mean, slope)
        } else {
            (at_rest + mean, Mat3::identity() + slope)
        };
        let [b, g] = shaded.map(|tangent| along * tangent);
        Felt { position, tangents: tangents.map(|tangent| along * tangent), normal: b.cross(&g).normalize() }
    }

    /// Returns the point that is felt on a body that can turn, and its derivative by the point at rest:
    /// p = Σ wᵢxᵢ + R (P − Σ wᵢXᵢ), with R the mean rotation of the support: the rotation in the polar decomposition of
    /// Σ wᵢ (xᵢ − x̄)(Xᵢ − X̄)ᵀ. `mean` and `slope` are those of the displacements.
    fn turned(
        &self,
        triangle: u32,
        weights: &DiscWeights,
        position: impl Fn(u32) -> Vec3,
        mean: Vec3,
        slope: Mat3,
    ) -> (Vec3, Mat3) {
        let (mut rest_mean, mut rest_slope) = (Vec3::zeros(), Mat3::zeros());
        for (&vertex, (weight, gradient)) in self.support(triangle).iter().zip(weights.entries()) {
            let rest = self.rest[vertex as usize];
            rest_mean += rest * *weight;
            rest_slope += rest * gradient.transpose();
        }
        let moved_mean = rest_mean + mean;
        let (mut spread, mut change) = (Mat3::zeros(), [Mat3::zeros(); 3]);
        for (&vertex, (weight, gradient)) in self.support(triangle).iter().zip(weights.entries()) {
            let product = (position(vertex) - moved_mean) * (self.rest[vertex as usize] - rest_mean).transpose();
            spread += product * *weight;
            change.iter_mut().zip(gradient.iter()).for_each(|(change, gradient)| *change += product * *gradient);
        }
        let rotation = rotation_of(&spread);
        let stretch = rotation.transpose() * spread;
        // Derivative of the polar decomposition M = RS: (tr S − S) ω is the axial vector of RᵀdM − dMᵀR, where dR = R[ω].
        let inverse = (Mat3::identity() * stretch.trace() - stretch).try_inverse().unwrap_or_else(Mat3::zeros);
        let offset = weights.place.position - rest_mean;
        let turning = Mat3::from_columns(&change.map(|change| {
            let skew = rotation.transpose() * change;
            let axial = Vec3::new(skew.m32 - skew.m23, skew.m13 - skew.m31, skew.m21 - skew.m12);
            rotation * (inverse * axial).cross(&offset)
        }));
        let along = rest_slope + slope + rotation * (Mat3::identity() - rest_slope) + turning;
        (moved_mean + rotation * offset, along)
    }
}

/// The proper rotation nearest to a matrix, whose rank may be two: points on a plane determine a rotation too.
fn rotation_of(matrix: &Mat3) -> Mat3 {
    let SVD { u: Some(u), v_t: Some(v_t), .. } = matrix.svd(true, true) else { return Mat3::identity() };
    let mut u = u;
    if (u * v_t).determinant() < 0.0 {
        u.column_mut(2).neg_mut();
    }
    u * v_t
}

impl DiscWeights {
    /// Returns weight and derivative of each vertex.
    pub fn entries(&self) -> &[(f64, Vec3)] {
        &self.entries[..self.len]
    }

    fn entries_mut(&mut self) -> &mut [Entry] {
        &mut self.entries[..self.len]
    }
}
