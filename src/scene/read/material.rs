//! The `[material]` table: masses and springs, given or from the constants of a material.

use super::{Read, no_effect};
use crate::Vec3;
use crate::model::material::{Bulk, PerSpring, pair_damping};
use crate::model::network::Material;
use crate::scene::MeshSource;
use crate::scene::check::{non_negative, positive};
use crate::scene::error::Problem;
use crate::scene::file::{MaterialTable, PerNode};

pub(super) fn material(material: &MaterialTable, mesh: &MeshSource) -> Read<Material> {
    let node_mass = node_mass(material, mesh)?;
    let stiffness = stiffness(material, mesh.bulk())?;
    let damping = match (material.damping, material.damping_ratio) {
        (Some(damping), None) => PerSpring::Same(damping),
        (None, Some(ratio)) => {
            let ratio = non_negative("material.damping_ratio", ratio)?;
            PerSpring::Each(pair_damping(&mesh.mesh(), &stiffness, &node_mass, ratio))
        }
        (Some(_), Some(_)) => return Err(Problem::Both("material.damping_ratio", "material.damping")),
        (None, None) => return Err(Problem::Missing("material.damping")),
    };
    let gravity = material.gravity.map_or(Vec3::zeros(), Vec3::from);
    Ok(Material { node_mass, stiffness, damping, drag: material.drag.unwrap_or(0.0), gravity })
}

fn node_mass(material: &MaterialTable, mesh: &MeshSource) -> Read<Vec<f64>> {
    match (&material.node_mass, &material.density) {
        (Some(mass), None) => per_node("material.node_mass", mass, mesh.node_count()),
        (None, Some(density)) => {
            let mut mass = per_node("material.density", density, mesh.node_count())?;
            mass.iter_mut().zip(mesh.node_volumes()).for_each(|(mass, volume)| *mass *= volume);
            Ok(mass)
        }
        (Some(_), Some(_)) => Err(Problem::Both("material.density", "material.node_mass")),
        (None, None) => Err(Problem::Missing("material.node_mass")),
    }
}

fn per_node(key: &'static str, values: &PerNode, nodes: usize) -> Read<Vec<f64>> {
    match values {
        PerNode::Same(value) => Ok(vec![positive(key, *value)?; nodes]),
        PerNode::Each(each) if each.len() == nodes => each.iter().map(|&value| positive(key, value)).collect(),
        PerNode::Each(each) => Err(Problem::WrongLength { key, found: each.len(), nodes }),
    }
}

fn stiffness(material: &MaterialTable, bulk: Bulk) -> Read<PerSpring> {
    let key = "material.young_modulus";
    let is_identified = material.identification.is_some();
    match (material.stiffness, material.young_modulus) {
        (Some(stiffness), None) => {
            no_effect("material.identification", is_identified, "`material.stiffness`")?;
            // Checked here, since damping may be derived from it.
            positive("material.stiffness", stiffness).map(PerSpring::Same)
        }
        (None, Some(modulus)) => {
            if let Bulk::Lattice(_) = bulk {
                let because = "a block, whose springs follow from `material.young_modulus` exactly";
                no_effect("material.identification", is_identified, because)?;
            }
            let identification = material.identification.unwrap_or_default();
            let stiffness = bulk.stiffness(positive(key, modulus)?, identification);
            stiffness.map(PerSpring::Each).map_err(|error| Problem::Material { key, error })
        }
        (Some(_), Some(_)) => Err(Problem::Both(key, "material.stiffness")),
        (None, None) => Err(Problem::Missing("material.stiffness")),
    }
}
