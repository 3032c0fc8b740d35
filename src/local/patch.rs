//! The part of the network that the local model covers: a centre, some rings of springs around it, and the triangle in
//! contact.

use crate::Vec3;
use crate::model::network::Network;
use crate::model::springs::{Spring, Springs};
use crate::model::topology::Surface;

/// Entry in [`Patch::vertex_slot`] of a surface vertex that is not in the patch.
pub const OUTSIDE: u32 = u32::MAX;

/// Extent of a patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// All nodes within this many springs of the centre.
    Rings(u32),
    /// All free nodes.
    All,
}

/// Nodes and springs of a local model. A patch node's index is its *slot*; slots
/// `m..m + boundary.len()` are the exterior nodes that a patch spring ends on.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Node that rings are counted from; `None` if the patch takes every node, or no node is free.
    pub centre: Option<u32>,
    /// The m free nodes, ascending.
    pub nodes: Vec<u32>,
    /// Exterior nodes at the far end of a patch spring, ascending.
    pub boundary: Vec<u32>,
    /// All springs with at least one end in the patch, between slots.
    pub springs: Springs,
    /// Mass of each patch node, kg.
    pub mass: Vec<f64>,
    /// Inverse mass of each patch node, 1/kg.
    pub inverse_mass: Vec<f64>,
    /// Rest position of each patch node, m.
    pub rest: Vec<Vec3>,
    /// Slot of each surface vertex, or [`OUTSIDE`].
    pub vertex_slot: Vec<u32>,
}

impl Patch {
    /// Number of free nodes m.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the node of a slot, of the patch or its boundary.
    pub fn node(&self, slot: usize) -> u32 {
        if slot < self.len() { self.nodes[slot] } else { self.boundary[slot - self.len()] }
    }

    /// Whether the patch has no free node.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }
}

/// Selects patches. Besides the patch itself a selection visits every surface vertex: to find the nearest, and to
/// record which are in the patch.
///
/// ```
/// use stickslip::local::patch::{Extent, OUTSIDE, PatchSelector};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let (network, surface) = (simulation.network(), simulation.surface());
/// let mut selector = PatchSelector::new(network, surface);
/// let mut select = |extent| selector.select(network, surface, &network.rest, Vec3::zeros(), &[], extent);
///
/// // One ring around a node in the middle of the top: 8 neighbours in its layer and 5 in the next (shear springs).
/// let ring = select(Extent::Rings(1));
/// assert_eq!(ring.len(), 1 + 8 + 5);
/// assert!(ring.boundary.iter().all(|node| !ring.nodes.contains(node)));
/// assert_eq!(ring.node(ring.len()), ring.boundary[0]); // boundary slots follow
/// assert_eq!(ring.vertex_slot.iter().filter(|&&slot| slot != OUTSIDE).count(), 9);
/// // All of it means every node that can move.
/// let all = select(Extent::All);
/// assert_eq!(all.len(), network.fixed.iter().filter(|&&fixed| !fixed).count());
/// assert!(!all.is_empty() && all.centre.is_none());
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct PatchSelector {
    slot: Vec<u32>,
    vertex_of_node: Vec<u32>,
}

impl PatchSelector {
    /// Builds a selector for one network and its surface.
    pub fn new(network: &Network, surface: &Surface) -> Self {
        let mut vertex_of_node = vec![OUTSIDE; network.node_count()];
        for (vertex, &node) in surface.vertex_node.iter().enumerate() {
            vertex_of_node[node as usize] = vertex as u32;
        }
        Self { slot: vec![OUTSIDE; network.node_count()], vertex_of_node }
    }

