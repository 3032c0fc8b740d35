//! How well springs from Young's modulus stand for the elastic solid: blocks of lattice cells and of tetrahedra, in
//! loads whose answer in the solid is known. Small displacements; what a network cannot have is any Poisson's ratio but
//! 1/4, so the solid is that of 1/4.

use std::f64::consts::PI;

use serde::Serialize;
use thiserror::Error;

use super::tetrahedral_block::{five_tetrahedra, six_tetrahedra, tetrahedral_block};
use crate::Vec3;
use crate::dynamics::statics::Statics;
use crate::model::material::{Bulk, Identification, MaterialError, POISSON_RATIO, PerSpring};
use crate::model::mesh::{Block, Stencil};
use crate::model::network::{Material, Network, NetworkError};
use crate::model::springs::TangentKind;

/// E, Pa; displacements are linear in everything, so that its value does not matter.
const YOUNG_MODULUS: f64 = 5e3;
/// Side of a bar, half width and depth of what is indented, m.
const SIZE: f64 = 0.1;
/// Length of a bar over its side.
const SLENDERNESS: usize = 2;
/// kg/m³ and m/s², for a bar's own weight.
const DENSITY: f64 = 1e3;
const GRAVITY: f64 = 9.81;
/// N, of the indentation.
const FORCE: f64 = 1.0;
/// Where the indentation is read: between these shares of the half width.
const READ: [f64; 2] = [0.25, 0.5];

/// How a block is filled.
///
/// ```
/// use stickslip::model::material::Identification;
/// use stickslip::verify::elasticity::{Filling, Quantity, measure, table};
///
/// // Springs of a lattice are exact where the strain is the same everywhere. Those of tetrahedra have a choice.
/// let exact = measure(Quantity::YoungModulus, Filling::Shear, Identification::default(), 2)?;
/// assert!(exact.relative_error.abs() < 1e-12 && exact.identification.is_none());
/// assert_eq!(Filling::ALL.map(|filling| filling.identifications().len()), [1, 1, 2, 2, 2, 2]);
/// let table = table(2)?;
/// assert_eq!(table.len(), (1 + 1 + 2 + 2 + 2 + 2) * Quantity::ALL.len());
/// let is_of = |filling: Filling| table.iter().filter(|row| row.filling == filling.name()).count();
/// assert_eq!(is_of(Filling::Full), Quantity::ALL.len());
/// # Ok::<(), stickslip::verify::elasticity::ElasticityError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filling {
    /// By lattice cells with face diagonals.
    Shear,
    /// By lattice cells with face and body diagonals.
    Full,
    /// By five tetrahedra a cell, mirrored from cell to cell; nodes moved at random by up to this share of the spacing,
    /// on the boundary within it.
    FiveTetrahedra {
        /// 0 for none; one that turns a tetrahedron inside out is refused.
        jitter: f64,
    },
    /// By six tetrahedra a cell, around the same diagonal everywhere.
    SixTetrahedra {
        /// As above.
        jitter: f64,
    },
}

impl Filling {
    /// What is compared.
    pub const ALL: [Self; 6] = [
        Self::Shear,
        Self::Full,
        Self::FiveTetrahedra { jitter: 0.0 },
        Self::FiveTetrahedra { jitter: 0.12 },
        Self::SixTetrahedra { jitter: 0.0 },
        Self::SixTetrahedra { jitter: 0.12 },
    ];

    /// For people.
    pub fn name(self) -> String {
        let tetrahedra = |count: &str, jitter: f64| {
            if jitter == 0.0 { format!("{count} tetrahedra") } else { format!("{count} tetrahedra, jitter {jitter}") }
        };
        match self {
            Filling::Shear => "lattice, shear".to_owned(),
            Filling::Full => "lattice, full".to_owned(),
            Filling::FiveTetrahedra { jitter } => tetrahedra("five", jitter),
            Filling::SixTetrahedra { jitter } => tetrahedra("six", jitter),
        }
    }

