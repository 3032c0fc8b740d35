//! The `[mesh]` table: a block, or a mesh from a file, and which of its nodes are fixed.

use std::path::Path;
use std::sync::Arc;

use super::{Read, no_effect};
use crate::mesh_file::{FileMesh, Layers, MeshFile};
use crate::model::mesh::{Block, Mesh};
use crate::scene::MeshSource;
use crate::scene::check::{at_least_one, block, positive};
use crate::scene::error::Problem;
use crate::scene::file::{Fixed, FixedRegion, MeshTable};
use crate::scene::memory::{Run, Size, available_memory, fits, mesh_fits};
use crate::scene::words::{FixedName, MeshKind};

/// Reads the mesh, and which nodes are fixed.
pub(super) fn mesh(table: &MeshTable, folder: &Path, run: Run) -> Read<(MeshSource, Vec<bool>)> {
    let (mesh, anchored) = match table.kind {
        MeshKind::Block => (MeshSource::Block(given_block(table)?), None),
        MeshKind::File => {
            let file = mesh_file(table, folder, run)?;
            let is_anchored = !file.innermost.is_empty() && table.anchor.unwrap_or(true);
            let anchored = is_anchored.then(|| file.innermost.clone());
            (MeshSource::File(Arc::new(file)), anchored)
        }
    };
    mesh_fits(&mesh, run)?;
    let mut is_fixed = match &table.fixed {
        // An anchor holds by itself: nothing else is fixed unless the scene requests it.
        None if anchored.is_some() => vec![false; mesh.node_count()],
        None | Some(Fixed::Named(FixedName::Bottom)) => mesh.bottom(),
        Some(Fixed::Named(FixedName::None)) => vec![false; mesh.node_count()],
        Some(Fixed::Region(region)) => fixed(region, &mesh.mesh())?,
    };
    if let Some(anchored) = anchored {
        is_fixed[anchored].fill(true);
    }
    Ok((mesh, is_fixed))
}

fn given_block(table: &MeshTable) -> Read<Block> {
    let because = "`mesh.kind = \"block\"`";
    no_effect("mesh.path", table.path.is_some(), because)?;
    no_effect("mesh.scale", table.scale.is_some(), because)?;
    no_effect("mesh.repair", table.repair.is_some(), because)?;
    no_layers(table, because)?;
    let given = Block {
        nodes: table.nodes.ok_or(Problem::Missing("mesh.nodes"))?,
        spacing: table.spacing.ok_or(Problem::Missing("mesh.spacing"))?,
        stencil: table.stencil.unwrap_or_default(),
    };
    block(&given).map(|()| given)
}

fn no_layers(table: &MeshTable, because: &'static str) -> Read {
    no_effect("mesh.layers", table.layers.is_some(), because)?;
    no_effect("mesh.layer_depth", table.layer_depth.is_some(), because)?;
    no_effect("mesh.anchor", table.anchor.is_some(), because)
}

fn mesh_file(table: &MeshTable, folder: &Path, run: Run) -> Read<FileMesh> {
    let because = "`mesh.kind = \"file\"`";
    no_effect("mesh.nodes", table.nodes.is_some(), because)?;
    no_effect("mesh.spacing", table.spacing.is_some(), because)?;
    no_effect("mesh.stencil", table.stencil.is_some(), because)?;
    let path = table.path.as_ref().ok_or(Problem::Missing("mesh.path"))?;
    let scale = positive("mesh.scale", table.scale.unwrap_or(1.0))?;
    let file = MeshFile::read(&folder.join(path), available_memory()).map_err(Problem::MeshFile)?;
    let file = file.repaired(table.repair.unwrap_or(false));
    if !file.is_surface() {
        no_layers(table, "a mesh of tetrahedra")?;
        return file.solid(scale).map_err(Problem::MeshFile);
    }
    let depth = table.layer_depth.ok_or(Problem::Missing("mesh.layer_depth"))?;
    let count = at_least_one("mesh.layers", table.layers.unwrap_or(1))? as usize;
    let layers = Layers { count, depth: positive("mesh.layer_depth", depth)? };
    // Checked before the copies that the scene requests are made.
    let (nodes, springs) = layers.sizes(file.cells());
    let key = if table.layers.is_some() { "mesh.layers" } else { "mesh.path" };
    fits(key, &Size { nodes, springs, within: &|_| 0 }, run)?;
    file.shell(scale, layers).map_err(Problem::MeshFile)
}

fn fixed(region: &FixedRegion, mesh: &Mesh) -> Read<Vec<bool>> {
    let refuse = |value: String| Problem::NotAccepted { key: "mesh.fixed", value };
    match region {
        FixedRegion::BelowZ(z) if z.is_finite() => Ok(mesh.nodes.iter().map(|node| node.z < *z).collect()),
        FixedRegion::BelowZ(z) => Err(refuse(format!("{{ below_z = {z} }}"))),
        FixedRegion::Nodes(nodes) => {
            let count = mesh.nodes.len();
            let mut fixed = vec![false; count];
            for &node in nodes {
                *fixed.get_mut(node as usize).ok_or_else(|| refuse(format!("node {node} of {count}")))? = true;
            }
            Ok(fixed)
        }
    }
}
