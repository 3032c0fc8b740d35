//! A body of tetrahedra: its orientation, faces and edges.

use super::error::MeshProblem;
use super::{Cells, FileMesh, pinched, surface, unique_edges};
use crate::Vec3;
use crate::model::mesh::Mesh;

/// Ratio of six volumes to the cube of the longest edge, below which a tetrahedron is flat. Rounding of 64-bit coordinates
/// gives a flat one a ratio of up to 2.6e-16 at the origin, and 4e-10 a million edges away from it (measured, 20,000 each).
/// In 32-bit coordinates it is up to 1.2e-7 at the origin; such a tetrahedron is accepted, since it may be a real sliver.
const FLAT: f64 = 1e-9;

/// A tetrahedron's faces, anticlockwise from outside if it is positively oriented.
pub const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// A tetrahedron's edges.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Builds a solid: edges become springs, and faces of only one tetrahedron the surface. Triangles of the file are
/// ignored.
pub fn mesh(mut cells: Cells, is_repaired: bool) -> Result<FileMesh, MeshProblem> {
    cells.triangles.clear();
    cells.count_once();
    surface::distinct(&cells.nodes, &cells.tetrahedra)?;
    cells.changes.turned = orient(&cells.nodes, &mut cells.tetrahedra)?;
    cells.triangles = boundary(&cells.tetrahedra)?;
    if is_repaired {
        cells.changes.split = pinched::separate(&mut cells.nodes, &mut cells.tetrahedra);
        cells.triangles = boundary(&cells.tetrahedra)?;
    }
    surface::connected(cells.nodes.len(), &cells.tetrahedra)?;
    surface::check(&cells.nodes, &cells.triangles, is_repaired)?;
    let Cells { nodes, tetrahedra, triangles, changes, .. } = cells.without_unused();
    let edges = unique_edges(tetrahedra.iter().flat_map(|t| EDGES.map(|edge| edge.map(|corner| t[corner]))));
    let mut node_volumes = vec![0.0; nodes.len()];
    for corners in &tetrahedra {
        let quarter = six_volumes(&nodes, corners) / 24.0;
        corners.iter().for_each(|&node| node_volumes[node as usize] += quarter);
    }
    Ok(FileMesh { mesh: Mesh { nodes, edges, triangles, tetrahedra }, node_volumes, innermost: 0..0, changes })
}

/// Six times the volume: positive if the fourth corner lies where the first three turn anticlockwise away from it.
pub fn six_volumes(nodes: &[Vec3], corners: &[u32; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|node| nodes[node as usize]);
    (b - a).cross(&(c - a)).dot(&(d - a))
}

/// Turns inverted tetrahedra round, since programs list corners in either order, and some mix both in one mesh. Returns the
/// number of tetrahedra turned; zero if every one is inverted, as by a program with the opposite order.
fn orient(nodes: &[Vec3], tetrahedra: &mut [[u32; 4]]) -> Result<usize, MeshProblem> {
    let mut turned = 0;
    for (element, corners) in tetrahedra.iter_mut().enumerate() {
        let longest = EDGES
            .map(|[i, j]| (nodes[corners[i] as usize] - nodes[corners[j] as usize]).norm())
            .into_iter()
            .fold(0.0, f64::max);
        let volumes = six_volumes(nodes, corners);
        if !(volumes.abs() > FLAT * longest.powi(3)) {
            return Err(MeshProblem::Flat { kind: "tetrahedron", element, nodes: corners.to_vec() });
        }
        if volumes < 0.0 {
            corners.swap(2, 3);
            turned += 1;
        }
    }
    Ok(if turned < tetrahedra.len() { turned } else { 0 })
}

/// Returns the faces of only one tetrahedron, in their order. Two tetrahedra that share a face must lie on opposite
/// sides of it.
fn boundary(tetrahedra: &[[u32; 4]]) -> Result<Vec<[u32; 3]>, MeshProblem> {
    // Entries: the face's nodes ascending, whether that order reverses it, and its place in `tetrahedra`.
    let mut faces: Vec<([u32; 3], bool, usize)> = Vec::with_capacity(4 * tetrahedra.len());
    for (element, corners) in tetrahedra.iter().enumerate() {
        for (side, face) in FACES.iter().enumerate() {
            let nodes = face.map(|corner| corners[corner]);
            let (sorted, turned) = ascending(nodes);
            faces.push((sorted, turned, 4 * element + side));
        }
    }
    faces.sort_unstable();
    let mut outer = Vec::new();
    for group in faces.chunk_by(|a, b| a.0 == b.0) {
        match group {
            [(_, _, place)] => outer.push(*place),
            [(_, false, _), (_, true, _)] => {}
            _ => {
                let same = group.windows(2).find(|pair| pair[0].1 == pair[1].1).unwrap_or(group);
                return Err(MeshProblem::Overlap { first: same[0].2 / 4, second: same[1].2 / 4, nodes: same[0].0 });
            }
        }
    }
    outer.sort_unstable();
    Ok(outer.iter().map(|place| FACES[place % 4].map(|corner| tetrahedra[place / 4][corner])).collect())
}

/// Returns a triangle's nodes ascending, and whether that takes an odd number of exchanges.
fn ascending(mut nodes: [u32; 3]) -> ([u32; 3], bool) {
    let mut turned = false;
    for [i, j] in [[0, 1], [1, 2], [0, 1]] {
        if nodes[i] > nodes[j] {
            nodes.swap(i, j);
            turned = !turned;
        }
    }
    (nodes, turned)
}
