//! A tree of boxes around the triangles of a surface, so that the cost of a search depends on the number of triangles
//! found and not on the size of the surface.
//!
//! `parry3d-f64` has such a tree: its `Bvh` is refitted in place, and its queries see every box, so that they can allow for
//! motion as a search does here. But its traversal keeps a stack that goes to the heap beyond 32 entries, and a tick must not
//! allocate. Its nearest points with pseudonormals are those of a `TriMesh` that owns its vertices: here the local model
//! moves them in every tick, and the surface may be a curved one.

use std::sync::Arc;

use super::geometry::ContactGeometry;
use crate::Vec3;
use crate::model::topology::Surface;

/// Largest number of triangles in one leaf.
const LEAF: usize = 4;

/// An axis-aligned box.
///
/// ```
/// use stickslip::{Vec3, surface::tree::Aabb};
///
/// let unit = Aabb::around([Vec3::zeros(), Vec3::new(1.0, 1.0, 1.0)]);
/// assert_eq!(unit.distance(Vec3::new(4.0, 5.0, 0.5)), 5.0);
/// assert_eq!(unit.distance(Vec3::repeat(0.5)), 0.0);
/// let beside = Aabb::around([Vec3::new(1.5, 0.0, 0.0)]);
/// assert!(!unit.overlaps(&beside) && unit.grown(0.5).overlaps(&beside));
/// assert!(!unit.overlaps(&Aabb::EMPTY));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    lower: Vec3,
    upper: Vec3,
}

impl Aabb {
    /// The empty box.
    pub const EMPTY: Self = Self {
        lower: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        upper: Vec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Returns the smallest box around some points.
    #[inline]
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { lower: b.lower.inf(&p), upper: b.upper.sup(&p) })
    }

    fn union(self, other: Self) -> Self {
        Self { lower: self.lower.inf(&other.lower), upper: self.upper.sup(&other.upper) }
    }

    /// Returns this box grown by `reach` on every side, m.
    pub fn grown(self, reach: f64) -> Self {
        let reach = Vec3::repeat(reach);
        Self { lower: self.lower - reach, upper: self.upper + reach }
    }

    /// Whether the boxes share a point.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|i| self.lower[i] <= other.upper[i] && other.lower[i] <= self.upper[i])
    }

    /// Distance from a point, m; zero inside.
    pub fn distance(&self, point: Vec3) -> f64 {
        (self.lower - point).sup(&(point - self.upper)).sup(&Vec3::zeros()).norm()
    }
}

/// A binary tree over a surface's triangles, in the order of a walk that visits a node before its children: the left
/// child follows its parent, and `after` is where the walk goes on when a node's subtree is skipped. No stack is
/// needed.
#[derive(Debug)]
pub struct TriangleTree {
    nodes: Vec<Node>,
    triangles: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    after: u32,
    first: u32,
    /// Number of triangles in a leaf; 0 for an inner node.
    count: u32,
}

impl TriangleTree {
    /// Divides the triangles at the median of their centres, at rest, along the longest axis.
    pub fn new(surface: &Surface, rest: &[Vec3]) -> Self {
        let centres: Vec<Vec3> = (0..surface.triangles.len() as u32)
            .map(|t| surface.triangle_nodes(t).iter().map(|&node| rest[node as usize]).sum())
            .collect();
        let mut triangles: Vec<u32> = (0..surface.triangles.len() as u32).collect();
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            divide(&mut nodes, &mut triangles, 0, &centres);
        }
        Self { nodes, triangles }
    }
}

fn divide(nodes: &mut Vec<Node>, triangles: &mut [u32], first: usize, centres: &[Vec3]) {
    let at = nodes.len();
    nodes.push(Node { after: 0, first: first as u32, count: triangles.len() as u32 });
    if triangles.len() > LEAF {
        nodes[at].count = 0;
        let extent = Aabb::around(triangles.iter().map(|&t| centres[t as usize]));
        let axis = (extent.upper - extent.lower).imax();
        let middle = triangles.len() / 2;
        triangles.select_nth_unstable_by(middle, |&a, &b| {
            centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
        });
        let (left, right) = triangles.split_at_mut(middle);
        divide(nodes, left, first, centres);
        divide(nodes, right, first + middle, centres);
    }
    nodes[at].after = nodes.len() as u32;
}

