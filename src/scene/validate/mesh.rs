//! The mesh of a scene: generated or read, whether it fits into memory, and which of its nodes are fixed.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use toml::Spanned;

use super::{Checker, Placed, Sign};
use crate::local::condensation::{FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::mesh_file::{FileMesh, Layers, MeshFile, MeshFileError, MeshProblem};
use crate::model::mesh::{Block, Mesh, Stencil};
use crate::scene::MeshSource;
use crate::scene::error::Problem;
use crate::scene::file::{Fixed, FixedName, FixedRegion, MeshKind, MeshTable, StencilName};

/// Micrometres: far below any tissue, and far above where the areas of triangles underflow.
const LEAST_SPACING: f64 = 1e-6;

/// Bytes that a run takes per node: rest position, mass, and eight position-and-velocity arrays of
/// the global side, the local side and their scratch.
const BYTES_PER_NODE: u128 = 500;
/// Bytes per spring: once in the network and twice in the adjacency, once in a patch that takes all.
const BYTES_PER_SPRING: u128 = 300;
/// Bytes per tick: what the summary and the plot keep, twice, and the spectrum's buffers.
const BYTES_PER_TICK: u128 = 256;

/// Bytes of a condensed exterior per point to the power of 4/3, the growth of a factor under nested
/// dissection in three dimensions: 900 of blocks of 1,000 to 10,000 nodes, matrix and pattern included.
const BYTES_PER_FACTOR_POINT: f64 = 1200.0;

/// Extents of a body in m beyond which, or below which, its unit is in doubt.
const USUAL_EXTENTS: Range<f64> = 1e-3..10.0;

/// What a scene does with its mesh, as far as memory goes.
pub(super) struct Needs<'a> {
    pub local: &'a LocalSettings,
    pub integrator: LocalIntegrator,
    pub ticks: u64,
    pub cycle_ticks: u64,
}

/// How large a mesh is.
struct Size<'a> {
    nodes: u128,
    springs: u128,
    /// Nodes within so many springs of one, at most.
    within: &'a dyn Fn(u32) -> u128,
}

/// What a condensed exterior takes of a mesh.
fn factor_bytes(reach: Reach, size: &Size) -> u128 {
    let points = match reach {
        Reach::All => size.nodes,
        Reach::Rings { rings, far_field: FarField::Fixed } => (size.within)(rings),
        // A vertex of the coarse grid for four nodes in every direction.
        Reach::Rings { rings, far_field: FarField::Coarse } => {
            (size.within)(rings).saturating_add(size.nodes.div_ceil(16))
        }
    };
    (BYTES_PER_FACTOR_POINT * (points as f64).powf(4.0 / 3.0)) as u128
}

impl Checker {
    /// The mesh, which nodes are fixed, and what may not be meant.
    pub(super) fn mesh(
        &self,
        table: &Spanned<MeshTable>,
        folder: &Path,
        needs: &Needs,
    ) -> Placed<(MeshSource, Vec<bool>, Vec<String>)> {
        let mesh = table.get_ref();
        match mesh.kind {
            MeshKind::Block => {
                let block = self.block(table, needs)?;
                let bottom = (0..block.nodes.iter().product()).map(|node| block.is_bottom(node));
                let fixed = self.fixed(&mesh.fixed, &block.mesh(), bottom)?;
                Ok((MeshSource::Block(block), fixed, Vec::new()))
            }
            MeshKind::File => {
                let file = self.mesh_file(table, folder, needs)?;
                let is_anchored = !file.innermost.is_empty() && mesh.anchor.as_ref().is_none_or(|is| *is.get_ref());
                // An anchor holds by itself: nothing else is fixed unless the scene says so.
                let by_default = file.bottom().map(|is_bottom| is_bottom && !(is_anchored && mesh.fixed.is_none()));
                let mut fixed = self.fixed(&mesh.fixed, &file.mesh, by_default)?;
                if is_anchored {
                    fixed[file.innermost.clone()].fill(true);
                }
                let warnings = warnings(&file, &fixed);
                Ok((MeshSource::File(Arc::new(file)), fixed, warnings))
            }
        }
    }

