//! The triangles around a triangle, in a numbering independent of their place in the mesh, and one step of Loop
//! subdivision of them.
//!
//! Two triangles with equal neighbourhoods have the same basis functions, so all tables are built per neighbourhood and
//! not per triangle.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::combination::Combination;

/// The triangles that share a vertex with the first one, whose vertices 0, 1 and 2 are its *corners*. They alone
/// determine the limit surface over the first triangle.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Neighborhood {
    triangles: Vec<[u8; 3]>,
    vertex_count: usize,
}

/// Positions of the twelve vertices around a triangle of the regular lattice, in units of its two edges from vertex 0,
/// in the order in which [`Neighborhood::around`] numbers them.
pub const LATTICE: [(i8, i8); 12] =
    [(0, 0), (1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1), (2, -1), (2, 0), (1, 1), (0, 2), (-1, 2)];

/// A neighbourhood after one step of subdivision.
pub struct Split {
    /// Neighbourhoods of the four children of the first triangle: those at its corners, then the middle one, whose
    /// corners lie opposite those of its parent.
    pub children: [Neighborhood; 4],
    /// The vertices of each child as combinations of those of the parent.
    pub refinement: [Combination; 4],
}

impl Neighborhood {
    /// Numbers the triangles around `first`: around each of its corners anticlockwise from itself, and at a border
    /// clockwise as well. Also returns the vertex that each number stands for. `triangles` holds at least all triangles
    /// that touch `first`, anticlockwise from outside.
    pub fn around(first: [u32; 3], triangles: &[[u32; 3]]) -> (Self, Vec<u32>) {
        let rotated = |t: &[u32; 3], from: u32, to: u32| {
            (0..3).map(|k| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]).find(|t| t[0] == from && t[1] == to)
        };
        let with_half_edge = |from, to| triangles.iter().find_map(|t| rotated(t, from, to));

