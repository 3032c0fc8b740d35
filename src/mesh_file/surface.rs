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

/// Checks that no two of the used nodes lie at the same place.
pub fn distinct(nodes: &[Vec3], is_used: &[bool]) -> Result<(), MeshProblem> {
    let used = || nodes.iter().enumerate().zip(is_used).filter(|&(_, &is_used)| is_used).map(|(node, _)| node);
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

/// Checks that elements connect all used nodes.
pub fn connected<const N: usize>(is_used: &[bool], elements: &[[u32; N]]) -> Result<(), MeshProblem> {
    // Every node points to one of its piece, and finally all to the same.
    let mut piece: Vec<u32> = (0..is_used.len() as u32).collect();
    fn find(piece: &mut [u32], mut node: u32) -> u32 {
        while piece[node as usize] != node {
            piece[node as usize] = piece[piece[node as usize] as usize];
            node = piece[node as usize];
        }
        node
    }
    for element in elements {
        for pair in element.windows(2) {
            let (one, other) = (find(&mut piece, pair[0]), find(&mut piece, pair[1]));
            piece[one.max(other) as usize] = one.min(other);
        }
    }
    let mut sizes: HashMap<u32, usize> = HashMap::new();
    for node in (0..is_used.len() as u32).filter(|&node| is_used[node as usize]) {
        *sizes.entry(find(&mut piece, node)).or_default() += 1;
    }
    if sizes.len() <= 1 {
        return Ok(());
    }
    let mut sizes: Vec<usize> = sizes.into_values().collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    Err(MeshProblem::Pieces { sizes })
}

/// Checks that triangles are not flat, form a closed oriented manifold, and enclose a volume. Returns that volume,
/// negative if they face inwards.
pub fn check(nodes: &[Vec3], triangles: &[[u32; 3]]) -> Result<f64, MeshProblem> {
    for (element, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|node| nodes[node as usize]);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        if !((b - a).cross(&(c - a)).norm() > FLAT * longest * longest) {
            return Err(MeshProblem::Flat { kind: "triangle", element, nodes: corners.to_vec() });
        }
    }
    let mesh = Mesh { triangles: triangles.to_vec(), ..Mesh::default() };
    let surface = Surface::new(&mesh)?;
    for (triangle, neighbors) in surface.neighbors.iter().enumerate() {
        if let Some(opposite) = neighbors.iter().position(Option::is_none) {
            let corners = triangles[triangle];
            return Err(MeshProblem::Open { from: corners[(opposite + 1) % 3], to: corners[(opposite + 2) % 3] });
        }
    }
    for (vertex, &node) in surface.vertex_node.iter().enumerate() {
        if around(&surface, vertex as u32) != surface.incident(vertex as u32).len() {
            return Err(MeshProblem::Pinched(node));
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
