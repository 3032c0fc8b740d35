//! A coarse grid over the rest shape of a mesh, which interpolates displacements far from the contact.

use crate::Vec3;

/// A box of equal cells around the rest positions. Cells touch the bounding box on every side, so that each has nodes
/// on its outer faces.
///
/// ```
/// use stickslip::{Vec3, local::coarse::Grid};
///
/// // A linear field on the grid's vertices is interpolated exactly at every node.
/// let node = |i| Vec3::new((1.3 * f64::from(i)).sin(), (0.7 * f64::from(i)).cos(), 0.0);
/// let rest: Vec<Vec3> = (0..60).map(node).collect();
/// let grid = Grid::new(&rest, 0.4);
/// let field = |x: Vec3| 3.0 * x.x - 2.0 * x.y + 0.5;
/// for (node, &x) in (0..).zip(&rest) {
///     let (cell, weights) = grid.place(node);
///     let corners = grid.corners(cell).into_iter().zip(weights);
///     let interpolated: f64 = corners.map(|(vertex, weight)| weight * field(grid.position(vertex))).sum();
///     assert!((interpolated - field(x)).abs() < 1e-13);
/// }
/// assert_eq!(grid.vertex_count(), 6 * 6 * 2); // five cells along x and y, one across
/// ```
#[derive(Debug, Clone)]
pub struct Grid {
    origin: Vec3,
    cell: Vec3,
    cells: [usize; 3],
    /// Cell of each node, and the weights of the cell's corners.
    places: Vec<(u32, [f64; CORNERS])>,
}

/// Nodes this close to a face of their cell, as a share of its length, lie on it.
const ON_FACE: f64 = 1e-9;

/// Number of vertices of a cell.
pub const CORNERS: usize = 8;

impl Grid {
    /// Builds a grid of cells about `size` long, m.
    pub fn new(rest: &[Vec3], size: f64) -> Self {
        let first = rest.first().copied().unwrap_or_default();
        let (low, high) = rest.iter().fold((first, first), |(low, high), x| (low.inf(x), high.sup(x)));
        let extent = high - low;
        let cells = [0, 1, 2].map(|axis| ((extent[axis] / size).round() as usize).max(1));
        let cell = Vec3::from_fn(|axis, _| extent[axis] / cells[axis] as f64);
        let mut grid = Self { origin: low, cell, cells, places: Vec::new() };
        grid.places = rest.iter().map(|&x| grid.locate(x)).collect();
        grid
    }

    /// Returns the cell that a node lies in, and the trilinear weights of its corners there.
    pub fn place(&self, node: u32) -> (u32, [f64; CORNERS]) {
        self.places[node as usize]
    }

    fn locate(&self, place: Vec3) -> (u32, [f64; CORNERS]) {
        let mut index = [0; 3];
        let mut share = [0.0; 3];
        for axis in 0..3 {
            // Cells of a flat mesh have no height.
            if self.cell[axis] > 0.0 {
                let along = (place[axis] - self.origin[axis]) / self.cell[axis];
                index[axis] = (along.floor().max(0.0) as usize).min(self.cells[axis] - 1);
                let exact = along - index[axis] as f64;
                // A node this close to a face lies on it, whatever the rounding.
                share[axis] = if (exact - exact.round()).abs() < ON_FACE { exact.round() } else { exact };
            }
        }
        let weight = |corner: usize| {
            let along = |axis: usize| if corner >> axis & 1 == 1 { share[axis] } else { 1.0 - share[axis] };
            along(0) * along(1) * along(2)
        };
        let cell = (index[2] * self.cells[1] + index[1]) * self.cells[0] + index[0];
        (cell as u32, std::array::from_fn(weight))
    }

    /// Returns the vertices at the corners of a cell.
    pub fn corners(&self, cell: u32) -> [usize; CORNERS] {
        let ([nx, ny, _], cell) = (self.cells, cell as usize);
        let index = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        std::array::from_fn(|corner| {
            let [i, j, k] = [0, 1, 2].map(|axis| index[axis] + (corner >> axis & 1));
            (k * (ny + 1) + j) * (nx + 1) + i
        })
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.cells.iter().map(|cells| cells + 1).product()
    }

    /// Returns the rest position of a vertex, m.
    pub fn position(&self, vertex: usize) -> Vec3 {
        let [nx, ny] = [self.cells[0] + 1, self.cells[1] + 1];
        let index = Vec3::new((vertex % nx) as f64, (vertex / nx % ny) as f64, (vertex / (nx * ny)) as f64);
        self.origin + self.cell.component_mul(&index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_exact_for_linear_fields() {
        let rest: Vec<Vec3> =
            (0..60).map(|i| Vec3::new((1.3 * f64::from(i)).sin(), 2.0 * (0.7 * f64::from(i)).cos(), 0.0)).collect();
        let grid = Grid::new(&rest, 0.4);
        let field = |x: Vec3| 3.0 * x.x - 2.0 * x.y + 0.5;
        for (&x, node) in rest.iter().zip(0..) {
            let (cell, weights) = grid.place(node);
            let sum: f64 =
                grid.corners(cell).iter().zip(weights).map(|(&vertex, w)| w * field(grid.position(vertex))).sum();
            assert!((sum - field(x)).abs() < 1e-13, "{sum} at {x:?}");
            assert!(weights.iter().all(|w| (-1e-15..=1.0 + 1e-15).contains(w)), "{weights:?}");
        }
    }
}
