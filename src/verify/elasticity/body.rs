//! Block or bar of springs, with its supports, its loads and the quantities measured on it.

use std::f64::consts::PI;
use std::path::Path;

use super::{DENSITY, ElasticityError, FORCE, Filling, GMSH_CELLS, GRAVITY, READ, SIZE, YOUNG_MODULUS};
use crate::Vec3;
use crate::dynamics::statics::Statics;
use crate::mesh_file::MeshFile;
use crate::model::material::{Bulk, Identification, POISSON_RATIO, PerSpring};
use crate::model::mesh::{Block, Mesh, Stencil};
use crate::model::network::{Material, Network};
use crate::model::springs::TangentKind;
use crate::verify::tetrahedral_block::{five_tetrahedra, six_tetrahedra, tetrahedral_block};

/// Largest distance of a node on a face from it, over the side.
const ON_FACE: f64 = 1e-9;
/// Memory limit for a bar's file, bytes.
const BUDGET: u64 = 1 << 26;

/// Bars by cells along the side; `reference/meshes/make.py` makes them.
const BARS: [(usize, &[u8]); 3] = [
    (GMSH_CELLS[0], include_bytes!("../../../fixtures/meshes/bar-4.msh")),
    (GMSH_CELLS[1], include_bytes!("../../../fixtures/meshes/bar-6.msh")),
    (GMSH_CELLS[2], include_bytes!("../../../fixtures/meshes/bar-8.msh")),
];

/// Block with one corner at the origin, below z = 0 and on the positive sides of x = 0 and y = 0.
pub(super) struct Body {
    network: Network,
    /// Length, m.
    length: f64,
}

/// Prescribed displacements, for each component of each node.
pub(super) type Given = Vec<[Option<f64>; 3]>;

impl Body {
    /// Builds a block with `cells` cells along its side and a length of `sides` sides.
    pub(super) fn new(
        filling: Filling,
        identification: Identification,
        cells: usize,
        sides: usize,
    ) -> Result<Self, ElasticityError> {
        let block =
            |stencil| Block { nodes: [cells + 1, cells + 1, sides * cells + 1], spacing: SIZE / cells as f64, stencil };
        let of_cells = |stencil| {
            let block = block(stencil);
            Self::filled(&at_origin(block.mesh()), Bulk::Lattice(&block), identification)
        };
        let of_tetrahedra = |mesh: Mesh| Self::filled(&mesh, Bulk::Tetrahedra(&mesh), identification);
        match filling {
            Filling::Shear => of_cells(Stencil::Shear),
            Filling::Full => of_cells(Stencil::Full),
            Filling::FiveTetrahedra { jitter } => {
                of_tetrahedra(at_origin(tetrahedral_block(&block(Stencil::Shear), five_tetrahedra, jitter)))
            }
            Filling::SixTetrahedra { jitter } => {
                of_tetrahedra(at_origin(tetrahedral_block(&block(Stencil::Shear), six_tetrahedra, jitter)))
            }
            Filling::Gmsh => of_tetrahedra(bar(cells)?),
        }
    }

    /// Builds a block of lattice cells twice as wide as deep around the origin, the middle of its top, with `cells` cells along
    /// its depth, and returns it with its mesh.
    pub(super) fn half_space(cells: usize) -> Result<(Self, Mesh), ElasticityError> {
        let nodes = [2 * cells + 1, 2 * cells + 1, cells + 1];
        let block = Block { nodes, spacing: SIZE / cells as f64, stencil: Stencil::Shear };
        let mesh = block.mesh();
        Ok((Self::filled(&mesh, Bulk::Lattice(&block), Identification::default())?, mesh))
    }

    fn filled(mesh: &Mesh, bulk: Bulk, identification: Identification) -> Result<Self, ElasticityError> {
        let material = Material {
            node_mass: bulk.node_volumes()?.iter().map(|volume| DENSITY * volume).collect(),
            stiffness: PerSpring::Each(bulk.stiffness(YOUNG_MODULUS, identification)?),
            damping: PerSpring::Same(0.0),
            drag: 0.0,
            gravity: Vec3::zeros(),
        };
        let length = mesh.nodes.iter().map(|x| -x.z).fold(0.0, f64::max);
        Ok(Self { network: Network::new(mesh, &material, vec![false; mesh.nodes.len()])?, length })
    }

