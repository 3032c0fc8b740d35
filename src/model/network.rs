//! The full model (1)–(2): lumped masses, damped springs, gravity and drag.

use thiserror::Error;

use super::material::PerSpring;
use super::mesh::Mesh;
use super::springs::{Spring, Springs};
use super::state::{ExternalForce, State};
use crate::Vec3;

/// Constants of the nodes and springs of a network.
#[derive(Debug, Clone)]
pub struct Material {
    /// Mass of each node, kg.
    pub node_mass: Vec<f64>,
    /// Stiffness k of the springs, N/m.
    pub stiffness: PerSpring,
    /// Damping c of the springs, N·s/m.
    pub damping: PerSpring,
    /// Drag b of every node, N·s/m.
    pub drag: f64,
    /// Gravity g, m/s².
    pub gravity: Vec3,
}

impl Material {
    /// Returns a material with one mass, kg, for all nodes and one stiffness, N/m, and damping, N·s/m, for all springs,
    /// without gravity and drag.
    pub fn uniform(nodes: usize, node_mass: f64, stiffness: f64, damping: f64) -> Self {
        Self {
            node_mass: vec![node_mass; nodes],
            stiffness: stiffness.into(),
            damping: damping.into(),
            drag: 0.0,
            gravity: Vec3::zeros(),
        }
    }
}

/// Reason why a mesh and a material make no network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The number of values differs from the number of nodes or edges.
    #[error("`{quantity}` has {found} values; the mesh needs {needed}")]
    WrongCount {
        /// Name of the quantity.
        quantity: &'static str,
        /// Number of values given.
        found: usize,
        /// Number of values needed.
        needed: usize,
    },
    /// An edge or a triangle names a node that does not exist.
    #[error("the mesh has {nodes} nodes, but one of its edges or triangles refers to node {node}")]
    UnknownNode {
        /// Index of the named node.
        node: u32,
        /// Number of nodes of the mesh.
        nodes: usize,
    },
}

/// The constant part of the full model.
///
/// ```
/// use stickslip::model::{mesh::{Block, Stencil}, network::{Material, Network}};
/// use stickslip::Vec3;
///
/// let block = Block { nodes: [3, 3, 2], spacing: 0.01, stencil: Stencil::Full };
/// let mesh = block.mesh();
/// let gravity = Vec3::new(0.0, 0.0, -9.81);
/// let (stiffness, damping) = (100.0.into(), 0.5.into());
/// let material = Material { node_mass: vec![0.01; 18], stiffness, damping, drag: 0.0, gravity };
/// let network = Network::new(&mesh, &material, (0..18).map(|node| block.is_bottom(node)).collect())?;
/// assert_eq!((network.node_count(), network.springs.len()), (18, block.edge_count()));
/// assert_eq!(network.links(13).len(), 8 + 9); // in the middle of the top: its layer and the one below
/// assert_eq!((network.inverse_mass[0], network.inverse_mass[13]), (0.0, 100.0)); // the bottom is fixed
///
/// // In any deformed state springs pull on each other, so only the weight remains in the sum of the forces.
/// let mut state = network.rest_state();
/// state.x[13] += Vec3::new(0.002, -0.001, 0.003);
/// let mut f = vec![Vec3::zeros(); 18];
/// network.forces(&state.x, &state.v, &mut f);
/// assert!((f.iter().sum::<Vec3>() - gravity * 0.18).norm() < 1e-14);
/// assert!((network.fixed_potential() + 9.0 * 0.01 * 9.81 * 0.01).abs() < 1e-15); // Σ mgz, z = −1 cm
/// # Ok::<(), stickslip::model::network::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Network {
    /// Rest positions, m.
    pub rest: Vec<Vec3>,
    /// Node masses, kg.
    pub mass: Vec<f64>,
    /// Inverse node masses, 1/kg, 0 for a fixed node: M⁻¹ of (2).
    pub inverse_mass: Vec<f64>,
    /// Whether each node is fixed.
    pub fixed: Vec<bool>,
    /// All springs.
    pub springs: Springs,
    /// Gravity and drag, as far as the material has them.
    pub external: Vec<ExternalForce>,
    link_start: Vec<u32>,
    links: Vec<Link>,
}

/// A spring as seen from one of its ends.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// Node at the other end.
    pub other: u32,
    /// The spring, oriented from its lower node.
    pub spring: Spring,
}

