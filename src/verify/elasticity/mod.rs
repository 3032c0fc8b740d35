//! Comparison of springs from Young's modulus with the elastic solid: blocks of lattice cells and of tetrahedra, and
//! bars meshed by Gmsh, in load cases whose solution in the solid is known. Displacements are small. Such a network
//! cannot have a Poisson's ratio other than 1/4, so that of the solid is 1/4.

mod body;
pub mod disc;

use std::f64::consts::PI;

use serde::Serialize;
use thiserror::Error;

use self::body::Body;
use crate::Vec3;
use crate::mesh_file::MeshFileError;
use crate::model::material::{Identification, MaterialError, POISSON_RATIO};
use crate::model::network::NetworkError;
use crate::model::topology::SurfaceError;
use crate::surface::disc::DiscError;

/// Young's modulus E, Pa; displacements are linear in everything, so its value does not matter.
const YOUNG_MODULUS: f64 = 5e3;
/// Side of a bar; half width and depth of the indented block, m.
const SIZE: f64 = 0.1;
/// Length of a bar over its side.
const SLENDERNESS: usize = 2;
/// Density, kg/m³, and gravity, m/s², of a bar under its own weight.
const DENSITY: f64 = 1e3;
const GRAVITY: f64 = 9.81;
/// Force of the indentation, N.
const FORCE: f64 = 1.0;
/// Range over the half width in which the indentation is read.
const READ: [f64; 2] = [0.25, 0.5];

/// Mesh of a block.
///
/// ```
/// use stickslip::model::material::Identification;
/// use stickslip::verify::elasticity::{Filling, Quantity, measure, table};
///
/// // Springs of a lattice are exact where the strain is the same everywhere. Those of tetrahedra have a choice.
/// let exact = measure(Quantity::YoungModulus, Filling::Shear, Identification::default(), 2)?;
/// assert!(exact.relative_error.abs() < 1e-12 && exact.identification.is_none());
/// assert_eq!(Filling::ALL.map(|filling| filling.identifications().len()), [1, 1, 2, 2, 2, 2, 2]);
/// assert!(Filling::Gmsh.is_made_with(8) && !Filling::Gmsh.is_made_with(2));
/// let table = table(&[4])?;
/// assert_eq!(table.len(), (1 + 1 + 5 * 2) * Quantity::ALL.len());
/// let is_of = |filling: Filling| table.iter().filter(|row| row.filling == filling.name()).count();
/// assert_eq!(is_of(Filling::Full), Quantity::ALL.len());
/// // Between a quarter and half of one cell there is no node beside the point load.
/// assert!(measure(Quantity::Indentation, Filling::Shear, Identification::default(), 1).is_err());
/// # Ok::<(), stickslip::verify::elasticity::ElasticityError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filling {
    /// Lattice cells with face diagonals.
    Shear,
    /// Lattice cells with face and body diagonals.
    Full,
    /// Five tetrahedra a cell, mirrored from cell to cell; nodes are moved at random by up to this share of the
    /// spacing, those on the boundary within it.
    FiveTetrahedra {
        /// Largest displacement over the spacing, 0 for none; one that inverts a tetrahedron is refused.
        jitter: f64,
    },
    /// Six tetrahedra a cell, around the same diagonal in every cell.
    SixTetrahedra {
        /// Largest displacement over the spacing, as for five tetrahedra.
        jitter: f64,
    },
    /// Tetrahedra of a bar meshed by Gmsh, with edges about as long as a cell. The bar is always twice
    /// as long as wide, and there is one for each of [`GMSH_CELLS`] only.
    Gmsh,
}

/// Numbers of cells along the side for which there are bars by Gmsh.
pub const GMSH_CELLS: [usize; 3] = [4, 6, 8];

impl Filling {
    /// Fillings that are compared.
    pub const ALL: [Self; 7] = [
        Self::Shear,
        Self::Full,
        Self::FiveTetrahedra { jitter: 0.0 },
        Self::FiveTetrahedra { jitter: 0.12 },
        Self::SixTetrahedra { jitter: 0.0 },
        Self::SixTetrahedra { jitter: 0.12 },
        Self::Gmsh,
    ];

    /// Returns the name as it is printed.
    pub fn name(self) -> String {
        let tetrahedra = |count: &str, jitter: f64| {
            if jitter == 0.0 { format!("{count} tetrahedra") } else { format!("{count} tetrahedra, jitter {jitter}") }
        };
        match self {
            Filling::Shear => "lattice, shear".to_owned(),
            Filling::Full => "lattice, full".to_owned(),
            Filling::FiveTetrahedra { jitter } => tetrahedra("five", jitter),
            Filling::SixTetrahedra { jitter } => tetrahedra("six", jitter),
            Filling::Gmsh => "Gmsh".to_owned(),
        }
    }

