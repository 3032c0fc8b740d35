//! Constants of springs and nodes from those of a material.
//!
//! Springs with central forces, of stiffness k, length L and direction n, store the energy of an elastic solid with
//! C_ijkl = Σ k L² n_i n_j n_k n_l / V. That is symmetric in all four indices (Cauchy), so an isotropic network has
//! λ = μ: Poisson's ratio is 1/4, whatever its stiffness, and E = 5μ/2. Contracted, C_iijj = Σ k L²/V = 6E: a network
//! can be right on average over all strains without being isotropic.

use std::fmt;
use std::ops::{DivAssign, MulAssign};

use thiserror::Error;

use super::mesh::{Block, Mesh, Stencil};
use crate::word::words;

/// Poisson's ratio of every isotropic network of central springs.
pub const POISSON_RATIO: f64 = 0.25;

/// A tetrahedron below this share of the mean volume is flat: its springs' stiffness would be round-off.
const FLAT: f64 = 1e-12;

/// A constant of the springs.
///
/// ```
/// use stickslip::model::material::PerSpring;
///
/// let mut stiffness = PerSpring::Each(vec![100.0, 300.0]);
/// stiffness /= 2.0;
/// assert_eq!((stiffness.at(1), stiffness.range()), (150.0, [50.0, 150.0]));
/// assert_eq!(PerSpring::from(100.0).at(1), 100.0);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum PerSpring {
    /// One value for all springs.
    Same(f64),
    /// One value for each edge of the mesh, in its order.
    Each(Vec<f64>),
}

impl PerSpring {
    /// Number of values, unless there is one for all.
    pub(crate) fn count(&self) -> Option<usize> {
        match self {
            PerSpring::Same(_) => None,
            PerSpring::Each(values) => Some(values.len()),
        }
    }

    /// Returns the value for the spring along an edge. An edge without a value gives NaN, which no
    /// [network](super::network::Network::new) accepts.
    pub fn at(&self, edge: usize) -> f64 {
        match self {
            PerSpring::Same(value) => *value,
            PerSpring::Each(values) => values.get(edge).copied().unwrap_or(f64::NAN),
        }
    }

    /// Returns the values times a factor.
    pub fn scaled(self, factor: f64) -> Self {
        match self {
            PerSpring::Same(value) => PerSpring::Same(value * factor),
            PerSpring::Each(values) => PerSpring::Each(values.into_iter().map(|value| value * factor).collect()),
        }
    }

    /// Returns the smallest and the largest value.
    pub fn range(&self) -> [f64; 2] {
        match self {
            PerSpring::Same(value) => [*value; 2],
            PerSpring::Each(values) => {
                let fold = |of: fn(f64, f64) -> f64| values.iter().copied().reduce(of).unwrap_or(0.0);
                [fold(f64::min), fold(f64::max)]
            }
        }
    }

    fn for_each(&mut self, change: impl FnMut(&mut f64)) {
        match self {
            PerSpring::Same(value) => std::slice::from_mut(value),
            PerSpring::Each(values) => values,
        }
        .iter_mut()
        .for_each(change);
    }
}

impl From<f64> for PerSpring {
    fn from(value: f64) -> Self {
        PerSpring::Same(value)
    }
}

impl MulAssign<f64> for PerSpring {
    fn mul_assign(&mut self, factor: f64) {
        self.for_each(|value| *value *= factor);
    }
}

impl DivAssign<f64> for PerSpring {
    fn div_assign(&mut self, divisor: f64) {
        self.for_each(|value| *value /= divisor);
    }
}

/// Prints the value, or the smallest and the largest.
impl fmt::Display for PerSpring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [smallest, largest] = self.range();
        match self {
            PerSpring::Same(value) => write!(f, "{value}"),
            PerSpring::Each(_) => write!(f, "{smallest:.4} to {largest:.4}"),
        }
    }
}

