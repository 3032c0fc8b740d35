//! The cells common to VTK's formats: one list of nodes with the end of each cell (the VTK file formats,
//! <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html>).

use super::cells::{Cells, Shape};
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
/// Strip of triangles.
pub const STRIP: u64 = 6;
/// Polygon of any number of corners.
pub const POLYGON: u64 = 7;

impl CellList {
    /// Adds these cells, whose nodes are counted from the `first` on.
    pub fn add_to(&self, cells: &mut Cells, first: u64) -> Result<(), Flaw> {
        if self.types.len() != self.ends.len() {
            let (announced, found) = (self.ends.len() as u64, self.types.len() as u64);
            return Err(MeshProblem::Count { what: "types of cells", announced, found }.into());
        }
        let mut start = 0;
        let mut nodes = Vec::new();
        for (element, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let range = usize::try_from(end).ok().and_then(|end| self.connectivity.get(start..end));
            let corners = range.ok_or(MeshProblem::Missing("nodes for every cell"))?;
            start += corners.len();
            nodes.clear();
            nodes.extend(corners.iter().map(|node| node.saturating_add(first)));
            match shape(kind, corners.len()) {
                Ok(Some(shape)) => cells.add(element, shape, &nodes)?,
                Ok(None) => {}
                Err(name) => return Err(MeshProblem::Element { element, name }.into()),
            }
        }
        Ok(())
    }

    /// Returns the cells with their nodes.
    pub fn cells(&self, nodes: Vec<Vec3>) -> Result<Cells, Flaw> {
        if nodes.is_empty() {
            return Err(MeshProblem::Missing("points").into());
        }
        let mut cells = Cells { nodes, ..Cells::default() };
        self.add_to(&mut cells, 0)?;
        Ok(cells)
    }
}

/// Returns the shape of a VTK cell type (`vtkCellType.h`), or the type's name; `None` for what is ignored: empty cells, points,
/// and straight and curved lines.
fn shape(kind: u64, nodes: usize) -> Result<Option<Shape>, String> {
    Ok(Some(match kind {
        0 | VERTEX | 2 | LINE | 4 | 21 | 35 | 68 | 75 => return Ok(None),
        // Linear; of second order with their variants; of any order, by Lagrange and by Bézier.
        5 | 22 | 34 | 69 | 76 => Shape::Triangle,
        9 | 23 | 28 | 30 | 70 | 77 => Shape::Quadrangle,
        10 | 24 | 71 | 78 => Shape::Tetrahedron,
        12 | 25 | 29 | 33 | 72 | 79 => Shape::Hexahedron,
        13 | 26 | 31 | 32 | 73 | 80 => Shape::Wedge,
        14 | 27 | 37 | 74 | 81 => Shape::Pyramid,
        STRIP => Shape::Strip,
        POLYGON => Shape::Polygon,
        8 => Shape::Pixel,
        11 => Shape::Voxel,
        _ => {
            let name = match kind {
                15 => "pentagonal prism",
                16 => "hexagonal prism",
                36 => "second-order polygon",
                41 => "convex set of points",
                42 => "polyhedron",
                _ => "cell of unknown type",
            };
            return Err(format!("{name} of {nodes} nodes (VTK type {kind})"));
        }
    }))
}
