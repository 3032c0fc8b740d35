//! Stiffness of a contact over a disc on the elastic half-space.

use std::f64::consts::PI;
use std::sync::Arc;

use super::body::{Body, Given, boussinesq};
use super::{ElasticityError, FORCE, SIZE, YOUNG_MODULUS};
use crate::Vec3;
use crate::model::material::POISSON_RATIO;
use crate::model::topology::Surface;
use crate::surface::geometry::{ContactPoint, ContactSurface, SurfaceModel};

/// Direction in which a disc is pushed.
///
/// ```
/// use stickslip::verify::elasticity::disc::{Push, stiffness};
/// use stickslip::ContactSurface;
///
/// // On a mesh of eight cells, each half as long as the radius, the disc is 9 % too stiff.
/// let error = stiffness(Push::Normal, ContactSurface::Faceted, 0.025, 8)? / Push::Normal.expected(0.025) - 1.0;
/// assert!(error > 0.0 && error < 0.1, "{error}");
/// # Ok::<(), stickslip::verify::elasticity::ElasticityError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Push {
    /// Into the surface, by the pressure of a rigid sphere.
    Normal,
    /// Along the surface, by a traction of the same distribution.
    Tangential,
}

impl Push {
    /// Both directions.
    pub const ALL: [Self; 2] = [Self::Normal, Self::Tangential];

    /// Returns F/d on the half-space, N/m, for a disc of this radius, m, with d the mean displacement under the pressure:
    /// (5/3)E*a with E* = E/(1 − ν²), and 20Ga/(3(2 − ν)). Means of the displacements of Hertz's pressure and of the same
    /// traction (K. L. Johnson, Contact Mechanics, 1985, 3.4 and 3.7).
    pub fn expected(self, radius: f64) -> f64 {
        let (e, nu) = (YOUNG_MODULUS, POISSON_RATIO);
        match self {
            Push::Normal => 5.0 / 3.0 * e / (1.0 - nu * nu) * radius,
            Push::Tangential => 20.0 / 3.0 * e / (2.0 * (1.0 + nu)) * radius / (2.0 - nu),
        }
    }

    fn force(self) -> Vec3 {
        match self {
            Push::Normal => Vec3::z() * -FORCE,
            Push::Tangential => Vec3::x() * FORCE,
        }
    }

    /// Displacement of the half-space z < 0 under the force at the origin, m.
    fn far_displacement(self, x: Vec3) -> Vec3 {
        match self {
            Push::Normal => boussinesq(x),
            Push::Tangential => cerruti(x),
        }
    }
}

/// Normal stiffness F/d on a layer of depth H bonded to rigid ground, over that on the half-space, for χ = a/H and a
/// Poisson's ratio of 1/4. The ground adds (1 − ν²)F/(πE) (α₀/H + β₀r²/H³) to the displacement at the distance r from a
/// point force, with α₀ and β₀ by E. K. Dimitriadis and others, Biophys. J. 82, 2002. Of two points under the pressure the mean
/// of r² is 4a²/5. Their series 1 + 0.853χ + … is another factor: that of F/δ^(3/2) for a sphere, whose disc grows with the
/// depth δ, with χ = √(Rδ)/H.
pub fn layer_factor(chi: f64) -> f64 {
    let nu = POISSON_RATIO;
    let alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    1.0 / (1.0 + 5.0 / (3.0 * PI) * (alpha * chi + 0.8 * beta * chi.powi(3)))
}

/// Measures F/d, N/m, of a disc of this radius, m, in the middle of a block's top, with `cells` lattice cells along the depth of
/// 10 cm and twice as many along the sides. Bottom and sides have the half-space's displacements under a point force, from
/// which those under the disc differ by a share of a²/R² at the distance R.
///
/// # Errors
/// If the disc does not fit the mesh.
pub fn stiffness(push: Push, surface: ContactSurface, radius: f64, cells: usize) -> Result<f64, ElasticityError> {
    let (body, mesh) = Body::half_space(cells)?;
    let topology = Arc::new(Surface::new(&mesh)?);
    let kept = vec![true; mesh.nodes.len()];
    let surface = SurfaceModel::new(surface, topology.clone())?.spread(radius, &mesh.nodes, &kept)?;
    let top = (0..topology.triangles.len() as u32).find_map(|triangle| {
        let corners = topology.triangle_nodes(triangle).map(|node| mesh.nodes[node as usize]);
        let k = corners.iter().position(|corner| corner.norm() <= 1e-9 * SIZE)?;
        let mut weights = [0.0; 3];
        weights[k] = 1.0;
        corners.iter().all(|corner| corner.z >= -1e-9 * SIZE).then_some(ContactPoint { triangle, weights })
    });
    let middle = top.ok_or(ElasticityError::NothingToRead)?;
    let weights: Vec<(usize, f64)> = surface.node_weights(&middle).collect();
    let mut load = vec![Vec3::zeros(); mesh.nodes.len()];
    weights.iter().for_each(|&(node, weight)| load[node] += push.force() * weight);
    let held = |x: &Vec3| x.z <= -SIZE * (1.0 - 1e-9) || x.x.abs().max(x.y.abs()) >= SIZE * (1.0 - 1e-9);
    let given: Given = mesh
        .nodes
        .iter()
        .map(|x| if held(x) { push.far_displacement(*x).map(Some).into() } else { [None; 3] })
        .collect();
    let u = body.solve(&given, load)?;
    let displacement: Vec3 = weights.iter().map(|&(node, weight)| u[node] * weight).sum();
    Ok(FORCE * FORCE / displacement.dot(&push.force()))
}

/// Returns the displacement of the half-space z < 0 under a force at the origin along x, m (V. Cerruti, 1882; in this form
/// K. L. Johnson, 3.6).
fn cerruti(x: Vec3) -> Vec3 {
    let (depth, distance) = (-x.z, x.norm());
    let shear = YOUNG_MODULUS / (2.0 * (1.0 + POISSON_RATIO));
    let scale = FORCE / (4.0 * PI * shear);
    let (open, sum) = (1.0 - 2.0 * POISSON_RATIO, distance + depth);
    let common = x.x / distance.powi(3) - open * x.x / (distance * sum * sum);
    let down = x.x * depth / distance.powi(3) + open * x.x / (distance * sum);
    Vec3::new(1.0 / distance + open / sum + common * x.x, common * x.y, -down) * scale
}
