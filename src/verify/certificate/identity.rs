//! Identity of a certificate: its time, its program, its scene with the mesh, and its machine.

use std::time::SystemTime;

use serde::Serialize;

use crate::model::mesh::Mesh;
use crate::realtime::machine::Machine;
use crate::scene::Scene;
use crate::session::sha256;
use crate::verify::baseline::Provenance;

/// Identity of a measurement. Equal hashes mean equal contents; what is not known is `None`.
///
/// ```
/// use stickslip::{realtime::machine::Machine, scene::Scene, verify::certificate::identity::Identity};
///
/// let machine = Machine::describe(0);
/// let of = |name: &str| Identity::now(&Scene::shipped(name).expect("shipped with the program"), &machine);
/// let (sliding, sticking) = (of("fig3-sliding"), of("fig4-sticking"));
/// assert_ne!(sliding.scene_sha256, sticking.scene_sha256);
/// assert_eq!(sliding.mesh_sha256, sticking.mesh_sha256); // the same block
/// assert_eq!(sliding.machine_sha256, sticking.machine_sha256);
/// assert!(sliding.date.ends_with('Z') && sliding.program_sha256 == machine.program_sha256);
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Identity {
    /// Time at which the verdicts were reached, UTC.
    pub date: String,
    /// Commit that the program was built from, with `+` if files had changed; `None` for debug builds and outside of a
    /// clone.
    pub commit: Option<&'static str>,
    /// SHA-256 of the scene, as in baselines.
    pub scene_sha256: String,
    /// Changes of single keys that the scene was read with, in their order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
    /// SHA-256 of the mesh: nodes, edges and triangles.
    pub mesh_sha256: String,
    /// SHA-256 of the program that ran.
    pub program_sha256: Option<String>,
    /// SHA-256 of the machine's description, without the program.
    pub machine_sha256: String,
}

impl Identity {
    /// Describes a measurement that ends now.
    pub fn now(scene: &Scene, machine: &Machine) -> Self {
        let Provenance { scene_sha256, changes, .. } = Provenance::of(scene);
        let hardware = Machine { program_sha256: None, ..machine.clone() };
        Self {
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            commit: option_env!("STICKSLIP_COMMIT"),
            scene_sha256,
            changes,
            mesh_sha256: mesh_sha256(&scene.mesh.mesh()),
            program_sha256: machine.program_sha256.clone(),
            machine_sha256: sha256(format!("{hardware:?}").as_bytes()),
        }
    }
}

fn mesh_sha256(mesh: &Mesh) -> String {
    let positions = mesh.nodes.iter().flat_map(|node| node.iter()).flat_map(|x| x.to_bits().to_le_bytes());
    let nodes = mesh.edges.iter().flatten().chain(mesh.triangles.iter().flatten());
    let bytes: Vec<u8> = positions.chain(nodes.flat_map(|node| node.to_le_bytes())).collect();
    sha256(&bytes)
}
