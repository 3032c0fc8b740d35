//! The cells of a file: every format's elements become tetrahedra and triangles here, by their corners.

use super::error::MeshProblem;
use super::solid::six_volumes;
use crate::Vec3;

/// The contents of a file that are used.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// Positions as written, in the file's unit.
    pub nodes: Vec<Vec3>,
    /// Nodes of each tetrahedron.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Nodes of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Changes made so far, to tetrahedra and what became tetrahedra.
    pub changes: Changes,
    /// Changes made so far to triangles and what became triangles, which count only where there are no tetrahedra.
    pub surface_changes: Changes,
}

/// Numbers of what was changed in a file's cells to make a body of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Changes {
    /// Cells of second or higher order, of which only the corners are used.
    pub by_corners: usize,
    /// Hexahedra, wedges and pyramids cut into tetrahedra, and quadrangles, polygons and strips into triangles.
    pub cut: usize,
    /// Elements that repeat another one, which count once.
    pub repeated: usize,
    /// Elements turned round because others have the opposite orientation.
    pub turned: usize,
    /// Nodes added where parts of the body touch, to separate them.
    pub split: usize,
    /// Nodes that no element uses, which are omitted.
    pub unused_nodes: usize,
}

/// Shape of a cell. Its corners come first among its nodes in every format; nodes of higher order follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    Triangle,
    Quadrangle,
    /// A polygon of all its nodes.
    Polygon,
    /// A strip of triangles: every node after the second forms one with the two nodes before it.
    Strip,
    /// A quadrangle along the axes, whose last two corners are exchanged.
    Pixel,
    Tetrahedron,
    Pyramid,
    Wedge,
    Hexahedron,
    /// A hexahedron along the axes, with corners as in two pixels.
    Voxel,
}

/// Largest number of corners from which cutting a polygon is tried. A convex polygon needs one try, unless corners lie on a
/// line.
const TRIED_CORNERS: usize = 32;

/// Faces of the cells that are cut, with corners anticlockwise as seen from outside, in VTK's order of corners.
const PYRAMID: &[&[usize]] = &[&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];
const WEDGE: &[&[usize]] = &[&[0, 1, 2], &[3, 5, 4], &[0, 3, 4, 1], &[1, 4, 5, 2], &[2, 5, 3, 0]];
const HEXAHEDRON: &[&[usize]] =
    &[&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];

impl Shape {
    /// Number of corners; `None` if all nodes are corners.
    fn corners(self) -> Option<usize> {
        match self {
            Shape::Triangle => Some(3),
            Shape::Quadrangle | Shape::Pixel | Shape::Tetrahedron => Some(4),
            Shape::Pyramid => Some(5),
            Shape::Wedge => Some(6),
            Shape::Hexahedron | Shape::Voxel => Some(8),
            Shape::Polygon | Shape::Strip => None,
        }
    }

    /// Whether the shape is a surface element.
    fn is_flat(self) -> bool {
        match self {
            Shape::Triangle | Shape::Quadrangle | Shape::Polygon | Shape::Strip | Shape::Pixel => true,
            Shape::Tetrahedron | Shape::Pyramid | Shape::Wedge | Shape::Hexahedron | Shape::Voxel => false,
        }
    }
}