    pub(super) fn node_count(&self) -> usize {
        self.network.node_count()
    }

    /// Returns nodes with rest positions, and whether each is on x = 0, y = 0, z = −length and on x = y = SIZE, z = 0.
    fn nodes(&self) -> impl Iterator<Item = (Vec3, [bool; 3], [bool; 3])> + '_ {
        let on = |value: f64, face: f64| (value - face).abs() <= ON_FACE * SIZE;
        self.network.rest.iter().map(move |&x| {
            let first = [on(x.x, 0.0), on(x.y, 0.0), on(x.z, -self.length)];
            (x, first, [on(x.x, SIZE), on(x.y, SIZE), on(x.z, 0.0)])
        })
    }

    /// Returns supports that keep a bar from moving and turning sideways without a force: two nodes of its lower end.
    fn upright(&self) -> Given {
        self.nodes()
            .map(|(_, first, last)| match (first, last[0]) {
                ([true, true, true], _) => [Some(0.0), Some(0.0), None],
                ([_, true, true], true) => [None, Some(0.0), None],
                _ => [None; 3],
            })
            .collect()
    }

    /// Solves for the displacements in equilibrium with loads, N.
    pub(super) fn solve(&self, given: &Given, mut load: Vec<Vec3>) -> Result<Vec<Vec3>, ElasticityError> {
        let imposed: Vec<Vec3> = given.iter().map(|node| Vec3::from(node.map(|value| value.unwrap_or(0.0)))).collect();
        for (load, force) in load.iter_mut().zip(self.forces(&imposed)) {
            *load += force;
        }
        let mut statics = Statics::new(given.iter().map(|node| node.map(|value| value.is_some())));
        let answer = statics.displacements(&self.network, &self.network.rest, TangentKind::Exact, 0.0, &load);
        let answer = answer.map_err(|_| ElasticityError::Unstable)?;
        Ok(imposed.iter().zip(answer).map(|(imposed, u)| imposed + u).collect())
    }

    /// Returns the springs' forces on the nodes for small displacements, N.
    fn forces(&self, u: &[Vec3]) -> Vec<Vec3> {
        let rest = &self.network.rest;
        let mut forces = vec![Vec3::zeros(); u.len()];
        for spring in self.network.springs.iter() {
            let [i, j] = spring.nodes.map(|node| node as usize);
            let (k, _) = spring.jacobian(rest[j] - rest[i], Vec3::zeros(), TangentKind::Exact);
            let force = k * (u[j] - u[i]);
            forces[i] += force;
            forces[j] -= force;
        }
        forces
    }

    fn unloaded(&self) -> Vec<Vec3> {
        vec![Vec3::zeros(); self.network.node_count()]
    }

    /// Measures Young's modulus and Poisson's ratio.
    pub(super) fn pulled(&self) -> Result<(f64, f64), ElasticityError> {
        let mut given = self.upright();
        for (given, (_, first, last)) in given.iter_mut().zip(self.nodes()) {
            if first[2] || last[2] {
                given[2] = Some(if last[2] { self.length } else { 0.0 });
            }
        }
        let u = self.solve(&given, self.unloaded())?;
        let pull: f64 = self.forces(&u).iter().zip(self.nodes()).filter(|(_, node)| node.2[2]).map(|(f, _)| -f.z).sum();
        // Least-squares slope of the lateral displacement over the lateral position.
        let slope = |axis: usize| {
            let centred = || self.network.rest.iter().zip(&u).map(|(x, u)| (x[axis] - 0.5 * SIZE, u[axis]));
            let mean = |of: fn((f64, f64)) -> f64| centred().map(of).sum::<f64>() / u.len() as f64;
            let (x, u) = (mean(|(x, _)| x), mean(|(_, u)| u));
            (mean(|(x, u)| x * u) - x * u) / (mean(|(x, _)| x * x) - x * x)
        };
        Ok((pull / (SIZE * SIZE), -0.5 * (slope(0) + slope(1))))
    }

    pub(super) fn sag(&self) -> Result<f64, ElasticityError> {
        let mut given = self.upright();
        given.iter_mut().zip(self.nodes()).filter(|(_, node)| node.2[2]).for_each(|(given, _)| given[2] = Some(0.0));
        let mass = &self.network.mass;
        let u = self.solve(&given, mass.iter().map(|mass| Vec3::z() * (-mass * GRAVITY)).collect())?;
        let lower = || u.iter().zip(mass).zip(self.nodes()).filter(|(_, node)| node.1[2]).map(|(node, _)| node);
        Ok(-lower().map(|(u, mass)| u.z * mass).sum::<f64>() / lower().map(|(_, mass)| mass).sum::<f64>())
    }

    /// Returns twice the energy over the volume, J/m³, with boundary components displaced by a unit strain and the rest
    /// in equilibrium.
    pub(super) fn strained(
        &self,
        displacement: impl Fn(Vec3) -> Vec3,
        held: impl Fn([bool; 3]) -> [bool; 3],
    ) -> Result<f64, ElasticityError> {
        let given = self.nodes().map(|(x, first, last)| {
            let u = displacement(x);
            let held = held([0, 1, 2].map(|axis| first[axis] || last[axis]));
            [0, 1, 2].map(|axis| held[axis].then_some(u[axis]))
        });
        let u = self.solve(&given.collect(), self.unloaded())?;
        let work: f64 = self.forces(&u).iter().zip(&u).map(|(force, u)| -force.dot(u)).sum();
        Ok(work / (SIZE * SIZE * self.length))
    }

    /// Measures the indentation on a quarter of the half-space, with mirror planes x = 0 and y = 0.
    pub(super) fn indented(&self) -> Result<f64, ElasticityError> {
        let given = self.nodes().map(|(x, first, last)| {
            if last[0] || last[1] || first[2] {
                boussinesq(x).map(Some).into()
            } else {
                [first[0].then_some(0.0), first[1].then_some(0.0), None]
            }
        });
        let pushed = |first: [bool; 3], last: [bool; 3]| first[0] && first[1] && last[2];
        let load = |(_, first, last)| if pushed(first, last) { Vec3::z() * (-FORCE / 4.0) } else { Vec3::zeros() };
        let load = self.nodes().map(load).collect();
        let u = self.solve(&given.collect(), load)?;
        let read = u
            .iter()
            .zip(self.nodes())
            .filter(|(_, (x, _, last))| last[2] && (READ[0]..=READ[1]).contains(&(x.norm() / SIZE)));
        let (count, sum) =
            read.fold((0.0, 0.0), |(count, sum), (u, (x, ..))| (count + 1.0, sum - u.z * x.norm() / FORCE));
        if count > 0.0 { Ok(sum / count) } else { Err(ElasticityError::NothingToRead) }
    }
}

