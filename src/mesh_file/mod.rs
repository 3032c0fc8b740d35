//! Meshes from files: Gmsh's MSH, VTK's formats, STL, OBJ and PLY, read into cells, checked, and made into a [`Mesh`]: a solid
//! of tetrahedra, or a shell below a closed surface.
//!
//! The readers are written here because the kept crates lose what a body needs (each tried on files like those in
//! `fixtures/meshes/formats`): mshio 0.4 drops the numbers of nodes where they have no gaps, whatever their order; vtkio 0.6 does
//! not know the cells of legacy VTK 5.1; stl_io 0.11 reads only the first solid of a file, no keywords in upper case, and 32 bits
//! of a coordinate; tobj 4.0 gives every group of an OBJ file nodes of its own, which opens a surface between groups; ply-rs-bw
//! 4.0 refuses the numbers `3.` and `.5`, and values that continue on the next line. XML, base64, zlib, lz4 and lzma come from
//! crates.

mod cells;
mod compression;
mod error;
mod legacy;
mod msh;
mod numbers;
mod obj;
mod pinched;
mod ply;
mod shell;
mod solid;
mod stl;
mod surface;
mod vtk;
mod xml;

use std::ops::Range;
use std::path::{Path, PathBuf};

pub use cells::{Cells, Changes};
pub use error::{MeshFileError, MeshProblem};
pub use shell::Layers;

use self::error::Flaw;
use crate::model::mesh::{Mesh, bounding_box};

/// Largest memory for reading and checking, per byte of the file. Text of 10 bytes can name a tetrahedron, whose cell,
/// edges and faces are then stored, twice while they are sorted.
const BYTES_PER_BYTE: u64 = 32;
/// Memory per tetrahedron or triangle for reading and checking, bytes: its nodes, faces and edges, sorted, and what joins them.
const BYTES_PER_ELEMENT: u64 = 320;

/// Nodes nearer than this in every coordinate, relative to the diagonal of the bounding box, coincide. Coordinates of
/// 32 bits differ by 6e-8 of their size or not at all.
const SAME_PLACE: f64 = 1e-9;

/// A checked mesh from a file.
#[derive(Debug, Clone)]
pub struct FileMesh {
    /// The mesh: nodes that elements use, in the order of the file; for a shell, layer by layer.
    pub mesh: Mesh,
    /// Volume that each node stands for, m³: a quarter of every tetrahedron around it, or its share of a shell.
    pub node_volumes: Vec<f64>,
    /// Nodes of a shell's innermost layer; empty for a solid.
    pub innermost: Range<usize>,
    /// Changes made to the file's cells.
    pub changes: Changes,
}

impl FileMesh {
    /// Largest extent along an axis, m.
    pub fn extent(&self) -> f64 {
        bounding_box(self.mesh.nodes.iter().copied()).1.amax()
    }

    /// Returns for each node whether its height is the lowest, to a millionth of the bounding box's diagonal: the
    /// precision with which programs write a plane in 32-bit coordinates.
    pub fn bottom(&self) -> impl Iterator<Item = bool> {
        const FLAT: f64 = 1e-6;
        let (lowest, extents) = bounding_box(self.mesh.nodes.iter().copied());
        let height = lowest.z + FLAT * extents.norm();
        self.mesh.nodes.iter().map(move |node| node.z <= height)
    }
}

/// The cells read from a file, with its path.
///
/// ```
/// use std::path::Path;
/// use stickslip::mesh_file::{Layers, MeshFile};
///
/// // A corner of a cube, in centimetres, as Gmsh writes it.
/// let text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 3 0 0\n3 0 3 0\n4 0 0 3\n$EndNodes\n\
///             $Elements\n1\n1 4 2 1 1 1 2 3 4\n$EndElements\n";
/// let file = MeshFile::parse(text.as_bytes(), Path::new("corner.msh"), 1 << 20)?;
/// assert_eq!((file.cells().tetrahedra.len(), file.is_surface()), (1, false));
/// let solid = file.solid(0.01)?;
/// assert!((solid.mesh.tetrahedron_volume(solid.mesh.tetrahedra[0]) - 0.03_f64.powi(3) / 6.0).abs() < 1e-18);
/// assert_eq!((solid.extent(), solid.bottom().filter(|is_bottom| *is_bottom).count()), (0.03, 3));
///
/// // A closed surface becomes the wall of a hollow body.
/// let file = MeshFile::read(Path::new("fixtures/meshes/formats/surface-2.2-text.msh"), 1 << 30)?;
/// let (layers, vertices) = (Layers { count: 2, depth: 1e-4 }, file.cells().nodes.len());
/// assert!(file.is_surface());
/// let sizes = layers.sizes(file.cells());
/// let shell = file.shell(0.01, layers)?;
/// assert_eq!((shell.mesh.nodes.len(), shell.innermost.len()), (3 * vertices, vertices));
/// assert_eq!((shell.mesh.nodes.len() as u128, shell.mesh.edges.len() as u128), sizes);
/// # Ok::<(), stickslip::mesh_file::MeshFileError>(())
/// ```
#[derive(Debug, Clone)]
pub struct MeshFile {
    path: PathBuf,
    cells: Cells,
    is_repaired: bool,
}

