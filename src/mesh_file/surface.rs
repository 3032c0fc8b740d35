//! Requirements on every body: its nodes are distinct, it is one piece, and its surface encloses a volume.

use std::collections::HashMap;

use super::SAME_PLACE;
use super::error::MeshProblem;
use crate::Vec3;
use crate::model::mesh::{Mesh, bounding_box};
use crate::model::topology::Surface;

/// Ratio of twice the area to the square of the longest edge, below which a triangle is flat; the limit is that for
/// tetrahedra.
const FLAT: f64 = 1e-9;
/// Ratio of the enclosed volume to the cube of the diagonal, below which there is no inside: rounding leaves 1e-16.
const NO_VOLUME: f64 = 1e-12;

/// Checks that no two nodes of the elements lie at the same place.
pub fn distinct<const N: usize>(nodes: &[Vec3], elements: &[[u32; N]]) -> Result<(), MeshProblem> {
    let is_used = used(nodes.len(), elements);
    let used = || nodes.iter().enumerate().zip(&is_used).filter(|&(_, &is_used)| is_used).map(|(node, _)| node);
    let (lowest, extents) = bounding_box(used().map(|(_, x)| *x));
    let tolerance = SAME_PLACE * extents.norm();
    // First node of each cell of a grid: nodes that coincide lie in one cell, or in two adjacent ones at most a
    // tolerance apart.
    let mut grid: HashMap<[i64; 3], usize> = HashMap::new();
    for (node, x) in used() {
        let cell: [i64; 3] = std::array::from_fn(|axis| ((x[axis] - lowest[axis]) / tolerance) as i64);
        let mut near = (0..27).filter_map(|i| {
            let cell = [cell[0] + i % 3 - 1, cell[1] + i / 3 % 3 - 1, cell[2] + i / 9 - 1];
            let &first = grid.get(&cell)?;
            ((nodes[first] - x).amax() <= tolerance).then_some(first)
        });
        if let Some(first) = near.next() {
            return Err(MeshProblem::Coincident { first, second: node, position: (*x).into() });
        }
        grid.insert(cell, node);
    }
    Ok(())
}

/// Returns for each node whether an element uses it.
fn used<const N: usize>(nodes: usize, elements: &[[u32; N]]) -> Vec<bool> {
    let mut is_used = vec![false; nodes];
    elements.as_flattened().iter().for_each(|&node| is_used[node as usize] = true);
    is_used
}

/// Groups of items that are joined one by one.
pub struct Groups(Vec<u32>);

impl Groups {
    /// Every item alone.
    pub fn new(items: usize) -> Self {
        Self((0..items as u32).collect())
    }

    /// Returns the representative of a group: its lowest item.
    pub fn of(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            self.0[item as usize] = self.0[self.0[item as usize] as usize];
            item = self.0[item as usize];
        }
        item
    }

    /// Merges two groups.
    pub fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one.max(other) as usize] = one.min(other);
    }
}

/// Checks that elements connect all nodes that they use.
pub fn connected<const N: usize>(nodes: usize, elements: &[[u32; N]]) -> Result<(), MeshProblem> {
    let mut pieces = Groups::new(nodes);
    for element in elements {
        element.windows(2).for_each(|pair| pieces.join(pair[0], pair[1]));
    }
    let mut sizes: HashMap<u32, usize> = HashMap::new();
    for (node, _) in (0..).zip(used(nodes, elements)).filter(|&(_, is_used)| is_used) {
        *sizes.entry(pieces.of(node)).or_default() += 1;
    }
    if sizes.len() <= 1 {
        return Ok(());
    }
    let mut sizes: Vec<usize> = sizes.into_values().collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    Err(MeshProblem::Pieces { sizes })
}

