//! Errors of mesh files, and advice on them.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

use crate::model::topology::SurfaceError;

/// Error of a mesh file that cannot be used.
///
/// ```
/// use std::path::Path;
/// use stickslip::mesh_file::{MeshFile, MeshProblem};
///
/// let error = MeshFile::parse(b"", Path::new("liver.stl"), 1 << 20).expect_err("not a format of bodies");
/// assert!(matches!(error.problem(), MeshProblem::Extension));
/// assert!(error.problem().advice().contains("meshio converts others"));
/// ```
#[derive(Debug)]
pub struct MeshFileError {
    path: PathBuf,
    flaw: Flaw,
}

impl MeshFileError {
    pub(super) fn new(path: PathBuf, flaw: Flaw) -> Self {
        Self { path, flaw }
    }

    /// Returns the problem with the file.
    pub fn problem(&self) -> &MeshProblem {
        &self.flaw.problem
    }
}

impl fmt::Display for MeshFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}: {}", self.path.display(), self.flaw.place, self.flaw.problem)
    }
}

impl std::error::Error for MeshFileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        // The problem is what the message says, and is no cause of it.
        self.flaw.problem.source()
    }
}

/// A problem with its place in the file.
#[derive(Debug)]
pub(super) struct Flaw {
    pub place: Place,
    pub problem: MeshProblem,
}

impl From<MeshProblem> for Flaw {
    fn from(problem: MeshProblem) -> Self {
        Self { place: Place::Anywhere, problem }
    }
}

/// Place in a file.
#[derive(Debug, Clone, Copy)]
pub(super) enum Place {
    /// The whole file.
    Anywhere,
    /// Line, counted from 1.
    Line(usize),
    /// Byte offset, counted from 0.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Anywhere => Ok(()),
            Place::Line(line) => write!(f, ":{line}"),
            Place::Byte(byte) => write!(f, " (byte {byte})"),
        }
    }
}

/// Problem with a mesh file. Nodes and elements are counted from 0, in the order of the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshProblem {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(#[source] std::io::Error),
    /// The file's extension is not `.msh`, `.vtk` or `.vtu`.
    #[error("is not a mesh file by its extension")]
    Extension,
    /// Reading the file would take more memory than is free.
    #[error("needs about {needed_mib} MiB to read; {budget_mib} MiB are free")]
    TooLarge {
        /// Memory needed, MiB.
        needed_mib: u64,
        /// Memory free, MiB.
        budget_mib: u64,
    },
    /// The file does not have what its format requires there.
    #[error("expected {what}, found {found:?}")]
    Expected {
        /// Content that the format requires.
        what: &'static str,
        /// Beginning of the content found.
        found: String,
    },
    /// The file ends too early.
    #[error("ends where {0} is expected")]
    Ended(&'static str),
    /// A required part is missing.
    #[error("has no {0}")]
    Missing(&'static str),
    /// The file is in an unsupported variety of its format.
    #[error("is in {0}, which is not supported")]
    Variety(String),
    /// An element is neither a tetrahedron nor a triangle, nor ignored as points and lines are.
    #[error("element {element} is a {name}: only tetrahedra of four nodes and triangles of three are supported")]
    Element {
        /// Index of the element.
        element: usize,
        /// Name of the element's type, and the format's number for it.
        name: String,
    },
    /// The file has no tetrahedron and no triangle.
    #[error("has neither tetrahedra nor triangles")]
    Empty,
    /// Two nodes have the same number.
    #[error("two nodes have the number {0}")]
    RepeatedNumber(u64),
    /// An element names a node that does not exist.
    #[error("element {element} names node {node}, which does not exist")]
    UnknownNode {
        /// Index of the element.
        element: usize,
        /// Index or number of the node, as the format has it.
        node: u64,
    },
    /// A position is not finite after scaling.
    #[error("node {node} lies at {position:?}, which is not finite")]
    NotFinite {
        /// Index of the node.
        node: usize,
        /// Position of the node, m.
        position: [f64; 3],
    },
    /// Two nodes lie at the same place.
    #[error("nodes {first} and {second} lie at the same place, {position:?} m")]
    Coincident {
        /// Index of the first node.
        first: usize,
        /// Index of the second node.
        second: usize,
        /// Position of the second node, m.
        position: [f64; 3],
    },
    /// A tetrahedron has no volume, or a triangle no area.
    #[error("{kind} {element} with nodes {nodes:?} is flat")]
    Flat {
        /// Kind of the element: tetrahedron or triangle.
        kind: &'static str,
        /// Index among the elements of its kind.
        element: usize,
        /// Nodes of the element.
        nodes: Vec<u32>,
    },
    /// Some tetrahedra are inverted.
    #[error(
        "{inverted} of {total} tetrahedra are inverted, the first of them tetrahedron {first} with nodes {nodes:?}"
    )]
    Inverted {
        /// Number of inverted tetrahedra.
        inverted: usize,
        /// Number of all tetrahedra.
        total: usize,
        /// Index of the first inverted one.
        first: usize,
        /// Nodes of the first inverted one.
        nodes: [u32; 4],
    },
    /// Two tetrahedra lie on the same side of a face.
    #[error("tetrahedra {first} and {second} lie on the same side of the face with nodes {nodes:?}")]
    Overlap {
        /// Index of one tetrahedron.
        first: usize,
        /// Index of the other.
        second: usize,
        /// Nodes of the face.
        nodes: [u32; 3],
    },
    /// The mesh consists of more than one body.
    #[error("is {} separate pieces, of {} nodes", sizes.len(), list(sizes))]
    Pieces {
        /// Number of nodes of each piece, the largest first.
        sizes: Vec<usize>,
    },
    /// The triangles do not form a surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The surface has a border.
    #[error("the surface is open: only one triangle meets the edge from node {from} to node {to}")]
    Open {
        /// Node on the border.
        from: u32,
        /// Next node on the border.
        to: u32,
    },
    /// Two parts of the surface touch at one node.
    #[error("two parts of the surface touch only at node {0}")]
    Pinched(u32),
    /// The surface encloses nothing.
    #[error("the surface encloses no volume")]
    NoInside,
    /// An inner copy of the surface folds over.
    #[error("{depth_m} m below the surface, triangle {triangle} with nodes {nodes:?} folds over")]
    Folds {
        /// Depth of the layer, m.
        depth_m: f64,
        /// Index of the triangle.
        triangle: usize,
        /// Nodes of the triangle on the surface.
        nodes: [u32; 3],
    },
}

