//! The contact surface at one instant: where a contact point is, which way its normal points, and
//! how it follows the tip from triangle to triangle.

use super::operators::{Metric, Support};
use crate::model::local::LocalModel;
use crate::model::patch::OUTSIDE;
use crate::{Mat3, Vec3};

/// Which surface the tip feels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactSurface {
    /// The triangles with their face normals (the paper). The normal jumps at an edge.
    Faceted,
    /// The triangles with normals interpolated from the vertices. No jump, but not the normal of
    /// what slides: it creates energy.
    Shaded,
}

/// A material point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// The triangle it lies in.
    pub triangle: u32,
    /// Barycentric weights α, β, γ; their sum is 1.
    pub weights: [f64; 3],
}

impl ContactPoint {
    /// p = αa + βb + γc.
    #[inline]
    pub fn position(&self, [a, b, c]: [Vec3; 3]) -> Vec3 {
        a * self.weights[0] + b * self.weights[1] + c * self.weights[2]
    }
}

/// The surface at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Shape<'a> {
    /// Whose surface.
    pub model: &'a LocalModel,
    /// Positions of the patch's slots, m.
    pub x: &'a [Vec3],
    /// Seconds since the state the model was built from.
    pub elapsed: f64,
}

/// Where a projection led.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// To this point.
    Found(ContactPoint),
    /// Over the border of an open surface.
    OverBorder,
}

/// Triangles that a walk has seen, without clearing between walks.
#[derive(Debug, Clone)]
pub struct Visited {
    stamp: Vec<u64>,
    walk: u64,
}

impl Visited {
    /// For a surface of this many triangles.
    pub fn new(triangles: usize) -> Self {
        Self { stamp: vec![0; triangles], walk: 0 }
    }

    fn start(&mut self) {
        self.walk += 1;
    }

    fn mark(&mut self, triangle: u32) {
        self.stamp[triangle as usize] = self.walk;
    }

    fn contains(&self, triangle: u32) -> bool {
        self.stamp[triangle as usize] == self.walk
    }
}

/// Newton steps of the projection along the normal field end when no weight changes by more.
const NEWTON_TOLERANCE: f64 = 1e-12;
/// Quadratic convergence needs five or six from anywhere in a triangle; a search that takes more
/// than this goes in circles.
const NEWTON_STEPS: usize = 40;