/// The tree with boxes around the triangles at their positions when a local model was built. Vertices move on from
/// there; a search allows for the largest such motion.
///
/// ```
/// use std::sync::Arc;
/// use stickslip::{surface::geometry::ContactGeometry, surface::tree::{Boxes, TriangleTree}};
/// use stickslip::{model::mesh::{Block, Stencil}, model::topology::Surface};
/// use stickslip::{Vec3, surface::tree::Aabb};
///
/// let mesh = Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear }.mesh();
/// let surface = Surface::new(&mesh)?;
/// let vertices: Vec<Vec3> = surface.vertex_node.iter().map(|&node| mesh.nodes[node as usize]).collect();
/// let tree = Arc::new(TriangleTree::new(&surface, &mesh.nodes));
/// let boxes = Boxes::new(tree, &surface, &ContactGeometry::Faceted, &vertices);
///
/// // Every triangle that comes within a millimetre of a point is among the few that are visited.
/// let near = |aabb: &Aabb| aabb.distance(Vec3::new(0.02, 0.01, 0.0)) <= 0.001;
/// let mut visited = Vec::new();
/// boxes.search(&mut visited, |_, aabb| near(aabb), |visited, triangle| visited.push(triangle));
/// let corners = |triangle: u32| surface.triangles[triangle as usize].map(|vertex| vertices[vertex as usize]);
/// let all = 0..surface.triangles.len() as u32;
/// assert!(all.filter(|&triangle| near(&Aabb::around(corners(triangle)))).all(|each| visited.contains(&each)));
/// assert!(visited.len() < 40, "of 448");
/// # Ok::<(), stickslip::model::topology::SurfaceError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Boxes {
    tree: Arc<TriangleTree>,
    boxes: Vec<Aabb>,
}

impl Boxes {
    /// Builds boxes at the given vertex positions, around all vertices that determine a triangle's contact points.
    pub fn new(tree: Arc<TriangleTree>, surface: &Surface, geometry: &ContactGeometry, vertices: &[Vec3]) -> Self {
        let mut boxes = vec![Aabb::EMPTY; tree.nodes.len()];
        // Children come after their parent, so in reverse order they are complete when the parent needs them.
        for (i, node) in tree.nodes.iter().enumerate().rev() {
            boxes[i] = if node.count == 0 {
                boxes[i + 1].union(boxes[tree.nodes[i + 1].after as usize])
            } else {
                let triangles = &tree.triangles[node.first as usize..(node.first + node.count) as usize];
                let support = triangles.iter().flat_map(|&t| geometry.support(surface, t));
                Aabb::around(support.map(|&v| vertices[v as usize])).grown(geometry.overhang())
            };
        }
        Self { tree, boxes }
    }

    /// Returns the box around the whole surface, with which every search begins.
    pub fn around_all(&self) -> Aabb {
        self.boxes.first().copied().unwrap_or(Aabb::EMPTY)
    }

    /// Calls `visit` with every triangle in a leaf that `enter` admits. `enter` is called for boxes on the way down, so
    /// its captured state may narrow as triangles are visited.
    pub fn search<S>(&self, search: &mut S, enter: impl Fn(&S, &Aabb) -> bool, mut visit: impl FnMut(&mut S, u32)) {
        let mut i = 0;
        while let Some(node) = self.tree.nodes.get(i) {
            if !enter(search, &self.boxes[i]) {
                i = node.after as usize;
                continue;
            }
            for &triangle in &self.tree.triangles[node.first as usize..(node.first + node.count) as usize] {
                visit(search, triangle);
            }
            i += 1;
        }
    }
}
