//! Networks, states and contact points to compare on: irregular, and the same in every run.

use stickslip::Vec3;
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::network::Network;
use stickslip::model::springs::Spring;
use stickslip::model::state::{ExternalForce, State};
use stickslip::surface::support::{Metric, Support};

/// Distance between lattice neighbours of the sample block, m.
pub const SPACING: f64 = 0.0125;

/// A reproducible sequence of numbers without pattern (the SplitMix64 generator).
#[derive(Debug, Clone)]
pub struct Numbers(u64);

impl Numbers {
    /// A sequence of its own for each seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number, in [−1, 1).
    pub fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A vector with components in [−size, size).
    pub fn vector(&mut self, size: f64) -> Vec3 {
        Vec3::new(self.draw(), self.draw(), self.draw()) * size
    }
}

/// 4 × 4 × 3 nodes with lattice edges and face diagonals.
pub fn block() -> Block {
    Block { nodes: [4, 4, 3], spacing: SPACING, stencil: Stencil::Shear }
}

/// How the sample network departs from a regular one.
#[derive(Debug, Clone, Copy)]
pub struct Variation {
    /// Nodes weigh 10 g times 1 ± this.
    pub mass: f64,
    /// Springs have 100 N/m times 1 ± this; their damping varies in the same way.
    pub stiffness: f64,
    /// Mean c of a spring, N·s/m.
    pub damping: f64,
}

/// The sample block as a network on a fixed bottom layer.
pub fn network(mesh: &Mesh, variation: Variation, external: Vec<ExternalForce>) -> Network {
    let mut numbers = Numbers::new(1);
    let mass = mesh.nodes.iter().map(|_| 0.01 * (1.0 + variation.mass * numbers.draw())).collect();
    let fixed = (0..mesh.nodes.len()).map(|node| block().is_bottom(node)).collect();
    let springs: Vec<Spring> = mesh
        .edges
        .iter()
        .map(|&nodes| Spring {
            nodes,
            stiffness: 100.0 * (1.0 + variation.stiffness * numbers.draw()),
            damping: variation.damping * (1.0 + variation.stiffness * numbers.draw()),
            rest_length: (mesh.nodes[nodes[1] as usize] - mesh.nodes[nodes[0] as usize]).norm(),
        })
        .collect();
    Network::from_parts(mesh.nodes.clone(), mass, fixed, &springs, external)
}

/// A deformed, moving state of a network: free nodes are up to `displacement` (m) from rest along
/// each axis and as fast as `speed` (m/s).
pub fn state(network: &Network, seed: u64, displacement: f64, speed: f64) -> State {
    let mut numbers = Numbers::new(seed);
    let mut state = network.rest_state();
    for node in (0..network.node_count()).filter(|&node| !network.fixed[node]) {
        state.x[node] += numbers.vector(displacement);
        state.v[node] = numbers.vector(speed);
    }
    state
}

/// A contact point on the surface of the sample block.
#[derive(Debug, Clone)]
pub struct Point {
    /// Corners of its triangle.
    pub nodes: [u32; 3],
    /// Barycentric weights.
    pub weights: [f64; 3],
}

impl Point {
    /// One inside each surface triangle with at least `free_nodes` corners that can move.
    pub fn all(mesh: &Mesh, network: &Network, free_nodes: usize) -> Vec<Self> {
        let movable = |nodes: &[u32; 3]| nodes.iter().filter(|&&node| !network.fixed[node as usize]).count();
        let triangles = mesh.triangles.iter().filter(|nodes| movable(nodes) >= free_nodes);
        triangles.enumerate().map(|(i, &nodes)| Self { nodes, weights: weights(i as u64) }).collect()
    }

    /// Its nodes with their weights.
    pub fn support(&self) -> [(usize, f64); 3] {
        std::array::from_fn(|corner| (self.nodes[corner] as usize, self.weights[corner]))
    }

    /// Our operators of this point, on arrays over all nodes.
    pub fn operators(&self, metric: Metric, network: &Network) -> Support {
        let mut support = Support::with_capacity(3);
        let free = self.support().into_iter().filter(|&(node, _)| !network.fixed[node]);
        support.set(metric, free.map(|(node, weight)| (node, weight, network.inverse_mass[node])));
        support
    }

    /// The outward normal of its triangle.
    pub fn normal(&self, x: &[Vec3]) -> Vec3 {
        let [a, b, c] = self.nodes.map(|node| x[node as usize]);
        (b - a).cross(&(c - a)).normalize()
    }

    /// Pushes the free corners of the triangle inwards by `depth`, m.
    pub fn press(&self, network: &Network, depth: f64, state: &mut State) {
        let inwards = -self.normal(&state.x);
        for node in self.nodes.map(|node| node as usize).into_iter().filter(|&node| !network.fixed[node]) {
            state.x[node] += inwards * depth;
        }
    }
}

/// Barycentric weights of a point inside a triangle, none of them small.
fn weights(seed: u64) -> [f64; 3] {
    let mut numbers = Numbers::new(seed);
    let raw = [(); 3].map(|()| 2.0 + numbers.draw());
    let sum: f64 = raw.iter().sum();
    raw.map(|weight| weight / sum)
}