    fn block(&self, table: &Spanned<MeshTable>, needs: &Needs) -> Placed<Block> {
        let mesh = table.get_ref();
        let because = "`mesh.kind = \"block\"`";
        self.no_effect("mesh.path", mesh.path.as_ref().map(Spanned::span), because)?;
        self.no_effect("mesh.scale", mesh.scale.as_ref().map(Spanned::span), because)?;
        self.no_layers(mesh, because)?;
        let missing = |key| self.error(Problem::Missing(key), table.span());
        let counts = mesh.nodes.as_ref().ok_or_else(|| missing("mesh.nodes"))?;
        let nodes = *counts.get_ref();
        if nodes.iter().any(|&count| count < 2) {
            let value = format!("{nodes:?}");
            return Err(self.error(Problem::NotAccepted { key: "mesh.nodes", value }, counts.span()));
        }
        let block = Block {
            nodes,
            spacing: self.spacing(mesh.spacing.as_ref().ok_or_else(|| missing("mesh.spacing"))?)?,
            stencil: match mesh.stencil.as_ref().map(Spanned::get_ref) {
                Some(StencilName::Structural) => Stencil::Structural,
                None | Some(StencilName::Shear) => Stencil::Shear,
                Some(StencilName::Full) => Stencil::Full,
            },
        };
        let count = nodes.iter().fold(1_u128, |product, &count| product.saturating_mul(count as u128));
        // A ring goes one lattice step further in every direction.
        let within = |rings: u32| count.min((2 * u128::from(rings) + 1).saturating_pow(3));
        let size = Size { nodes: count, springs: block.edge_count() as u128, within: &within };
        self.fits_memory(&size, needs, counts.span())?;
        Ok(block)
    }

    fn spacing(&self, spacing: &Spanned<f64>) -> Placed<f64> {
        let key = "mesh.spacing";
        let value = self.number(key, spacing, Sign::Positive)?;
        if value >= LEAST_SPACING {
            return Ok(value);
        }
        Err(self.error(Problem::NotAccepted { key, value: value.to_string() }, spacing.span()))
    }

    fn no_layers(&self, mesh: &MeshTable, because: &'static str) -> Placed<()> {
        self.no_effect("mesh.layers", mesh.layers.as_ref().map(Spanned::span), because)?;
        self.no_effect("mesh.layer_depth", mesh.layer_depth.as_ref().map(Spanned::span), because)?;
        self.no_effect("mesh.anchor", mesh.anchor.as_ref().map(Spanned::span), because)
    }

    fn mesh_file(&self, table: &Spanned<MeshTable>, folder: &Path, needs: &Needs) -> Placed<FileMesh> {
        let mesh = table.get_ref();
        let because = "`mesh.kind = \"file\"`";
        self.no_effect("mesh.nodes", mesh.nodes.as_ref().map(Spanned::span), because)?;
        self.no_effect("mesh.spacing", mesh.spacing.as_ref().map(Spanned::span), because)?;
        self.no_effect("mesh.stencil", mesh.stencil.as_ref().map(Spanned::span), because)?;
        let path = mesh.path.as_ref().ok_or_else(|| self.error(Problem::Missing("mesh.path"), table.span()))?;
        let scale = self.number_or("mesh.scale", &mesh.scale, 1.0, Sign::Positive)?;

        let refuse = |error: MeshFileError| {
            let span = match (error.problem(), &mesh.layer_depth) {
                (MeshProblem::Folds { .. }, Some(depth)) => depth.span(),
                _ => path.span(),
            };
            let advice = error.problem().advice();
            self.error(Problem::MeshFile(error), span).with_help(advice)
        };
        let file = MeshFile::read(&folder.join(path.get_ref()), available_memory()).map_err(refuse)?;
        let file = if file.is_surface() {
            let missing = || self.error(Problem::Missing("mesh.layer_depth"), table.span());
            let depth = mesh.layer_depth.as_ref().ok_or_else(missing)?;
            let layers = Layers {
                count: self.count_or("mesh.layers", &mesh.layers, 1)? as usize,
                depth: self.number("mesh.layer_depth", depth, Sign::Positive)?,
            };
            // Before as many copies are made as the scene asks for.
            let (nodes, springs) = layers.sizes(file.cells());
            let size = Size { nodes, springs, within: &|_| 0 };
            self.fits_memory(&size, needs, mesh.layers.as_ref().map_or(path.span(), Spanned::span))?;
            file.shell(scale, layers).map_err(refuse)?
        } else {
            self.no_layers(mesh, "a mesh of tetrahedra")?;
            file.solid(scale).map_err(refuse)?
        };
        let nodes = file.mesh.nodes.len() as u128;
        let largest = |rings: u32| largest_neighbourhood(&file.mesh, rings).min(nodes);
        let size = Size { nodes, springs: file.mesh.edges.len() as u128, within: &largest };
        self.fits_memory(&size, needs, path.span())?;
        Ok(file)
    }