/// Returns the displacement of the half-space z < 0 under a downward force at the origin, m (J. Boussinesq, 1885; in
/// this form K. L. Johnson, Contact Mechanics, 1985, 3.2).
pub(super) fn boussinesq(x: Vec3) -> Vec3 {
    let (depth, r, distance) = (-x.z, x.x.hypot(x.y), x.norm());
    let shear = YOUNG_MODULUS / (2.0 * (1.0 + POISSON_RATIO));
    let scale = FORCE / (4.0 * PI * shear);
    let down = depth * depth / distance.powi(3) + 2.0 * (1.0 - POISSON_RATIO) / distance;
    let outwards = r * depth / distance.powi(3) - (1.0 - 2.0 * POISSON_RATIO) * r / (distance * (distance + depth));
    let across = if r > 0.0 { scale * outwards / r } else { 0.0 };
    Vec3::new(across * x.x, across * x.y, -scale * down)
}

/// Moves a mesh to the place of the blocks.
fn at_origin(mut mesh: Mesh) -> Mesh {
    mesh.nodes.iter_mut().for_each(|x| *x += Vec3::new(0.5, 0.5, 0.0) * SIZE);
    mesh
}

fn bar(cells: usize) -> Result<Mesh, ElasticityError> {
    let (_, bytes) = BARS.iter().find(|(of, _)| *of == cells).ok_or(ElasticityError::NoBar(cells))?;
    let file = MeshFile::parse(bytes, Path::new("bar.msh"), BUDGET)?;
    Ok(file.solid(1.0)?.mesh)
}
