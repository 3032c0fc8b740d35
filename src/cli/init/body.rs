//! Choices for a scene over a mesh from a file: its unit, what is fixed, and where the tip goes.

use std::path::Path;

use crate::Vec3;
use crate::mesh_file::{FileMesh, Layers, MeshFile, MeshFileError, MeshProblem};
use crate::model::mesh::bounding_box;
use crate::scene::available_memory;

/// Unit of most files of bodies that are larger than any of them, m.
const MILLIMETRE: f64 = 1e-3;
/// Largest extent of a body, m, beyond which its file is taken to be in mm.
const LARGEST_EXTENT_M: f64 = 10.0;
/// Copies of a surface below it.
const LAYERS: usize = 2;
/// Depths between the layers of a shell, in the order in which they are tried, over the diagonal of the body: the first at
/// which no layer folds over is taken.
const LAYER_DEPTHS: [f64; 4] = [0.05, 0.025, 0.0125, 0.006];
/// Share of the body's height that is fixed.
const FIXED_HEIGHT: f64 = 0.2;
/// Heights that count as the top, below the highest node, over the diagonal.
const TOP: f64 = 0.01;
/// Heights of the tip at its start and depth of the press, over the diagonal; most of the depth of a shell's layers together that
/// the press may take: at two fifths, springs across a layer turn over and the run diverges.
const START: f64 = 0.01;
const PRESS: f64 = 0.02;
const PRESS_OF_LAYERS: f64 = 0.2;
/// Length of the drag, over the diagonal.
const DRAG: f64 = 0.1;
/// Distance of the tip from the node that it is pressed in at, over the diagonal: edges and nodes are special places.
const BESIDE: f64 = 0.003;

/// The layers of a shell, as chosen.
pub struct Shell {
    pub layers: usize,
    pub layer_depth_m: f64,
}

/// What is chosen for a mesh. Lengths are rounded for people.
pub struct Body {
    /// Length of the file's unit, m.
    pub scale: f64,
    /// Diagonal of the bounding box, m.
    pub diagonal_m: f64,
    pub nodes: usize,
    /// `None` for a body of tetrahedra.
    pub shell: Option<Shell>,
    /// Height below which nodes are fixed, m; of a shell the innermost layer is fixed instead.
    pub fixed_below_z_m: Option<f64>,
    /// Tip above the surface, pressed in, and after the drag, m.
    pub tip: [Vec3; 3],
}

impl Body {
    /// Reads a mesh and makes the choices.
    ///
    /// # Errors
    /// If the file is no body.
    pub fn of(path: &Path) -> Result<Self, MeshFileError> {
        let file = MeshFile::read(path, available_memory())?;
        let unscaled = bounding_box(file.cells().nodes.iter().copied()).1;
        let scale = if unscaled.amax() > LARGEST_EXTENT_M { MILLIMETRE } else { 1.0 };
        let diagonal_m = scale * unscaled.norm();
        if !file.is_surface() {
            let solid = file.solid(scale)?;
            return Ok(Self::new(&solid, scale, None, PRESS * diagonal_m));
        }
        let with_layers = |share: &f64| -> Result<Self, MeshFileError> {
            let layer_depth_m = rounded(share * diagonal_m, diagonal_m);
            let mesh = file.clone().shell(scale, Layers { count: LAYERS, depth: layer_depth_m })?;
            let press = (PRESS * diagonal_m).min(PRESS_OF_LAYERS * LAYERS as f64 * layer_depth_m);
            Ok(Self::new(&mesh, scale, Some(Shell { layers: LAYERS, layer_depth_m }), press))
        };
        let [deeper @ .., least] = &LAYER_DEPTHS;
        for share in deeper {
            match with_layers(share) {
                Err(error) if matches!(error.problem(), MeshProblem::Folds { .. }) => {}
                body => return body,
            }
        }
        with_layers(least)
    }

    fn new(file: &FileMesh, scale: f64, shell: Option<Shell>, press_m: f64) -> Self {
        let mesh = &file.mesh;
        let (lowest, extents) = bounding_box(mesh.nodes.iter().copied());
        let (middle, diagonal_m) = (lowest + extents / 2.0, extents.norm());
        let round = |x: f64| rounded(x, diagonal_m);
        // The highest part of the surface, at its place nearest to the middle.
        let surface = || mesh.triangles.iter().flatten().map(|&node| mesh.nodes[node as usize]);
        let highest = surface().map(|x| x.z).fold(f64::NEG_INFINITY, f64::max);
        let from_middle = |x: &Vec3| (x - middle).xy().norm();
        let is_top = |x: &Vec3| x.z >= highest - TOP * diagonal_m;
        let top = surface().filter(is_top).min_by(|a, b| from_middle(a).total_cmp(&from_middle(b))).unwrap_or(middle);
        let direction = if top.x > middle.x { -1.0 } else { 1.0 };
        let (x, y) = (top.x + direction * BESIDE * diagonal_m, top.y + BESIDE * diagonal_m);
        let tip = [
            Vec3::new(x, y, highest + START * diagonal_m),
            Vec3::new(x, y, top.z - press_m),
            Vec3::new(x + direction * DRAG * diagonal_m, y, top.z - press_m),
        ];
        Self {
            scale,
            diagonal_m,
            nodes: mesh.nodes.len(),
            fixed_below_z_m: shell.is_none().then(|| round(lowest.z + FIXED_HEIGHT * extents.z)),
            shell,
            tip: tip.map(|point| point.map(round)),
        }
    }
}

/// Rounds a length to about a ten-thousandth of the body.
fn rounded(length: f64, diagonal: f64) -> f64 {
    let decimals = (4.0 - diagonal.log10().floor()).clamp(0.0, 12.0) as usize;
    // Printing and reading gives the number with the fewest digits.
    format!("{length:.decimals$}").parse().unwrap_or(length)
}

#[cfg(test)]
mod tests {
    use super::rounded;

    #[test]
    fn lengths_have_the_digits_that_matter() {
        assert_eq!(
            [rounded(0.027_456_789, 0.17), rounded(-12.345_678, 3.0), rounded(1e-9, 0.2)],
            [0.02746, -12.3457, 0.0]
        );
    }
}