    /// Before anything of the size of the simulation is allocated.
    fn fits_memory(&self, size: &Size, needs: &Needs, span: Range<usize>) -> Placed<()> {
        let &Size { nodes, springs, within } = size;
        let &Needs { local, integrator, ticks, cycle_ticks } = needs;
        let patch = match local.extent {
            Extent::All => nodes,
            Extent::Rings(rings) => within(rings),
        };
        // Matrices of the size of K, dense over every node of the patch: K, D, what a tick adds to them, and what is
        // in use at once while that is built.
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
            Extent::Rings(_) => patch.saturating_mul(u128::from(ticks.min(cycle_ticks)) + 1).saturating_mul(2 * 24),
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
        let problem =
            Problem::TooLarge { nodes, springs, ticks, needed_mib: mib(needed), available_mib: mib(available) };
        Err(self
            .error(problem, span)
            .with_help("give fewer nodes (at most 2³² − 2), fewer rings or a shorter duration"))
    }

    fn fixed(
        &self,
        fixed: &Option<Spanned<Fixed>>,
        mesh: &Mesh,
        bottom: impl Iterator<Item = bool>,
    ) -> Placed<Vec<bool>> {
        let count = mesh.nodes.len();
        let Some(fixed) = fixed else { return Ok(bottom.collect()) };
        let refuse = |value: String| self.error(Problem::NotAccepted { key: "mesh.fixed", value }, fixed.span());
        match fixed.get_ref() {
            Fixed::Named(FixedName::Bottom) => Ok(bottom.collect()),
            Fixed::Named(FixedName::None) => Ok(vec![false; count]),
            Fixed::Region(FixedRegion::BelowZ(z)) if z.is_finite() => {
                Ok(mesh.nodes.iter().map(|node| node.z < *z).collect())
            }
            Fixed::Region(FixedRegion::BelowZ(z)) => Err(refuse(format!("{{ below_z = {z} }}"))),
            Fixed::Region(FixedRegion::Nodes(nodes)) => {
                let mut fixed = vec![false; count];
                for &node in nodes {
                    match fixed.get_mut(node as usize) {
                        Some(fixed) => *fixed = true,
                        None => return Err(refuse(format!("node {node} of {count}"))),
                    }
                }
                Ok(fixed)
            }
        }
    }
}

/// Bytes.
fn available_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    system.available_memory()
}

/// Nodes within so many springs of one: the most of some surface nodes, and half as many again for the others.
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
        let mut is_within = vec![false; mesh.nodes.len()];
        is_within[centre as usize] = true;
        let (mut count, mut ring) = (1_u128, vec![centre]);
        for _ in 0..rings {
            let next: Vec<u32> = (ring.iter().flat_map(|&node| &neighbours[node as usize]))
                .filter(|&&node| !std::mem::replace(&mut is_within[node as usize], true))
                .copied()
                .collect();
            if next.is_empty() {
                break;
            }
            count += next.len() as u128;
            ring = next;
        }
        count
    });
    counts.max().unwrap_or(0) * 3 / 2
}

fn warnings(file: &FileMesh, fixed: &[bool]) -> Vec<String> {
    let mut warnings = Vec::new();
    let extent = file.extent();
    if !USUAL_EXTENTS.contains(&extent) {
        warnings.push(format!(
            "the mesh is {extent:e} m large: if its file is in mm, `mesh.scale = 0.001` makes it m; without `scale` a unit \
             of the file is 1 m"
        ));
    }
    if file.unused_nodes > 0 {
        warnings.push(format!(
            "{} nodes of the mesh's file are left out, as no element uses them: indices count the others",
            file.unused_nodes
        ));
    }
    let held = fixed.iter().filter(|&&is_fixed| is_fixed).count();
    if (1..3).contains(&held) {
        warnings.push(format!(
            "the mesh is fixed at {held} of its nodes, about which it can turn: `mesh.fixed = {{ below_z = … }}` fixes \
             a region"
        ));
    }
    warnings
}
