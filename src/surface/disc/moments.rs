//! Integrals of a Hertzian pressure over a flat triangle, in closed form.
//!
//! The pressure around a point P is κ(y) = √(a² − |y − P|²), without a factor that the normalisation of the weights removes,
//! and zero beyond the distance a. In the plane of a triangle at distance d from P it is √(ρ² − r²) with ρ² = a² − d² and r
//! the distance from the projection of P. It is the divergence of a radial field, and −κ³/3 is the potential of yκ, so that
//! Green's theorem leaves integrals along the three edges. Each takes two arctangents and two square roots.

use crate::Vec3;

/// An edge of a [`Face`], named by the opposite corner.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Unit vector along the edge, anticlockwise.
    along: Vec3,
    /// Unit vector out of the triangle, in its plane.
    outwards: Vec3,
    /// Length, m.
    length: f64,
    /// Distance of the opposite corner, m.
    height: f64,
}

/// A flat triangle, prepared for integration.
///
/// ```
/// use stickslip::{Vec3, surface::disc::moments::Face};
///
/// // A disc of 2 mm well inside a large triangle: the whole hemisphere, ⅔πa³, centred on P.
/// let face = Face::new([Vec3::zeros(), Vec3::x() * 0.02, Vec3::y() * 0.02]);
/// let moments = face.moments(Vec3::new(0.005, 0.004, 0.0), 0.002).expect("it is within reach");
/// let sum: f64 = moments.hats.iter().map(|hat| hat.integral).sum();
/// assert!((sum / (2.0 / 3.0 * std::f64::consts::PI * 0.002_f64.powi(3)) - 1.0).abs() < 1e-14);
/// let centre: f64 = moments.hats[1].integral / sum * 0.02;
/// assert!((centre - 0.005).abs() < 1e-17); // by symmetry
/// assert_eq!(moments.reaches, [false; 3]);
/// assert!(face.moments(Vec3::new(0.005, 0.004, 0.003), 0.002).is_none()); // too high above it
/// ```
#[derive(Debug, Clone)]
pub struct Face {
    corners: [Vec3; 3],
    normal: Vec3,
    edges: [Edge; 3],
}

/// The pressure's integral against one hat function: 1 at a corner, 0 at the other two, and linear between them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Hat {
    /// Integral ∫ φκ dA, m³.
    pub integral: f64,
    /// Its derivative by the point P, m².
    pub gradient: Vec3,
}

/// Integrals of the pressure over a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Integrals against the hat function of each corner.
    pub hats: [Hat; 3],
    /// Whether the pressure reaches the edge opposite each corner.
    pub reaches: [bool; 3],
}

/// Integrals along an edge, over the parameter s from the foot of the perpendicular from P.
struct EdgeIntegrals {
    /// Signed distance h of the edge's line from the projection of P, m, positive if P is on the inner side.
    distance: f64,
    /// ∫ κ ds.
    pressure: f64,
    /// ∫ κ³ ds.
    cubed: f64,
    /// ∫ κ φ ds for φ rising from 0 to 1 along the edge, then for φ falling.
    weighted: [f64; 2],
    /// The edge's part of ∫ κ dA and of ∫ dA/κ.
    area: [f64; 2],
    /// Whether the edge comes within the disc.
    is_reached: bool,
}

impl Face {
    /// Prepares the triangle of these corners, m. A triangle without area yields integrals that are not finite.
    pub fn new(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let cross = (b - a).cross(&(c - a));
        let normal = cross.normalize();
        let edges = [0, 1, 2].map(|k: usize| {
            let edge = corners[(k + 2) % 3] - corners[(k + 1) % 3];
            let length = edge.norm();
            let along = edge / length;
            Edge { along, outwards: along.cross(&normal), length, height: cross.norm() / length }
        });
        Self { corners, normal, edges }
    }

    /// Height of a point over the face's plane, m.
    pub fn height(&self, point: Vec3) -> f64 {
        (point - self.corners[0]).dot(&self.normal)
    }

