//! A check that a scene fits into memory, before anything of its size is allocated.

use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::{FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::mesh::{Block, Mesh, Stencil};
use crate::model::search::breadth_first;
use crate::scene::error::Problem;
use crate::scene::{MeshSource, Scene};

/// Bytes of the program and its libraries.
const BYTES_OF_PROGRAM: u128 = 12 << 20;
/// Bytes of a run per node: rest position, mass, and eight position-and-velocity arrays of the global side, the local
/// side and their scratch.
const BYTES_PER_NODE: u128 = 500;
/// Bytes per spring: once in the network and twice in the adjacency, once in a patch that takes all.
const BYTES_PER_SPRING: u128 = 250;
/// Bytes per tick: records of the summary and the plot, twice, and the spectrum's buffers.
const BYTES_PER_TICK: u128 = 128;
/// Bytes of [K D] per node of a patch beside a fixed or drifting exterior: the matrix is stored as if it were dense, and only the
/// pages around a node's neighbours are ever touched.
const BYTES_PER_PATCH_NODE: u128 = 28 << 10;

/// Bytes of a factor: a coefficient times a power of the number of points, both of which depend on the order of
/// elimination. On blocks of 600 to 20,000 nodes the measured bytes, with matrix and pattern, are within a factor of 1.2
/// (`benches/memory.py`).
struct Factor {
    bytes: f64,
    power: f64,
}

/// A condensed exterior: LDLᵀ under nested dissection.
const CONDENSATION: Factor = Factor { bytes: 800.0, power: 4.0 / 3.0 };
/// An equilibrium: LLᵀ in an order of minimum degree.
const EQUILIBRIUM: Factor = Factor { bytes: 640.0, power: 1.41 };
/// An implicit step of the network: LU in an order of minimum degree of AᵀA.
const IMPLICIT_STEP: Factor = Factor { bytes: 169.0, power: 1.7 };

impl Factor {
    fn of(&self, points: u128) -> u128 {
        (self.bytes * (points as f64).powf(self.power)) as u128
    }
}

/// The settings of a run that determine its memory.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub local: &'a LocalSettings,
    pub integrator: LocalIntegrator,
    pub ticks: u64,
    pub ticks_per_cycle: u32,
    /// Whether the equilibrium under gravity is computed.
    pub settles: bool,
    /// Whether steps of the network are implicit.
    pub is_implicit: bool,
}

impl<'a> Run<'a> {
    pub(super) fn of(scene: &'a Scene) -> Self {
        Self {
            local: &scene.local,
            integrator: scene.integrator,
            ticks: scene.tick_count,
            ticks_per_cycle: scene.ticks_per_cycle,
            settles: scene.settle,
            is_implicit: !scene.is_full && scene.global.integrator == GlobalIntegrator::ImplicitEuler,
        }
    }
}

/// The size of a mesh.
pub(super) struct Size<'a> {
    pub nodes: u128,
    pub springs: u128,
    /// Upper bound on the number of nodes within a number of springs of one on the surface.
    pub within: &'a dyn Fn(u32) -> u128,
}

impl Size<'_> {
    /// Calls `with` with the size of a mesh.
    fn of<T>(mesh: &MeshSource, with: impl FnOnce(&Size) -> T) -> T {
        match mesh {
            MeshSource::Block(block) => {
                let nodes = block.nodes.iter().fold(1_u128, |product, &count| product.saturating_mul(count as u128));
                with(&Size {
                    nodes,
                    springs: block.edge_count() as u128,
                    within: &|rings| surface_neighbourhood(block, rings),
                })
            }
            MeshSource::File(file) => {
                let nodes = file.mesh.nodes.len() as u128;
                let within = |rings: u32| largest_neighbourhood(&file.mesh, rings).min(nodes);
                with(&Size { nodes, springs: file.mesh.edges.len() as u128, within: &within })
            }
        }
    }
}

/// Estimates the memory of a scene's run, bytes.
pub(super) fn estimate(scene: &Scene) -> u128 {
    Size::of(&scene.mesh, |size| needed(size, Run::of(scene), Counted::Touched))
}

/// Checks that a run over this mesh fits.
pub(super) fn mesh_fits(mesh: &MeshSource, run: Run) -> Result<(), Problem> {
    let key = match mesh {
        MeshSource::Block(_) => "mesh.nodes",
        MeshSource::File(_) => "mesh.path",
    };
    Size::of(mesh, |size| fits(key, size, run))
}

/// Which part counts of a matrix that is stored as if it were dense.
#[derive(Clone, Copy, PartialEq)]
enum Counted {
    /// Only the pages that are ever touched.
    Touched,
    /// The whole matrix, which the system has to grant.
    Allocated,
}

