//! The `[material]` part: masses and springs, given or from the constants of a material, and `settle`.

use std::ops::Range;

use toml::Spanned;

use super::{Checker, Placed, Sign};
use crate::Vec3;
use crate::model::material::{Bulk, Identification, MaterialError, PerSpring, pair_damping};
use crate::model::network::Material;
use crate::scene::MeshSource;
use crate::scene::error::{Problem, SceneError};
use crate::scene::file::{IdentificationName, MaterialTable, PerNode};

impl Checker {
    pub(super) fn material(&self, table: &Spanned<MaterialTable>, mesh: &MeshSource) -> Placed<Material> {
        let material = table.get_ref();
        let node_mass = self.node_mass(table, mesh)?;
        let stiffness = self.stiffness(table, mesh.bulk())?;
        let damping = match (&material.damping, &material.damping_ratio) {
            (Some(damping), None) => PerSpring::Same(self.number("material.damping", damping, Sign::NonNegative)?),
            (None, Some(ratio)) => {
                let ratio = self.number("material.damping_ratio", ratio, Sign::NonNegative)?;
                PerSpring::Each(pair_damping(&mesh.mesh(), &stiffness, &node_mass, ratio))
            }
            (Some(_), Some(ratio)) => {
                return Err(self.error(Problem::Both("material.damping_ratio", "material.damping"), ratio.span()));
            }
            (None, None) => return Err(self.error(Problem::Missing("material.damping"), table.span())),
        };
        let gravity = match &material.gravity {
            None => Vec3::zeros(),
            Some(gravity) if gravity.get_ref().iter().all(|g| g.is_finite()) => Vec3::from(*gravity.get_ref()),
            Some(gravity) => {
                let value = format!("{:?}", gravity.get_ref());
                return Err(self.error(Problem::NotAccepted { key: "material.gravity", value }, gravity.span()));
            }
        };
        Ok(Material {
            node_mass,
            stiffness,
            damping,
            drag: self.number_or("material.drag", &material.drag, 0.0, Sign::NonNegative)?,
            gravity,
        })
    }

    fn node_mass(&self, table: &Spanned<MaterialTable>, mesh: &MeshSource) -> Placed<Vec<f64>> {
        let material = table.get_ref();
        match (&material.node_mass, &material.density) {
            (Some(mass), None) => self.per_node("material.node_mass", mass, mesh.node_count()),
            (None, Some(density)) => {
                let mut mass = self.per_node("material.density", density, mesh.node_count())?;
                mass.iter_mut().zip(mesh.node_volumes()).for_each(|(mass, volume)| *mass *= volume);
                Ok(mass)
            }
            (Some(_), Some(density)) => {
                Err(self.error(Problem::Both("material.density", "material.node_mass"), density.span()))
            }
            (None, None) => Err(self.error(Problem::Missing("material.node_mass"), table.span())),
        }
    }

    fn stiffness(&self, table: &Spanned<MaterialTable>, bulk: Bulk) -> Placed<PerSpring> {
        let material = table.get_ref();
        let key = "material.young_modulus";
        let identification_span = material.identification.as_ref().map(Spanned::span);
        match (&material.stiffness, &material.young_modulus) {
            (Some(stiffness), None) => {
                self.no_effect("material.identification", identification_span, "`material.stiffness`")?;
                Ok(PerSpring::Same(self.number("material.stiffness", stiffness, Sign::Positive)?))
            }
            (None, Some(modulus)) => {
                if let Bulk::Lattice(_) = bulk {
                    let because = "a block, whose springs follow from `material.young_modulus` exactly";
                    self.no_effect("material.identification", identification_span, because)?;
                }
                let identification = match material.identification.as_ref().map(Spanned::get_ref) {
                    None => Identification::default(),
                    Some(IdentificationName::VanGelder) => Identification::VanGelder,
                    Some(IdentificationName::Lloyd) => Identification::Lloyd,
                };
                let young_modulus = self.number(key, modulus, Sign::Positive)?;
                let stiffness = bulk.stiffness(young_modulus, identification);
                stiffness.map(PerSpring::Each).map_err(|error| self.not_material(key, error, modulus.span()))
            }
            (Some(_), Some(modulus)) => Err(self.error(Problem::Both(key, "material.stiffness"), modulus.span())),
            (None, None) => Err(self.error(Problem::Missing("material.stiffness"), table.span())),
        }
    }

    fn not_material(&self, key: &'static str, error: MaterialError, span: Range<usize>) -> SceneError {
        self.error(Problem::Material { key, error }, span).with_help(match error {
            MaterialError::NoShear => "give another `mesh.stencil`, or `material.stiffness`",
            MaterialError::NoVolume => "give a mesh of tetrahedra, or `material.stiffness` instead",
            MaterialError::Flat { .. } | MaterialError::Loose { .. } => "repair the mesh",
        })
    }

    fn per_node(&self, key: &'static str, values: &Spanned<PerNode>, nodes: usize) -> Placed<Vec<f64>> {
        let positive = |value: f64| self.check(key, value, values.span(), Sign::Positive);
        match values.get_ref() {
            PerNode::Same(value) => Ok(vec![positive(*value)?; nodes]),
            PerNode::Each(each) if each.len() == nodes => each.iter().map(|&value| positive(value)).collect(),
            PerNode::Each(each) => {
                Err(self.error(Problem::WrongLength { key, found: each.len(), nodes }, values.span()))
            }
        }
    }

    pub(super) fn settle(&self, settle: &Option<Spanned<bool>>, material: &Material) -> Placed<bool> {
        let asked = settle.as_ref().filter(|settle| *settle.get_ref());
        if material.gravity == Vec3::zeros() {
            let because = "a `material.gravity` of zero: the network is at rest as it is";
            self.no_effect("settle", asked.map(Spanned::span), because)?;
        }
        Ok(asked.is_some())
    }
}
