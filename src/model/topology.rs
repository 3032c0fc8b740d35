//! The surface as a triangle mesh with adjacency. Positions are stored elsewhere, because they move.

use thiserror::Error;

use super::mesh::Mesh;

/// Reason why a list of triangles is no valid contact surface.
#[derive(Debug, Clone, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A triangle names one node twice.
    #[error("surface triangle {triangle} names a node twice: {nodes:?}")]
    RepeatedNode {
        /// Index of the triangle.
        triangle: usize,
        /// Nodes of the triangle.
        nodes: [u32; 3],
    },
    /// More than two triangles meet at an edge, or two with opposite orientation.
    #[error(
        "triangles {first} and {second} both run from node {from} to node {to}: the surface is not a consistently oriented manifold"
    )]
    NotManifold {
        /// Node at which the shared half-edge starts.
        from: u32,
        /// Node at which the shared half-edge ends.
        to: u32,
        /// First triangle that has it.
        first: u32,
        /// Second triangle that has it.
        second: u32,
    },
    /// Too many vertices around a triangle for the tables of a subdivision surface.
    #[error(
        "surface triangle {triangle} with nodes {nodes:?} has {around} vertices around it: a subdivision surface allows at most {most}"
    )]
    Crowded {
        /// Index of the triangle.
        triangle: usize,
        /// Nodes of the triangle.
        nodes: [u32; 3],
        /// Number of vertices that share a triangle with its nodes, the nodes included.
        around: usize,
        /// Largest number allowed.
        most: usize,
    },
}

/// An oriented triangle surface with adjacency. Its *vertices* are the nodes that lie on it, numbered compactly in
/// ascending node order.
///
/// ```
/// use stickslip::{model::mesh::{Block, Stencil}, model::topology::{Surface, SurfaceError}};
///
/// let mut cube = Block { nodes: [2, 2, 2], spacing: 0.01, stencil: Stencil::Full }.mesh();
/// let surface = Surface::new(&cube)?;
/// assert!(surface.is_closed());
/// let (vertices, triangles) = (surface.vertex_node.len(), surface.triangles.len());
/// assert_eq!(vertices + triangles - 3 * triangles / 2, 2); // Euler's formula
/// assert_eq!((0..8).map(|vertex| surface.incident(vertex).len()).sum::<usize>(), 3 * triangles);
/// assert_eq!(surface.triangle_nodes(5), cube.triangles[5]);
/// let across = surface.neighbors[5][0].expect("it is closed") as usize;
/// assert!(surface.neighbors[across].contains(&Some(5)));
///
/// // A reversed triangle makes the surface invalid.
/// cube.triangles[5].swap(1, 2);
/// assert!(matches!(Surface::new(&cube), Err(SurfaceError::NotManifold { .. })));
/// # Ok::<(), SurfaceError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Surface {
    /// Node of each vertex, ascending.
    pub vertex_node: Vec<u32>,
    /// Vertices of each triangle, anticlockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles across the edge opposite each vertex, per triangle; `None` at a border.
    pub neighbors: Vec<[Option<u32>; 3]>,
    incident_start: Vec<u32>,
    incident: Vec<u32>,
}

