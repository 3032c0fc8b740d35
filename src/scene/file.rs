//! The scene file as written: keys and the types of their values. [`super::read`] interprets the values;
//! [`super::check`] decides which go together.

use super::Schedule;
use super::words::*;
use crate::contact::rules::Deformation;
use crate::device::path::Interpolation;
use crate::device::phantom::TipSensing;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::FarField;
use crate::local::step::LocalIntegrator;
use crate::model::material::Identification;
use crate::model::mesh::Stencil;
use crate::model::springs::TangentKind;
use crate::multirate::global::SyncMode;
use crate::multirate::timeline::OverrunPolicy;
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    pub name: String,
    pub duration: f64,
    pub settle: Option<bool>,
    pub mesh: MeshTable,
    pub material: MaterialTable,
    #[serde(default)]
    pub global: GlobalTable,
    #[serde(default)]
    pub local: LocalTable,
    pub contact: ContactTable,
    pub instrument: InstrumentTable,
    #[serde(default)]
    pub sync: SyncTable,
    #[serde(default)]
    pub run: RunTable,
    #[serde(default)]
    pub timing: TimingTable,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    #[serde(default)]
    pub kind: MeshKind,
    pub nodes: Option<[usize; 3]>,
    pub spacing: Option<f64>,
    pub stencil: Option<Stencil>,
    pub path: Option<String>,
    pub scale: Option<f64>,
    pub layers: Option<u32>,
    pub layer_depth: Option<f64>,
    pub anchor: Option<bool>,
    pub repair: Option<bool>,
    pub fixed: Option<Fixed>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected \"bottom\", \"none\", { below_z = … } or { nodes = [ … ] }")]
pub enum Fixed {
    Named(FixedName),
    Region(FixedRegion),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FixedRegion {
    BelowZ(f64),
    Nodes(Vec<u32>),
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number or a list of one number per node")]
pub enum PerNode {
    Same(f64),
    Each(Vec<f64>),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialTable {
    pub node_mass: Option<PerNode>,
    pub density: Option<PerNode>,
    pub stiffness: Option<f64>,
    pub young_modulus: Option<f64>,
    pub identification: Option<Identification>,
    pub damping: Option<f64>,
    pub damping_ratio: Option<f64>,
    pub drag: Option<f64>,
    pub gravity: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlobalTable {
    pub rate: Option<f64>,
    #[serde(default)]
    pub integrator: GlobalIntegrator,
    pub substeps: Option<u32>,
    pub threads: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalTable {
    pub rate: Option<f64>,
    #[serde(default)]
    pub model: LocalModelName,
    pub rings: Option<Rings>,
    pub linearization: Option<LinearizationName>,
    pub exterior: Option<ExteriorName>,
    pub tangent: Option<TangentKind>,
    pub condense_rings: Option<Rings>,
    pub far_field: Option<FarField>,
    pub integrator: Option<LocalIntegrator>,
    pub library: Option<String>,
    pub options: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactTable {
    pub law: LawName,
    pub friction: Option<FrictionValue>,
    pub adhesion: Option<f64>,
    #[serde(default)]
    pub scheme: SchemeName,
    #[serde(default)]
    pub surface: ContactSurface,
    pub radius: Option<f64>,
    pub deformation: Option<Deformation>,
    pub metric: Option<Metric>,
    pub wall_stiffness: Option<f64>,
    pub wall_damping: Option<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "expected a number or { static = …, kinetic = … }")]
pub enum FrictionValue {
    Single(f64),
    Pair(FrictionPair),
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrictionPair {
    #[serde(rename = "static")]
    pub static_coefficient: f64,
    #[serde(rename = "kinetic")]
    pub kinetic_coefficient: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstrumentTable {
    #[serde(default)]
    pub kind: InstrumentName,
    pub waypoints: Option<Vec<Vec<f64>>>,
    pub file: Option<String>,
    pub columns: Option<[String; 4]>,
    pub scale: Option<f64>,
    pub time_scale: Option<f64>,
    pub start: Option<f64>,
    pub filter_hz: Option<f64>,
    pub interpolation: Option<Interpolation>,
    pub force_limit: Option<f64>,
    pub smoothing_ticks: Option<u32>,
    pub passivity_control: Option<bool>,
    pub device: Option<DeviceTable>,
    pub hand: Option<HandTable>,
    pub coupling: Option<CouplingTable>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceTable {
    pub tip: Option<TipSensing>,
    pub rotation: Option<[[f64; 3]; 3]>,
    pub offset: Option<[f64; 3]>,
    pub joint_friction: Option<[f64; 3]>,
    pub friction_speed: Option<f64>,
    pub joint_damping: Option<f64>,
    pub rotor_inertia: Option<[f64; 3]>,
    pub capstan_ratio: Option<[f64; 3]>,
    pub torque_constant: Option<f64>,
    pub largest_current: Option<f64>,
    pub torque_bits: Option<u32>,
    pub encoder_counts: Option<u32>,
    pub amplifier_bandwidth: Option<f64>,
    pub largest_force: Option<f64>,
    pub substeps: Option<u32>,
    pub structure: Option<StructureTable>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StructureTable {
    pub stiffness: Option<f64>,
    pub tip_mass: Option<f64>,
    pub damping_ratio: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandTable {
    pub mass: Option<[f64; 3]>,
    pub stylus_stiffness: Option<[f64; 3]>,
    pub stylus_damping: Option<[f64; 3]>,
    pub arm_stiffness: Option<[f64; 3]>,
    pub arm_damping: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingTable {
    pub stiffness: Option<f64>,
    pub damping: Option<f64>,
    pub mass: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SyncTable {
    #[serde(default)]
    pub mode: SyncMode,
    pub latency_ticks: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunTable {
    #[serde(default)]
    pub schedule: Schedule,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingTable {
    pub tick_cost: Option<CostValue>,
    pub model_cost: Option<CostValue>,
    pub deadline: Option<f64>,
    pub overrun: Option<OverrunPolicy>,
    pub seed: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, a list of numbers, { median = …, p99 = … } or { usual = …, rare = …, share = … }"
)]
pub enum CostValue {
    Constant(f64),
    Table(Vec<f64>),
    LogNormal(LogNormalCost),
    Rare(RareCost),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogNormalCost {
    pub median: f64,
    pub p99: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RareCost {
    pub usual: f64,
    pub rare: f64,
    pub share: f64,
}