impl MeshFile {
    /// Reads a file. `budget` is the memory that reading may take, bytes.
    ///
    /// # Errors
    /// If the file cannot be read, has none of the formats, is damaged, or holds unsupported elements or none.
    pub fn read(path: &Path, budget: u64) -> Result<Self, MeshFileError> {
        let fail = |problem: MeshProblem| MeshFileError::new(path.to_owned(), problem.into());
        let size = std::fs::metadata(path).map_err(|error| fail(MeshProblem::Unreadable(error)))?.len();
        if size > budget / BYTES_PER_BYTE {
            let needed_mib = size.saturating_mul(BYTES_PER_BYTE) >> 20;
            return Err(fail(MeshProblem::TooLarge { needed_mib, budget_mib: budget >> 20 }));
        }
        let bytes = std::fs::read(path).map_err(|error| fail(MeshProblem::Unreadable(error)))?;
        Self::parse(&bytes, path, budget)
    }

    /// Parses the contents of a file; `path` names it in errors and determines its format.
    ///
    /// # Errors
    /// If the contents have a defect that [`read`](Self::read) refuses.
    pub fn parse(bytes: &[u8], path: &Path, budget: u64) -> Result<Self, MeshFileError> {
        let fail = |flaw: Flaw| MeshFileError::new(path.to_owned(), flaw);
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let cells = match extension.to_str() {
            Some("msh") => msh::read(bytes),
            Some("vtk") => legacy::read(bytes),
            Some("vtu") => xml::read(bytes, xml::Kind::UnstructuredGrid, budget),
            Some("vtp") => xml::read(bytes, xml::Kind::PolyData, budget),
            Some("stl") => stl::read(bytes),
            Some("obj") => obj::read(bytes),
            Some("ply") => ply::read(bytes),
            _ => Err(MeshProblem::Extension.into()),
        };
        let cells = cells.map_err(fail)?;
        if cells.tetrahedra.is_empty() && cells.triangles.is_empty() {
            return Err(fail(MeshProblem::Empty.into()));
        }
        // A hexahedron, which takes few bytes in a file, becomes six tetrahedra.
        let elements = (cells.tetrahedra.len() + cells.triangles.len()) as u64;
        let needed = elements.saturating_mul(BYTES_PER_ELEMENT);
        if needed > budget {
            return Err(fail(MeshProblem::TooLarge { needed_mib: needed >> 20, budget_mib: budget >> 20 }.into()));
        }
        Ok(Self { path: path.to_owned(), cells, is_repaired: false })
    }

    /// Sets whether parts of a body that touch at a node or an edge are separated, instead of being refused.
    pub fn repaired(self, is_repaired: bool) -> Self {
        Self { is_repaired, ..self }
    }

    /// Returns the cells of the file.
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Whether the file has only triangles.
    pub fn is_surface(&self) -> bool {
        self.cells.tetrahedra.is_empty()
    }

    /// Builds a solid from the tetrahedra, with coordinates multiplied by `scale`. Triangles are ignored.
    ///
    /// # Errors
    /// If the tetrahedra form no body: see [`MeshProblem`].
    pub fn solid(self, scale: f64) -> Result<FileMesh, MeshFileError> {
        let made = self.cells.scaled(scale).and_then(|cells| solid::mesh(cells, self.is_repaired));
        made.map_err(|problem| MeshFileError::new(self.path, problem.into()))
    }

    /// Builds a shell from the triangles, with coordinates multiplied by `scale`, and layers below them.
    ///
    /// # Errors
    /// If the triangles form no closed surface, or a layer folds over.
    pub fn shell(self, scale: f64, layers: Layers) -> Result<FileMesh, MeshFileError> {
        let made = self.cells.scaled(scale).and_then(|cells| shell::mesh(cells, &layers, self.is_repaired));
        made.map_err(|problem| MeshFileError::new(self.path, problem.into()))
    }
}

/// Returns every pair once, ascending.
fn unique_edges(pairs: impl Iterator<Item = [u32; 2]>) -> Vec<[u32; 2]> {
    let mut edges: Vec<[u32; 2]> = pairs.map(|[i, j]| [i.min(j), i.max(j)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}