    /// Selects the patch around a point of the surface: the free surface node nearest to it (lowest index on a tie),
    /// the nodes within the extent of that node, and the vertices that carry the contact. Rings may pass through fixed
    /// nodes, which the patch then omits.
    pub fn select(
        &mut self,
        network: &Network,
        surface: &Surface,
        x: &[Vec3],
        point: Vec3,
        support: &[u32],
        extent: Extent,
    ) -> Patch {
        let mut centre = None;
        let mut nodes: Vec<u32> = match extent {
            Extent::All => (0..network.node_count() as u32).collect(),
            Extent::Rings(rings) => {
                let mut nodes = Vec::new();
                centre = nearest_free_vertex(network, surface, x, point);
                if let Some(centre) = centre {
                    self.rings(network, centre, rings, &mut nodes);
                }
                nodes.extend(support.iter().map(|&vertex| surface.vertex_node[vertex as usize]));
                nodes
            }
        };
        nodes.retain(|&node| !network.fixed[node as usize]);
        nodes.sort_unstable();
        nodes.dedup();
        self.assemble(network, surface, centre, nodes)
    }

    /// Returns the patch without nodes.
    pub fn none(&mut self, network: &Network, surface: &Surface) -> Patch {
        self.assemble(network, surface, None, Vec::new())
    }

    /// Collects nodes breadth first from the centre, one ring after the other.
    fn rings(&mut self, network: &Network, centre: u32, rings: u32, nodes: &mut Vec<u32>) {
        nodes.push(centre);
        self.slot[centre as usize] = 0;
        let mut ring_start = 0;
        for _ in 0..rings {
            let ring_end = nodes.len();
            for i in ring_start..ring_end {
                for link in network.links(nodes[i]) {
                    if self.slot[link.other as usize] == OUTSIDE {
                        self.slot[link.other as usize] = 0;
                        nodes.push(link.other);
                    }
                }
            }
            ring_start = ring_end;
            if ring_end == nodes.len() {
                break;
            }
        }
        nodes.iter().for_each(|&node| self.slot[node as usize] = OUTSIDE);
    }

    fn assemble(&mut self, network: &Network, surface: &Surface, centre: Option<u32>, nodes: Vec<u32>) -> Patch {
        let m = nodes.len() as u32;
        nodes.iter().zip(0..).for_each(|(&node, slot)| self.slot[node as usize] = slot);
        let mut boundary: Vec<u32> = nodes
            .iter()
            .flat_map(|&node| network.links(node))
            .map(|link| link.other)
            .filter(|&other| self.slot[other as usize] == OUTSIDE)
            .collect();
        boundary.sort_unstable();
        boundary.dedup();
        boundary.iter().zip(m..).for_each(|(&node, slot)| self.slot[node as usize] = slot);

        let mut springs: Vec<Spring> = Vec::new();
        let mut vertex_slot = vec![OUTSIDE; surface.vertex_node.len()];
        for &node in &nodes {
            let slot = self.slot[node as usize];
            for link in network.links(node) {
                let other = self.slot[link.other as usize];
                // A spring inside the patch is seen from both ends; it is taken from the lower one.
                if other > slot {
                    springs.push(Spring { nodes: [slot, other], ..link.spring });
                }
            }
            let vertex = self.vertex_of_node[node as usize];
            if vertex != OUTSIDE {
                vertex_slot[vertex as usize] = slot;
            }
        }
        nodes.iter().chain(&boundary).for_each(|&node| self.slot[node as usize] = OUTSIDE);

        let of_nodes = |values: &[f64]| nodes.iter().map(|&node| values[node as usize]).collect();
        Patch {
            centre,
            springs: Springs::new(nodes.len() + boundary.len(), &springs),
            mass: of_nodes(&network.mass),
            inverse_mass: of_nodes(&network.inverse_mass),
            rest: nodes.iter().map(|&node| network.rest[node as usize]).collect(),
            vertex_slot,
            nodes,
            boundary,
        }
    }
}

fn nearest_free_vertex(network: &Network, surface: &Surface, x: &[Vec3], point: Vec3) -> Option<u32> {
    let mut best: Option<(f64, u32)> = None;
    for &node in surface.vertex_node.iter().filter(|&&node| !network.fixed[node as usize]) {
        let distance = (x[node as usize] - point).norm_squared();
        // Ascending nodes and a strict comparison: the lowest index wins a tie.
        if best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, node));
        }
    }
    best.map(|(_, node)| node)
}
