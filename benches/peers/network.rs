//! Networks that every peer simulates, and the file in which they are passed.

use std::f64::consts::TAU;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use stickslip::Vec3;
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::network::Network;
use stickslip::model::springs::Spring;
use stickslip::model::state::State;

/// Distance between lattice neighbours, m.
const SPACING: f64 = 0.0125;
/// Mass of every node, kg; stiffness, N/m, and damping, N·s/m, of every spring.
const MASS: f64 = 0.01;
const STIFFNESS: f64 = 100.0;
/// Light enough for the block to swing, and for semi-implicit Euler at [`STEP`]: the fastest mode has about 400/s.
const DAMPING: f64 = 0.1;
/// Time step, s.
pub const STEP: f64 = 1e-3;

/// Network in its initial state, as written to the file; SI units.
#[derive(Debug, Serialize, Deserialize)]
pub struct NetworkFile {
    rest: Vec<[f64; 3]>,
    mass: Vec<f64>,
    fixed: Vec<bool>,
    /// Springs as (i, j, k, c, L).
    springs: Vec<(u32, u32, f64, f64, f64)>,
    x: Vec<[f64; 3]>,
    v: Vec<[f64; 3]>,
    step: f64,
}

/// Returns the networks with their names: blocks from few springs to many, then the irregular ones.
pub fn cases() -> Vec<(String, NetworkFile)> {
    let networks = [
        ("block", NetworkFile::new(&block(5), 1)),
        ("block", NetworkFile::new(&block(10), 1)),
        ("block", NetworkFile::new(&block(16), 1)),
        ("block", NetworkFile::new(&block(32), 1)),
        ("ball", NetworkFile::new(&ball(10), 4)),
        ("shuffled", NetworkFile::new(&shuffled(&block(16)), 1)),
    ];
    networks.into_iter().map(|(kind, file)| (format!("{kind}-{}", file.node_count()), file)).collect()
}

fn block(side: usize) -> Mesh {
    Block { nodes: [side; 3], spacing: SPACING, stencil: Stencil::Full }.mesh()
}

/// Returns the nodes of a block within `radius` lattice steps of its centre, numbered without gaps in block order.
fn ball(radius: usize) -> Mesh {
    let cube = block(2 * radius + 1);
    let centre = cube.nodes.iter().sum::<Vec3>() / cube.nodes.len() as f64;
    // The limit is half a step in squared distance further out, so that membership does not depend on rounding.
    let limit = SPACING * SPACING * ((radius * radius) as f64 + 0.5);
    let mut nodes = Vec::new();
    let number: Vec<Option<u32>> = cube
        .nodes
        .iter()
        .map(|node| {
            let inside = (node - centre).norm_squared() < limit;
            inside.then(|| {
                nodes.push(*node);
                nodes.len() as u32 - 1
            })
        })
        .collect();
    let edges = cube.edges.iter().filter_map(|&[i, j]| Some([number[i as usize]?, number[j as usize]?])).collect();
    Mesh { nodes, edges, triangles: Vec::new(), tetrahedra: Vec::new() }
}

/// Returns a mesh with its nodes numbered at random: springs join equal distances in the numbering only by
/// chance.
fn shuffled(mesh: &Mesh) -> Mesh {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut number: Vec<u32> = (0..mesh.nodes.len() as u32).collect();
    number.sort_by_cached_key(|_| random.next_u64());
    let mut nodes = mesh.nodes.clone();
    mesh.nodes.iter().zip(&number).for_each(|(node, &to)| nodes[to as usize] = *node);
    let edges = mesh.edges.iter().map(|edge| edge.map(|node| number[node as usize])).collect();
    Mesh { nodes, edges, triangles: Vec::new(), tetrahedra: Vec::new() }
}

impl NetworkFile {
    /// Builds springs along the edges of a mesh whose lowest layers of nodes are fixed; stretched upwards by 5 %,
    /// sheared by 10 %, bent by a wave, and moving across. Springs between fixed nodes, which have no effect, are
    /// omitted, since not every peer would compute them.
    fn new(mesh: &Mesh, fixed_layers: usize) -> Self {
        let heights = || mesh.nodes.iter().map(|node| node.z);
        let bottom = heights().fold(f64::INFINITY, f64::min);
        let height = heights().fold(f64::NEG_INFINITY, f64::max) - bottom;
        let fixed: Vec<bool> = heights().map(|z| z < bottom + (fixed_layers as f64 - 0.5) * SPACING).collect();
        let springs = mesh.edges.iter().filter(|edge| !edge.iter().all(|&node| fixed[node as usize])).map(|&[i, j]| {
            let length = (mesh.nodes[j as usize] - mesh.nodes[i as usize]).norm();
            (i, j, STIFFNESS, DAMPING, length)
        });
        let moving = |node: &Vec3, fixed: bool| if fixed { 0.0 } else { node.z - bottom };
        let displaced = mesh.nodes.iter().zip(&fixed).map(|(node, &fixed)| {
            let above = moving(node, fixed);
            let wave = 0.02 * (TAU * above / height).sin();
            (node + Vec3::new(0.1 * above, wave * above, 0.05 * above)).into()
        });
        let velocities = mesh.nodes.iter().zip(&fixed).map(|(node, &fixed)| [0.0, moving(node, fixed), 0.0]);
        Self {
            rest: mesh.nodes.iter().map(|&node| node.into()).collect(),
            mass: vec![MASS; mesh.nodes.len()],
            springs: springs.collect(),
            x: displaced.collect(),
            v: velocities.collect(),
            fixed,
            step: STEP,
        }
    }

    /// Reads a file written by [`write`](Self::write).
    pub fn read(path: &Path) -> std::io::Result<Self> {
        Ok(serde_json::from_reader(BufReader::new(File::open(path)?))?)
    }

    /// Writes the network as JSON. Numbers have the shortest round-trip form, so that readers obtain identical bits.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        serde_json::to_writer(&mut file, self)?;
        file.flush()
    }

    /// Returns the number of springs.
    pub fn spring_count(&self) -> usize {
        self.springs.len()
    }

    /// Returns the number of nodes.
    pub fn node_count(&self) -> usize {
        self.rest.len()
    }

    /// Builds the library's network.
    pub fn network(&self) -> Network {
        let springs: Vec<Spring> = self
            .springs
            .iter()
            .map(|&(i, j, stiffness, damping, rest_length)| Spring { nodes: [i, j], stiffness, damping, rest_length })
            .collect();
        Network::from_parts(vectors(&self.rest), self.mass.clone(), self.fixed.clone(), &springs, Vec::new())
    }

    /// Returns the initial state.
    pub fn initial(&self) -> State {
        State { x: vectors(&self.x), v: vectors(&self.v) }
    }

    /// Returns the root mean square of the nodes' initial displacements, m: the unit of all differences.
    pub fn initial_displacement(&self) -> f64 {
        root_mean_square(&vectors(&self.x), &vectors(&self.rest))
    }
}

/// Converts vectors from a file or a reply.
pub fn vectors(values: &[[f64; 3]]) -> Vec<Vec3> {
    values.iter().map(|&value| value.into()).collect()
}

/// Returns the root mean square of the distances between positions of the same nodes, m.
pub fn root_mean_square(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (sum / a.len() as f64).sqrt()
}

/// Returns the largest of these distances, m; NaN if one of them is.
pub fn largest(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, |largest, next| if next <= largest { largest } else { next })
}
