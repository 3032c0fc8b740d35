//! Meshes: node positions, edges that become springs, and the triangles of the surface.

use crate::Vec3;
use crate::word::words;

/// A mesh: geometry only. Masses and springs belong to the [network](super::network::Network).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Rest position of every node, m.
    pub nodes: Vec<Vec3>,
    /// Pairs of nodes joined by a spring, each once.
    pub edges: Vec<[u32; 2]>,
    /// Surface triangles, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Tetrahedra that fill the mesh, positively oriented: the first three nodes anticlockwise seen from the fourth.
    /// Empty for blocks, which lattice cells fill, and for shells.
    pub tetrahedra: Vec<[u32; 4]>,
}

impl Mesh {
    /// Volume of a tetrahedron with these corners, m³; negative if it is inverted.
    pub fn tetrahedron_volume(&self, corners: [u32; 4]) -> f64 {
        let [a, b, c, d] = corners.map(|node| self.nodes[node as usize]);
        (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
    }
}

/// Neighbours in a block's lattice that springs join.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stencil {
    /// Neighbours along lattice edges.
    Structural,
    /// Neighbours along lattice edges and both diagonals of every lattice face.
    #[default]
    Shear,
    /// Neighbours along lattice edges, face diagonals and the four diagonals of every lattice cell.
    Full,
}

words!(Stencil { Structural = "structural", Shear = "shear", Full = "full" });

impl Stencil {
    /// Lattice steps to the later of the two nodes that an edge joins, one per direction.
    fn offsets(self) -> &'static [[i64; 3]] {
        const ALL: [[i64; 3]; 13] = [
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 1, 0],
            [-1, 1, 0],
            [1, 0, 1],
            [-1, 0, 1],
            [0, 1, 1],
            [0, -1, 1],
            [1, 1, 1],
            [-1, 1, 1],
            [1, -1, 1],
            [-1, -1, 1],
        ];
        match self {
            Stencil::Structural => &ALL[..3],
            Stencil::Shear => &ALL[..9],
            Stencil::Full => &ALL,
        }
    }
}

/// A rectangular block of lattice nodes, centred in x and y, with its top layer at z = 0.
///
/// Node (ix, iy, iz) has the index (iz·ny + iy)·nx + ix, and z grows with iz.
///
/// ```
/// use stickslip::model::mesh::{Block, Stencil};
/// let block = Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear };
/// let mesh = block.mesh();
/// assert_eq!(mesh.nodes.len(), 324);
/// assert_eq!(mesh.triangles.len(), 448);
/// // A corner node stands for an eighth of a cell, and the edge along x from it belongs to one cell instead of four.
/// assert_eq!((block.boundary_directions(0), block.node_volumes()[0]), (3, 0.0125_f64.powi(3) / 8.0));
/// assert_eq!((mesh.edges[0], block.edge_shares().next()), ([0, 1], Some((1, 0.25))));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Number of nodes along x, y, z; at least two each.
    pub nodes: [usize; 3],
    /// Distance between lattice neighbours, m.
    pub spacing: f64,
    /// Neighbours that springs join.
    pub stencil: Stencil,
}

impl Block {
    /// Number of nodes; `None` if it does not fit the address space.
    pub fn node_count(&self) -> Option<usize> {
        let [nx, ny, nz] = self.nodes;
        nx.checked_mul(ny)?.checked_mul(nz)
    }

    /// Number of springs, summed over the lattice directions without building the mesh.
    ///
    /// ```
    /// use stickslip::model::mesh::{Block, Stencil};
    /// let block = Block { nodes: [16, 16, 16], spacing: 0.01, stencil: Stencil::Full };
    /// assert_eq!(block.edge_count(), 46_620);
    /// assert_eq!(block.edge_count(), block.mesh().edges.len());
    /// ```
    pub fn edge_count(&self) -> usize {
        self.stencil
            .offsets()
            .iter()
            .map(|offset| {
                (0..3)
                    .map(|axis| self.nodes[axis].saturating_sub(offset[axis].unsigned_abs() as usize))
                    .fold(1, usize::saturating_mul)
            })
            .fold(0, usize::saturating_add)
    }

    /// Whether a node lies on the bottom layer.
    pub fn is_bottom(&self, node: usize) -> bool {
        node < self.nodes[0] * self.nodes[1]
    }

    /// Number of directions in which a node lies on the boundary: 0 inside, 1 on a face, 2 on an edge, 3 at a corner.
    pub fn boundary_directions(&self, node: usize) -> u32 {
        self.lattice(node).iter().zip(self.nodes).map(|(&i, count)| u32::from(i == 0 || i == count - 1)).sum()
    }

    /// Volume that each node stands for, m³: a lattice cell, halved once for every boundary direction.
    pub fn node_volumes(&self) -> Vec<f64> {
        let cell = self.spacing.powi(3);
        (0..self.nodes.iter().product()).map(|node| cell / f64::from(1 << self.boundary_directions(node))).collect()
    }