/// Identification of the springs of tetrahedra from Young's modulus. Tetrahedra do not fill space isotropically:
/// neither rule is exact, nor becomes so under refinement.
///
/// ```
/// use stickslip::model::material::{Bulk, Identification};
/// use stickslip::{Vec3, model::mesh::Mesh};
///
/// // A regular tetrahedron: four corners of a cube.
/// let nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]].map(Vec3::from).to_vec();
/// let edges = vec![[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
/// let mesh = Mesh { nodes, edges, triangles: vec![], tetrahedra: vec![[0, 1, 2, 3]] };
/// let bulk = Bulk::Tetrahedra(&mesh);
/// assert_eq!(bulk.node_volumes(), Ok(vec![1.0 / 12.0; 4])); // a third of the cube
/// let [van_gelder, lloyd] = Identification::ALL.map(|kind| bulk.stiffness(1e4, kind).expect("it is filled"));
/// assert!(van_gelder.iter().zip(&lloyd).all(|(k, nearest)| (nearest / k - 24.0 / 25.0).abs() < 1e-14));
/// assert_eq!(Identification::Lloyd.name(), "lloyd");
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Identification {
    /// k = E Σ V/L² over the tetrahedra around an edge: each gives each of its edges the same k L², so that C_iijj is
    /// that of the solid in every mesh. A. Van Gelder, "Approximate simulation of elastic membranes by triangulated
    /// spring meshes", Journal of Graphics Tools 3(2), 1998.
    #[default]
    VanGelder,
    /// k = E Σ (2√2/25) L over the tetrahedra around an edge. For a regular tetrahedron this is nearest to the solid in
    /// all entries of C, 24/25 of Van Gelder's value; in an irregular one a longer edge is stiffer. B. Lloyd, G.
    /// Székely, M. Harders, "Identification of spring parameters for deformable object simulation", IEEE Transactions
    /// on Visualization and Computer Graphics 13(5), 2007, for regular tetrahedra.
    Lloyd,
}

words!(Identification { VanGelder = "van-gelder", Lloyd = "lloyd" });

/// Reason why a mesh cannot be given a material's constants.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum MaterialError {
    /// The lattice has only structural springs.
    #[error("a \"structural\" lattice resists no shear, so it has no Young's modulus: use \"shear\" or \"full\"")]
    NoShear,
    /// The mesh is a surface.
    #[error("the mesh is a surface: without tetrahedra it has no volume")]
    NoVolume,
    /// A tetrahedron is flat or inverted.
    #[error("tetrahedron {index} is flat or inverted: its volume is {volume:e} m³")]
    Flat {
        /// Index of the tetrahedron, from 0.
        index: usize,
        /// Volume of the tetrahedron, m³.
        volume: f64,
    },
    /// An edge belongs to no tetrahedron.
    #[error("the spring between nodes {} and {} belongs to no tetrahedron", nodes[0], nodes[1])]
    Loose {
        /// Nodes at the ends of the edge.
        nodes: [u32; 2],
    },
}

/// Filling of the body whose springs and masses are computed.
#[derive(Debug, Clone, Copy)]
pub enum Bulk<'a> {
    /// The cells of a block's lattice.
    Lattice(&'a Block),
    /// A mesh's tetrahedra.
    Tetrahedra(&'a Mesh),
    /// No filling: a surface, or layers of one.
    Shell,
}

impl Bulk<'_> {
    /// Returns k of every edge, N/m, for Young's modulus E in Pa. Lattices are isotropic, and take no identification.
    ///
    /// In a lattice of spacing a, a spring inside belongs to several cells, on the block's boundary to fewer: its
    /// stiffness is in proportion to the cells that exist. Any affine strain then has exactly the energy of the solid.
    ///
    /// # Errors
    /// If the mesh resists no shear, or is not filled with tetrahedra.
    ///
    /// ```
    /// use stickslip::model::material::{Bulk, Identification};
    /// use stickslip::model::mesh::{Block, Stencil};
    /// let block = Block { nodes: [3; 3], spacing: 0.01, stencil: Stencil::Shear };
    /// let stiffness = Bulk::Lattice(&block).stiffness(5e3, Identification::default()).expect("it resists shear");
    /// // 2Ea/5 inside; the first edge lies along an edge of the block.
    /// assert_eq!((stiffness.iter().fold(0.0, |a, b| b.max(a)), stiffness[0]), (20.0, 5.0));
    /// ```
    pub fn stiffness(&self, young_modulus: f64, identification: Identification) -> Result<Vec<f64>, MaterialError> {
        match self {
            Bulk::Lattice(block) => {
                let inside = lattice_stiffness(block.stencil, young_modulus * block.spacing)?;
                Ok(block
                    .edge_shares()
                    .map(|(axes, share)| share * inside[usize::from(axes).saturating_sub(1)])
                    .collect())
            }
            Bulk::Tetrahedra(mesh) => tetrahedral_stiffness(mesh, young_modulus, identification),
            Bulk::Shell => Err(MaterialError::NoVolume),
        }
    }

    /// Returns the volume that each node stands for, m³: an equal part of every cell or tetrahedron of which it is a
    /// corner.
    ///
    /// # Errors
    /// If the mesh is not filled with tetrahedra.
    pub fn node_volumes(&self) -> Result<Vec<f64>, MaterialError> {
        match self {
            Bulk::Lattice(block) => Ok(block.node_volumes()),
            Bulk::Tetrahedra(mesh) => {
                let mut volumes = vec![0.0; mesh.nodes.len()];
                for (corners, volume) in mesh.tetrahedra.iter().zip(tetrahedral_volumes(mesh)?) {
                    corners.iter().for_each(|&node| volumes[node as usize] += volume / 4.0);
                }
                Ok(volumes)
            }
            Bulk::Shell => Err(MaterialError::NoVolume),
        }
    }
}