    /// Returns the identifications that give different springs in this filling.
    pub fn identifications(self) -> &'static [Identification] {
        match self {
            Filling::Shear | Filling::Full => &Identification::ALL[..1],
            Filling::FiveTetrahedra { .. } | Filling::SixTetrahedra { .. } | Filling::Gmsh => &Identification::ALL,
        }
    }

    /// Returns whether there is such a block with this number of cells along its side.
    pub fn is_made_with(self, cells: usize) -> bool {
        self != Filling::Gmsh || GMSH_CELLS.contains(&cells)
    }
}

/// Measured quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Young's modulus, Pa: FL/(AΔL) of a bar pulled by its ends, which are free to contract.
    YoungModulus,
    /// Poisson's ratio of the same bar: −(lateral strain)/(axial strain).
    PoissonRatio,
    /// Displacement of the lower end of a bar that hangs by its upper end, m: ρgL²/2E.
    Sag,
    /// Pressure over strain of a block between frictionless walls, Pa: E(1 − ν)/((1 + ν)(1 − 2ν)).
    ConfinedModulus,
    /// Force over area and angle of a block whose whole boundary is sheared, Pa: E/2(1 + ν).
    ShearModulus,
    /// Settlement u of the surface beside a point force F as u r/F, m²/N, which is (1 − ν²)/(πE) everywhere
    /// (J. Boussinesq, 1885): the mean over nodes between a quarter and half of the way to the sides. Bottom and sides
    /// have the half-space's displacements, so that the remaining error is the mesh's; they also hide a part of the
    /// effect of a wrong E.
    Indentation,
}

impl Quantity {
    /// All quantities.
    pub const ALL: [Self; 6] = [
        Self::YoungModulus,
        Self::PoissonRatio,
        Self::Sag,
        Self::ConfinedModulus,
        Self::ShearModulus,
        Self::Indentation,
    ];

    /// Returns the value in the elastic solid, in the quantity's unit.
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

/// One quantity of one mesh.
#[derive(Debug, Clone, Serialize)]
pub struct ElasticityRow {
    /// Measured quantity.
    pub quantity: Quantity,
    /// How the block is filled.
    pub filling: String,
    /// Identification of the springs from Young's modulus; none where they are exact.
    pub identification: Option<&'static str>,
    /// Cells along the side.
    pub cells: usize,
    /// Number of nodes of the whole block or bar.
    pub nodes: usize,
    /// Value of the elastic solid.
    pub expected: f64,
    /// Value of the network, in the same unit.
    pub measured: f64,
    /// Relative error, measured / expected − 1.
    pub relative_error: f64,
}

/// Why a quantity could not be measured.
#[derive(Debug, Error)]
pub enum ElasticityError {
    /// No bar by Gmsh has this number of cells.
    #[error("there is no bar by Gmsh with {0} cells along its side")]
    NoBar(usize),
    /// The bar's mesh file is damaged.
    #[error(transparent)]
    File(#[from] MeshFileError),
    /// No springs or masses can be identified.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// The springs or masses do not fit the block.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// No node lies where the indentation is read: there are too few cells.
    #[error("no node lies where the indentation is read; give more cells")]
    NothingToRead,
    /// The mesh has no proper surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The contact cannot be spread over the disc.
    #[error(transparent)]
    Disc(#[from] DiscError),
    /// The network can move without a force.
    #[error("the network has no stable equilibrium under this load")]
    Unstable,
}

/// Measures every quantity of every filling by every identification, for each number of cells along the side: rows of
/// one mesh, and meshes of one kind, are together, in the given order. A filling that does not exist with a number of
/// cells is omitted.
///
/// # Errors
/// If a measurement fails ([`measure`]).
pub fn table(cells: &[usize]) -> Result<Vec<ElasticityRow>, ElasticityError> {
    let mut rows = Vec::new();
    for filling in Filling::ALL {
        for &identification in filling.identifications() {
            for &cells in cells.iter().filter(|&&cells| filling.is_made_with(cells)) {
                for quantity in Quantity::ALL {
                    rows.push(measure(quantity, filling, identification, cells)?);
                }
            }
        }
    }
    Ok(rows)
}

/// Measures one quantity of a block with this number of cells along its side.
///
/// # Errors
/// If the block cannot be filled in this way, or does not resist the load.
pub fn measure(
    quantity: Quantity,
    filling: Filling,
    identification: Identification,
    cells: usize,
) -> Result<ElasticityRow, ElasticityError> {
    let sides = match quantity {
        Quantity::YoungModulus | Quantity::PoissonRatio | Quantity::Sag => SLENDERNESS,
        Quantity::ConfinedModulus | Quantity::ShearModulus | Quantity::Indentation => 1,
    };
    let body = Body::new(filling, identification, cells, sides)?;
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
        nodes: body.node_count(),
        expected,
        measured,
        relative_error: measured / expected - 1.0,
    })
}
