//! Continuous collision detection of the moving tip against moving triangles.

use super::shape::{Shape, plane_weights};
use crate::Vec3;
use crate::surface::geometry::ContactPoint;
use crate::surface::tree::Aabb;

/// A point this far outside a triangle, in barycentric weight, still hits it: neighbours share their common edge to
/// round-off.
const WEIGHT_TOLERANCE: f64 = 1e-9;
/// Triangles hit this close together, in τ, count as hit at once, and the first of them is taken.
const SAME_TIME: f64 = 1e-12;
/// A tip this far inside a triangle's plane, m, at the start of a tick still counts as outside: a tip released on the
/// surface may be inside by the last bit. This is 1e5 ulps of a position of 0.1 m, and a ten-millionth of an encoder's
/// resolution.
pub const START_TOLERANCE: f64 = 1e-12;

/// Workspace of [`first_collision`]: every triangle that the tip passes through.
#[derive(Debug)]
pub struct Hits(Vec<Collision>);

impl Hits {
    /// Allocates for a surface of this many triangles.
    pub fn new(triangles: usize) -> Self {
        Self(Vec::with_capacity(triangles))
    }
}

impl Clone for Hits {
    /// Clones an empty workspace of the same capacity, so that a copy allocates as little as the original.
    fn clone(&self) -> Self {
        Self::new(self.0.capacity())
    }
}

/// The tip's first passage from the outer to the inner side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// Time of the passage τ ∈ \[0, 1\], a fraction of the tick.
    pub time: f64,
    /// Point of the passage on the surface.
    pub point: ContactPoint,
}

/// Returns when and where the tip, moving from q₀ to q₁, first passes inwards through triangles that move from `start`
/// to `end`, all linear in τ. `hits` is a workspace; it never holds more entries than the surface has triangles.
/// `tested` counts the triangles that the search visits.
///
/// ```
/// use stickslip::contact::collision::{Hits, first_collision};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let block = simulation.local().shape(); // its top is at z = 0
/// let (mut hits, mut tested) = (Hits::new(simulation.surface().triangles.len()), 0);
/// let (above, inside) = (Vec3::new(0.001, 0.002, 0.003), Vec3::new(0.001, 0.002, -0.001));
/// let hit = first_collision(&block, &block, above, inside, &mut hits, &mut tested).expect("it falls in");
/// assert!((hit.time - 0.75).abs() < 1e-15);
/// assert!((block.position(&hit.point) - Vec3::new(0.001, 0.002, 0.0)).norm() < 1e-15);
/// assert!(tested < 20, "of 448 triangles");
/// assert_eq!(first_collision(&block, &block, inside, above, &mut hits, &mut tested), None); // outward motion
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
pub fn first_collision(
    start: &Shape,
    end: &Shape,
    q0: Vec3,
    q1: Vec3,
    Hits(hits): &mut Hits,
    tested: &mut u64,
) -> Option<Collision> {
    hits.clear();
    let tip = Aabb::around([q0, q1]).grown(START_TOLERANCE);
    let consider = |hits: &mut Vec<Collision>, triangle: u32| {
        *tested += 1;
        let (from, to) = (start.corners(triangle), end.corners(triangle));
        if Aabb::around(from.into_iter().chain(to)).grown(START_TOLERANCE).overlaps(&tip)
            && let Some((time, weights)) = pass_inwards(from, to, q0, q1)
        {
            hits.push(Collision { time, point: ContactPoint { triangle, weights } });
        }
    };
    let reachable = tip.grown(start.reach().max(end.reach()));
    start.model.boxes.search(hits, |_, aabb| aabb.overlaps(&reachable), consider);

    let earliest = hits.iter().map(|hit| hit.time).fold(f64::INFINITY, f64::min);
    hits.iter().filter(|hit| hit.time <= earliest + SAME_TIME).min_by_key(|hit| hit.point.triangle).copied()
}

