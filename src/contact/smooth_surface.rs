//! Contact with a surface that has derivatives: the Loop limit surface, or a surface that is felt over a disc.
//!
//! Finds its point nearest to the tip, by a safeguarded Newton search that walks from triangle to triangle; the side on
//! which the tip is; and the time at which the tip passes inwards.

use super::collision::{Collision, START_TOLERANCE};
use super::nearest::signed;
use super::shape::{Projection, Shape};
use crate::Vec3;
use crate::surface::disc::{DiscSurface, DiscWeights, Felt};
use crate::surface::geometry::{ContactPoint, SmoothSurface};
use crate::surface::subdivision::{DERIVATIVES, Jet, LimitSurface};
use crate::surface::tree::Aabb;

/// A search for the nearest point ends when its next step is shorter than this, relative to the distance between the
/// triangle's corners. The error of the point is then the square of it.
const STEP_TOLERANCE: f64 = 1e-12;
/// Cap on the evaluations of a search. Newton needs three to six, and one for every triangle crossed. A search that
/// takes this many has met a surface that folds onto itself; it returns the best point found.
const LARGEST_SEARCH: usize = 200;

/// Largest number of restarts of a search; each starts nearer than the one before ended.
const RESTARTS: usize = 3;
/// Largest number of halvings of a step that does not lead nearer.
const HALVINGS: usize = 30;
/// Largest number of edges that a search crosses without moving. A search that crosses more circles around a corner of the
/// body, which is the nearest point.
const LARGEST_STALL: usize = 16;

/// A tick is examined in pieces in which tip and surface move by no more than this share of a mesh edge, so that a body
/// of that thickness is not passed through undetected.
const PIECE: f64 = 0.25;
/// Largest number of pieces.
const LARGEST_PIECES: f64 = 64.0;
/// Largest number of halvings of a piece with the tip outside at both ends, in search of a moment inside. The search
/// can miss only a contact much shorter than a tick.
const LOOKS: u32 = 12;
/// Depth of the tip, m, from which it has passed inwards: above the round-off of a distance between positions of 0.1 m. A
/// tip that ends a tick on the surface passes it in the next one, whichever way the last bit falls.
const PASSED_M: f64 = 1e-15;
/// Width in τ to which a passage is located.
const TIME_TOLERANCE: f64 = 1e-15;

/// A point of a smooth surface at one instant, with its derivatives by β and γ.
///
/// ```
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene, surface::geometry::ContactGeometry};
///
/// let scene = Scene::shipped("fig3-sliding-subdivision").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let block = simulation.local().shape();
/// let ContactGeometry::Smooth(smooth) = &block.surface.geometry else { panic!("the scene says subdivision") };
/// let tip = Vec3::new(0.001, 0.0013, 0.002);
/// let point = block.smooth_point(smooth, &block.nearest(tip).expect("the surface is not empty"));
/// assert!((point.position - Vec3::new(0.001, 0.0013, 0.0)).norm() < 1e-12); // the top is flat in the middle
/// assert!((point.normal() - Vec3::z()).norm() < 1e-12);
/// assert!(point.tangents.iter().all(|tangent| tangent.dot(&point.normal()).abs() < 1e-15));
/// assert!(point.curvatures.iter().all(|curvature| curvature.norm() < 1e-12));
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// Position p, m.
    pub position: Vec3,
    /// Tangents ∂p/∂β and ∂p/∂γ, m.
    pub tangents: [Vec3; 2],
    /// Second derivatives ∂²p/∂β², ∂²p/∂β∂γ, ∂²p/∂γ², m. Zero where they are not known, which makes Newton's step that of
    /// Gauss and Newton.
    pub curvatures: [Vec3; 3],
}

impl SurfacePoint {
    /// Unit normal n̂, not finite where the surface has no tangent plane.
    pub fn normal(&self) -> Vec3 {
        self.tangents[0].cross(&self.tangents[1]).normalize()
    }

