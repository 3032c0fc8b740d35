//! The surface at rest as flat faces, over which the pressure is integrated in closed form.
//!
//! On a faceted or shaded surface these are its triangles, with their hat functions. Each triangle of a limit surface is
//! divided into n² faces with their corners on the surface, between which its basis functions are interpolated.

use std::collections::HashMap;

use super::moments::Face;
use super::{DiscError, RestSurface};
use crate::Vec3;
use crate::model::topology::Surface;
use crate::surface::subdivision::LimitSurface;

/// Largest side of a limit surface's faces, as a share of the radius. The error of a weight is then within 2 % of the
/// largest weight, compared with ever smaller faces.
const SHARE_OF_RADIUS: f64 = 0.5;
/// Least number of faces along a triangle's edge: a basis function spans several triangles, and is linear on none.
const LEAST_DIVISIONS: f64 = 2.0;
/// Largest number of faces along a triangle's edge. Over a disc that would need more, basis functions are nearly linear.
const MOST_DIVISIONS: usize = 8;
/// Largest distance of a face's middle from the limit surface, as a share of the radius. Its square, 1 %, is the error of
/// 1 − |y − P|²/a² at P.
const LARGEST_SAG: f64 = 0.1;

/// No face across an edge.
pub const NO_FACE: u32 = u32::MAX;

/// The faces of a surface at rest: n² per triangle, in order.
#[derive(Debug, Clone)]
pub struct Faces {
    /// Divisions n of a triangle's edge.
    pub divisions: usize,
    /// The faces, prepared for integration.
    pub faces: Vec<Face>,
    /// Points at the corners of each face.
    pub corners: Vec<[u32; 3]>,
    /// Faces across the edge opposite each corner, or [`NO_FACE`].
    pub neighbors: Vec<[u32; 3]>,
    /// Positions of the points, m.
    pub points: Vec<Vec3>,
    /// End of each point's row in `entries`.
    ends: Vec<u32>,
    /// Vertices that determine a point, with their weights.
    entries: Vec<(u32, f64)>,
}

impl Faces {
    /// Divides a surface at rest for discs of this radius, m.
    ///
    /// # Errors
    /// If the disc is too small for the faces of a limit surface.
    pub fn new(kind: &RestSurface, surface: &Surface, rest: &[Vec3], radius: f64) -> Result<Self, DiscError> {
        match kind {
            RestSurface::Faceted | RestSurface::Shaded(_) => Ok(Self::of_triangles(surface, rest)),
            RestSurface::Limit(limit) => {
                let longest = surface.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
                let longest = longest.map(|[a, b]| (rest[a as usize] - rest[b as usize]).norm()).fold(0.0, f64::max);
                let wanted = (longest / (SHARE_OF_RADIUS * radius)).ceil();
                let divisions = wanted.clamp(LEAST_DIVISIONS, MOST_DIVISIONS as f64) as usize;
                let faces = Self::of_limit(limit, surface, rest, divisions);
                let sag = faces.largest_sag(limit, rest);
                if !(sag <= LARGEST_SAG * radius) {
                    return Err(DiscError::TooNarrow { radius, least: sag / LARGEST_SAG });
                }
                Ok(faces)
            }
        }
    }

    fn of_triangles(surface: &Surface, rest: &[Vec3]) -> Self {
        let vertices = 0..rest.len() as u32;
        Self::assemble(
            1,
            surface.triangles.clone(),
            rest.to_vec(),
            (1..=rest.len() as u32).collect(),
            vertices.map(|vertex| (vertex, 1.0)).collect(),
        )
    }