impl<'a> Shape<'a> {
    /// Corners of a triangle, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.model.surface.triangles[triangle as usize].map(|v| self.model.vertex(v, self.x, self.elapsed))
    }

    /// How far, m, a vertex may be from where it was when the model was built.
    pub fn reach(&self) -> f64 {
        self.model.reach(self.x, self.elapsed)
    }

    /// Where a contact point is, m.
    pub fn position(&self, point: &ContactPoint) -> Vec3 {
        point.position(self.corners(point.triangle))
    }

    /// Cross product of two edges: twice the area, along the outward normal, m².
    pub fn area_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// n̂ at a contact point. Not finite where the triangle has no area.
    pub fn normal(&self, surface: ContactSurface, point: &ContactPoint) -> Vec3 {
        match surface {
            ContactSurface::Faceted => self.area_normal(point.triangle).normalize(),
            ContactSurface::Shaded => {
                let [na, nb, nc] = self.vertex_normals(point.triangle);
                (na * point.weights[0] + nb * point.weights[1] + nc * point.weights[2]).normalize()
            }
        }
    }

    /// Normalised sums of the area normals around each corner.
    fn vertex_normals(&self, triangle: u32) -> [Vec3; 3] {
        self.model.surface.triangles[triangle as usize].map(|vertex| {
            let around = self.model.surface.incident(vertex);
            around.iter().map(|&t| self.area_normal(t)).sum::<Vec3>().normalize()
        })
    }

    /// W of a contact point: its corners that are free and in the patch.
    pub fn support(&self, metric: Metric, point: &ContactPoint, support: &mut Support) {
        let patch = &self.model.patch;
        let corners = self.model.surface.triangles[point.triangle as usize];
        support.set(
            metric,
            corners.into_iter().zip(point.weights).filter_map(|(vertex, weight)| {
                let slot = patch.vertex_slot[vertex as usize];
                (slot != OUTSIDE).then(|| (slot as usize, weight, patch.inverse_mass[slot as usize]))
            }),
        );
    }

    /// Projects q onto the surface, walking from triangle to triangle.
    ///
    /// A projection that leaves its triangle crosses the edge opposite its most negative weight. In
    /// front of a triangle already seen, which is so in a valley, it takes the nearest point of the
    /// shared edge and the lower of the two triangles.
    pub fn project(&self, surface: ContactSurface, from: &ContactPoint, q: Vec3, visited: &mut Visited) -> Projection {
        visited.start();
        let mut here = *from;
        loop {
            visited.mark(here.triangle);
            let found = match surface {
                ContactSurface::Faceted => self.onto_plane(here.triangle, q),
                ContactSurface::Shaded => match self.along_normals(&here, q) {
                    Some(point) => point,
                    // The normal field of this triangle has no ray through q.
                    None => match self.nearest(q) {
                        Some(point) => return Projection::Found(point),
                        None => self.onto_plane(here.triangle, q),
                    },
                },
            };
            let (opposite, least) = least_weight(found.weights);
            // Also where the weights are not finite: the tick turns these into a fault.
            if !(least < 0.0) {
                return Projection::Found(found);
            }
            let Some(next) = self.model.surface.neighbors[here.triangle as usize][opposite] else {
                return Projection::OverBorder;
            };
            if visited.contains(next) {
                return Projection::Found(self.on_shared_edge(here.triangle, opposite, next, q));
            }
            // A walk starts Newton's search in the middle of the next triangle.
            here = ContactPoint { triangle: next, weights: [1.0 / 3.0; 3] };
        }
    }

    /// Orthogonal projection onto the plane of a triangle.
    fn onto_plane(&self, triangle: u32, q: Vec3) -> ContactPoint {
        let [a, b, c] = self.corners(triangle);
        ContactPoint { triangle, weights: plane_weights(b - a, c - a, q - a) }
    }

    /// The point whose interpolated normal passes through q: p(w) + t n(w) = q, by Newton.
    fn along_normals(&self, from: &ContactPoint, q: Vec3) -> Option<ContactPoint> {
        let [a, b, c] = self.corners(from.triangle);
        let [na, nb, nc] = self.vertex_normals(from.triangle);
        let [_, mut beta, mut gamma] = from.weights;
        let mut t = 0.0;
        for _ in 0..NEWTON_STEPS {
            let alpha = 1.0 - beta - gamma;
            let normal = na * alpha + nb * beta + nc * gamma;
            let residual = q - (a * alpha + b * beta + c * gamma) - normal * t;
            let jacobian = Mat3::from_columns(&[(b - a) + (nb - na) * t, (c - a) + (nc - na) * t, normal]);
            let step = jacobian.try_inverse()? * residual;
            beta += step.x;
            gamma += step.y;
            t += step.z;
            if step.x.abs() <= NEWTON_TOLERANCE && step.y.abs() <= NEWTON_TOLERANCE {
                return Some(ContactPoint { triangle: from.triangle, weights: [1.0 - beta - gamma, beta, gamma] });
            }
        }
        None
    }

    /// The point of the edge between two triangles that is nearest to q.
    fn on_shared_edge(&self, triangle: u32, opposite: usize, neighbor: u32, q: Vec3) -> ContactPoint {
        let lower = triangle.min(neighbor);
        let triangles = &self.model.surface.triangles;
        let ends = [1, 2].map(|k| triangles[triangle as usize][(opposite + k) % 3]);
        let [start, end] = ends.map(|vertex| self.model.vertex(vertex, self.x, self.elapsed));
        let along = end - start;
        let t = ((q - start).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        let weights = triangles[lower as usize].map(|vertex| {
            if vertex == ends[0] {
                1.0 - t
            } else if vertex == ends[1] {
                t
            } else {
                0.0
            }
        });
        ContactPoint { triangle: lower, weights }
    }
}

/// Barycentric weights of the orthogonal projection of a + aq onto the plane of a, a + ab, a + ac.
pub(super) fn plane_weights(ab: Vec3, ac: Vec3, aq: Vec3) -> [f64; 3] {
    let normal = ab.cross(&ac);
    let scale = 1.0 / normal.norm_squared();
    let beta = aq.cross(&ac).dot(&normal) * scale;
    let gamma = ab.cross(&aq).dot(&normal) * scale;
    [1.0 - beta - gamma, beta, gamma]
}

fn least_weight(weights: [f64; 3]) -> (usize, f64) {
    let mut least = (0, weights[0]);
    for (i, &weight) in weights.iter().enumerate().skip(1) {
        if weight < least.1 {
            least = (i, weight);
        }
    }
    least
}