impl Surface {
    /// Numbers the vertices and finds the neighbours of a mesh's surface.
    ///
    /// # Errors
    /// If a triangle repeats a node, or the triangles do not form an oriented manifold.
    pub fn new(mesh: &Mesh) -> Result<Self, SurfaceError> {
        for (triangle, &nodes) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = nodes;
            if a == b || b == c || c == a {
                return Err(SurfaceError::RepeatedNode { triangle, nodes });
            }
        }
        let mut vertex_node: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        vertex_node.sort_unstable();
        vertex_node.dedup();
        let vertex_of = |node: u32| vertex_node.partition_point(|&other| other < node) as u32;
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|nodes| nodes.map(vertex_of)).collect();

        let mut half_edges: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(3 * triangles.len());
        for (t, triangle) in triangles.iter().enumerate() {
            for opposite in 0..3 {
                let (from, to) = (triangle[(opposite + 1) % 3], triangle[(opposite + 2) % 3]);
                half_edges.push((from, to, t as u32, opposite as u8));
            }
        }
        half_edges.sort_unstable();
        if let Some(pair) = half_edges.windows(2).find(|pair| (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1)) {
            return Err(SurfaceError::NotManifold {
                from: vertex_node[pair[0].0 as usize],
                to: vertex_node[pair[0].1 as usize],
                first: pair[0].2,
                second: pair[1].2,
            });
        }
        let mut neighbors = vec![[None; 3]; triangles.len()];
        for &(from, to, t, opposite) in &half_edges {
            let twin = half_edges.binary_search_by(|edge| (edge.0, edge.1).cmp(&(to, from)));
            neighbors[t as usize][opposite as usize] = twin.ok().map(|i| half_edges[i].2);
        }

        let mut incident_start = vec![0_u32; vertex_node.len() + 1];
        for &vertex in triangles.iter().flatten() {
            incident_start[vertex as usize + 1] += 1;
        }
        for i in 1..incident_start.len() {
            incident_start[i] += incident_start[i - 1];
        }
        let mut next = incident_start.clone();
        let mut incident = vec![0; 3 * triangles.len()];
        for (t, triangle) in triangles.iter().enumerate() {
            for &vertex in triangle {
                incident[next[vertex as usize] as usize] = t as u32;
                next[vertex as usize] += 1;
            }
        }
        Ok(Self { vertex_node, triangles, neighbors, incident_start, incident })
    }

    /// Returns the triangles that meet at a vertex, ascending.
    pub fn incident(&self, vertex: u32) -> &[u32] {
        let i = vertex as usize;
        &self.incident[self.incident_start[i] as usize..self.incident_start[i + 1] as usize]
    }

    /// Returns the three nodes of a triangle.
    pub fn triangle_nodes(&self, triangle: u32) -> [u32; 3] {
        self.triangles[triangle as usize].map(|vertex| self.vertex_node[vertex as usize])
    }

    /// Whether every edge has a triangle on both sides.
    pub fn is_closed(&self) -> bool {
        self.neighbors.iter().flatten().all(Option::is_some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::mesh::{Block, Stencil};

    fn block() -> Mesh {
        Block { nodes: [4, 3, 3], spacing: 0.25, stencil: Stencil::Structural }.mesh()
    }

    #[test]
    fn a_block_is_closed_and_outward() {
        let mesh = block();
        let surface = Surface::new(&mesh).unwrap();
        assert!(surface.is_closed());
        // Divergence theorem: the enclosed volume is positive only if the triangles face outwards.
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|t| t.map(|i| mesh.nodes[i as usize]))
            .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
            .sum();
        assert!((volume - 0.75 * 0.5 * 0.5).abs() < 1e-15, "volume {volume}");
        // Euler's formula for a sphere.
        let (v, f) = (surface.vertex_node.len(), surface.triangles.len());
        assert_eq!(v + f, 3 * f / 2 + 2);
        // The one interior column of nodes is not on the surface.
        assert_eq!(v, 4 * 3 * 3 - 2);
    }

    #[test]
    fn neighbours_share_the_edge_they_are_listed_for() {
        let surface = Surface::new(&block()).unwrap();
        for (t, neighbors) in surface.neighbors.iter().enumerate() {
            for (opposite, neighbor) in neighbors.iter().enumerate() {
                let other = surface.triangles[neighbor.unwrap() as usize];
                for k in [1, 2] {
                    assert!(other.contains(&surface.triangles[t][(opposite + k) % 3]));
                }
                assert!(!other.contains(&surface.triangles[t][opposite]));
            }
        }
    }

    #[test]
    fn a_flipped_triangle_is_named() {
        let mut mesh = block();
        mesh.triangles[5].swap(0, 1);
        assert!(matches!(Surface::new(&mesh), Err(SurfaceError::NotManifold { .. })));
        mesh.triangles.remove(5);
        assert!(!Surface::new(&mesh).unwrap().is_closed());
    }
}
