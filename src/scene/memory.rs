//! A check that a scene fits into memory, before anything of its size is allocated.

use crate::local::condensation::{FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::mesh::Mesh;
use crate::model::search::breadth_first;
use crate::scene::MeshSource;
use crate::scene::error::Problem;

/// Bytes of a run per node: rest position, mass, and eight position-and-velocity arrays of the global side, the local
/// side and their scratch.
const BYTES_PER_NODE: u128 = 500;
/// Bytes per spring: once in the network and twice in the adjacency, once in a patch that takes all.
const BYTES_PER_SPRING: u128 = 300;
/// Bytes per tick: records of the summary and the plot, twice, and the spectrum's buffers.
const BYTES_PER_TICK: u128 = 256;

/// Bytes of a condensed exterior per point to the power of 4/3, the growth of a factor under nested dissection in three
/// dimensions: 900 for blocks of 1,000 to 10,000 nodes, matrix and pattern included.
const BYTES_PER_FACTOR_POINT: f64 = 1200.0;

/// The settings of a run that determine its memory.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub local: &'a LocalSettings,
    pub integrator: LocalIntegrator,
    pub ticks: u64,
    pub ticks_per_cycle: u32,
}

/// The size of a mesh.
pub(super) struct Size<'a> {
    pub nodes: u128,
    pub springs: u128,
    /// Upper bound on the number of nodes within a number of springs of one.
    pub within: &'a dyn Fn(u32) -> u128,
}

/// Estimates the bytes of a condensed exterior.
fn factor_bytes(reach: Reach, size: &Size) -> u128 {
    let points = match reach {
        Reach::All => size.nodes,
        Reach::Rings { rings, far_field: FarField::Fixed } => (size.within)(rings),
        // The coarse grid has a vertex for four nodes in every direction.
        Reach::Rings { rings, far_field: FarField::Coarse } => {
            (size.within)(rings).saturating_add(size.nodes.div_ceil(16))
        }
    };
    (BYTES_PER_FACTOR_POINT * (points as f64).powf(4.0 / 3.0)) as u128
}

/// Checks that a run over this mesh fits.
pub(super) fn mesh_fits(mesh: &MeshSource, run: Run) -> Result<(), Problem> {
    match mesh {
        MeshSource::Block(block) => {
            let nodes = block.nodes.iter().fold(1_u128, |product, &count| product.saturating_mul(count as u128));
            // A ring goes one lattice step further in every direction.
            let within = |rings: u32| nodes.min((2 * u128::from(rings) + 1).saturating_pow(3));
            let size = Size { nodes, springs: block.edge_count() as u128, within: &within };
            fits("mesh.nodes", &size, run)
        }
        MeshSource::File(file) => {
            let nodes = file.mesh.nodes.len() as u128;
            let within = |rings: u32| largest_neighbourhood(&file.mesh, rings).min(nodes);
            let size = Size { nodes, springs: file.mesh.edges.len() as u128, within: &within };
            fits("mesh.path", &size, run)
        }
    }
}

/// Checks that a run over a mesh of this size, given by `key`, fits.
pub(super) fn fits(key: &'static str, size: &Size, run: Run) -> Result<(), Problem> {
    let &Size { nodes, springs, within } = size;
    let Run { local, integrator, ticks, ticks_per_cycle } = run;
    let patch = match local.extent {
        Extent::All => nodes,
        Extent::Rings(rings) => within(rings),
    };
    // Matrices of the size of K, dense over every node of the patch: K, D, those that a tick adds to them, and those in
    // use at once while they are built.
    let matrices = match integrator {
        LocalIntegrator::SemiImplicitEuler => 2,
        LocalIntegrator::ImplicitEuler | LocalIntegrator::ImplicitMidpoint => 2 + 3 + 9,
        LocalIntegrator::Exponential => 2 + 6 + 18,
    };
    let matrix = match local.linearization {
        Linearization::Tangent(_) => patch.saturating_mul(patch).saturating_mul(matrices * 9 * 8),
        Linearization::None => 0,
    };
    // Positions and velocities of every tick of a cycle, for the replay.
    let recorded = match local.extent {
        Extent::All => 0,
        Extent::Rings(_) => {
            patch.saturating_mul(u128::from(ticks.min(u64::from(ticks_per_cycle))) + 1).saturating_mul(2 * 24)
        }
    };
    let factor = match local.exterior {
        ExteriorKind::Fixed | ExteriorKind::Drifting => 0,
        ExteriorKind::Condensed(condensation) => factor_bytes(condensation.reach, size),
    };
    let needed = nodes
        .saturating_mul(BYTES_PER_NODE)
        .saturating_add(springs.saturating_mul(BYTES_PER_SPRING))
        .saturating_add(matrix)
        .saturating_add(factor)
        .saturating_add(recorded)
        .saturating_add(u128::from(ticks) * BYTES_PER_TICK);
    let available = u128::from(available_memory());
    if needed <= available && nodes < u128::from(u32::MAX) {
        return Ok(());
    }
    let mib = |bytes: u128| bytes >> 20;
    Err(Problem::TooLarge { key, nodes, springs, ticks, needed_mib: mib(needed), available_mib: mib(available) })
}

/// Returns the available memory, bytes. A build without the feature `files` does not look, and takes every scene.
#[cfg(feature = "files")]
pub(super) fn available_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    system.available_memory()
}

#[cfg(not(feature = "files"))]
pub(super) fn available_memory() -> u64 {
    u64::MAX
}

/// Returns the number of nodes within some springs of one: the largest of some surface nodes, and half as many again
/// for the others.
fn largest_neighbourhood(mesh: &Mesh, rings: u32) -> u128 {
    const LOOKED_AT: usize = 32;
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); mesh.nodes.len()];
    for &[i, j] in &mesh.edges {
        neighbours[i as usize].push(j);
        neighbours[j as usize].push(i);
    }
    let centres = mesh.triangles.iter().step_by(mesh.triangles.len().div_ceil(LOOKED_AT).max(1));
    let crowded = (0..mesh.nodes.len() as u32).max_by_key(|&node| neighbours[node as usize].len());
    let counts = centres.map(|corners| corners[0]).chain(crowded).map(|centre| {
        breadth_first(mesh.nodes.len(), [centre], rings, |node| neighbours[node as usize].iter().copied()).0.len()
    });
    counts.max().unwrap_or(0) as u128 * 3 / 2
}