    fn along(&self, [b, g]: [f64; 2]) -> Vec3 {
        self.tangents[0] * b + self.tangents[1] * g
    }

    /// Step to the nearest point. If `newton` is set and the second-order model of the squared distance has a minimum,
    /// this is that minimum; otherwise it is the minimum of the first-order model of the surface (Gauss–Newton), which
    /// always leads downhill and is the same vector in space on both sides of an edge.
    fn step(&self, offset: Vec3, newton: bool) -> [f64; 2] {
        let [pb, pg] = self.tangents;
        let [pbb, pbg, pgg] = self.curvatures;
        let downhill = [offset.dot(&pb), offset.dot(&pg)];
        let metric = [pb.norm_squared(), pb.dot(&pg), pg.norm_squared()];
        let hessian = [metric[0] - offset.dot(&pbb), metric[1] - offset.dot(&pbg), metric[2] - offset.dot(&pgg)];
        let determinant = |[a, b, c]: [f64; 3]| a * c - b * b;
        let convex = hessian[0] > 0.0 && determinant(hessian) > 0.0;
        let [a, b, c] = if newton && convex { hessian } else { metric };
        let scale = 1.0 / determinant([a, b, c]);
        [(c * downhill[0] - b * downhill[1]) * scale, (a * downhill[1] - b * downhill[0]) * scale]
    }

    /// Step to the nearest point along one direction of the parameters.
    fn step_along(&self, offset: Vec3, [b, g]: [f64; 2]) -> [f64; 2] {
        let tangent = self.along([b, g]);
        let curvature =
            self.curvatures[0] * (b * b) + self.curvatures[1] * (2.0 * b * g) + self.curvatures[2] * (g * g);
        let metric = tangent.norm_squared();
        let hessian = metric - offset.dot(&curvature);
        let t = offset.dot(&tangent) / if hessian > 0.0 { hessian } else { metric };
        [b * t, g * t]
    }
}

/// Outcome of a search for the nearest point.
struct Search {
    point: ContactPoint,
    surface: SurfacePoint,
    over_border: bool,
}