        let mut order: Vec<u32> = first.to_vec();
        let mut found: Vec<[u32; 3]> = vec![first];
        let mut visit = |t: [u32; 3]| {
            let seen = found.iter().any(|f| t.iter().all(|v| f.contains(v)));
            if !seen {
                order.extend(t.into_iter().filter(|v| !order.contains(v)).collect::<Vec<_>>());
                found.push(t);
            }
        };
        for k in 0..3 {
            let (corner, right, left) = (first[k], first[(k + 1) % 3], first[(k + 2) % 3]);
            let mut ahead = left;
            while let Some(next) = with_half_edge(corner, ahead).filter(|t| t[1] != right) {
                visit(next);
                ahead = next[2];
            }
            if ahead == right {
                continue; // All the way round.
            }
            let mut behind = right;
            while let Some([from, to, apex]) = with_half_edge(behind, corner) {
                visit([to, apex, from]);
                behind = apex;
            }
        }
        let number = |v: u32| order.iter().position(|&o| o == v).unwrap_or(0) as u8;
        let triangles = found.iter().map(|t| t.map(number)).collect();
        (Self { triangles, vertex_count: order.len() }, order)
    }

    /// Number of vertices, including the corners.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// Third vertices of the triangles on an edge: one at a border, otherwise two.
    fn apexes(&self, i: u8, j: u8) -> Vec<u8> {
        let on_edge = self.triangles.iter().filter(|t| t.contains(&i) && t.contains(&j));
        on_edge.flatten().copied().filter(|&v| v != i && v != j).collect()
    }

    /// Vertices that share an edge with a corner.
    fn ring(&self, corner: u8) -> Vec<u8> {
        let mut ring: Vec<u8> = self.triangles.iter().filter(|t| t.contains(&corner)).flatten().copied().collect();
        ring.sort_unstable();
        ring.dedup();
        ring.retain(|&v| v != corner);
        ring
    }

    /// Performs one step of Loop's scheme; borders follow the cubic B-spline rule.
    pub fn split(&self) -> Split {
        let is_corner = |v: u8| v < 3;
        // The name of a child vertex is (i, i) for the successor of corner i, and (i, j) with i < j for a point on an
        // edge that touches a corner.
        let mut names: BTreeMap<(u8, u8), u32> = BTreeMap::new();
        for (i, j) in self.triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]) {
            if is_corner(i) || is_corner(j) {
                let next = names.len() as u32;
                names.entry((i.min(j), i.max(j))).or_insert(next);
            }
        }
        for corner in 0..3 {
            let next = names.len() as u32;
            names.insert((corner, corner), next);
        }
        let name = |i: u8, j: u8| names[&(i.min(j), i.max(j))];

        let mut fine: Vec<[u32; 3]> = Vec::new();
        for &[i, j, k] in &self.triangles {
            for [a, b, c] in [[i, j, k], [j, k, i], [k, i, j]] {
                if is_corner(a) {
                    fine.push([name(a, a), name(a, b), name(a, c)]);
                }
            }
            if [i, j, k].into_iter().filter(|&v| is_corner(v)).count() >= 2 {
                fine.push([name(j, k), name(k, i), name(i, j)]);
            }
        }

        let mut masks = vec![Vec::new(); names.len()];
        for (&(i, j), &fine_vertex) in &names {
            masks[fine_vertex as usize] = if i == j { self.vertex_mask(i) } else { self.edge_mask(i, j) };
        }
        let child = |first: [u32; 3]| {
            let (child, order) = Self::around(first, &fine);
            let rows = order.iter().map(|&v| masks[v as usize].clone()).collect();
            (child, Combination::new(self.vertex_count, rows))
        };
        let [(first, to_first), (second, to_second), (third, to_third), (middle, to_middle)] = [
            child([name(0, 0), name(0, 1), name(0, 2)]),
            child([name(0, 1), name(1, 1), name(1, 2)]),
            child([name(0, 2), name(1, 2), name(2, 2)]),
            child([name(1, 2), name(0, 2), name(0, 1)]),
        ];
        Split { children: [first, second, third, middle], refinement: [to_first, to_second, to_third, to_middle] }
    }

    fn vertex_mask(&self, corner: u8) -> Vec<(u8, f64)> {
        let ring = self.ring(corner);
        let border: Vec<u8> = ring.iter().copied().filter(|&v| self.apexes(corner, v).len() == 1).collect();
        if border.is_empty() {
            let beta = interior_weight(ring.len());
            let around = ring.iter().map(|&v| (v, beta));
            around.chain([(corner, 1.0 - beta * ring.len() as f64)]).collect()
        } else {
            border.iter().map(|&v| (v, 0.125)).chain([(corner, 0.75)]).collect()
        }
    }

    fn edge_mask(&self, i: u8, j: u8) -> Vec<(u8, f64)> {
        match self.apexes(i, j)[..] {
            [a, b] => vec![(i, 0.375), (j, 0.375), (a, 0.125), (b, 0.125)],
            _ => vec![(i, 0.5), (j, 0.5)],
        }
    }

    /// Returns the twelve vertices of the regular lattice as combinations of those of this neighbourhood, if it is a
    /// part of the lattice. Across a border they are mirrored, b + b′ − a for the triangle (b, b′, a) on it: the
    /// lattice's rules then give the B-spline rules on the border.
    pub fn regular(&self) -> Option<Combination> {
        let mut place: Vec<Option<(i8, i8)>> = vec![None; self.vertex_count];
        (place[0], place[1], place[2]) = (Some(LATTICE[0]), Some(LATTICE[1]), Some(LATTICE[2]));
        let across = |i: (i8, i8), j: (i8, i8), a: (i8, i8)| (i.0 + j.0 - a.0, i.1 + j.1 - a.1);
        let edges = || (0..self.vertex_count as u8).flat_map(|i| (0..i).map(move |j| (i, j)));
        // Placed triangles place their neighbours, until nothing new is found.
        loop {
            let mut changed = false;
            for (i, j) in edges().filter(|&(i, j)| i < 3 || j < 3) {
                let [a, b] = self.apexes(i, j)[..] else { continue };
                for (a, b) in [(a, b), (b, a)] {
                    let (Some(pi), Some(pj), Some(pa)) = (place[i as usize], place[j as usize], place[a as usize])
                    else {
                        continue;
                    };
                    let expected = across(pi, pj, pa);
                    match place[b as usize] {
                        None => {
                            place[b as usize] = Some(expected);
                            changed = true;
                        }
                        Some(found) if found != expected => return None,
                        Some(_) => {}
                    }
                }
            }
            if !changed {
                break;
            }
        }
        let mut rows: BTreeMap<(i8, i8), Vec<(u8, f64)>> = BTreeMap::new();
        for (vertex, place) in place.iter().enumerate() {
            if rows.insert((*place)?, vec![(vertex as u8, 1.0)]).is_some() {
                return None;
            }
        }
        for (i, j) in edges().filter(|&(i, j)| i < 3 || j < 3) {
            let [a] = self.apexes(i, j)[..] else { continue };
            let ghost = across(place[i as usize]?, place[j as usize]?, place[a as usize]?);
            if rows.insert(ghost, vec![(i, 1.0), (j, 1.0), (a, -1.0)]).is_some() {
                return None;
            }
        }
        let rows = LATTICE.iter().map(|place| rows.get(place).cloned()).collect::<Option<Vec<_>>>()?;
        Some(Combination::new(self.vertex_count, rows))
    }
}

/// Loop's weight β of each of the n neighbours of an interior vertex.
fn interior_weight(n: usize) -> f64 {
    let n = n as f64;
    let centre = 0.375 + 0.25 * (TAU / n).cos();
    (0.625 - centre * centre) / n
}