    /// Builds the mesh.
    pub fn mesh(&self) -> Mesh {
        let [nx, ny, nz] = self.nodes;
        let count = nx * ny * nz;
        let half = |count: usize| (count - 1) as f64 / 2.0;
        let nodes = (0..count)
            .map(|node| {
                let [ix, iy, iz] = self.lattice(node);
                Vec3::new(
                    (ix as f64 - half(nx)) * self.spacing,
                    (iy as f64 - half(ny)) * self.spacing,
                    (iz as f64 - (nz - 1) as f64) * self.spacing,
                )
            })
            .collect();
        let mut edges = Vec::with_capacity(self.edge_count());
        for node in 0..count {
            for &offset in self.stencil.offsets() {
                if let Some(other) = self.neighbour(node, offset) {
                    edges.push([node as u32, other as u32]);
                }
            }
        }
        Mesh { nodes, edges, triangles: self.surface_triangles(), tetrahedra: Vec::new() }
    }

    /// Returns for every edge, in the mesh's order, the number of axes that it runs along (1 for an edge of the
    /// lattice, 2 for a face's diagonal, 3 for a cell's), and the share of the cells around it that belong to the
    /// block: 1 inside, less on the boundary.
    pub fn edge_shares(&self) -> impl Iterator<Item = (u8, f64)> + '_ {
        let count = self.nodes.iter().product();
        (0..count).flat_map(move |node| {
            let at = self.lattice(node);
            let inside = self.stencil.offsets().iter().filter(move |&&offset| self.neighbour(node, offset).is_some());
            inside.map(move |offset| {
                let axes = offset.iter().filter(|&&step| step != 0).count() as u8;
                let on_boundary = |axis: usize| at[axis] == 0 || at[axis] == self.nodes[axis] - 1;
                let halvings = (0..3).filter(|&axis| offset[axis] == 0 && on_boundary(axis)).count();
                (axes, 0.5_f64.powi(halvings as i32))
            })
        })
    }

    /// Returns the steps along x, y, z from the first node.
    pub fn lattice(&self, node: usize) -> [usize; 3] {
        let [nx, ny, _] = self.nodes;
        [node % nx, node / nx % ny, node / (nx * ny)]
    }

    fn index(&self, [ix, iy, iz]: [usize; 3]) -> usize {
        (iz * self.nodes[1] + iy) * self.nodes[0] + ix
    }

    fn neighbour(&self, node: usize, offset: [i64; 3]) -> Option<usize> {
        let mut at = self.lattice(node);
        for axis in 0..3 {
            at[axis] = at[axis].checked_add_signed(offset[axis] as isize)?;
            if at[axis] >= self.nodes[axis] {
                return None;
            }
        }
        Some(self.index(at))
    }

    /// Returns two triangles for every lattice square of the six sides, top first. Every square is cut along the same
    /// diagonal, so that inside a side every vertex has six neighbours.
    fn surface_triangles(&self) -> Vec<[u32; 3]> {
        // On each side, `normal` is fixed at its last (or first) layer; u × v points outwards.
        const SIDES: [(usize, bool, usize, usize); 6] =
            [(2, true, 0, 1), (2, false, 1, 0), (0, true, 1, 2), (0, false, 2, 1), (1, true, 2, 0), (1, false, 0, 2)];
        let mut triangles = Vec::new();
        for (normal, last, u, v) in SIDES {
            let layer = if last { self.nodes[normal] - 1 } else { 0 };
            for iv in 0..self.nodes[v] - 1 {
                for iu in 0..self.nodes[u] - 1 {
                    let corner = |du: usize, dv: usize| {
                        let mut at = [0; 3];
                        at[normal] = layer;
                        at[u] = iu + du;
                        at[v] = iv + dv;
                        self.index(at) as u32
                    };
                    triangles.push([corner(0, 0), corner(1, 0), corner(1, 1)]);
                    triangles.push([corner(0, 0), corner(1, 1), corner(0, 1)]);
                }
            }
        }
        triangles
    }
}

/// Returns the lowest corner and the extents of a box around points, m.
pub fn bounding_box(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    let empty = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    let (lowest, highest) = points.fold(empty, |(low, high), x| (low.inf(&x), high.sup(&x)));
    (lowest, highest - lowest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_is_centred_with_its_top_at_zero() {
        let block = Block { nodes: [3, 5, 2], spacing: 0.5, stencil: Stencil::Structural };
        let mesh = block.mesh();
        assert_eq!(mesh.nodes[0], Vec3::new(-0.5, -1.0, -0.5));
        assert_eq!(mesh.nodes[29], Vec3::new(0.5, 1.0, 0.0));
        assert!(block.is_bottom(14) && !block.is_bottom(15));
        assert_eq!(block.boundary_directions(0), 3);
        assert_eq!(block.boundary_directions(7), 1);
    }

    #[test]
    fn every_edge_has_the_length_of_its_stencil_and_appears_once() {
        for (stencil, longest) in
            [(Stencil::Structural, 1.0), (Stencil::Shear, 2.0_f64.sqrt()), (Stencil::Full, 3.0_f64.sqrt())]
        {
            let mesh = Block { nodes: [4, 3, 5], spacing: 1.0, stencil }.mesh();
            let lengths: Vec<f64> =
                mesh.edges.iter().map(|&[i, j]| (mesh.nodes[j as usize] - mesh.nodes[i as usize]).norm()).collect();
            let max = lengths.iter().copied().fold(0.0, f64::max);
            assert!((max - longest).abs() < 1e-12, "{stencil:?}: longest edge {max}");
            let unique: std::collections::HashSet<_> = mesh.edges.iter().map(|&[i, j]| (i.min(j), i.max(j))).collect();
            assert_eq!(unique.len(), mesh.edges.len());
        }
    }
}