impl Cells {
    /// Adds an element of the file by its corners. `nodes` has them first, as indices into the nodes of the file.
    pub(super) fn add(&mut self, element: usize, shape: Shape, nodes: &[u64]) -> Result<(), MeshProblem> {
        let corners = shape.corners().unwrap_or(nodes.len());
        if nodes.len() < corners.max(3) {
            let name = format!("cell of {} nodes, which is fewer than its type has", nodes.len());
            return Err(MeshProblem::Element { element, name });
        }
        let mut known = Vec::with_capacity(corners);
        for &node in &nodes[..corners] {
            let index = u32::try_from(node).ok().filter(|&index| (index as usize) < self.nodes.len());
            known.push(index.ok_or(MeshProblem::UnknownNode { element, node })?);
        }
        let changes = if shape.is_flat() { &mut self.surface_changes } else { &mut self.changes };
        changes.by_corners += usize::from(nodes.len() > corners);
        changes.cut += usize::from(shape != Shape::Tetrahedron && corners > 3);
        let taken = |order: &[usize]| order.iter().map(|&corner| known[corner]).collect::<Vec<_>>();
        match shape {
            Shape::Tetrahedron => self.tetrahedra.push(std::array::from_fn(|corner| known[corner])),
            Shape::Pyramid => self.cut(PYRAMID, &known),
            Shape::Wedge => self.cut(WEDGE, &known),
            Shape::Hexahedron => self.cut(HEXAHEDRON, &known),
            Shape::Voxel => self.cut(HEXAHEDRON, &taken(&[0, 1, 3, 2, 4, 5, 7, 6])),
            Shape::Triangle | Shape::Quadrangle | Shape::Polygon => self.polygon(element, &known)?,
            Shape::Pixel => self.polygon(element, &taken(&[0, 1, 3, 2]))?,
            Shape::Strip => {
                // The orientation alternates along a strip.
                let triangles = known.windows(3).enumerate();
                self.triangles
                    .extend(triangles.map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] }));
            }
        }
        Ok(())
    }

    /// Cuts a cell into tetrahedra from its lowest-numbered node to the faces without that node. Each face is divided from
    /// its own lowest-numbered node. Two cells divide their common face alike, whatever their shapes, since the rule
    /// depends on nothing but the numbers of its nodes (J. Dompierre, P. Labbé, M.-G. Vallet, R. Camarero, "How to
    /// Subdivide Pyramids, Prisms and Hexahedra into Tetrahedra", 1999).
    fn cut(&mut self, faces: &[&[usize]], corners: &[u32]) {
        let Some(&apex) = corners.iter().min() else { return };
        for face in faces {
            let face: Vec<u32> = face.iter().map(|&corner| corners[corner]).collect();
            if face.contains(&apex) {
                continue;
            }
            let lowest = (0..face.len()).min_by_key(|&corner| face[corner]).unwrap_or(0);
            for [a, b, c] in fan(&face, lowest) {
                // A cell with a repeated corner, such as a wedge written as a hexahedron, has flat parts without a volume.
                if a == b || b == c || c == a {
                    continue;
                }
                let mut tetrahedron = [apex, a, b, c];
                // Some programs list the corners of a cell in the opposite order, for instance of wedges.
                if six_volumes(&self.nodes, &tetrahedron) < 0.0 {
                    tetrahedron.swap(2, 3);
                }
                self.tetrahedra.push(tetrahedron);
            }
        }
    }

    /// Cuts a polygon into a fan of triangles that all face the same side. Every convex polygon has such a fan.
    fn polygon(&mut self, element: usize, corners: &[u32]) -> Result<(), MeshProblem> {
        if let &[a, b, c] = corners {
            self.triangles.push([a, b, c]);
            return Ok(());
        }
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|node| self.nodes[node as usize]);
            (b - a).cross(&(c - a))
        };
        let whole: Vec3 = fan(corners, 0).map(area).sum();
        let fits = |&first: &usize| fan(corners, first).all(|triangle| area(triangle).dot(&whole) > 0.0);
        let Some(first) = (0..corners.len().min(TRIED_CORNERS)).find(fits) else {
            return Err(MeshProblem::Element {
                element,
                name: format!("polygon of {} corners that is not convex", corners.len()),
            });
        };
        self.triangles.extend(fan(corners, first));
        Ok(())
    }

    /// Removes elements that have the same nodes as one before them, such as one listed in two groups.
    pub(super) fn count_once(&mut self) {
        self.changes.repeated += without_repeated(&mut self.tetrahedra, |mut nodes| {
            nodes.sort_unstable();
            nodes
        });
        // Two triangles of opposite orientation are the two sides of a wall, not a repetition.
        self.changes.repeated += without_repeated(&mut self.triangles, |mut nodes| {
            let lowest = (0..3).min_by_key(|&corner| nodes[corner]).unwrap_or(0);
            nodes.rotate_left(lowest);
            nodes
        });
    }

    /// Multiplies the coordinates by `scale`.
    pub(super) fn scaled(mut self, scale: f64) -> Result<Self, MeshProblem> {
        self.nodes.iter_mut().for_each(|node| *node *= scale);
        match self.nodes.iter().enumerate().find(|(_, x)| !x.iter().all(|x| x.is_finite())) {
            Some((node, position)) => Err(MeshProblem::NotFinite { node, position: (*position).into() }),
            None => Ok(self),
        }
    }

    /// Removes the nodes that no element uses.
    pub(super) fn without_unused(mut self) -> Self {
        let mut new_index = vec![u32::MAX; self.nodes.len()];
        for &node in self.tetrahedra.as_flattened().iter().chain(self.triangles.as_flattened()) {
            new_index[node as usize] = 0;
        }
        let mut used = 0;
        for index in new_index.iter_mut().filter(|index| **index == 0) {
            *index = used;
            used += 1;
        }
        self.changes.unused_nodes = self.nodes.len() - used as usize;
        let mut index = new_index.iter();
        self.nodes.retain(|_| index.next().is_some_and(|&index| index != u32::MAX));
        self.tetrahedra.as_flattened_mut().iter_mut().for_each(|node| *node = new_index[*node as usize]);
        self.triangles.as_flattened_mut().iter_mut().for_each(|node| *node = new_index[*node as usize]);
        self
    }
}

/// Returns the fan of triangles of a polygon from one of its corners.
fn fan(corners: &[u32], first: usize) -> impl Iterator<Item = [u32; 3]> {
    let corner = move |i: usize| corners[(first + i) % corners.len()];
    (1..corners.len().saturating_sub(1)).map(move |i| [corner(0), corner(i), corner(i + 1)])
}

/// Removes every element whose key equals that of an earlier one, and returns the number removed.
fn without_repeated<const N: usize>(elements: &mut Vec<[u32; N]>, key: impl Fn([u32; N]) -> [u32; N]) -> usize {
    let mut keys: Vec<([u32; N], u32)> = (0..).zip(elements.iter()).map(|(i, &nodes)| (key(nodes), i)).collect();
    keys.sort_unstable();
    let mut repeated: Vec<u32> = keys.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    repeated.sort_unstable();
    let mut skip = repeated.iter().peekable();
    let mut index = 0..;
    elements.retain(|_| skip.next_if_eq(&&index.next().unwrap_or(u32::MAX)).is_none());
    repeated.len()
}