/// Returns k of springs along edges, face diagonals and body diagonals inside a lattice, N/m, from E·a.
///
/// A cell has three of the first, six of the second, four of the third: with those k₁, k₂, k₃, a C₁₁ is k₁ + 2k₂ +
/// 4k₃/3 and a C₁₂ = a C₄₄ is k₂ + 4k₃/3. Isotropy requires C₁₁ = 3C₁₂, and C₄₄ = μ = 2E/5. Without body diagonals this
/// gives k₁ = k₂ = 2Ea/5; with them one choice is free, and here face and body diagonals contribute equally to μ.
fn lattice_stiffness(stencil: Stencil, ea: f64) -> Result<[f64; 3], MaterialError> {
    match stencil {
        Stencil::Structural => Err(MaterialError::NoShear),
        Stencil::Shear => Ok([0.4 * ea, 0.4 * ea, 0.0]),
        Stencil::Full => Ok([0.6 * ea, 0.2 * ea, 0.15 * ea]),
    }
}

fn tetrahedral_volumes(mesh: &Mesh) -> Result<Vec<f64>, MaterialError> {
    if mesh.tetrahedra.is_empty() {
        return Err(MaterialError::NoVolume);
    }
    let volumes: Vec<f64> = mesh.tetrahedra.iter().map(|corners| mesh.tetrahedron_volume(*corners)).collect();
    let mean = volumes.iter().map(|volume| volume.abs()).sum::<f64>() / volumes.len() as f64;
    match volumes.iter().position(|&volume| !(volume > FLAT * mean)) {
        Some(index) => Err(MaterialError::Flat { index, volume: volumes[index] }),
        None => Ok(volumes),
    }
}

fn tetrahedral_stiffness(
    mesh: &Mesh,
    young_modulus: f64,
    identification: Identification,
) -> Result<Vec<f64>, MaterialError> {
    let sorted = |[i, j]: [u32; 2]| (i.min(j), i.max(j));
    let edges: std::collections::HashMap<(u32, u32), usize> =
        mesh.edges.iter().enumerate().map(|(edge, &nodes)| (sorted(nodes), edge)).collect();
    let mut stiffness = vec![0.0; mesh.edges.len()];
    for (&[a, b, c, d], volume) in mesh.tetrahedra.iter().zip(tetrahedral_volumes(mesh)?) {
        for nodes in [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]] {
            let Some(&edge) = edges.get(&sorted(nodes)) else { continue };
            let along = mesh.nodes[nodes[1] as usize] - mesh.nodes[nodes[0] as usize];
            stiffness[edge] += young_modulus
                * match identification {
                    Identification::VanGelder => volume / along.norm_squared(),
                    Identification::Lloyd => 2.0 * 2.0_f64.sqrt() / 25.0 * along.norm(),
                };
        }
    }
    match stiffness.iter().position(|&k| !(k > 0.0)) {
        Some(edge) => Err(MaterialError::Loose { nodes: mesh.edges[edge] }),
        None => Ok(stiffness),
    }
}

/// Returns c of every edge, N·s/m: the fraction ζ of the critical damping of the two nodes on their spring,
/// c = 2ζ√(k m_ij) with 1/m_ij = 1/m_i + 1/m_j, whether a node is fixed or not.
///
/// The ratio ζ holds for that pair alone. In a network of equal springs and masses a mode of angular frequency ω has
/// the damping ratio ζω√(m/2k): far less for the slowest mode, two or three times ζ for the fastest.
///
/// ```
/// use stickslip::{Vec3, model::{material::pair_damping, mesh::Mesh}};
///
/// let mesh = Mesh { nodes: vec![Vec3::zeros(), Vec3::x()], edges: vec![[0, 1]], ..Mesh::default() };
/// let c = pair_damping(&mesh, &100.0.into(), &[1.0, 3.0], 0.5)[0];
/// // Half of the critical damping of two masses on a spring: c² = 4k m₁m₂/(m₁ + m₂).
/// assert!((c - 0.5 * (4.0 * 100.0 * 0.75_f64).sqrt()).abs() < 1e-14);
/// ```
pub fn pair_damping(mesh: &Mesh, stiffness: &PerSpring, node_mass: &[f64], ratio: f64) -> Vec<f64> {
    let damping = |(edge, &[i, j]): (usize, &[u32; 2])| {
        let [mi, mj] = [i, j].map(|node| node_mass[node as usize]);
        2.0 * ratio * (stiffness.at(edge) * (mi * mj / (mi + mj))).sqrt()
    };
    mesh.edges.iter().enumerate().map(damping).collect()
}
