//! Blocks filled with tetrahedra: meshes of adjustable irregularity with an exactly known outline.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::model::mesh::{Block, Mesh};

/// Seed of the random displacements of nodes.
const SEED: u64 = 4;

/// Pattern of a cell: the corners of its tetrahedra as steps from its first node, given whether that node is even.
pub type Split = fn(bool) -> Vec<[[usize; 3]; 4]>;

/// Divides a cell into a tetrahedron of its four even nodes and one in each remaining corner.
pub fn five_tetrahedra(is_even: bool) -> Vec<[[usize; 3]; 4]> {
    let corners = |even: bool| {
        (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]).filter(move |c| (c.iter().sum::<usize>() % 2 == 0) == even)
    };
    let middle: Vec<[usize; 3]> = corners(is_even).collect();
    let mut split = vec![[middle[0], middle[1], middle[2], middle[3]]];
    for tip in corners(!is_even) {
        let beside = |axis: usize| {
            let mut at = tip;
            at[axis] = 1 - at[axis];
            at
        };
        split.push([tip, beside(0), beside(1), beside(2)]);
    }
    split
}

/// Divides a cell into one tetrahedron for each path along three edges from the first node to the opposite one
/// (H. W. Kuhn, 1960).
pub fn six_tetrahedra(_: bool) -> Vec<[[usize; 3]; 4]> {
    [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]]
        .map(|way| {
            let mut at = [[0; 3]; 4];
            for (step, axis) in way.into_iter().enumerate() {
                at[step + 1] = at[step];
                at[step + 1][axis] = 1;
            }
            at
        })
        .to_vec()
}

/// Builds a block filled with tetrahedra, whose edges are its springs; nodes are moved at random by up to `jitter`
/// spacings, those on the boundary within it. It has no surface that can be touched.
///
/// ```
/// use stickslip::model::mesh::{Block, Stencil};
/// use stickslip::verify::tetrahedral_block::{Split, five_tetrahedra, six_tetrahedra, tetrahedral_block};
///
/// let block = Block { nodes: [3; 3], spacing: 0.5, stencil: Stencil::Structural };
/// for (split, count) in [(five_tetrahedra as Split, 5), (six_tetrahedra, 6)] {
///     let mesh = tetrahedral_block(&block, split, 0.12);
///     let volumes = mesh.tetrahedra.iter().map(|&corners| mesh.tetrahedron_volume(corners));
///     assert_eq!(volumes.len(), 8 * count);
///     assert!((volumes.sum::<f64>() - 1.0).abs() < 1e-14); // wherever the nodes inside have gone
/// }
/// ```
pub fn tetrahedral_block(block: &Block, split: Split, jitter: f64) -> Mesh {
    let mut mesh = Mesh { edges: Vec::new(), triangles: Vec::new(), ..block.mesh() };
    let [nx, ny, _] = block.nodes;
    let cells = (0..mesh.nodes.len()).map(|node| block.lattice(node));
    for first in cells.filter(|at| (0..3).all(|axis| at[axis] + 1 < block.nodes[axis])) {
        for corners in split(first.iter().sum::<usize>() % 2 == 0) {
            let mut corners = corners.map(|step| {
                let [ix, iy, iz] = [0, 1, 2].map(|axis| first[axis] + step[axis]);
                ((iz * ny + iy) * nx + ix) as u32
            });
            if mesh.tetrahedron_volume(corners) < 0.0 {
                corners.swap(2, 3);
            }
            mesh.tetrahedra.push(corners);
        }
    }
    let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    let edges = mesh.tetrahedra.iter().flat_map(|corners| pairs.map(|pair| pair.map(|i: usize| corners[i])));
    let mut edges: Vec<[u32; 2]> = edges.map(|[i, j]| [i.min(j), i.max(j)]).collect();
    edges.sort_unstable();
    edges.dedup();
    mesh.edges = edges;

    let mut generator = ChaCha8Rng::seed_from_u64(SEED);
    let mut random = || 2.0 * (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64 - 1.0;
    for (node, x) in mesh.nodes.iter_mut().enumerate() {
        let at = block.lattice(node);
        for axis in (0..3).filter(|&axis| at[axis] > 0 && at[axis] + 1 < block.nodes[axis]) {
            x[axis] += jitter * block.spacing * random();
        }
    }
    mesh
}
