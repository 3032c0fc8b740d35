//! Sources of a scene's mesh.

use std::ops::Range;
use std::sync::Arc;

use super::Warning;
use crate::mesh_file::{Changes, FileMesh};
use crate::model::material::Bulk;
use crate::model::mesh::{Block, Mesh};

/// Usual extents of a body, m; beyond them the unit of its file is in doubt.
const USUAL_EXTENTS: Range<f64> = 1e-3..10.0;

/// A generated block, or a mesh from a file.
///
/// ```
/// use stickslip::scene::Scene;
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let (mesh, spacing) = (scene.mesh.mesh(), scene.mesh.spacing());
/// assert_eq!(scene.mesh.node_count(), mesh.nodes.len());
/// assert!((mesh.nodes[1] - mesh.nodes[0] - stickslip::Vec3::x() * spacing).norm() < 1e-15);
/// // Nodes stand for the whole block between them, 8 × 8 × 3 cells.
/// let volumes = scene.mesh.node_volumes();
/// assert!((volumes.iter().sum::<f64>() / (8.0 * 8.0 * 3.0 * spacing.powi(3)) - 1.0).abs() < 1e-14);
/// assert_eq!(scene.mesh.bulk().node_volumes(), Ok(volumes));
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum MeshSource {
    /// A generated block.
    Block(Block),
    /// A mesh from a file.
    File(Arc<FileMesh>),
}

impl MeshSource {
    /// Builds the mesh.
    pub fn mesh(&self) -> Mesh {
        match self {
            MeshSource::Block(block) => block.mesh(),
            MeshSource::File(file) => file.mesh.clone(),
        }
    }

    /// Returns the number of nodes.
    pub fn node_count(&self) -> usize {
        match self {
            MeshSource::Block(block) => block.nodes.iter().product(),
            MeshSource::File(file) => file.mesh.nodes.len(),
        }
    }

    /// Returns the distance between neighbours, m: a block's spacing, or the mean length of a file's edges.
    pub fn spacing(&self) -> f64 {
        match self {
            MeshSource::Block(block) => block.spacing,
            MeshSource::File(file) => {
                let Mesh { nodes, edges, .. } = &file.mesh;
                let length = |&[i, j]: &[u32; 2]| (nodes[j as usize] - nodes[i as usize]).norm();
                edges.iter().map(length).sum::<f64>() / edges.len() as f64
            }
        }
    }

    /// Returns the bulk of the mesh: a lattice, a shell or tetrahedra.
    pub fn bulk(&self) -> Bulk<'_> {
        match self {
            MeshSource::Block(block) => Bulk::Lattice(block),
            MeshSource::File(file) if file.mesh.tetrahedra.is_empty() => Bulk::Shell,
            MeshSource::File(file) => Bulk::Tetrahedra(&file.mesh),
        }
    }

    /// Returns the volume of each node, m³.
    pub fn node_volumes(&self) -> Vec<f64> {
        match self {
            MeshSource::Block(block) => block.node_volumes(),
            MeshSource::File(file) => file.node_volumes.clone(),
        }
    }

    /// Returns whether each node is one of the lowest: a block's lowest layer, or a file's nodes at the lowest z.
    pub fn bottom(&self) -> Vec<bool> {
        match self {
            MeshSource::Block(block) => (0..self.node_count()).map(|node| block.is_bottom(node)).collect(),
            MeshSource::File(file) => file.bottom().collect(),
        }
    }

    /// Returns warnings about what may be unintended in the mesh, with these nodes fixed.
    pub(super) fn warnings(&self, fixed: &[bool]) -> Vec<Warning> {
        match self {
            MeshSource::Block(_) => Vec::new(),
            MeshSource::File(file) => warnings(file, fixed),
        }
    }
}

impl From<Block> for MeshSource {
    fn from(block: Block) -> Self {
        MeshSource::Block(block)
    }
}

impl From<FileMesh> for MeshSource {
    fn from(file: FileMesh) -> Self {
        MeshSource::File(Arc::new(file))
    }
}

/// Returns warnings about what was changed in the cells of a file.
fn changes(changes: &Changes) -> impl Iterator<Item = Warning> {
    let &Changes { by_corners, cut, repeated, turned, split, unused_nodes } = changes;
    let texts = [
        (
            "mesh-corners",
            by_corners,
            "cells of the mesh's file are of second or higher order: only their corners are used",
        ),
        ("mesh-cut", cut, "cells of the mesh's file are cut into tetrahedra or triangles"),
        ("mesh-repeated", repeated, "elements of the mesh's file repeat others and count once"),
        (
            "mesh-turned",
            turned,
            "elements of the mesh's file are turned round, as the others are oriented the other way",
        ),
        ("mesh-split", split, "nodes are added to the mesh, where parts of it touched that `mesh.repair` separates"),
        (
            "mesh-unused-nodes",
            unused_nodes,
            "nodes of the mesh's file are omitted, as no element uses them: indices count the others",
        ),
    ];
    let found = texts.into_iter().filter(|(_, count, _)| *count > 0);
    found.map(|(code, count, text)| Warning::new(code, format!("{count} {text}")))
}

fn warnings(file: &FileMesh, fixed: &[bool]) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let extent = file.extent();
    if !USUAL_EXTENTS.contains(&extent) {
        warnings.push(Warning::new("mesh-unit", format!(
            "the mesh is {extent:e} m large: if its file is in mm, `mesh.scale = 0.001` makes it m; without `scale` a unit \
             of the file is 1 m"
        )));
    }
    warnings.extend(changes(&file.changes));
    let held = fixed.iter().filter(|&&is_fixed| is_fixed).count();
    if (1..3).contains(&held) {
        warnings.push(Warning::new("mesh-pivot", format!(
            "the mesh is fixed at {held} of its nodes, about which it can turn: `mesh.fixed = {{ below_z = … }}` fixes \
             a region"
        )));
    }
    warnings
}