/// Returns the first τ at which q₀ + τ(q₁ − q₀) passes from the outer to the inner side of a triangle that moves from
/// `from` to `to`, within its edges, and the barycentric weights there.
///
/// The tip's height over the moving plane times twice the area is
/// g(τ) = (q − a)·((b − a) × (c − a)), a cubic.
///
/// ```
/// use stickslip::{Vec3, contact::collision::pass_inwards};
///
/// let floor = [Vec3::zeros(), Vec3::x(), Vec3::y()];
/// let risen = floor.map(|corner| corner + Vec3::z() * 0.1);
/// let (start, end) = (Vec3::new(0.25, 0.25, 0.3), Vec3::new(0.25, 0.25, -0.2));
/// // The tip falls onto a triangle that rises: 0.3 − 0.5τ = 0.1τ.
/// let (time, [alpha, beta, gamma]) = pass_inwards(floor, risen, start, end).expect("they meet");
/// assert!((time - 0.5).abs() < 1e-15);
/// assert!((alpha - 0.5).abs() < 1e-15 && (beta - 0.25).abs() < 1e-15 && (gamma - 0.25).abs() < 1e-15);
/// ```
pub fn pass_inwards(from: [Vec3; 3], to: [Vec3; 3], q0: Vec3, q1: Vec3) -> Option<(f64, [f64; 3])> {
    let ([a0, b0, c0], [a1, b1, c1]) = (from, to);
    let edge_b = [b0 - a0, (b1 - a1) - (b0 - a0)];
    let edge_c = [c0 - a0, (c1 - a1) - (c0 - a0)];
    let tip = [q0 - a0, (q1 - a1) - (q0 - a0)];
    let normal = [
        edge_b[0].cross(&edge_c[0]),
        edge_b[0].cross(&edge_c[1]) + edge_b[1].cross(&edge_c[0]),
        edge_b[1].cross(&edge_c[1]),
    ];
    let height = Cubic([
        tip[0].dot(&normal[0]),
        tip[0].dot(&normal[1]) + tip[1].dot(&normal[0]),
        tip[0].dot(&normal[2]) + tip[1].dot(&normal[1]),
        tip[1].dot(&normal[2]),
    ]);
    let inside = |time: f64| {
        let at = |part: [Vec3; 2]| part[0] + part[1] * time;
        let weights = plane_weights(at(edge_b), at(edge_c), at(tip));
        weights.iter().all(|&w| w >= -WEIGHT_TOLERANCE).then_some((time, weights))
    };
    let twice_area = normal[0].norm();
    height.falls_through_zero(START_TOLERANCE * twice_area).into_iter().flatten().find_map(inside)
}

/// The cubic c₀ + c₁τ + c₂τ² + c₃τ³.
struct Cubic([f64; 4]);

impl Cubic {
    fn value(&self, t: f64) -> f64 {
        let [c0, c1, c2, c3] = self.0;
        c0 + t * (c1 + t * (c2 + t * c3))
    }

    /// Returns where the cubic falls from positive to negative in \[0, 1\], ascending; at most two places. A start at
    /// zero, or below it by no more than the tolerance, counts as positive.
    fn falls_through_zero(&self, start_tolerance: f64) -> [Option<f64>; 2] {
        let mut falls = [None; 2];
        let mut found = 0;
        // Between its turning points the cubic is monotone: one root or none in each piece.
        let [first, second] = self.turning_points();
        let mut left = (0.0, self.value(0.0));
        if left.1 <= 0.0 && left.1 >= -start_tolerance {
            left.1 = 0.0;
        }
        for end in [first, second, Some(1.0)].into_iter().flatten() {
            let right = (end, self.value(end));
            if left.1 >= 0.0 && right.1 < 0.0 && found < falls.len() {
                falls[found] = Some(self.root_between(left.0, right.0));
                found += 1;
            }
            left = right;
        }
        falls
    }