    /// Those that make a difference to its springs.
    pub fn identifications(self) -> &'static [Identification] {
        match self {
            Filling::Shear | Filling::Full => &Identification::ALL[..1],
            Filling::FiveTetrahedra { .. } | Filling::SixTetrahedra { .. } => &Identification::ALL,
        }
    }
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Young's modulus, Pa: the force on a bar pulled by its ends, which are free to contract, FL/(AΔL).
    YoungModulus,
    /// −(strain across)/(strain along) of the same bar.
    PoissonRatio,
    /// How far the lower end of a bar comes down that hangs by its upper one, m: ρgL²/2E.
    Sag,
    /// Pressure over strain of a block between slippery walls, Pa: E(1 − ν)/((1 + ν)(1 − 2ν)).
    ConfinedModulus,
    /// Force over area and angle of a block whose whole boundary is sheared, Pa: E/2(1 + ν).
    ShearModulus,
    /// Settlement u of the surface beside a point force F as u r/F, m²/N, which is (1 − ν²)/(πE) everywhere
    /// (J. Boussinesq, 1885): the mean over nodes between a quarter and half of the way to the sides. Bottom and sides
    /// are moved as the half-space is there, so that what is left is of the mesh; they also take away a part of what a
    /// wrong E would do.
    Indentation,
}

impl Quantity {
    /// All.
    pub const ALL: [Self; 6] = [
        Self::YoungModulus,
        Self::PoissonRatio,
        Self::Sag,
        Self::ConfinedModulus,
        Self::ShearModulus,
        Self::Indentation,
    ];

    /// In the elastic solid, in its unit.
    pub fn expected(self) -> f64 {
        let (e, nu) = (YOUNG_MODULUS, POISSON_RATIO);
        let length = SLENDERNESS as f64 * SIZE;
        match self {
            Quantity::YoungModulus => e,
            Quantity::PoissonRatio => nu,
            Quantity::Sag => DENSITY * GRAVITY * length * length / (2.0 * e),
            Quantity::ConfinedModulus => e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            Quantity::ShearModulus => e / (2.0 * (1.0 + nu)),
            Quantity::Indentation => (1.0 - nu * nu) / (PI * e),
        }
    }
}

/// A quantity of one mesh.
#[derive(Debug, Clone, Serialize)]
pub struct ElasticityRow {
    /// What is measured.
    pub quantity: Quantity,
    /// How the block is filled.
    pub filling: String,
    /// How its springs are told from Young's modulus; none where that is exact.
    pub identification: Option<&'static str>,
    /// Cells along the side.
    pub cells: usize,
    /// Of the solid.
    pub expected: f64,
    /// Of the network, in the same unit.
    pub measured: f64,
    /// measured / expected − 1.
    pub relative_error: f64,
}

/// Why a quantity was not measured.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ElasticityError {
    /// Springs or masses cannot be had.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// They do not fit the block.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The network can move without a force.
    #[error("the network has no stable equilibrium under this load")]
    Unstable,
}

/// Every quantity of every filling by every identification, in blocks with so many cells along their side.
///
/// # Errors
/// As [`measure`].
pub fn table(cells: usize) -> Result<Vec<ElasticityRow>, ElasticityError> {
    let mut rows = Vec::new();
    for filling in Filling::ALL {
        for &identification in filling.identifications() {
            for quantity in Quantity::ALL {
                rows.push(measure(quantity, filling, identification, cells)?);
            }
        }
    }
    Ok(rows)
}

/// One quantity of a block with so many cells along its side.
///
/// # Errors
/// If the block cannot be filled so, or does not resist.
pub fn measure(
    quantity: Quantity,
    filling: Filling,
    identification: Identification,
    cells: usize,
) -> Result<ElasticityRow, ElasticityError> {
    let length = match quantity {
        Quantity::YoungModulus | Quantity::PoissonRatio | Quantity::Sag => SLENDERNESS * cells,
        Quantity::ConfinedModulus | Quantity::ShearModulus | Quantity::Indentation => cells,
    };
    let body = Body::new(filling, identification, [cells, cells, length])?;
    let measured = match quantity {
        Quantity::YoungModulus => body.pulled()?.0,
        Quantity::PoissonRatio => body.pulled()?.1,
        Quantity::Sag => body.sag()?,
        Quantity::ConfinedModulus => body.strained(|x| Vec3::z() * x.z, |on| on)?,
        Quantity::ShearModulus => body.strained(|x| Vec3::x() * x.z, |on| [on.contains(&true); 3])?,
        Quantity::Indentation => body.indented()?,
    };
    let expected = quantity.expected();
    Ok(ElasticityRow {
        quantity,
        filling: filling.name(),
        identification: (filling.identifications().len() > 1).then_some(identification.name()),
        cells,
        expected,
        measured,
        relative_error: measured / expected - 1.0,
    })
}

