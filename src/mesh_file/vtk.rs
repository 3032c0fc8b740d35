//! The cells common to both VTK formats: one list of nodes with the end of each cell (the VTK file formats,
//! <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html>).

use super::Cells;
use super::error::{Flaw, MeshProblem};
use crate::Vec3;

/// Cells in VTK's representation.
#[derive(Debug, Default)]
pub struct CellList {
    /// Nodes of all cells, one cell after the other.
    pub connectivity: Vec<u64>,
    /// End of each cell in `connectivity`.
    pub ends: Vec<u64>,
    /// VTK type of each cell.
    pub types: Vec<u64>,
}

const VERTEX: u64 = 1;
const LINE: u64 = 3;
const TRIANGLE: u64 = 5;
/// Polygon of any number of corners.
pub const POLYGON: u64 = 7;
const TETRAHEDRON: u64 = 10;

impl CellList {
    /// Returns the tetrahedra and triangles among the cells.
    pub fn cells(&self, nodes: Vec<Vec3>) -> Result<Cells, Flaw> {
        if nodes.is_empty() {
            return Err(MeshProblem::Missing("points").into());
        }
        if self.types.len() != self.ends.len() {
            return Err(MeshProblem::Missing("type for every cell").into());
        }
        let mut cells = Cells { nodes, ..Cells::default() };
        let mut start = 0;
        for (element, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let range = usize::try_from(end).ok().and_then(|end| self.connectivity.get(start..end));
            let corners = range.ok_or(MeshProblem::Missing("nodes for every cell"))?;
            start += corners.len();
            match (kind, corners.len()) {
                (TETRAHEDRON, _) => cells.tetrahedra.push(cells.corners(element, corners)?),
                (TRIANGLE, _) | (POLYGON, 3) => cells.triangles.push(cells.corners(element, corners)?),
                // Ignored cells: empty ones, points, and straight and curved lines.
                (VERTEX, 1) | (LINE, 2) | (0 | 2 | 4 | 21 | 35 | 68, _) => {}
                _ => return Err(MeshProblem::Element { element, name: name(kind) }.into()),
            }
        }
        Ok(cells)
    }
}

impl Cells {
    fn corners<const N: usize>(&self, element: usize, corners: &[u64]) -> Result<[u32; N], MeshProblem> {
        let corners: [u64; N] = corners.try_into().map_err(|_| MeshProblem::Element {
            element,
            name: format!("cell with {} corners and the type of a cell with {N}", corners.len()),
        })?;
        let mut nodes = [0; N];
        for (node, corner) in nodes.iter_mut().zip(corners) {
            let known = u32::try_from(corner).ok().filter(|&known| (known as usize) < self.nodes.len());
            *node = known.ok_or(MeshProblem::UnknownNode { element, node: corner })?;
        }
        Ok(nodes)
    }
}

/// Returns the name of a VTK cell type (`vtkCellType.h`).
fn name(kind: u64) -> String {
    let name = match kind {
        VERTEX => "vertex of several nodes",
        LINE => "line without exactly two nodes",
        6 => "triangle strip",
        POLYGON => "polygon",
        8 | 9 => "quadrangle",
        11 | 12 => "hexahedron",
        13 => "wedge",
        14 => "pyramid",
        22 => "second-order triangle",
        24 => "second-order tetrahedron",
        69 => "higher-order triangle",
        71 => "higher-order tetrahedron",
        42 => "polyhedron",
        _ => "cell of unknown type",
    };
    format!("{name} (VTK type {kind})")
}
