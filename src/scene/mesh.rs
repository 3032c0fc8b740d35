//! Where a scene's mesh comes from.

use std::sync::Arc;

use crate::mesh_file::FileMesh;
use crate::model::material::Bulk;
use crate::model::mesh::{Block, Mesh};

/// A block that is generated, or a mesh that has been read.
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
pub enum MeshSource {
    /// Generated.
    Block(Block),
    /// Read from a file.
    File(Arc<FileMesh>),
}

impl MeshSource {
    /// The mesh itself.
    pub fn mesh(&self) -> Mesh {
        match self {
            MeshSource::Block(block) => block.mesh(),
            MeshSource::File(file) => file.mesh.clone(),
        }
    }

    /// Its number of nodes.
    pub fn node_count(&self) -> usize {
        match self {
            MeshSource::Block(block) => block.nodes.iter().product(),
            MeshSource::File(file) => file.mesh.nodes.len(),
        }
    }

    /// Distance between neighbours, m: a block's spacing, or the mean length of a file's edges.
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

    /// What fills it.
    pub fn bulk(&self) -> Bulk<'_> {
        match self {
            MeshSource::Block(block) => Bulk::Lattice(block),
            MeshSource::File(file) if file.mesh.tetrahedra.is_empty() => Bulk::Shell,
            MeshSource::File(file) => Bulk::Tetrahedra(&file.mesh),
        }
    }

    /// Volume that each node stands for, m³.
    pub fn node_volumes(&self) -> Vec<f64> {
        match self {
            MeshSource::Block(block) => block.node_volumes(),
            MeshSource::File(file) => file.node_volumes.clone(),
        }
    }
}
