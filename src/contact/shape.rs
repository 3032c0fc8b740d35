//! The contact surface at one instant: the position and the normal of a contact point, and how the point follows the
//! tip from triangle to triangle.

use crate::local::model::LocalModel;
use crate::local::patch::OUTSIDE;
use crate::surface::geometry::{ContactGeometry, ContactPoint, SmoothSurface, SurfaceModel};
use crate::surface::support::{Metric, Support};
use crate::{Mat3, Vec3};

/// The contact surface at one instant.
///
/// ```
/// use stickslip::surface::support::{Metric, Support};
/// use stickslip::contact::shape::{Projection, Visited};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let block = simulation.local().shape();
/// assert_eq!(block.reach(), 0.0); // nothing has moved yet
///
/// let tip = Vec3::new(0.001, 0.002, 0.003); // 3 mm above its top, z = 0
/// assert!((block.signed_distance(tip) - 0.003).abs() < 1e-15 && block.is_outside(tip));
/// let point = block.nearest(tip).expect("the surface is not empty");
/// let touch = block.touch(Metric::Euclidean, &point, &mut Support::with_capacity(3));
/// assert!((touch.normal - Vec3::z()).norm() < 1e-15);
/// assert!((touch.position - Vec3::new(0.001, 0.002, 0.0)).norm() < 1e-15);
/// assert_eq!(block.position(&point), touch.position);
///
/// // Following the tip from triangle to triangle leads to the point below it.
/// let far = Vec3::new(0.031, -0.022, -0.001);
/// let mut visited = Visited::new(simulation.surface().triangles.len());
/// let Projection::Found(there) = block.project(&point, far, &mut visited) else { panic!("over the border") };
/// assert!((block.position(&there) - Vec3::new(0.031, -0.022, 0.0)).norm() < 1e-15);
///
/// // A lattice square is cut into two triangles.
/// let [a, b, c] = block.corners(there.triangle);
/// assert!((block.area_normal(there.triangle).norm() - 0.0125 * 0.0125).abs() < 1e-15);
/// assert!((there.position([a, b, c]) - block.position(&there)).norm() < 1e-15);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Shape<'a> {
    /// The contact surface of the whole body.
    pub surface: &'a SurfaceModel,
    /// The local model, which determines the vertex positions.
    pub model: &'a LocalModel,
    /// Positions of the patch's slots, m.
    pub x: &'a [Vec3],
    /// Time since the state that the model was built from, s.
    pub elapsed: f64,
}

/// A contact located at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Material point of the contact.
    pub point: ContactPoint,
    /// Position of the contact, m.
    pub position: Vec3,
    /// Outward unit normal n̂.
    pub normal: Vec3,
}

/// Result of a projection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// The projection led to this point.
    Found(ContactPoint),
    /// The projection left an open surface over its border.
    OverBorder,
}

/// The triangles that a walk has visited; it needs no clearing between walks.
#[derive(Debug, Clone)]
pub struct Visited {
    stamp: Vec<u64>,
    walk: u64,
}

impl Visited {
    /// Allocates for a surface of this many triangles.
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

/// Newton's projection along the normal field ends when no weight changes by more than this.
const NEWTON_TOLERANCE: f64 = 1e-12;
/// Cap on Newton steps. Quadratic convergence needs five or six from anywhere in a triangle; a search that takes more
/// than this cycles.
const NEWTON_STEPS: usize = 40;

impl<'a> Shape<'a> {
    /// Returns the corners of a triangle, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.surface.topology.triangles[triangle as usize].map(|v| self.model.vertex(v, self.x, self.elapsed))
    }

    /// Largest possible distance of a vertex from its position when the model was built, m.
    pub fn reach(&self) -> f64 {
        self.model.reach(self.x, self.elapsed)
    }

    /// Returns the position of a contact point, m.
    pub fn position(&self, point: &ContactPoint) -> Vec3 {
        match &self.surface.geometry {
            ContactGeometry::Faceted | ContactGeometry::Shaded => point.position(self.corners(point.triangle)),
            ContactGeometry::Smooth(smooth) => self.smooth_point(smooth, point).position,
        }
    }

