//! The scene file as written: names, types, and where each value stands. What values mean and which
//! go together is decided in [`super::validate`].

use serde::Deserialize;
use toml::Spanned;

use crate::multirate::timeline::OverrunPolicy;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    pub name: Spanned<String>,
    pub duration: Spanned<f64>,
    pub settle: Option<Spanned<bool>>,
    pub mesh: Spanned<MeshTable>,
    pub material: Spanned<MaterialTable>,
    #[serde(default)]
    pub global: GlobalTable,
    #[serde(default)]
    pub local: LocalTable,
    pub contact: Spanned<ContactTable>,
    pub instrument: Spanned<InstrumentTable>,
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
    pub nodes: Option<Spanned<[usize; 3]>>,
    pub spacing: Option<Spanned<f64>>,
    pub stencil: Option<Spanned<StencilName>>,
    pub path: Option<Spanned<String>>,
    pub scale: Option<Spanned<f64>>,
    pub layers: Option<Spanned<u32>>,
    pub layer_depth: Option<Spanned<f64>>,
    pub anchor: Option<Spanned<bool>>,
    pub fixed: Option<Spanned<Fixed>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeshKind {
    #[default]
    Block,
    File,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StencilName {
    Structural,
    Shear,
    Full,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected \"bottom\", \"none\", { below_z = … } or { nodes = [ … ] }")]
pub enum Fixed {
    Named(FixedName),
    Region(FixedRegion),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FixedName {
    Bottom,
    None,
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
    pub node_mass: Option<Spanned<PerNode>>,
    pub density: Option<Spanned<PerNode>>,
    pub stiffness: Option<Spanned<f64>>,
    pub young_modulus: Option<Spanned<f64>>,
    pub identification: Option<Spanned<IdentificationName>>,
    pub damping: Option<Spanned<f64>>,
    pub damping_ratio: Option<Spanned<f64>>,
    pub drag: Option<Spanned<f64>>,
    pub gravity: Option<Spanned<[f64; 3]>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IdentificationName {
    VanGelder,
    Lloyd,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlobalTable {
    pub rate: Option<Spanned<f64>>,
    #[serde(default)]
    pub integrator: GlobalIntegratorName,
    pub substeps: Option<Spanned<u32>>,
    pub threads: Option<Spanned<u32>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GlobalIntegratorName {
    #[default]
    SemiImplicitEuler,
    ImplicitEuler,
    Rk4,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalTable {
    pub rate: Option<Spanned<f64>>,
    #[serde(default)]
    pub model: LocalModelName,
    pub rings: Option<Spanned<Rings>>,
    pub linearization: Option<Spanned<LinearizationName>>,
    pub exterior: Option<Spanned<ExteriorName>>,
    pub tangent: Option<Spanned<TangentName>>,
    pub condense_rings: Option<Spanned<Rings>>,
    pub far_field: Option<Spanned<FarFieldName>>,
    pub integrator: Option<Spanned<LocalIntegratorName>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LocalModelName {
    #[default]
    Patch,
    Full,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a whole number of at least 1 or \"all\"")]
pub enum Rings {
    Count(u32),
    Named(AllName),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AllName {
    All,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinearizationName {
    #[default]
    Tangent,
    None,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExteriorName {
    #[default]
    Fixed,
    Drifting,
    Condensed,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FarFieldName {
    #[default]
    Fixed,
    Coarse,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TangentName {
    #[default]
    Exact,
    Stabilised,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LocalIntegratorName {
    SemiImplicitEuler,
    ImplicitEuler,
    ImplicitMidpoint,
    Exponential,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactTable {
    pub law: LawName,
    pub friction: Option<Spanned<f64>>,
    #[serde(default)]
    pub scheme: SchemeName,
    #[serde(default)]
    pub surface: SurfaceName,
    pub deformation: Option<Spanned<DeformationName>>,
    pub metric: Option<Spanned<MetricName>>,
    pub wall_stiffness: Option<Spanned<f64>>,
    pub wall_damping: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LawName {
    Sliding,
    Sticking,
    StickSlip,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SchemeName {
    #[default]
    Geometric,
    Velocity,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SurfaceName {
    #[default]
    Faceted,
    Shaded,
    Subdivision,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeformationName {
    #[default]
    Rigid,
    LeastNorm,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MetricName {
    #[default]
    Euclidean,
    Mass,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstrumentTable {
    #[serde(default)]
    pub kind: InstrumentName,
    pub waypoints: Option<Spanned<Vec<Spanned<Vec<f64>>>>>,
    pub file: Option<Spanned<String>>,
    pub smoothing_ticks: Option<Spanned<u32>>,
    pub passivity_control: Option<Spanned<bool>>,
    pub device: Option<Spanned<DeviceTable>>,
    pub hand: Option<Spanned<HandTable>>,
    pub coupling: Option<Spanned<CouplingTable>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceTable {
    pub rotation: Option<Spanned<[[f64; 3]; 3]>>,
    pub offset: Option<Spanned<[f64; 3]>>,
    pub joint_friction: Option<Spanned<[f64; 3]>>,
    pub friction_speed: Option<Spanned<f64>>,
    pub joint_damping: Option<Spanned<f64>>,
    pub rotor_inertia: Option<Spanned<[f64; 3]>>,
    pub capstan_ratio: Option<Spanned<[f64; 3]>>,
    pub torque_constant: Option<Spanned<f64>>,
    pub largest_current: Option<Spanned<f64>>,
    pub torque_bits: Option<Spanned<u32>>,
    pub encoder_counts: Option<Spanned<u32>>,
    pub amplifier_bandwidth: Option<Spanned<f64>>,
    pub largest_force: Option<Spanned<f64>>,
    pub substeps: Option<Spanned<u32>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandTable {
    pub mass: Option<Spanned<[f64; 3]>>,
    pub stylus_stiffness: Option<Spanned<[f64; 3]>>,
    pub stylus_damping: Option<Spanned<[f64; 3]>>,
    pub arm_stiffness: Option<Spanned<[f64; 3]>>,
    pub arm_damping: Option<Spanned<[f64; 3]>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingTable {
    pub stiffness: Option<Spanned<f64>>,
    pub damping: Option<Spanned<f64>>,
    pub mass: Option<Spanned<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InstrumentName {
    #[default]
    Path,
    Recording,
    #[serde(rename = "phantom-1.5")]
    Phantom,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SyncTable {
    #[serde(default)]
    pub mode: SyncName,
    pub latency_ticks: Option<Spanned<u32>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SyncName {
    #[default]
    Replay,
    Overwrite,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunTable {
    #[serde(default)]
    pub schedule: ScheduleName,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScheduleName {
    #[default]
    Lockstep,
    Threads,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingTable {
    pub tick_cost: Option<Spanned<CostValue>>,
    pub model_cost: Option<Spanned<CostValue>>,
    pub deadline: Option<Spanned<f64>>,
    pub overrun: Option<Spanned<OverrunPolicy>>,
    pub seed: Option<Spanned<u64>>,
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