/// Estimates the bytes of a run over a mesh of this size.
fn needed(size: &Size, run: Run, counted: Counted) -> u128 {
    let &Size { nodes, springs, within } = size;
    let Run { local, integrator, ticks, ticks_per_cycle, settles, is_implicit } = run;
    let patch = match local.extent {
        Extent::All => nodes,
        Extent::Rings(rings) => within(rings),
    };
    // Matrices of the size of K, dense over every node of the patch: K, D, those that a tick adds to them, and those in
    // use at once while they are built.
    let dense = |matrices: u128| patch.saturating_mul(patch).saturating_mul(matrices * 9 * 8);
    let is_condensed = matches!(local.exterior, ExteriorKind::Condensed(_));
    let matrix = match (local.linearization, integrator) {
        (Linearization::None, _) if is_condensed => dense(2),
        (Linearization::None, _) => 0,
        (_, LocalIntegrator::SemiImplicitEuler) if is_condensed => dense(3),
        (_, LocalIntegrator::SemiImplicitEuler) if counted == Counted::Allocated => dense(2),
        (_, LocalIntegrator::SemiImplicitEuler) => dense(2).min(patch.saturating_mul(BYTES_PER_PATCH_NODE)),
        (_, LocalIntegrator::ImplicitEuler | LocalIntegrator::ImplicitMidpoint) => dense(2 + 3 + 9),
        (_, LocalIntegrator::Exponential) => dense(2 + 6 + 18),
    };
    // Positions and velocities of every tick of a cycle, for the replay.
    let recorded = match local.extent {
        Extent::All => 0,
        Extent::Rings(_) => {
            patch.saturating_mul(u128::from(ticks.min(u64::from(ticks_per_cycle))) + 1).saturating_mul(2 * 24)
        }
    };
    let condensation = match local.exterior {
        ExteriorKind::Fixed | ExteriorKind::Drifting => 0,
        ExteriorKind::Condensed(condensation) => CONDENSATION.of(match condensation.reach {
            Reach::All => nodes,
            Reach::Rings { rings, far_field: FarField::Fixed } => within(rings),
            // The coarse grid has a vertex for four nodes in every direction.
            Reach::Rings { rings, far_field: FarField::Coarse } => within(rings).saturating_add(nodes.div_ceil(16)),
        }),
    };
    // The equilibrium is computed before anything else has a factor.
    let factors = (condensation + if is_implicit { IMPLICIT_STEP.of(nodes) } else { 0 }).max(if settles {
        EQUILIBRIUM.of(nodes)
    } else {
        0
    });
    BYTES_OF_PROGRAM
        .saturating_add(nodes.saturating_mul(BYTES_PER_NODE))
        .saturating_add(springs.saturating_mul(BYTES_PER_SPRING))
        .saturating_add(matrix)
        .saturating_add(factors)
        .saturating_add(recorded)
        .saturating_add(u128::from(ticks) * BYTES_PER_TICK)
}

/// Checks that a run over a mesh of this size, given by `key`, fits.
pub(super) fn fits(key: &'static str, size: &Size, run: Run) -> Result<(), Problem> {
    let (needed, available) = (needed(size, run, Counted::Allocated), u128::from(available_memory()));
    if needed <= available && size.nodes < u128::from(u32::MAX) {
        return Ok(());
    }
    let mib = |bytes: u128| bytes >> 20;
    let (needed_mib, available_mib) = (mib(needed), mib(available));
    Err(Problem::TooLarge {
        key,
        nodes: size.nodes,
        springs: size.springs,
        ticks: run.ticks,
        needed_mib,
        available_mib,
    })
}

/// Returns the available memory, bytes: what is free on the machine, limited by what the process's control group and its
/// address-space limit leave. A build without the feature `files` does not look, and accepts every scene.
#[cfg(feature = "files")]
pub(crate) fn available_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let free = system.available_memory();
    let of_group = system.cgroup_limits().map_or(u64::MAX, |limits| limits.free_memory);
    free.min(of_group).min(address_space())
}

/// Returns the bytes that the address-space limit leaves.
#[cfg(all(feature = "files", unix))]
fn address_space() -> u64 {
    rlimit::Resource::AS.get_soft().unwrap_or(rlimit::INFINITY)
}

#[cfg(all(feature = "files", not(unix)))]
fn address_space() -> u64 {
    u64::MAX
}

#[cfg(not(feature = "files"))]
pub(crate) fn available_memory() -> u64 {
    u64::MAX
}

/// Returns the number of a block's nodes within some springs of one in the middle of its top.
fn surface_neighbourhood(block: &Block, rings: u32) -> u128 {
    /// Largest number of rings whose nodes are counted one by one; for more, the nodes of a box around them are counted.
    const COUNTED: u32 = 40;
    let all = block.nodes.iter().fold(1_u128, |product, &count| product.saturating_mul(count as u128));
    if rings > COUNTED {
        let side = 2 * u128::from(rings) + 1;
        return all.min(side.saturating_mul(side).saturating_mul(u128::from(rings) + 1));
    }
    let [x_side, y_side, depth] = block.nodes.map(|count| rings.min(u32::try_from(count - 1).unwrap_or(u32::MAX)));
    let is_near = |x: u32, y: u32, z: u32| {
        let springs = match block.stencil {
            Stencil::Structural => x + y + z,
            // A face diagonal goes along two axes at once.
            Stencil::Shear => x.max(y).max(z).max((x + y + z).div_ceil(2)),
            Stencil::Full => x.max(y).max(z),
        };
        springs <= rings
    };
    let mut nodes = 0;
    for (z, y, x) in (0..=depth).flat_map(|z| (0..=y_side).flat_map(move |y| (0..=x_side).map(move |x| (z, y, x)))) {
        // A component that is not zero has two signs.
        let places = [x, y].iter().map(|&offset| if offset > 0 { 2 } else { 1 }).product::<u128>();
        nodes += if is_near(x, y, z) { places } else { 0 };
    }
    all.min(nodes)
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
