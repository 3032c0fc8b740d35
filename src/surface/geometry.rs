//! The contact surface: its kind, the tables prepared for it once per mesh, and the points on it.

use std::sync::Arc;

use super::disc::{DiscError, DiscSurface, RestSurface};
use super::subdivision::LimitSurface;
use crate::Vec3;
use crate::model::topology::{Surface, SurfaceError};
use crate::word::words;

/// Kind of surface that the tip touches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ContactSurface {
    /// The triangles with their face normals (the paper). The normal jumps at an edge.
    #[default]
    Faceted,
    /// The triangles with normals interpolated from the vertices (Phong). They do not jump, but are not the normals of
    /// the surface that slides: this creates energy.
    Shaded,
    /// The Loop limit surface with its true normal: no jump, and no energy is created.
    Subdivision,
}

words!(ContactSurface { Faceted = "faceted", Shaded = "shaded", Subdivision = "subdivision" });

/// A contact surface with the tables prepared for it once per mesh.
///
/// ```
/// use stickslip::surface::geometry::{ContactGeometry, ContactPoint, ContactSurface};
/// use stickslip::{model::mesh::{Block, Stencil}, model::topology::Surface};
///
/// let mesh = Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear }.mesh();
/// let surface = Surface::new(&mesh)?;
/// let point = ContactPoint { triangle: 60, weights: [0.2, 0.3, 0.5] };
/// for kind in [ContactSurface::Faceted, ContactSurface::Subdivision] {
///     let geometry = ContactGeometry::new(kind, &surface)?;
///     let weights: Vec<(u32, f64)> = geometry.weights(&surface, &point).collect();
///     assert_eq!(weights.len(), geometry.support(&surface, 60).len());
///     assert!(weights.len() <= geometry.largest_support());
///     let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
///     assert!((sum - 1.0).abs() < 1e-14); // the contact point moves with the mesh
/// }
/// # Ok::<(), stickslip::model::topology::SurfaceError>(())
/// ```
#[derive(Debug, Clone)]
pub enum ContactGeometry {
    /// The triangles with their face normals.
    Faceted,
    /// The triangles with interpolated normals.
    Shaded,
    /// A surface with derivatives.
    Smooth(SmoothSurface),
}

/// A contact surface that is given by weights of its vertices and their derivatives.
#[derive(Debug, Clone)]
pub enum SmoothSurface {
    /// The Loop limit surface, touched at a point.
    Limit(Arc<LimitSurface>),
    /// Any kind of surface, touched over a disc.
    Disc(Arc<DiscSurface>),
}

impl SmoothSurface {
    /// Bound on the speed of a point of the surface, over that of the fastest vertex. On a disc the offset from the mean of the
    /// vertices, shorter than the radius, turns with the vertices, whose mean distance is a good half of the radius.
    pub fn agility(&self) -> f64 {
        match self {
            Self::Disc(disc) if disc.turns() => 3.0,
            Self::Disc(_) | Self::Limit(_) => 1.0,
        }
    }
}

impl ContactGeometry {
    /// Prepares a contact surface.
    ///
    /// # Errors
    /// If no subdivision surface can be built from the mesh.
    pub fn new(kind: ContactSurface, surface: &Surface) -> Result<Self, SurfaceError> {
        Ok(match kind {
            ContactSurface::Faceted => Self::Faceted,
            ContactSurface::Shaded => Self::Shaded,
            ContactSurface::Subdivision => Self::Smooth(SmoothSurface::Limit(Arc::new(LimitSurface::new(surface)?))),
        })
    }

    /// Returns the vertices that determine the contact points of a triangle.
    #[inline]
    pub fn support<'a>(&'a self, surface: &'a Surface, triangle: u32) -> &'a [u32] {
        match self {
            Self::Faceted | Self::Shaded => &surface.triangles[triangle as usize],
            Self::Smooth(SmoothSurface::Limit(limit)) => limit.support(triangle),
            Self::Smooth(SmoothSurface::Disc(disc)) => disc.support(triangle),
        }
    }

    /// Largest number of vertices in a [`support`](Self::support).
    pub fn largest_support(&self) -> usize {
        match self {
            Self::Faceted | Self::Shaded => 3,
            Self::Smooth(SmoothSurface::Limit(limit)) => limit.largest_support(),
            Self::Smooth(SmoothSurface::Disc(disc)) => disc.largest_support(),
        }
    }

    /// Largest distance of a contact point from the convex hull of its support, m: on a disc, the mean of the vertices is within
    /// the radius of the location.
    pub fn overhang(&self) -> f64 {
        match self {
            Self::Faceted | Self::Shaded | Self::Smooth(SmoothSurface::Limit(_)) => 0.0,
            Self::Smooth(SmoothSurface::Disc(disc)) => disc.radius(),
        }
    }