    /// Integrates the pressure of radius a around P, m, and its derivatives by P; `None` if it does not reach the face.
    pub fn moments(&self, point: Vec3, radius: f64) -> Option<Moments> {
        let offset = self.height(point);
        let rho_squared = radius * radius - offset * offset;
        if !(rho_squared > 0.0) {
            return None;
        }
        let rho = rho_squared.sqrt();
        let from_point = self.corners.map(|corner| corner - point);
        let distances = [0, 1, 2].map(|k| self.edges[k].outwards.dot(&from_point[(k + 1) % 3]));
        if distances.iter().any(|&distance| distance <= -rho) {
            return None;
        }
        let integrals = [0, 1, 2].map(|k| {
            let edge = &self.edges[k];
            edge.integrals(distances[k], edge.along.dot(&from_point[(k + 1) % 3]), rho)
        });
        let total = |of: fn(&EdgeIntegrals) -> f64| of(&integrals[0]) + of(&integrals[1]) + of(&integrals[2]);
        let along_edges = |of: fn(&EdgeIntegrals) -> f64| -> Vec3 {
            self.edges.iter().zip(&integrals).map(|(edge, integral)| edge.outwards * -of(integral)).sum()
        };
        // ∫ κ, ∫ yκ, ∫ 1/κ and ∫ y/κ over the face, with y from the projection of P.
        let [pressure, inverse] = [total(|edge| edge.area[0]), total(|edge| edge.area[1])];
        let [moment, inverse_moment] = [along_edges(|edge| edge.cubed) / 3.0, along_edges(|edge| edge.pressure)];
        let hats = [0, 1, 2].map(|k: usize| {
            let (edge, integral) = (&self.edges[k], &integrals[k]);
            let value = integral.distance / edge.height;
            let slope = edge.outwards * (-1.0 / edge.height);
            let (before, after) = ((k + 1) % 3, (k + 2) % 3);
            // κ vanishes at the rim, so that only the triangle's edges contribute.
            let in_plane = slope * pressure
                - self.edges[before].outwards * integrals[before].weighted[0]
                - self.edges[after].outwards * integrals[after].weighted[1];
            let across = -offset * (value * inverse + slope.dot(&inverse_moment));
            Hat { integral: value * pressure + slope.dot(&moment), gradient: in_plane + self.normal * across }
        });
        Some(Moments { hats, reaches: integrals.map(|integral| integral.is_reached) })
    }
}

impl Edge {
    /// Integrates along the edge, which begins at `start` and whose line is at `distance` from the centre of a disc of
    /// radius ρ.
    fn integrals(&self, distance: f64, start: f64, rho: f64) -> EdgeIntegrals {
        let (h, ends) = (distance, [start, start + self.length]);
        let half_chord_squared = rho * rho - h * h;
        let nearest = 0.0_f64.clamp(ends[0], ends[1]);
        // Pressures at the ends; the angle that the edge subtends at the centre, less a part within the disc, where the
        // radial field differs from that outside; and the angle asin(s/c) along the chord of half length c.
        let (kappa, turn, chord) = if half_chord_squared > 0.0 {
            let kappa = ends.map(|s| (half_chord_squared - s * s).max(0.0).sqrt());
            let turn = |k: usize| {
                let (s, q) = (ends[k], kappa[k]);
                let below = (h * h + s * s).min(rho * rho) / (q + rho); // ρ − κ
                [h * h * q + s * s * rho, -s * h * below]
            };
            let ([x0, y0], [x1, y1]) = (turn(0), turn(1));
            let chord = (ends[1] * kappa[0] - ends[0] * kappa[1]).atan2(kappa[0] * kappa[1] + ends[0] * ends[1]);
            (kappa, (x0 * y1 - x1 * y0).atan2(x0 * x1 + y0 * y1), chord)
        } else {
            ([0.0; 2], (h * self.length).atan2(h * h + ends[0] * ends[1]), 0.0)
        };
        let difference = |of: fn(f64, f64) -> f64| of(ends[1], kappa[1]) - of(ends[0], kappa[0]);
        let linear = difference(|s, kappa| s * kappa);
        let pressure = 0.5 * (linear + half_chord_squared * chord);
        let first = difference(|_, kappa| kappa * kappa * kappa) / -3.0;
        let cubed = 0.25 * difference(|s, kappa| s * kappa * kappa * kappa) + 0.75 * half_chord_squared * pressure;
        let area = rho * rho * rho * turn / 3.0 + h / 3.0 * (pressure + rho * rho * chord);
        EdgeIntegrals {
            distance,
            pressure,
            cubed,
            weighted: [(first - ends[0] * pressure) / self.length, (ends[1] * pressure - first) / self.length],
            area: [area, rho * turn + h * chord],
            is_reached: nearest * nearest < half_chord_squared,
        }
    }
}