impl Shape<'_> {
    /// Evaluates a smooth surface at a contact point.
    pub fn smooth_point(&self, smooth: &SmoothSurface, point: &ContactPoint) -> SurfacePoint {
        match smooth {
            SmoothSurface::Limit(limit) => {
                self.limit_point(limit, point.triangle, &limit.jet(point.triangle, point.weights))
            }
            SmoothSurface::Disc(disc) => {
                let Felt { position, tangents, .. } = self.felt(disc, point.triangle, &disc.weights(point));
                SurfacePoint { position, tangents, curvatures: [Vec3::zeros(); 3] }
            }
        }
    }

    pub(super) fn felt(&self, disc: &DiscSurface, triangle: u32, weights: &DiscWeights) -> Felt {
        disc.felt(triangle, weights, |vertex| self.model.vertex(vertex, self.x, self.elapsed))
    }

    pub(super) fn limit_point(&self, limit: &LimitSurface, triangle: u32, jet: &Jet) -> SurfacePoint {
        let mut sums = [Vec3::zeros(); DERIVATIVES];
        for (&vertex, entry) in limit.support(triangle).iter().zip(jet.entries()) {
            let x = self.model.vertex(vertex, self.x, self.elapsed);
            sums.iter_mut().zip(entry).for_each(|(sum, weight)| *sum += x * *weight);
        }
        let [position, pb, pg, pbb, pbg, pgg] = sums;
        SurfacePoint { position, tangents: [pb, pg], curvatures: [pbb, pbg, pgg] }
    }

    /// Returns the nearest point that a walk downhill from `from` finds. Beyond the border of an open surface the
    /// contact ends.
    pub(super) fn project_onto_smooth(&self, smooth: &SmoothSurface, from: &ContactPoint, q: Vec3) -> Projection {
        let search = self.descend(smooth, *from, q);
        if search.over_border { Projection::OverBorder } else { Projection::Found(search.point) }
    }

    /// Returns the nearest point of a smooth surface.
    pub(super) fn nearest_on_smooth(&self, smooth: &SmoothSurface, q: Vec3) -> Option<ContactPoint> {
        Some(self.search(smooth, q)?.point)
    }

    /// Searches downhill from the nearest point of the control mesh, and again if the middle of another triangle's
    /// surface is nearer than the point found. The two differ where the mesh is crumpled, because control vertices
    /// stick out of the surface that they define.
    fn search(&self, smooth: &SmoothSurface, q: Vec3) -> Option<Search> {
        let mut best = self.descend(smooth, self.nearest_on_triangles(q)?, q);
        let restarts = match smooth {
            SmoothSurface::Limit(_) => RESTARTS,
            // The mean over a disc is not crumpled, and each look would cost as much as a step.
            SmoothSurface::Disc(_) => 0,
        };
        for _ in 0..restarts {
            let distance = (q - best.surface.position).norm();
            let reach = self.reach();
            let mut nearer: (f64, Option<ContactPoint>) = (distance, None);
            let look = |nearer: &mut (f64, Option<ContactPoint>), triangle: u32| {
                let middle = ContactPoint { triangle, weights: [1.0 / 3.0; 3] };
                let away = (q - self.smooth_point(smooth, &middle).position).norm();
                if away < nearer.0 {
                    *nearer = (away, Some(middle));
                }
            };
            // The surface over a triangle lies in the convex hull of its support.
            self.model.boxes.search(&mut nearer, |nearer, aabb| aabb.distance(q) - reach < nearer.0, look);
            let Some(start) = nearer.1 else { break };
            best = self.descend(smooth, start, q);
        }
        Some(best)
    }

    /// Length of the longest edge of the control triangle nearest to q, m.
    fn edge_near(&self, q: Vec3) -> Option<f64> {
        let [a, b, c] = self.corners(self.nearest_on_triangles(q)?.triangle);
        Some((b - a).norm().max((c - b).norm()).max((a - c).norm()))
    }

    /// Distance of q from a smooth surface, m, negative on the inner side of its nearest point; NaN if the surface is
    /// not finite.
    pub(super) fn signed_distance_to_smooth(&self, smooth: &SmoothSurface, q: Vec3) -> f64 {
        self.search(smooth, q)
            .map_or(f64::NAN, |search| signed(q, search.surface.position, self.outwards(smooth, &search)))
    }

    /// Vector to the outer side at the end of a search. A surface that is felt over a disc keeps the sharp edges of the body:
    /// there it is the angle-weighted pseudonormal (Bærentzen & Aanæs 2005).
    fn outwards(&self, smooth: &SmoothSurface, Search { point, surface, .. }: &Search) -> Vec3 {
        let normal = surface.tangents[0].cross(&surface.tangents[1]);
        if let SmoothSurface::Limit(_) = smooth {
            return normal;
        }
        let topology = &self.surface.topology;
        let (vertices, neighbors) =
            (topology.triangles[point.triangle as usize], topology.neighbors[point.triangle as usize]);
        let on_edge = |k: usize| !(point.weights[k] > 0.0);
        match (0..3).filter(|&k| on_edge(k)).count() {
            0 => normal,
            1 => {
                let neighbor = (0..3).find(|&k| on_edge(k)).and_then(|k| neighbors[k]);
                let across = neighbor.map(|neighbor| self.smooth_point(smooth, &self.across(point, neighbor)).normal());
                normal.normalize() + across.unwrap_or_default()
            }
            _ => {
                let corner = vertices[Vec3::from(point.weights).imax()];
                let around = topology.incident(corner).iter().map(|&triangle| {
                    let k = topology.triangles[triangle as usize].iter().position(|&v| v == corner).unwrap_or(0);
                    let mut weights = [0.0; 3];
                    weights[k] = 1.0;
                    let there = self.smooth_point(smooth, &ContactPoint { triangle, weights });
                    let [b, g] = there.tangents;
                    let sides = [[b, g], [g - b, -b], [-g, b - g]][k];
                    there.normal() * sides[0].angle(&sides[1])
                });
                around.sum()
            }
        }
    }

    /// Minimises |q − p(β, γ)| over the surface. A step that leaves its triangle ends on the edge, and the search
    /// continues in the neighbour; at a border it continues along the border.
    fn descend(&self, smooth: &SmoothSurface, from: ContactPoint, q: Vec3) -> Search {
        let [a, b, c] = self.corners(from.triangle);
        let shortest = STEP_TOLERANCE * (b - a).norm().max((c - a).norm());
        let mut here = ContactPoint { triangle: from.triangle, weights: from.weights.map(|w| w.max(0.0)) };
        let mut surface = self.smooth_point(smooth, &here);
        let mut came_from = None;
        let mut newton = true;
        let mut over_border = false;
        let mut stall = 0;
        for _ in 0..LARGEST_SEARCH {
            let offset = q - surface.position;
            let mut step = surface.step(offset, newton);
            let border = self.border_ahead(&here, step);
            over_border = border.is_some();
            let crease = match smooth {
                SmoothSurface::Limit(_) => None,
                SmoothSurface::Disc(_) => self.crease_ahead(&here, step, came_from),
            };
            if let Some(opposite) = border.or(crease) {
                step = surface.step_along(offset, EDGE_DIRECTIONS[opposite]);
            }
            let length = surface.along(step).norm();
            // This also ends where the surface is not finite: the tick turns that into a fault.
            if !(length > shortest) {
                break;
            }
            let Some((next, crossed, moved)) = self.advance(smooth, &here, &surface, q, step) else { break };
            if let Some(neighbor) = crossed {
                // The step leads back across the edge just crossed: the second-order models of the two sides disagree.
                newton &= came_from != Some(neighbor);
                came_from = Some(here.triangle);
            }
            if let SmoothSurface::Disc(_) = smooth {
                let has_moved = (moved.position - surface.position).norm() > shortest;
                stall = if has_moved { 0 } else { stall + 1 };
                came_from = came_from.filter(|_| crossed.is_some());
            }
            (here, surface) = (next, moved);
            if stall > LARGEST_STALL {
                break;
            }
        }
        Search { point: here, surface, over_border }
    }

    /// Returns the edge, by the opposite corner, over which the search is about to leave an open surface: the point is
    /// on that edge, and the step points outwards.
    fn border_ahead(&self, here: &ContactPoint, step: [f64; 2]) -> Option<usize> {
        self.edge_ahead(here, step, None)
    }

    /// Returns the edge over which the search is about to go back to the triangle that it has just left: two triangles meet
    /// there at an angle, and the nearest point is on the edge.
    fn crease_ahead(&self, here: &ContactPoint, step: [f64; 2], came_from: Option<u32>) -> Option<usize> {
        came_from.and_then(|_| self.edge_ahead(here, step, came_from))
    }

    /// Returns the edge to this neighbour, if the point is on it and the step leads over it.
    fn edge_ahead(&self, here: &ContactPoint, step: [f64; 2], neighbor: Option<u32>) -> Option<usize> {
        let change = [-step[0] - step[1], step[0], step[1]];
        (0..3).find(|&k| {
            here.weights[k] <= 0.0
                && change[k] < 0.0
                && self.surface.topology.neighbors[here.triangle as usize][k] == neighbor
        })
    }

    /// Takes a step, shortened until it leads nearer, and cut at the edge of the triangle. Returns the point and the
    /// triangle entered, if any; `None` if no step leads nearer.
    fn advance(
        &self,
        smooth: &SmoothSurface,
        here: &ContactPoint,
        surface: &SurfacePoint,
        q: Vec3,
        step: [f64; 2],
    ) -> Option<(ContactPoint, Option<u32>, SurfacePoint)> {
        // Near the end, and on entering the next triangle, the distance changes only by round-off.
        let distance = (q - surface.position).norm();
        let round_off = ROUND_OFF * (q.norm() + surface.position.norm());
        let change = [-step[0] - step[1], step[0], step[1]];
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            let (mut point, crossed) = self.moved(here, change.map(|c| c * fraction));
            if let Some(neighbor) = crossed {
                point = self.across(&point, neighbor);
            }
            let moved = self.smooth_point(smooth, &point);
            if (q - moved.position).norm() <= distance + round_off {
                return Some((point, crossed, moved));
            }
            fraction *= 0.5;
        }
        None
    }

    /// Moves within a triangle as far as its edge. Also returns the triangle beyond, if the move ends at the edge.
    fn moved(&self, here: &ContactPoint, change: [f64; 3]) -> (ContactPoint, Option<u32>) {
        let mut exit: Option<(f64, usize)> = None;
        for (k, (weight, change)) in here.weights.into_iter().zip(change).enumerate() {
            if weight + change < 0.0 {
                let at = weight / -change;
                if exit.is_none_or(|(first, _)| at < first) {
                    exit = Some((at, k));
                }
            }
        }
        let (fraction, opposite) = exit.map_or((1.0, None), |(at, k)| (at, Some(k)));
        let mut weights: [f64; 3] = std::array::from_fn(|k| (here.weights[k] + change[k] * fraction).max(0.0));
        if let Some(k) = opposite {
            weights[k] = 0.0;
        }
        let sum: f64 = weights.iter().sum();
        let point = ContactPoint { triangle: here.triangle, weights: weights.map(|w| w / sum) };
        let neighbors = &self.surface.topology.neighbors[here.triangle as usize];
        (point, opposite.and_then(|k| neighbors[k]))
    }

    /// Returns a point of a shared edge as a point of the neighbour.
    fn across(&self, point: &ContactPoint, neighbor: u32) -> ContactPoint {
        let triangles = &self.surface.topology.triangles;
        let from = triangles[point.triangle as usize];
        let weights = triangles[neighbor as usize].map(|vertex| {
            let k = from.iter().position(|&v| v == vertex);
            k.map_or(0.0, |k| point.weights[k])
        });
        ContactPoint { triangle: neighbor, weights }
    }
}