/// Lists the first few of some numbers.
fn list(numbers: &[usize]) -> String {
    const SHOWN: usize = 8;
    let mut text: Vec<String> = numbers.iter().take(SHOWN).map(ToString::to_string).collect();
    if numbers.len() > SHOWN {
        text.push("…".to_owned());
    }
    text.join(", ")
}

impl MeshProblem {
    /// Returns advice on how to solve the problem.
    pub fn advice(&self) -> &'static str {
        match self {
            MeshProblem::Unreadable(_) => "`path` is relative to the scene file",
            MeshProblem::Extension => {
                "give a Gmsh file (.msh, version 2.2 or 4.1) or a VTK one (.vtk legacy, .vtu); meshio converts others"
            }
            MeshProblem::TooLarge { .. } => "give a coarser mesh",
            MeshProblem::Expected { .. }
            | MeshProblem::Ended(_)
            | MeshProblem::Missing(_)
            | MeshProblem::RepeatedNumber(_)
            | MeshProblem::UnknownNode { .. } => "the file is damaged or incomplete: write it again",
            MeshProblem::Variety(_) => {
                "save as MSH 2.2 or 4.1 (`Mesh.MshFileVersion = 4.1` in Gmsh), as legacy VTK, or as .vtu of one piece, \
                 uncompressed or with zlib"
            }
            MeshProblem::Element { .. } => {
                "make linear simplices: in Gmsh `Mesh.ElementOrder = 1`, no recombination and \
                 `Mesh.SubdivisionAlgorithm = 0`; in ParaView the filters Tetrahedralize or Triangulate"
            }
            MeshProblem::Empty => {
                "mesh a volume, or a closed surface; in Gmsh, elements outside physical groups are omitted when there \
                 are any (`Mesh.SaveAll = 1`)"
            }
            MeshProblem::NotFinite { .. } => "every coordinate must be finite, also times `scale`",
            MeshProblem::Coincident { .. } => {
                "merge them: `Coherence Mesh;` in Gmsh, Clean to Grid in ParaView; unmerged parts are not joined"
            }
            MeshProblem::Flat { .. } => "mesh again with optimisation (`Mesh.Optimize = 1` in Gmsh), or collapse it",
            MeshProblem::Inverted { .. } => {
                "give all the same orientation (if every one is inverted, all are reversed); one that a deformation \
                 has turned inside out needs a new mesh"
            }
            MeshProblem::Overlap { .. } => "remove the repeated or overlapping tetrahedra",
            MeshProblem::Pieces { .. } => "give one connected body, or join the pieces where they touch",
            MeshProblem::Surface(_) => {
                "orient the triangles consistently and let two meet at every edge, as MeshLab's repair filters do"
            }
            MeshProblem::Open { .. } => "close the holes: a body needs an inside",
            MeshProblem::Pinched(_) => "separate the parts, or join them by more than a node",
            MeshProblem::NoInside => "give a surface that encloses a body",
            MeshProblem::Folds { .. } => {
                "give a smaller `mesh.layer_depth` or fewer `mesh.layers`, or a smoother surface"
            }
        }
    }
}