impl Network {
    /// Joins the nodes of a mesh by springs whose rest length is the mesh's edge length.
    ///
    /// # Errors
    /// If `node_mass` or `fixed` does not have one entry per node, `stiffness` or `damping` has neither one entry for
    /// all edges nor one per edge, or the mesh names a node that does not exist.
    pub fn new(mesh: &Mesh, material: &Material, fixed: Vec<bool>) -> Result<Self, NetworkError> {
        let (nodes, edges) = (mesh.nodes.len(), mesh.edges.len());
        let counts = [
            ("node_mass", material.node_mass.len(), nodes),
            ("fixed", fixed.len(), nodes),
            ("stiffness", material.stiffness.count().unwrap_or(edges), edges),
            ("damping", material.damping.count().unwrap_or(edges), edges),
        ];
        if let Some((quantity, found, needed)) = counts.into_iter().find(|(_, found, needed)| found != needed) {
            return Err(NetworkError::WrongCount { quantity, found, needed });
        }
        let named = mesh.edges.as_flattened().iter().chain(mesh.triangles.as_flattened());
        if let Some(&node) = named.max().filter(|&&node| node as usize >= nodes) {
            return Err(NetworkError::UnknownNode { node, nodes });
        }
        let springs: Vec<Spring> = mesh
            .edges
            .iter()
            .enumerate()
            .map(|(edge, &nodes)| Spring {
                nodes,
                stiffness: material.stiffness.at(edge),
                damping: material.damping.at(edge),
                rest_length: (mesh.nodes[nodes[1] as usize] - mesh.nodes[nodes[0] as usize]).norm(),
            })
            .collect();
        let mut external = Vec::new();
        if material.gravity != Vec3::zeros() {
            external.push(ExternalForce::Gravity(material.gravity));
        }
        if material.drag != 0.0 {
            external.push(ExternalForce::Drag(material.drag));
        }
        Ok(Self::from_parts(mesh.nodes.clone(), material.node_mass.clone(), fixed, &springs, external))
    }

    /// Builds a network from any springs, for instance from springs that differ.
    pub fn from_parts(
        rest: Vec<Vec3>,
        mass: Vec<f64>,
        fixed: Vec<bool>,
        springs: &[Spring],
        external: Vec<ExternalForce>,
    ) -> Self {
        let springs = Springs::new(rest.len(), springs);
        let mut link_start = vec![0_u32; rest.len() + 1];
        for spring in springs.iter() {
            for node in spring.nodes {
                link_start[node as usize + 1] += 1;
            }
        }
        for i in 1..link_start.len() {
            link_start[i] += link_start[i - 1];
        }
        let nowhere =
            Link { other: 0, spring: Spring { nodes: [0; 2], stiffness: 0.0, damping: 0.0, rest_length: 0.0 } };
        let mut links = vec![nowhere; 2 * springs.len()];
        let mut next = link_start.clone();
        for spring in springs.iter() {
            let [i, j] = spring.nodes;
            for (node, other) in [(i, j), (j, i)] {
                links[next[node as usize] as usize] = Link { other, spring };
                next[node as usize] += 1;
            }
        }
        let inverse_mass = mass.iter().zip(&fixed).map(|(m, &fixed)| if fixed { 0.0 } else { 1.0 / m }).collect();
        Self { rest, mass, inverse_mass, fixed, springs, external, link_start, links }
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.rest.len()
    }

    /// Returns the springs that end on a node.
    pub fn links(&self, node: u32) -> &[Link] {
        let i = node as usize;
        &self.links[self.link_start[i] as usize..self.link_start[i + 1] as usize]
    }

    /// Returns the nodes at the other ends of a node's springs.
    pub fn neighbours(&self, node: u32) -> impl Iterator<Item = u32> {
        self.links(node).iter().map(|link| link.other)
    }

    /// Returns the state in which no spring is stretched and nothing moves.
    pub fn rest_state(&self) -> State {
        State { x: self.rest.clone(), v: vec![Vec3::zeros(); self.rest.len()] }
    }

    /// Potential energy of the fixed nodes, J.
    pub fn fixed_potential(&self) -> f64 {
        let nodes = self.fixed.iter().zip(&self.mass).zip(&self.rest).filter(|((fixed, _), _)| **fixed);
        let potential =
            |mass: f64, x: &Vec3| self.external.iter().fold(0.0, |sum, force| sum + force.potential(mass, x));
        nodes.fold(0.0, |sum, ((_, mass), x)| sum + potential(*mass, x))
    }

    /// Evaluates f(x, v) of (1), N. Fixed nodes have a force too; their M⁻¹ is zero.
    pub fn forces(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        f.fill(Vec3::zeros());
        self.springs.add_forces(x, v, f);
        for force in &self.external {
            force.add(&self.mass, v, f);
        }
    }
}