    /// Divides every triangle of a limit surface into `divisions`² faces.
    pub fn of_limit(limit: &LimitSurface, surface: &Surface, rest: &[Vec3], divisions: usize) -> Self {
        let n = divisions;
        let mut known: HashMap<[(u32, usize); 3], u32> = HashMap::new();
        let (mut corners, mut points, mut ends, mut entries) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (triangle, vertices) in surface.triangles.iter().enumerate() {
            let triangle = triangle as u32;
            let mut point = |i: usize, j: usize| {
                // A point on an edge or a corner belongs to all triangles there: it is known by the vertices that carry it.
                let mut parts = [(vertices[0], n - i - j), (vertices[1], i), (vertices[2], j)];
                parts.iter_mut().filter(|part| part.1 == 0).for_each(|part| part.0 = u32::MAX);
                parts.sort_unstable();
                *known.entry(parts).or_insert_with(|| {
                    let weights = [n - i - j, i, j].map(|part| part as f64 / n as f64);
                    let jet = limit.jet(triangle, weights);
                    let row =
                        limit.support(triangle).iter().zip(jet.entries()).map(|(&vertex, entry)| (vertex, entry[0]));
                    points.push(row.clone().map(|(vertex, weight)| rest[vertex as usize] * weight).sum());
                    entries.extend(row);
                    ends.push(entries.len() as u32);
                    ends.len() as u32 - 1
                })
            };
            for i in 0..n {
                for j in 0..n - i {
                    let [right, left] = [point(i + 1, j), point(i, j + 1)];
                    corners.push([point(i, j), right, left]);
                    if i + j + 1 < n {
                        corners.push([point(i + 1, j + 1), left, right]);
                    }
                }
            }
        }
        Self::assemble(n, corners, points, ends, entries)
    }

    fn assemble(
        divisions: usize,
        corners: Vec<[u32; 3]>,
        points: Vec<Vec3>,
        ends: Vec<u32>,
        entries: Vec<(u32, f64)>,
    ) -> Self {
        let half_edge = |corners: [u32; 3], k: usize| [corners[(k + 1) % 3], corners[(k + 2) % 3]];
        let of_half_edge: HashMap<[u32; 2], u32> =
            corners.iter().zip(0..).flat_map(|(&face, index)| [0, 1, 2].map(|k| (half_edge(face, k), index))).collect();
        let across = |face: [u32; 3], k: usize| {
            let [from, to] = half_edge(face, k);
            of_half_edge.get(&[to, from]).copied().unwrap_or(NO_FACE)
        };
        let neighbors = corners.iter().map(|&face| [0, 1, 2].map(|k| across(face, k))).collect();
        let faces = corners.iter().map(|face| Face::new(face.map(|point| points[point as usize]))).collect();
        Self { divisions, faces, corners, neighbors, points, ends, entries }
    }

    /// Returns the vertices that determine a point, with their weights.
    #[inline]
    pub fn row(&self, point: u32) -> &[(u32, f64)] {
        let p = point as usize;
        let start = if p == 0 { 0 } else { self.ends[p - 1] };
        &self.entries[start as usize..self.ends[p] as usize]
    }

    /// Returns which of its triangle's faces a point lies in, by its barycentric weights.
    pub fn in_triangle(&self, [_, beta, gamma]: [f64; 3]) -> usize {
        let n = self.divisions;
        let cell = |weight: f64, most: usize| ((weight * n as f64) as usize).min(most);
        let i = cell(beta, n - 1);
        let j = cell(gamma, n - 1 - i);
        let rest = (beta + gamma) * n as f64 - (i + j) as f64;
        let is_second = rest > 1.0 && i + j + 1 < n;
        2 * n * i - i * i + 2 * j + usize::from(is_second)
    }

    /// Largest distance of the limit surface from the middles of the faces, m.
    fn largest_sag(&self, limit: &LimitSurface, rest: &[Vec3]) -> f64 {
        let n = self.divisions as f64;
        let middles = (0..self.divisions).flat_map(|i| {
            (0..self.divisions - i).flat_map(move |j| {
                let is_whole = |second: f64| i as f64 + j as f64 + second < n;
                let at = move |part: f64| [(i as f64 + part) / n, (j as f64 + part) / n];
                std::iter::once(at(1.0 / 3.0)).chain(is_whole(1.0).then(|| at(2.0 / 3.0)))
            })
        });
        let middles: Vec<[f64; 2]> = middles.collect();
        let sag = |face: usize| {
            let triangle = (face / middles.len()) as u32;
            let [beta, gamma] = middles[face % middles.len()];
            let jet = limit.jet(triangle, [1.0 - beta - gamma, beta, gamma]);
            let support = limit.support(triangle).iter().zip(jet.entries());
            let point: Vec3 = support.map(|(&vertex, entry)| rest[vertex as usize] * entry[0]).sum();
            self.faces[face].height(point).abs()
        };
        (0..self.faces.len()).map(sag).fold(0.0, f64::max)
    }
}
