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
/// let error = MeshFile::parse(b"", Path::new("liver.step"), 1 << 20).expect_err("not a format of meshes");
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
    /// The file's extension is that of no format that is read.
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
    /// The file announces a number of items that differs from what it contains.
    #[error("announces {announced} {what}, but has {found}")]
    Count {
        /// Content that is counted.
        what: &'static str,
        /// Number announced.
        announced: u64,
        /// Number found. Reading stops at one more than announced.
        found: u64,
    },
    /// The file is in an unsupported variety of its format.
    #[error("is in {0}, which is not supported")]
    Variety(String),
    /// An element has a shape that is not supported. Points and lines are ignored instead.
    #[error("element {element} is a {name}, which is not supported")]
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
    /// Parts of the body, or of its surface, touch at an edge.
    #[error(
        "{faces} faces of the surface meet at the edge from node {from} at {from_position:?} m to node {to} at \
         {to_position:?} m: parts of the body touch only there"
    )]
    PinchedEdge {
        /// Number of faces at the edge.
        faces: usize,
        /// Node at one end.
        from: u32,
        /// Node at the other end.
        to: u32,
        /// Position of the first node, m.
        from_position: [f64; 3],
        /// Position of the second node, m.
        to_position: [f64; 3],
        /// Whether `mesh.repair` has separated parts as far as possible, and these remain.
        is_separated: bool,
    },
    /// Parts of the body, or of its surface, touch at a node.
    #[error("two parts of the surface touch only at node {node} at {position:?} m")]
    Pinched {
        /// Node at which they touch.
        node: u32,
        /// Position of the node, m.
        position: [f64; 3],
        /// Whether `mesh.repair` has separated parts as far as possible, and this node remains.
        is_separated: bool,
    },
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
                "give a file of Gmsh (.msh), VTK (.vtk, .vtu, .vtp), STL, OBJ or PLY; meshio converts others: `meshio convert \
                 liver.inp liver.vtu`"
            }
            MeshProblem::TooLarge { .. } => "give a coarser mesh",
            MeshProblem::Expected { .. }
            | MeshProblem::Ended(_)
            | MeshProblem::Missing(_)
            | MeshProblem::RepeatedNumber(_)
            | MeshProblem::Count { .. }
            | MeshProblem::UnknownNode { .. } => "the file is damaged or incomplete: write it again",
            MeshProblem::Variety(_) => {
                "write it in another way: in Gmsh with `Mesh.MshFileVersion = 4.1`, from VTK formats with PyVista: \
                 `pyvista.read(\"liver.vtk\").cast_to_unstructured_grid().save(\"liver.vtu\")`"
            }
            MeshProblem::Element { .. } => {
                "divide it into triangles or tetrahedra, for instance with PyVista: \
                 `pyvista.read(\"liver.vtu\").triangulate().save(\"simplices.vtu\")`"
            }
            MeshProblem::Empty => {
                "mesh a volume, or a closed surface; in Gmsh, elements outside physical groups are omitted when there \
                 are any (`Mesh.SaveAll = 1`)"
            }
            MeshProblem::NotFinite { .. } => "every coordinate must be finite, also times `scale`",
            MeshProblem::Coincident { .. } => {
                "merge them, since unmerged parts are not joined: in PyVista `mesh.clean(tolerance=d)` joins nodes nearer than d, \
                 in the file's unit"
            }
            MeshProblem::Flat { kind: "triangle", .. } => {
                "`mesh.clean()` in PyVista removes it if two of its corners are one; else move the corner that lies on the opposite \
                 edge away from it, or mesh again"
            }
            MeshProblem::Flat { .. } => {
                "remove it if it lies at the surface, as Delaunay triangulations leave them: in PyVista \
                 `mesh.compute_cell_sizes().threshold(v, scalars=\"Volume\")` keeps those of a volume above v; else mesh again"
            }
            MeshProblem::Overlap { .. } => {
                "parts of the body lie over each other, or a deformation has turned a tetrahedron inside out: remove one of \
                 them, or mesh again"
            }
            MeshProblem::Pieces { .. } => {
                "give one connected body: in PyVista `mesh.connectivity(\"largest\")` takes the largest piece"
            }
            MeshProblem::Surface(_) => {
                "the surface is one-sided, or lies on itself: remove the triangles that are not part of the outside"
            }
            MeshProblem::Open { .. } => {
                "close the holes, since a body needs an inside: in PyVista `mesh.fill_holes(size)`, or \
                 `mesh.clean(tolerance=d)` if it is open where nodes are not joined"
            }
            MeshProblem::PinchedEdge { is_separated: false, .. } | MeshProblem::Pinched { is_separated: false, .. } => {
                "`mesh.repair = true` separates the parts there, and adds a node for each of them"
            }
            MeshProblem::PinchedEdge { .. } => {
                "a wall inside the body ends here: remove the triangles that are not part of the outside"
            }
            MeshProblem::Pinched { .. } => {
                "a hole through the body ends in this one node: remove the tetrahedra around it, or mesh again"
            }
            MeshProblem::NoInside => "give a surface that encloses a body",
            MeshProblem::Folds { .. } => {
                "give a smaller `mesh.layer_depth` or fewer `mesh.layers`, or a smoother surface"
            }
        }
    }
}
