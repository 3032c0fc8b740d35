//! The points by which the condensed exterior moves: nodes themselves, or vertices of the coarse grid between which
//! nodes are interpolated.

use super::Reach;
use crate::Vec3;
use crate::local::coarse::{CORNERS, Grid};
use crate::local::patch::Patch;
use crate::model::network::Network;
use crate::model::search::breadth_first;

/// Role of a node in the condensed system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// The node is a point itself.
    Point(u32),
    /// The node is interpolated in a cell of the coarse grid.
    Cell(u32),
    /// The node stays fixed.
    Held,
}

/// The points of a condensed system, those of the exterior first, then the patch's slots.
pub(super) struct Points<'a> {
    grid: Option<&'a Grid>,
    pub(super) role: Vec<Role>,
    /// Number of the exterior's points, and number of those that are nodes.
    pub(super) exterior: usize,
    pub(super) nodes: usize,
    /// Rest positions of the exterior's points, m, in their first numbering.
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

    /// Returns the roles of two nodes, in ascending order.
    pub(super) fn roles(&self, nodes: [u32; 2]) -> [Role; 2] {
        let [a, b] = nodes.map(|node| self.role[node as usize]);
        [a.min(b), a.max(b)]
    }

    /// Whether one of two nodes belongs to the condensed exterior.
    pub(super) fn are_exterior(&self, nodes: [u32; 2]) -> bool {
        self.roles(nodes).iter().any(|role| match role {
            Role::Point(point) => (*point as usize) < self.exterior,
            Role::Cell(_) => true,
            Role::Held => false,
        })
    }

    /// Renumbers the exterior's points by the given order.
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

    /// Returns the points that move one of two nodes, ascending.
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

    /// Returns the places, in a list of points, of the points that move a node of this role.
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

    /// Returns the share of each such point in the node's motion.
    pub(super) fn shares(&self, node: u32) -> [f64; CORNERS] {
        match (self.role[node as usize], self.grid) {
            (Role::Cell(_), Some(grid)) => grid.place(node).1,
            (Role::Point(_) | Role::Held, _) | (Role::Cell(_), None) => [1.0; CORNERS],
        }
    }
}

/// Marks the nodes within this many springs of a centre; paths may pass through fixed nodes.
fn within(network: &Network, centre: Option<u32>, rings: u32) -> Vec<bool> {
    breadth_first(network.node_count(), centre, rings, |node| network.neighbours(node)).1
}

/// Returns the exterior's free nodes that may be condensed and are connected to the patch through others that may,
/// ascending. Nodes without a connection to the patch add nothing to C, and on their own could move without any force.
fn following(network: &Network, patch: &Patch, may_follow: impl Fn(u32) -> bool) -> Vec<u32> {
    let follows = |&node: &u32| !network.fixed[node as usize] && may_follow(node);
    let neighbours = |node| network.neighbours(node).filter(follows);
    let (mut nodes, _) = breadth_first(network.node_count(), patch.nodes.iter().copied(), u32::MAX, neighbours);
    let mut following = nodes.split_off(patch.len());
    following.sort_unstable();
    following
}