/// Turns triangles round so that neighbours have the same orientation; in each part, the minority is turned. Returns the
/// number of triangles turned. A one-sided surface keeps a contradiction.
pub fn orient(triangles: &mut [[u32; 3]]) -> usize {
    // Entries: the edge's nodes ascending, the triangle, and whether it runs from the lower to the higher.
    let mut edges: Vec<([u32; 2], u32, bool)> = Vec::with_capacity(3 * triangles.len());
    for (triangle, &[a, b, c]) in (0..).zip(triangles.iter()) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[i, j]| ([i.min(j), i.max(j)], triangle, i < j)));
    }
    edges.sort_unstable();
    // For both triangles at an edge: the triangle, the other one, and whether one of the two is turned.
    let mut neighbors: Vec<(u32, u32, bool)> = Vec::with_capacity(edges.len());
    for pair in edges.chunk_by(|a, b| a.0 == b.0) {
        if let &[(_, one, runs_up), (_, other, too)] = pair {
            neighbors.extend([(one, other, runs_up == too), (other, one, runs_up == too)]);
        }
    }
    neighbors.sort_unstable();
    let mut is_turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = 0;
    for start in 0..triangles.len() as u32 {
        if is_turned[start as usize].is_some() {
            continue;
        }
        is_turned[start as usize] = Some(false);
        let mut part = vec![start];
        let mut at = 0;
        while let Some(&triangle) = part.get(at) {
            at += 1;
            let first = neighbors.partition_point(|entry| entry.0 < triangle);
            for &(_, other, differs) in neighbors[first..].iter().take_while(|entry| entry.0 == triangle) {
                if is_turned[other as usize].is_none() {
                    is_turned[other as usize] = is_turned[triangle as usize].map(|turned| turned != differs);
                    part.push(other);
                }
            }
        }
        let mut minority: Vec<u32> = part.iter().copied().filter(|&t| is_turned[t as usize] == Some(true)).collect();
        if 2 * minority.len() > part.len() {
            minority = part.into_iter().filter(|&t| is_turned[t as usize] == Some(false)).collect();
        }
        turned += minority.len();
        minority.iter().for_each(|&triangle| triangles[triangle as usize].swap(1, 2));
    }
    turned
}

/// Checks that triangles are not flat, form a closed oriented manifold, and enclose a volume. Returns that volume,
/// negative if they face inwards. `is_separated`: parts that touch have been separated before.
pub fn check(nodes: &[Vec3], triangles: &[[u32; 3]], is_separated: bool) -> Result<f64, MeshProblem> {
    let position = |node: u32| nodes[node as usize].into();
    for (element, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|node| nodes[node as usize]);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        if !((b - a).cross(&(c - a)).norm() > FLAT * longest * longest) {
            return Err(MeshProblem::Flat { kind: "triangle", element, nodes: corners.to_vec() });
        }
    }
    let ends = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]].map(|[i, j]: [u32; 2]| [i.min(j), i.max(j)]);
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(ends).collect();
    edges.sort_unstable();
    for edge in edges.chunk_by(|a, b| a == b) {
        let ([from, to], faces) = (edge[0], edge.len());
        let (from_position, to_position) = (position(from), position(to));
        match faces {
            1 => return Err(MeshProblem::Open { from, to }),
            2 => {}
            _ => return Err(MeshProblem::PinchedEdge { faces, from, to, from_position, to_position, is_separated }),
        }
    }
    let mesh = Mesh { triangles: triangles.to_vec(), ..Mesh::default() };
    let surface = Surface::new(&mesh)?;
    for (vertex, &node) in surface.vertex_node.iter().enumerate() {
        if around(&surface, vertex as u32) != surface.incident(vertex as u32).len() {
            return Err(MeshProblem::Pinched { node, position: position(node), is_separated });
        }
    }
    let used = || triangles.as_flattened().iter().map(|&node| nodes[node as usize]);
    let (lowest, extents) = bounding_box(used());
    let volume: f64 = (triangles.iter())
        .map(|corners| corners.map(|node| nodes[node as usize] - lowest))
        .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
        .sum();
    if !(volume.abs() > NO_VOLUME * extents.norm().powi(3)) {
        return Err(MeshProblem::NoInside);
    }
    Ok(volume)
}

/// Number of triangles met on a walk from edge to edge around a vertex of a closed surface.
fn around(surface: &Surface, vertex: u32) -> usize {
    let incident = surface.incident(vertex);
    let Some(&start) = incident.first() else { return 0 };
    let mut at = start;
    for count in 1..=incident.len() {
        let Some(corner) = surface.triangles[at as usize].iter().position(|&other| other == vertex) else { return 0 };
        match surface.neighbors[at as usize][(corner + 1) % 3] {
            Some(next) if next != start => at = next,
            _ => return count,
        }
    }
    0
}