    /// Cross product of two edges, m²: twice the area, along the outward normal.
    pub fn area_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// Locates a contact at this instant and sets its W. n̂ is not finite where the triangle has no area, or a smooth surface
    /// no tangent plane.
    pub fn touch(&self, metric: Metric, point: &ContactPoint, support: &mut Support) -> Touch {
        let triangle = point.triangle;
        let (position, normal) = match &self.surface.geometry {
            ContactGeometry::Faceted => {
                self.set_support(metric, self.weighted(triangle, point.weights), support);
                (point.position(self.corners(triangle)), self.area_normal(triangle).normalize())
            }
            ContactGeometry::Shaded => {
                self.set_support(metric, self.weighted(triangle, point.weights), support);
                let [na, nb, nc] = self.vertex_normals(triangle);
                let [alpha, beta, gamma] = point.weights;
                (point.position(self.corners(triangle)), (na * alpha + nb * beta + nc * gamma).normalize())
            }
            ContactGeometry::Smooth(SmoothSurface::Limit(limit)) => {
                let jet = limit.jet(triangle, point.weights);
                let weights = jet.entries().iter().map(|entry| entry[0]);
                self.set_support(metric, self.weighted(triangle, weights), support);
                let surface = self.limit_point(limit, triangle, &jet);
                (surface.position, surface.normal())
            }
            ContactGeometry::Smooth(SmoothSurface::Disc(disc)) => {
                let weights = disc.weights(point);
                let within = self.weighted(triangle, weights.entries().iter().map(|entry| entry.0));
                self.set_support(metric, within.filter(|&(_, weight)| weight > 0.0), support);
                let felt = self.felt(disc, triangle, &weights);
                (felt.position, felt.normal)
            }
        };
        Touch { point: *point, position, normal }
    }

    /// Normalised sums of the area normals around each corner.
    fn vertex_normals(&self, triangle: u32) -> [Vec3; 3] {
        self.surface.topology.triangles[triangle as usize].map(|vertex| {
            let around = self.surface.topology.incident(vertex);
            around.iter().map(|&t| self.area_normal(t)).sum::<Vec3>().normalize()
        })
    }

    /// Returns the vertices of a triangle's support with these weights.
    fn weighted(&self, triangle: u32, weights: impl IntoIterator<Item = f64>) -> impl Iterator<Item = (u32, f64)> {
        self.surface.support(triangle).iter().copied().zip(weights)
    }

    /// Sets W of a contact point: its weighted vertices that are free and in the patch.
    fn set_support(&self, metric: Metric, weighted: impl Iterator<Item = (u32, f64)>, support: &mut Support) {
        let patch = &self.model.patch;
        support.set(
            metric,
            weighted.filter_map(|(vertex, weight)| {
                let slot = patch.vertex_slot[vertex as usize];
                (slot != OUTSIDE).then(|| (slot as usize, weight, patch.inverse_mass[slot as usize]))
            }),
        );
    }

    /// Projects q onto the surface, walking from triangle to triangle.
    ///
    /// A projection that leaves its triangle crosses the edge opposite its most negative weight. If the next triangle
    /// has already been visited, as happens in a valley, the result is the nearest point of the shared edge, on the
    /// triangle of lower index.
    ///
    /// On a smooth surface the projection is the nearest point.
    pub fn project(&self, from: &ContactPoint, q: Vec3, visited: &mut Visited) -> Projection {
        let along_field = match &self.surface.geometry {
            ContactGeometry::Faceted => false,
            ContactGeometry::Shaded => true,
            ContactGeometry::Smooth(smooth) => return self.project_onto_smooth(smooth, from, q),
        };
        visited.start();
        let mut here = *from;
        loop {
            visited.mark(here.triangle);
            let found = if !along_field {
                self.onto_plane(here.triangle, q)
            } else if let Some(point) = self.along_normals(&here, q) {
                point
            } else if let Some(point) = self.nearest_on_triangles(q) {
                // The normal field of this triangle has no ray through q.
                return Projection::Found(point);
            } else {
                self.onto_plane(here.triangle, q)
            };
            let (opposite, least) = least_weight(found.weights);
            // This also ends where the weights are not finite: the tick turns them into a fault.
            if !(least < 0.0) {
                return Projection::Found(found);
            }
            let Some(next) = self.surface.topology.neighbors[here.triangle as usize][opposite] else {
                return Projection::OverBorder;
            };
            if visited.contains(next) {
                return Projection::Found(self.on_shared_edge(here.triangle, opposite, next, q));
            }
            // A walk starts Newton's search in the middle of the next triangle.
            here = ContactPoint { triangle: next, weights: [1.0 / 3.0; 3] };
        }
    }

    /// Projects q orthogonally onto the plane of a triangle.
    fn onto_plane(&self, triangle: u32, q: Vec3) -> ContactPoint {
        let [a, b, c] = self.corners(triangle);
        ContactPoint { triangle, weights: plane_weights(b - a, c - a, q - a) }
    }

    /// Returns the point whose interpolated normal passes through q, from p(w) + t n(w) = q by Newton.
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

    /// Returns the point nearest to q on the edge between two triangles.
    fn on_shared_edge(&self, triangle: u32, opposite: usize, neighbor: u32, q: Vec3) -> ContactPoint {
        let lower = triangle.min(neighbor);
        let triangles = &self.surface.topology.triangles;
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