    /// Zeros of the derivative in (0, 1), ascending.
    fn turning_points(&self) -> [Option<f64>; 2] {
        let [_, c1, c2, c3] = self.0;
        // Roots of 3c₃t² + 2c₂t + c₁ in the form without cancellation.
        let discriminant = c2 * c2 - 3.0 * c3 * c1;
        if !(discriminant > 0.0) {
            return [None; 2];
        }
        let sum = -(c2 + discriminant.sqrt().copysign(c2));
        let mut points = [sum / (3.0 * c3), c1 / sum];
        points.sort_by(f64::total_cmp);
        points.map(|t| (t > 0.0 && t < 1.0).then_some(t))
    }

    /// Returns the zero of a piece that starts at or above zero and ends below. It bisects down to the resolution of τ
    /// near 1: bisection cannot miss, and a collision happens once per contact.
    fn root_between(&self, mut above: f64, mut below: f64) -> f64 {
        for _ in 0..f64::MANTISSA_DIGITS {
            let middle = 0.5 * (above + below);
            if self.value(middle) >= 0.0 {
                above = middle;
            } else {
                below = middle;
            }
        }
        above
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    fn moved(triangle: [Vec3; 3], by: Vec3) -> [Vec3; 3] {
        triangle.map(|corner| corner + by)
    }

    #[test]
    fn tip_falls_onto_a_rising_triangle() {
        let q0 = Vec3::new(0.25, 0.25, 0.3);
        let (time, weights) =
            pass_inwards(FLOOR, moved(FLOOR, Vec3::z() * 0.1), q0, q0 - Vec3::z() * 0.5).expect("they meet");
        // 0.3 − 0.5τ = 0.1τ
        assert!((time - 0.5).abs() <= 1e-15, "τ = {time}");
        assert!((weights[0] - 0.5).abs() <= 1e-15 && (weights[1] - 0.25).abs() <= 1e-15);
    }

    #[test]
    fn passing_outwards_or_beside_is_no_collision() {
        let (below, above) = (Vec3::new(0.2, 0.2, -0.1), Vec3::new(0.2, 0.2, 0.1));
        assert_eq!(pass_inwards(FLOOR, FLOOR, below, above), None);
        let beside = Vec3::new(2.0, 0.0, 0.0);
        assert_eq!(pass_inwards(FLOOR, FLOOR, above + beside, below + beside), None);
        assert!(pass_inwards(FLOOR, FLOOR, above, below).is_some());
    }

    #[test]
    fn a_grazing_touch_is_no_passage() {
        // The tip stands still; the triangle rises to it and falls again, turning at the touch:
        // its height over the plane has a double root.
        let cubic = Cubic([0.25, -1.0, 1.0, 0.0]);
        assert_eq!(cubic.falls_through_zero(0.0), [None; 2]);
        let cubic = Cubic([0.2499, -1.0, 1.0, 0.0]);
        assert!((cubic.falls_through_zero(0.0)[0].expect("two roots") - 0.49).abs() <= 1e-14);
    }

    #[test]
    fn all_falls_of_a_cubic_are_found() {
        // −(t − 0.2)(t − 0.5)(t − 0.8): falls at 0.2 and 0.8.
        let cubic = Cubic([0.08, -0.66, 1.5, -1.0]);
        let falls = cubic.falls_through_zero(0.0).map(|t| t.expect("a fall"));
        assert!((falls[0] - 0.2).abs() <= 1e-14 && (falls[1] - 0.8).abs() <= 1e-14, "{falls:?}");
    }

    #[test]
    fn a_start_on_the_surface_counts_and_a_start_inside_does_not() {
        let down = Vec3::new(0.0, 0.0, -0.1);
        let on = Vec3::new(0.2, 0.2, 0.0);
        assert_eq!(pass_inwards(FLOOR, FLOOR, on, on + down).map(|hit| hit.0), Some(0.0));
        let last_bit_inside = on - Vec3::z() * 1e-16;
        assert_eq!(pass_inwards(FLOOR, FLOOR, last_bit_inside, on + down).map(|hit| hit.0), Some(0.0));
        let inside = on - Vec3::z() * 1e-9;
        assert_eq!(pass_inwards(FLOOR, FLOOR, inside, on + down), None);
    }
}