    /// Returns the support's vertices with their weights at a contact point, W: Σ w = 1. It allocates.
    pub fn weights<'a>(
        &'a self,
        surface: &'a Surface,
        point: &ContactPoint,
    ) -> impl Iterator<Item = (u32, f64)> + use<'a> {
        let support = self.support(surface, point.triangle).iter().copied();
        let weights: Vec<f64> = match self {
            Self::Faceted | Self::Shaded => point.weights.to_vec(),
            Self::Smooth(SmoothSurface::Limit(limit)) => {
                limit.jet(point.triangle, point.weights).entries().iter().map(|entry| entry[0]).collect()
            }
            Self::Smooth(SmoothSurface::Disc(disc)) => {
                disc.weights(point).entries().iter().map(|(weight, _)| *weight).collect()
            }
        };
        support.zip(weights)
    }
}

/// The contact surface of one mesh: its triangles, and the positions and normals of contact points on them. Constant
/// within a run, and cheap to clone.
#[derive(Debug, Clone)]
pub struct SurfaceModel {
    /// The boundary triangles of the mesh and their neighbours.
    pub topology: Arc<Surface>,
    /// Tables prepared for the kind of surface.
    pub geometry: ContactGeometry,
}

impl SurfaceModel {
    /// Prepares a kind of contact surface over the boundary of a mesh.
    ///
    /// # Errors
    /// If no subdivision surface can be built from the mesh.
    pub fn new(kind: ContactSurface, topology: Arc<Surface>) -> Result<Self, SurfaceError> {
        Ok(Self { geometry: ContactGeometry::new(kind, &topology)?, topology })
    }

    /// Spreads its contacts over discs of this radius, m, around their points on the surface at rest, whose vertices are among
    /// these nodes; a radius of 0 leaves them points. A body with fewer than three fixed nodes can turn.
    ///
    /// # Errors
    /// If the disc spreads over too many vertices, or is too small for a subdivision surface.
    pub fn spread(self, radius: f64, rest: &[Vec3], fixed: &[bool]) -> Result<Self, DiscError> {
        if radius == 0.0 {
            return Ok(self);
        }
        let Self { topology, geometry } = self;
        let rest: Vec<Vec3> = topology.vertex_node.iter().map(|&node| rest[node as usize]).collect();
        let kind = match geometry {
            ContactGeometry::Faceted => RestSurface::Faceted,
            ContactGeometry::Shaded => RestSurface::Shaded(vertex_normals(&topology, &rest)),
            ContactGeometry::Smooth(SmoothSurface::Limit(limit)) => RestSurface::Limit(limit),
            ContactGeometry::Smooth(SmoothSurface::Disc(disc)) => disc.kind().clone(),
        };
        let turns = fixed.iter().filter(|&&fixed| fixed).count() < 3;
        let disc = DiscSurface::new(kind, topology.clone(), rest, radius, turns)?;
        Ok(Self { topology, geometry: ContactGeometry::Smooth(SmoothSurface::Disc(Arc::new(disc))) })
    }

    /// Prepares the triangles with their face normals (the paper), which any mesh has.
    pub fn faceted(topology: Arc<Surface>) -> Self {
        Self { topology, geometry: ContactGeometry::Faceted }
    }

    /// Returns the vertices that determine the contact points of a triangle.
    pub fn support(&self, triangle: u32) -> &[u32] {
        self.geometry.support(&self.topology, triangle)
    }

    /// Returns the support's vertices with their weights at a contact point, W: Σ w = 1. It allocates.
    pub fn weights(&self, point: &ContactPoint) -> impl Iterator<Item = (u32, f64)> {
        self.geometry.weights(&self.topology, point)
    }

    /// Returns the nodes that carry a contact point, with their weights.
    pub fn node_weights(&self, point: &ContactPoint) -> impl Iterator<Item = (usize, f64)> {
        self.weights(point).map(|(vertex, weight)| (self.topology.vertex_node[vertex as usize] as usize, weight))
    }
}

/// Normalised sums of the area normals around each vertex.
fn vertex_normals(topology: &Surface, vertices: &[Vec3]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::zeros(); vertices.len()];
    for &triangle in &topology.triangles {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        let normal = (b - a).cross(&(c - a));
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    normals.iter_mut().for_each(|normal| *normal = normal.normalize());
    normals
}

/// A material point of the surface.
///
/// ```
/// use stickslip::{Vec3, surface::geometry::ContactPoint};
///
/// let middle = ContactPoint { triangle: 0, weights: [1.0 / 3.0; 3] };
/// let centroid = middle.position([Vec3::zeros(), Vec3::x() * 3.0, Vec3::y() * 3.0]);
/// assert!((centroid - Vec3::new(1.0, 1.0, 0.0)).norm() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The triangle that the point lies in.
    pub triangle: u32,
    /// Barycentric weights α, β, γ; their sum is 1.
    pub weights: [f64; 3],
}

impl ContactPoint {
    /// Position p = αa + βb + γc, m, for corners a, b, c.
    #[inline]
    pub fn position(&self, [a, b, c]: [Vec3; 3]) -> Vec3 {
        a * self.weights[0] + b * self.weights[1] + c * self.weights[2]
    }
}