/// A block with one corner at the origin, below z = 0 and beside x = 0 and y = 0.
struct Body {
    block: Block,
    network: Network,
}

/// Displacements that are given, for each component of each node.
type Given = Vec<[Option<f64>; 3]>;

impl Body {
    fn new(filling: Filling, identification: Identification, cells: [usize; 3]) -> Result<Self, ElasticityError> {
        let stencil = if filling == Filling::Full { Stencil::Full } else { Stencil::Shear };
        let block = Block { nodes: cells.map(|cells| cells + 1), spacing: SIZE / cells[0] as f64, stencil };
        let mut mesh = match filling {
            Filling::Shear | Filling::Full => block.mesh(),
            Filling::FiveTetrahedra { jitter } => tetrahedral_block(&block, five_tetrahedra, jitter),
            Filling::SixTetrahedra { jitter } => tetrahedral_block(&block, six_tetrahedra, jitter),
        };
        mesh.nodes.iter_mut().for_each(|x| *x += Vec3::new(0.5, 0.5, 0.0) * SIZE);
        let bulk = match filling {
            Filling::Shear | Filling::Full => Bulk::Lattice(&block),
            Filling::FiveTetrahedra { .. } | Filling::SixTetrahedra { .. } => Bulk::Tetrahedra(&mesh),
        };
        let material = Material {
            node_mass: bulk.node_volumes()?.iter().map(|volume| DENSITY * volume).collect(),
            stiffness: PerSpring::Each(bulk.stiffness(YOUNG_MODULUS, identification)?),
            damping: PerSpring::Same(0.0),
            drag: 0.0,
            gravity: Vec3::zeros(),
        };
        let network = Network::new(&mesh, &material, vec![false; mesh.nodes.len()])?;
        Ok(Self { block, network })
    }

    fn length(&self) -> f64 {
        self.block.spacing * (self.block.nodes[2] - 1) as f64
    }

