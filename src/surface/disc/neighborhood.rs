//! The faces that the discs of one triangle may reach, and the integration over those that a disc does reach.

use std::collections::HashMap;

use super::faces::{Faces, NO_FACE};
use super::{Entry, MOST_FACES};
use crate::Vec3;

/// No face across an edge, or one out of reach.
const BEYOND: u16 = u16::MAX;

/// Least number of divisions of a triangle's edges, at whose points the region of its contact points is sampled.
const SAMPLES: usize = 6;
/// Largest distance of a point of a triangle from the nearest corner, as a share of the longest edge: 1/√3.
const FARTHEST: f64 = 0.578;

/// The faces that a disc around some point of a triangle may reach, by a path on the surface that stays within the radius.
#[derive(Debug, Clone)]
pub struct Neighborhood {
    /// Vertices that determine the faces.
    pub vertices: Vec<u32>,
    /// The faces; those of the triangle itself are the first.
    pub faces: Vec<NearFace>,
    /// Points at the corners of the faces: each as its number, and where its row begins in `columns`.
    points: Vec<(u32, u32)>,
    /// Places in `vertices` of the entries of each point's row.
    columns: Vec<u16>,
}

/// A face, with its corners and neighbours numbered within the neighbourhood.
#[derive(Debug, Clone, Copy)]
pub struct NearFace {
    face: u32,
    corners: [u16; 3],
    neighbors: [u16; 3],
}

impl Neighborhood {
    /// Collects the faces around a triangle, outwards over shared edges. They may be more than [`integrate`](Self::integrate)
    /// has room for, [`MOST_FACES`]: the caller refuses such a radius.
    pub fn new(faces: &Faces, triangle: u32, radius: f64) -> Self {
        let own = faces.divisions * faces.divisions;
        let first = triangle as usize * own;
        let region = Region::new(faces, first..first + own, radius);
        let mut order: Vec<u32> = (first as u32..(first + own) as u32).collect();
        let mut number: HashMap<u32, u16> = order.iter().copied().zip(0..).collect();
        let mut next = 0;
        while next < order.len() && order.len() < usize::from(BEYOND) - 3 {
            let face = order[next] as usize;
            for k in 0..3 {
                let neighbor = faces.neighbors[face][k];
                let ends = [(k + 1) % 3, (k + 2) % 3].map(|k| faces.points[faces.corners[face][k] as usize]);
                if neighbor != NO_FACE && !number.contains_key(&neighbor) && region.reaches(ends) {
                    number.insert(neighbor, order.len() as u16);
                    order.push(neighbor);
                }
            }
            next += 1;
        }
        let mut around = Self { vertices: Vec::new(), faces: Vec::new(), points: Vec::new(), columns: Vec::new() };
        let (mut point_number, mut vertex_number) = (HashMap::new(), HashMap::new());
        for &face in &order {
            let corners = faces.corners[face as usize].map(|point| {
                *point_number.entry(point).or_insert_with(|| {
                    around.points.push((point, around.columns.len() as u32));
                    for &(vertex, _) in faces.row(point) {
                        let column = *vertex_number.entry(vertex).or_insert_with(|| {
                            around.vertices.push(vertex);
                            around.vertices.len() as u16 - 1
                        });
                        around.columns.push(column);
                    }
                    around.points.len() as u16 - 1
                })
            });
            let neighbors = faces.neighbors[face as usize].map(|other| number.get(&other).copied().unwrap_or(BEYOND));
            around.faces.push(NearFace { face, corners, neighbors });
        }
        around
    }

    /// Adds the pressure of this radius around P, m, and its derivative, to the entries of the vertices: over the faces that
    /// are connected within the radius to the face where P lies, the triangle's `first`.
    pub fn integrate(&self, faces: &Faces, first: usize, point: Vec3, radius: f64, entries: &mut [Entry]) {
        // A triangle and a ball are convex, so that two faces are connected if the ball reaches their common edge.
        let mut is_known = [0_u64; MOST_FACES.div_ceil(64)];
        let mut waiting = [0_u16; MOST_FACES];
        let mut count = 1;
        waiting[0] = first as u16;
        is_known[first / 64] |= 1 << (first % 64);
        while count > 0 {
            count -= 1;
            let near = &self.faces[waiting[count] as usize];
            let Some(moments) = faces.faces[near.face as usize].moments(point, radius) else { continue };
            for k in 0..3 {
                let hat = &moments.hats[k];
                let (point, start) = self.points[near.corners[k] as usize];
                let row = faces.row(point);
                for (&column, (_, weight)) in self.columns[start as usize..].iter().zip(row) {
                    let entry = &mut entries[column as usize];
                    entry.0 += hat.integral * weight;
                    entry.1 += hat.gradient * *weight;
                }
                let neighbor = near.neighbors[k];
                if moments.reaches[k] && neighbor != BEYOND {
                    let n = neighbor as usize;
                    if is_known[n / 64] & (1 << (n % 64)) == 0 {
                        is_known[n / 64] |= 1 << (n % 64);
                        waiting[count] = neighbor;
                        count += 1;
                    }
                }
            }
        }
    }
}

/// Samples of the points of a triangle, at which the centres of its discs may be.
struct Region {
    samples: Vec<Vec3>,
    /// Distance of an edge from a sample within which a disc may reach it, m.
    reach: f64,
}

impl Region {
    fn new(faces: &Faces, own: std::ops::Range<usize>, radius: f64) -> Self {
        let mut region = Self { samples: Vec::new(), reach: radius };
        let per_face = SAMPLES.div_ceil(faces.divisions);
        for face in own {
            let [a, b, c] = faces.corners[face].map(|point| faces.points[point as usize]);
            for i in 0..=per_face {
                for j in 0..=per_face - i {
                    let [beta, gamma] = [i, j].map(|part| part as f64 / per_face as f64);
                    region.samples.push(a + (b - a) * beta + (c - a) * gamma);
                }
            }
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            region.reach = region.reach.max(radius + FARTHEST * longest / per_face as f64);
        }
        region
    }

    /// Whether a disc may reach an edge.
    fn reaches(&self, [from, to]: [Vec3; 2]) -> bool {
        let along = to - from;
        self.samples.iter().any(|sample| {
            let t = ((sample - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (from + along * t - sample).norm_squared() <= self.reach * self.reach
        })
    }
}