/// Round-off of a distance, relative to the positions it lies between: each is a sum of about twelve terms.
const ROUND_OFF: f64 = 16.0 * f64::EPSILON;

/// Direction ∂(β, γ) along the edge opposite each corner.
const EDGE_DIRECTIONS: [[f64; 2]; 3] = [[-1.0, 1.0], [0.0, 1.0], [1.0, 0.0]];

/// Time τ, and the signed distance of the tip at that time, m.
type Moment = (f64, f64);

/// The surface while it moves from its position at the start of a tick to the predicted one.
pub(super) struct MovingSurface<'a> {
    pub smooth: &'a SmoothSurface,
    pub start: Shape<'a>,
    pub end: Shape<'a>,
    pub between: &'a mut [Vec3],
    pub q0: Vec3,
    pub q1: Vec3,
}

impl MovingSurface<'_> {
    /// Returns when and where the tip passes from the outer to the inner side. A tip that is inside at the start passes
    /// through nothing.
    pub fn first_collision(&mut self, tested: &mut u64) -> Option<Collision> {
        // The surface over a triangle lies in the convex hull of its support, or no further from it than its overhang, by
        // which the boxes are grown.
        let tip = Aabb::around([self.q0, self.q1]).grown(START_TOLERANCE);
        let reachable = tip.grown(self.start.reach().max(self.end.reach()));
        let mut near = 0;
        self.start.model.boxes.search(&mut near, |_, aabb| aabb.overlaps(&reachable), |near, _| *near += 1);
        *tested += near;
        if near == 0 {
            return None;
        }

        let speed = (self.q1 - self.q0).norm() + self.fastest() * self.smooth.agility();
        let mut before = (0.0, self.distance(0.0));
        // A tip that starts inside passes through nothing, and one further away than all motion in the tick arrives later.
        if !(before.1 >= -START_TOLERANCE && before.1 <= speed) {
            return None;
        }
        before.1 = before.1.max(0.0);
        let edge = self.start.edge_near(self.q0)?;
        let pieces = (speed / (PIECE * edge)).ceil().clamp(1.0, LARGEST_PIECES);
        for piece in 1..=pieces as u32 {
            let time = f64::from(piece) / pieces;
            let after = (time, self.distance(time));
            let mut looks = LOOKS;
            if let Some((outside, inside)) = self.passage(before, after, speed, &mut looks) {
                let time = self.root_between(outside, inside);
                let point = self.at(time, |shape, smooth, q| shape.nearest_on_smooth(smooth, q))?;
                return Some(Collision { time, point });
            }
            before = after;
        }
        None
    }

    /// Returns a moment outside and a later one inside, between a moment outside and another. It halves every interval
    /// in which the distance, which changes by no more than `speed`, can reach zero, and takes the first pair found.
    fn passage(&mut self, from: Moment, to: Moment, speed: f64, looks: &mut u32) -> Option<(Moment, Moment)> {
        if to.1 < -PASSED_M {
            return Some((from, to));
        }
        if *looks == 0 || !(from.1 + to.1 <= speed * (to.0 - from.0)) {
            return None;
        }
        *looks -= 1;
        let time = 0.5 * (from.0 + to.0);
        let middle = (time, self.distance(time));
        self.passage(from, middle, speed, looks).or_else(|| self.passage(middle, to, speed, looks))
    }

    /// Largest movement of a vertex in the tick, m.
    fn fastest(&self) -> f64 {
        let moved = self.start.x.iter().zip(self.end.x).map(|(from, to)| (to - from).norm_squared());
        moved.fold(0.0, f64::max).sqrt().max(self.start.model.drift(self.end.elapsed - self.start.elapsed))
    }

    /// Signed distance of the tip at τ, m.
    fn distance(&mut self, time: f64) -> f64 {
        self.at(time, |shape, smooth, q| shape.signed_distance_to_smooth(smooth, q))
    }

    fn at<T>(&mut self, time: f64, evaluate: impl Fn(Shape, &SmoothSurface, Vec3) -> T) -> T {
        let between = |from: Vec3, to: Vec3| from + (to - from) * time;
        for ((x, from), to) in self.between.iter_mut().zip(self.start.x).zip(self.end.x) {
            *x = between(*from, *to);
        }
        let elapsed = self.start.elapsed + (self.end.elapsed - self.start.elapsed) * time;
        let shape = Shape { x: self.between, elapsed, ..self.start };
        evaluate(shape, self.smooth, between(self.q0, self.q1))
    }

    /// Returns the zero between a τ outside and one inside, by false position with the Illinois rule, and by bisection
    /// wherever that stalls.
    fn root_between(&mut self, mut outside: Moment, mut inside: Moment) -> f64 {
        let mut last_side = 0.0;
        for round in 0..200 {
            if !(inside.0 - outside.0 > TIME_TOLERANCE) {
                break;
            }
            let share = outside.1 / (outside.1 - inside.1);
            let guess = outside.0 + (inside.0 - outside.0) * if round % 3 == 2 { 0.5 } else { share };
            if !(guess > outside.0 && guess < inside.0) {
                break;
            }
            let distance = self.distance(guess);
            if distance >= 0.0 {
                outside = (guess, distance);
                inside.1 *= if last_side > 0.0 { 0.5 } else { 1.0 };
                last_side = 1.0;
            } else {
                inside = (guess, distance);
                outside.1 *= if last_side < 0.0 { 0.5 } else { 1.0 };
                last_side = -1.0;
            }
        }
        outside.0
    }
}
