//! What follows the patch, and by which points: nodes themselves, or vertices of the coarse grid that they are
//! interpolated between.

use super::Reach;
use crate::Vec3;
use crate::local::coarse::{CORNERS, Grid};
use crate::local::patch::Patch;
use crate::model::network::Network;

/// What a node does in the condensed system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// It is a point.
    Point(u32),
    /// It is interpolated in a cell of the coarse grid.
    Cell(u32),
    /// It stays where it is.
    Held,
}

/// The points of a condensed system, those of the exterior first, then the patch's slots.
pub(super) struct Points<'a> {
    grid: Option<&'a Grid>,
    pub(super) role: Vec<Role>,
    /// Number of the exterior's points, and of those that are nodes.
    pub(super) exterior: usize,
    pub(super) nodes: usize,
    /// Rest positions of the exterior's points, in their first numbering, m.
    pub(super) positions: Vec<Vec3>,
    pub(super) vertex_point: Vec<Option<u32>>,
}

impl<'a> Points<'a> {
    pub(super) fn new(network: &Network, patch: &Patch, reach: Reach, grid: Option<&'a Grid>) -> Self {
        let near = match reach {
            Reach::All => vec![true; network.node_count()],
            Reach::Rings { rings, .. } => within(network, patch.centre, rings),
        };
        let mut role = vec![Role::Held; network.node_count()];
        let mut positions = Vec::new();
        let mut vertex_point = vec![None; grid.map_or(0, Grid::vertex_count)];
        let following = following(network, patch, |node| near[node as usize] || grid.is_some());
        for &node in following.iter().filter(|&&node| near[node as usize]) {
            role[node as usize] = Role::Point(positions.len() as u32);
            positions.push(network.rest[node as usize]);
        }
        let nodes = positions.len();
        if let Some(grid) = grid {
            for &node in following.iter().filter(|&&node| !near[node as usize]) {
                let (cell, weights) = grid.place(node);
                role[node as usize] = Role::Cell(cell);
                for (vertex, _) in grid.corners(cell).into_iter().zip(weights).filter(|&(_, weight)| weight != 0.0) {
                    vertex_point[vertex].get_or_insert_with(|| {
                        positions.push(grid.position(vertex));
                        positions.len() as u32 - 1
                    });
                }
            }
        }
        let exterior = positions.len();
        for (&node, point) in patch.nodes.iter().zip(exterior as u32..) {
            role[node as usize] = Role::Point(point);
        }
        Self { grid, role, exterior, nodes, positions, vertex_point }
    }

    /// What two nodes do, in whatever order.
    pub(super) fn roles(&self, nodes: [u32; 2]) -> [Role; 2] {
        let [a, b] = nodes.map(|node| self.role[node as usize]);
        [a.min(b), a.max(b)]
    }

    /// Whether one of two nodes follows the patch.
    pub(super) fn are_exterior(&self, nodes: [u32; 2]) -> bool {
        self.roles(nodes).iter().any(|role| match role {
            Role::Point(point) => (*point as usize) < self.exterior,
            Role::Cell(_) => true,
            Role::Held => false,
        })
    }

    /// Puts the exterior's points into an order.
    pub(super) fn renumber(&mut self, order: &[u32]) {
        let mut number = vec![0; order.len()];
        order.iter().zip(0..).for_each(|(&point, at)| number[point as usize] = at);
        let renumber = |point: &mut u32| {
            if let Some(&number) = number.get(*point as usize) {
                *point = number;
            }
        };
        for role in &mut self.role {
            if let Role::Point(point) = role {
                renumber(point);
            }
        }
        self.vertex_point.iter_mut().flatten().for_each(renumber);
    }

    /// The points that move one of two nodes, ascending.
    pub(super) fn of(&self, nodes: [u32; 2]) -> Vec<u32> {
        let mut points = Vec::with_capacity(2);
        for role in self.roles(nodes) {
            match (role, self.grid) {
                (Role::Point(point), _) => points.push(point),
                (Role::Cell(cell), Some(grid)) => {
                    points.extend(grid.corners(cell).into_iter().filter_map(|vertex| self.vertex_point[vertex]));
                }
                (Role::Held, _) | (Role::Cell(_), None) => {}
            }
        }
        points.sort_unstable();
        points.dedup();
        points
    }

    /// Where the points that move a node of this role are in a list of points.
    pub(super) fn columns(&self, role: Role, list: &[u32]) -> [Option<usize>; CORNERS] {
        let column = |point: u32| list.binary_search(&point).ok();
        match (role, self.grid) {
            (Role::Point(point), _) => std::array::from_fn(|i| if i == 0 { column(point) } else { None }),
            (Role::Cell(cell), Some(grid)) => {
                grid.corners(cell).map(|vertex| self.vertex_point[vertex].and_then(column))
            }
            (Role::Held, _) | (Role::Cell(_), None) => [None; CORNERS],
        }
    }

    /// How far a node moves with each of these.
    pub(super) fn shares(&self, node: u32) -> [f64; CORNERS] {
        match (self.role[node as usize], self.grid) {
            (Role::Cell(_), Some(grid)) => grid.place(node).1,
            (Role::Point(_) | Role::Held, _) | (Role::Cell(_), None) => [1.0; CORNERS],
        }
    }
}

/// Which nodes are within so many springs of a centre; hops may pass through fixed nodes.
fn within(network: &Network, centre: Option<u32>, rings: u32) -> Vec<bool> {
    let mut reached = vec![false; network.node_count()];
    let mut ring: Vec<u32> = centre.into_iter().collect();
    ring.iter().for_each(|&node| reached[node as usize] = true);
    for _ in 0..rings {
        let mut next = Vec::new();
        for link in ring.iter().flat_map(|&node| network.links(node)) {
            if !std::mem::replace(&mut reached[link.other as usize], true) {
                next.push(link.other);
            }
        }
        ring = next;
        if ring.is_empty() {
            break;
        }
    }
    reached
}

/// The exterior's free nodes that may follow and hang on the patch through others that do, ascending.
/// What does not hang on the patch adds nothing to C, and on its own it could move without any force.
fn following(network: &Network, patch: &Patch, may_follow: impl Fn(u32) -> bool) -> Vec<u32> {
    let mut seen = vec![false; network.node_count()];
    patch.nodes.iter().for_each(|&node| seen[node as usize] = true);
    let mut nodes = patch.nodes.clone();
    let mut next = 0;
    while next < nodes.len() {
        for link in network.links(nodes[next]) {
            let other = link.other;
            if !seen[other as usize] && !network.fixed[other as usize] && may_follow(other) {
                seen[other as usize] = true;
                nodes.push(other);
            }
        }
        next += 1;
    }
    let mut following = nodes.split_off(patch.len());
    following.sort_unstable();
    following
}