    /// Nodes with their rest positions, and on which of x = 0, y = 0, z = −length and of x = y = SIZE, z = 0 they are.
    fn nodes(&self) -> impl Iterator<Item = (Vec3, [bool; 3], [bool; 3])> + '_ {
        self.network.rest.iter().enumerate().map(|(node, &x)| {
            let at = self.block.lattice(node);
            let last = |axis: usize| at[axis] + 1 == self.block.nodes[axis];
            (x, at.map(|i| i == 0), [last(0), last(1), last(2)])
        })
    }

    /// What keeps a bar from moving and turning sideways without a force: two nodes of its lower end.
    fn upright(&self) -> Given {
        let mut given = vec![[None; 3]; self.network.node_count()];
        given[0] = [Some(0.0), Some(0.0), None];
        given[self.block.nodes[0] - 1][1] = Some(0.0);
        given
    }

    /// Displacements in equilibrium with loads, N.
    fn solve(&self, given: &Given, mut load: Vec<Vec3>) -> Result<Vec<Vec3>, ElasticityError> {
        let imposed: Vec<Vec3> = given.iter().map(|node| Vec3::from(node.map(|value| value.unwrap_or(0.0)))).collect();
        for (load, force) in load.iter_mut().zip(self.forces(&imposed)) {
            *load += force;
        }
        let mut statics = Statics::new(given.iter().map(|node| node.map(|value| value.is_some())));
        let answer = statics.displacements(&self.network, &self.network.rest, TangentKind::Exact, 0.0, &load);
        let answer = answer.ok_or(ElasticityError::Unstable)?;
        Ok(imposed.iter().zip(answer).map(|(imposed, u)| imposed + u).collect())
    }

    /// Of the springs on the nodes, N, for small displacements.
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

    /// Young's modulus and Poisson's ratio.
    fn pulled(&self) -> Result<(f64, f64), ElasticityError> {
        let mut given = self.upright();
        for (given, (_, first, last)) in given.iter_mut().zip(self.nodes()) {
            if first[2] || last[2] {
                given[2] = Some(if last[2] { self.length() } else { 0.0 });
            }
        }
        let u = self.solve(&given, self.unloaded())?;
        let pull: f64 = self.forces(&u).iter().zip(self.nodes()).filter(|(_, node)| node.2[2]).map(|(f, _)| -f.z).sum();
        // Least squares of the displacement across over the place across.
        let slope = |axis: usize| {
            let centred = || self.network.rest.iter().zip(&u).map(|(x, u)| (x[axis] - 0.5 * SIZE, u[axis]));
            let mean = |of: fn((f64, f64)) -> f64| centred().map(of).sum::<f64>() / u.len() as f64;
            let (x, u) = (mean(|(x, _)| x), mean(|(_, u)| u));
            (mean(|(x, u)| x * u) - x * u) / (mean(|(x, _)| x * x) - x * x)
        };
        Ok((pull / (SIZE * SIZE), -0.5 * (slope(0) + slope(1))))
    }

    fn sag(&self) -> Result<f64, ElasticityError> {
        let mut given = self.upright();
        given.iter_mut().zip(self.nodes()).filter(|(_, node)| node.2[2]).for_each(|(given, _)| given[2] = Some(0.0));
        let mass = &self.network.mass;
        let u = self.solve(&given, mass.iter().map(|mass| Vec3::z() * (-mass * GRAVITY)).collect())?;
        let lower = || u.iter().zip(mass).zip(self.nodes()).filter(|(_, node)| node.1[2]).map(|(node, _)| node);
        Ok(-lower().map(|(u, mass)| u.z * mass).sum::<f64>() / lower().map(|(_, mass)| mass).sum::<f64>())
    }

    /// Twice the energy over the volume, J/m³, where components on the boundary are displaced in a strain of one, and
    /// the rest finds its place.
    fn strained(
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
        Ok(work / (SIZE * SIZE * self.length()))
    }

    /// A quarter of the half-space, whose cuts x = 0 and y = 0 are mirrors.
    fn indented(&self) -> Result<f64, ElasticityError> {
        let given = self.nodes().map(|(x, first, last)| {
            if last[0] || last[1] || first[2] {
                boussinesq(x)
            } else {
                [first[0].then_some(0.0), first[1].then_some(0.0), None]
            }
        });
        let [nx, ny, nz] = self.block.nodes;
        let mut load = self.unloaded();
        load[(nz - 1) * ny * nx] = Vec3::z() * (-FORCE / 4.0);
        let u = self.solve(&given.collect(), load)?;
        let read = u
            .iter()
            .zip(self.nodes())
            .filter(|(_, (x, _, last))| last[2] && (READ[0]..=READ[1]).contains(&(x.norm() / SIZE)));
        let (count, sum) =
            read.fold((0.0, 0.0), |(count, sum), (u, (x, ..))| (count + 1.0, sum - u.z * x.norm() / FORCE));
        Ok(sum / count)
    }
}

/// Displacement of the half-space below z = 0 under a force down at the origin, m (J. Boussinesq, 1885; in this form
/// K. L. Johnson, Contact Mechanics, 1985, 3.2).
fn boussinesq(x: Vec3) -> [Option<f64>; 3] {
    let (depth, r, distance) = (-x.z, x.x.hypot(x.y), x.norm());
    let shear = YOUNG_MODULUS / (2.0 * (1.0 + POISSON_RATIO));
    let scale = FORCE / (4.0 * PI * shear);
    let down = depth * depth / distance.powi(3) + 2.0 * (1.0 - POISSON_RATIO) / distance;
    let outwards = r * depth / distance.powi(3) - (1.0 - 2.0 * POISSON_RATIO) * r / (distance * (distance + depth));
    let across = if r > 0.0 { scale * outwards / r } else { 0.0 };
    [Some(across * x.x), Some(across * x.y), Some(-scale * down)]
}
