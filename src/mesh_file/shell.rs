//! A shell below a closed surface: the wall of a hollow organ. Copies of the surface lie below it, each a depth further
//! along the inward normals at the nodes, and springs join every copy with the next.

use super::error::MeshProblem;
use super::{Cells, FileMesh, pinched, surface, unique_edges};
use crate::Vec3;
use crate::model::mesh::Mesh;

/// Layers of a shell: copies of the surface below it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layers {
    /// Number of copies, at least one.
    pub count: usize,
    /// Distance from one copy to the next along the normals, m.
    pub depth: f64,
}

impl Layers {
    /// Largest numbers of nodes and springs of a shell below a surface, without building it. Every layer has the
    /// surface's nodes and its edges, three for two triangles; between two layers there are one spring per node and two
    /// per edge.
    pub fn sizes(&self, surface: &Cells) -> (u128, u128) {
        let (nodes, triangles) = (surface.nodes.len() as u128, surface.triangles.len() as u128);
        let (count, edges) = (self.count as u128, (3 * triangles).div_ceil(2));
        ((count + 1) * nodes, (count + 1) * edges + count * (nodes + 2 * edges))
    }
}

/// Builds a shell. Its springs run along the edges of every layer, from every node to the one below it, and along both
/// diagonals of the quadrangle below an edge, which resist shear.
pub fn mesh(mut cells: Cells, layers: &Layers, is_repaired: bool) -> Result<FileMesh, MeshProblem> {
    cells.changes = cells.surface_changes;
    cells.count_once();
    surface::distinct(&cells.nodes, &cells.triangles)?;
    cells.changes.turned = surface::orient(&mut cells.triangles);
    if is_repaired {
        cells.changes.split = pinched::separate_surface(&mut cells.nodes, &mut cells.triangles);
    }
    surface::connected(cells.nodes.len(), &cells.triangles)?;
    // All triangles may face inwards: some programs count corners in the opposite order.
    if surface::check(&cells.nodes, &cells.triangles, is_repaired)? < 0.0 {
        cells.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    let Cells { nodes: outer, triangles, changes, .. } = cells.without_unused();
    let count = outer.len();
    let mut normals = vec![Vec3::zeros(); count];
    for corners in &triangles {
        let area = area_vector(&outer, corners);
        corners.iter().for_each(|&node| normals[node as usize] += area);
    }
    // A node around which the triangles' areas cancel has no normal; its copy stays in place and the layer folds over.
    normals.iter_mut().for_each(|normal| *normal = normal.try_normalize(0.0).unwrap_or_default());

    let surface_edges = unique_edges(triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]));
    let (mut nodes, mut node_volumes) = (Vec::new(), Vec::new());
    let mut pairs = Vec::new();
    for layer in 0..=layers.count {
        let depth = layer as f64 * layers.depth;
        let copy: Vec<Vec3> = outer.iter().zip(&normals).map(|(x, normal)| x - normal * depth).collect();
        check_copy(&outer, &copy, &triangles, depth)?;
        // The outermost and the innermost layer each stand for half a layer of wall, those between for a whole one.
        let is_outside = layer == 0 || layer == layers.count;
        let thickness = if is_outside { layers.depth / 2.0 } else { layers.depth };
        let mut volumes = vec![0.0; count];
        for corners in &triangles {
            let third = area_vector(&copy, corners).norm() / 3.0 * thickness;
            corners.iter().for_each(|&node| volumes[node as usize] += third);
        }
        nodes.extend(copy);
        node_volumes.extend(volumes);

        let [here, below] = [layer, layer + 1].map(|layer| (layer * count) as u32);
        pairs.extend(surface_edges.iter().map(|edge| edge.map(|node| node + here)));
        if layer < layers.count {
            pairs.extend((0..count as u32).map(|node| [node + here, node + below]));
            pairs.extend(surface_edges.iter().flat_map(|&[a, b]| [[a + here, b + below], [b + here, a + below]]));
        }
    }
    let innermost = layers.count * count..nodes.len();
    let mesh = Mesh { nodes, edges: unique_edges(pairs.into_iter()), triangles, tetrahedra: Vec::new() };
    Ok(FileMesh { mesh, node_volumes, innermost, changes })
}

/// Area vector of a triangle: half the cross product of two edges, outwards, m².
fn area_vector(nodes: &[Vec3], corners: &[u32; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|node| nodes[node as usize]);
    (b - a).cross(&(c - a)) / 2.0
}

/// Checks that no triangle of a copy has turned over and no edge has reversed, as happens where the depth exceeds the
/// surface's radius of curvature. Opposite walls of a closed body fail this test at their rim before they meet.
fn check_copy(outer: &[Vec3], copy: &[Vec3], triangles: &[[u32; 3]], depth_m: f64) -> Result<(), MeshProblem> {
    for (triangle, &nodes) in triangles.iter().enumerate() {
        let keeps_side = area_vector(outer, &nodes).dot(&area_vector(copy, &nodes)) > 0.0;
        let edge = |x: &[Vec3], from: usize| x[nodes[(from + 1) % 3] as usize] - x[nodes[from] as usize];
        let keeps_edges = (0..3).all(|from| edge(outer, from).dot(&edge(copy, from)) > 0.0);
        if !(keeps_side && keeps_edges) {
            return Err(MeshProblem::Folds { depth_m, triangle, nodes });
        }
    }
    Ok(())
}
