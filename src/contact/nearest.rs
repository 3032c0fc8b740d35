//! The surface point nearest to the tip, and the side of the surface on which the tip is.

use super::shape::Shape;
use crate::Vec3;
use crate::surface::geometry::{ContactGeometry, ContactPoint};
use crate::surface::tree::Aabb;

/// Squared distances within this of each other, (1 nm)² in m², tie, and the triangle with the lowest index is taken. The
/// distances of a point from the two triangles at an edge differ by round-off.
const SAME_DISTANCE_SQUARED: f64 = 1e-18;

/// A box is skipped only if it is further away by more than the round-off of its distance: at 10 cm the last bit of a
/// squared distance already exceeds `SAME_DISTANCE_SQUARED`.
const BOX_MARGIN: f64 = 1.0 + 1e-12;

/// The feature of a triangle on which a nearest point lies: its interior, the edge opposite a corner, or a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// The open triangle.
    Face,
    /// The edge opposite this corner.
    Edge(usize),
    /// This corner.
    Corner(usize),
}

/// Barycentric weights of the point of a triangle nearest to q, and the feature it lies on.
///
/// Tests the Voronoi regions of the corners, then of the edges, then the interior (Ericson, *Real-Time Collision
/// Detection*, 5.1.5).
///
/// ```
/// use stickslip::{Vec3, contact::nearest::{Feature, nearest_on_triangle}};
///
/// let triangle = [Vec3::zeros(), Vec3::x(), Vec3::y()];
/// let (weights, feature) = nearest_on_triangle(triangle, Vec3::new(0.25, 0.25, 7.0));
/// assert_eq!((weights, feature), ([0.5, 0.25, 0.25], Feature::Face));
/// let (weights, feature) = nearest_on_triangle(triangle, Vec3::new(0.5, -2.0, 0.0));
/// assert_eq!((weights, feature), ([0.5, 0.5, 0.0], Feature::Edge(2)));
/// let (_, feature) = nearest_on_triangle(triangle, Vec3::new(-1.0, -1.0, 1.0));
/// assert_eq!(feature, Feature::Corner(0));
/// ```
pub fn nearest_on_triangle([a, b, c]: [Vec3; 3], q: Vec3) -> ([f64; 3], Feature) {
    let (ab, ac) = (b - a, c - a);
    let (aq, bq, cq) = (q - a, q - b, q - c);
    let (d1, d2) = (ab.dot(&aq), ac.dot(&aq));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ([1.0, 0.0, 0.0], Feature::Corner(0));
    }
    let (d3, d4) = (ab.dot(&bq), ac.dot(&bq));
    if d3 >= 0.0 && d4 <= d3 {
        return ([0.0, 1.0, 0.0], Feature::Corner(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return ([1.0 - t, t, 0.0], Feature::Edge(2));
    }
    let (d5, d6) = (ab.dot(&cq), ac.dot(&cq));
    if d6 >= 0.0 && d5 <= d6 {
        return ([0.0, 0.0, 1.0], Feature::Corner(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return ([1.0 - t, 0.0, t], Feature::Edge(1));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return ([0.0, 1.0 - t, t], Feature::Edge(0));
    }
    let scale = 1.0 / (va + vb + vc);
    let (beta, gamma) = (vb * scale, vc * scale);
    ([1.0 - beta - gamma, beta, gamma], Feature::Face)
}

/// Distance of q from its nearest point, m, negative on the side away from `outwards`; NaN if that side is not a number.
pub(super) fn signed(q: Vec3, nearest: Vec3, outwards: Vec3) -> f64 {
    let offset = q - nearest;
    let side = offset.dot(&outwards);
    if side > 0.0 {
        offset.norm()
    } else if side <= 0.0 {
        -offset.norm()
    } else {
        f64::NAN
    }
}

#[derive(Debug, Clone, Copy)]
struct Nearest {
    distance_squared: f64,
    point: ContactPoint,
    feature: Feature,
}

impl Shape<'_> {
    /// Returns the surface point nearest to q, on the triangle of lowest index among those that are equally near.
    /// `None` only if the surface has no triangle, or its positions are not finite.
    pub fn nearest(&self, q: Vec3) -> Option<ContactPoint> {
        match &self.surface.geometry {
            ContactGeometry::Faceted | ContactGeometry::Shaded => self.nearest_on_triangles(q),
            ContactGeometry::Smooth(smooth) => self.nearest_on_smooth(smooth, q),
        }
    }

    pub(super) fn nearest_on_triangles(&self, q: Vec3) -> Option<ContactPoint> {
        Some(self.nearest_feature(q)?.point)
    }

    fn nearest_feature(&self, q: Vec3) -> Option<Nearest> {
        let least = self.least_distant(q)?;
        let bound = least.distance_squared + SAME_DISTANCE_SQUARED;
        self.sweep(q, bound, |best, candidate| candidate.point.triangle < best.point.triangle).or(Some(least))
    }

    /// Returns the nearest feature, to the last bit. Its pseudonormal decides the side of the surface; that of a triangle
    /// which only ties with it within [`SAME_DISTANCE_SQUARED`] may face the other way.
    fn least_distant(&self, q: Vec3) -> Option<Nearest> {
        self.sweep(q, f64::INFINITY, |best, candidate| candidate.distance_squared < best.distance_squared)
    }

    /// Returns the best of all triangles within a squared distance, by the given order.
    fn sweep(&self, q: Vec3, bound: f64, better: impl Fn(&Nearest, &Nearest) -> bool) -> Option<Nearest> {
        let fixed_bound = bound < f64::INFINITY;
        let mut best: Option<Nearest> = None;
        let consider = |best: &mut Option<Nearest>, triangle: u32| {
            let corners = self.corners(triangle);
            let (weights, feature) = nearest_on_triangle(corners, q);
            let point = ContactPoint { triangle, weights };
            let distance_squared = (q - point.position(corners)).norm_squared();
            let candidate = Nearest { distance_squared, point, feature };
            if distance_squared <= bound && best.as_ref().is_none_or(|best| better(best, &candidate)) {
                *best = Some(candidate);
            }
        };
        let reach = self.reach();
        let enter = |best: &Option<Nearest>, aabb: &Aabb| {
            let limit = match best {
                Some(best) if !fixed_bound => best.distance_squared,
                _ => bound,
            };
            let distance = (aabb.distance(q) - reach).max(0.0);
            distance * distance <= limit * BOX_MARGIN
        };
        self.model.boxes.search(&mut best, enter, consider);
        best
    }

    /// Whether q is outside the closed surface, which must not intersect itself; a point on the surface is not outside.
    pub fn is_outside(&self, q: Vec3) -> bool {
        self.signed_distance(q) > 0.0
    }

    /// Whether q is within reach of the box around the surface; every other point is outside the surface.
    pub(super) fn may_contain(&self, q: Vec3) -> bool {
        self.model.boxes.around_all().distance(q) <= self.reach()
    }

    /// Distance of q from the surface, m, negative inside; NaN if the surface is not finite.
    pub fn signed_distance(&self, q: Vec3) -> f64 {
        match &self.surface.geometry {
            ContactGeometry::Faceted | ContactGeometry::Shaded => self.signed_distance_to_triangles(q),
            ContactGeometry::Smooth(smooth) => self.signed_distance_to_smooth(smooth, q),
        }
    }

    /// Signed distance by the angle-weighted pseudonormal at the nearest point (Bærentzen & Aanæs 2005).
    fn signed_distance_to_triangles(&self, q: Vec3) -> f64 {
        let Some(nearest) = self.least_distant(q) else { return f64::NAN };
        let ContactPoint { triangle, .. } = nearest.point;
        let surface = &self.surface.topology;
        let normal = match nearest.feature {
            Feature::Face => self.unit_face_normal(triangle),
            Feature::Edge(opposite) => {
                let across = surface.neighbors[triangle as usize][opposite];
                self.unit_face_normal(triangle) + across.map_or(Vec3::zeros(), |t| self.unit_face_normal(t))
            }
            Feature::Corner(corner) => {
                let vertex = surface.triangles[triangle as usize][corner];
                surface.incident(vertex).iter().map(|&t| self.unit_face_normal(t) * self.angle(t, vertex)).sum()
            }
        };
        signed(q, nearest.point.position(self.corners(triangle)), normal)
    }

    /// Unit normal of a face; zero for a triangle without area, which then adds nothing to a pseudonormal.
    fn unit_face_normal(&self, triangle: u32) -> Vec3 {
        self.area_normal(triangle).try_normalize(0.0).unwrap_or_default()
    }

    fn angle(&self, triangle: u32, vertex: u32) -> f64 {
        let vertices = self.surface.topology.triangles[triangle as usize];
        let corners = self.corners(triangle);
        let k = vertices.iter().position(|&v| v == vertex).unwrap_or(0);
        let here = corners[k];
        (corners[(k + 1) % 3] - here).angle(&(corners[(k + 2) % 3] - here))
    }
}
