//! The stability-limit time step of explicit integration.

use crate::Vec3;
use crate::model::springs::{Springs, TangentKind};

/// The stability-limit time step of semi-implicit Euler (11), and the mode that sets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepLimit {
    /// Largest stable step, s; infinite where nothing moves or no spring or drag acts.
    pub step: f64,
    /// Angular frequency √κ of the critical mode, rad/s.
    pub omega: f64,
}

/// Largest number of power iterations for the critical mode, which bounds the cost on large meshes.
const ITERATIONS: usize = 400;
/// Convergence limit: the relative change of the Rayleigh quotient. Its error is the square of the vector's, so the
/// printed digits have settled long before.
const CONVERGED: f64 = 1e-12;
/// Number of solves of the quadratic for h; one is enough where damping is proportional to stiffness.
const REFINEMENTS: usize = 4;

/// Returns the limit at a state at rest, where K and D are symmetric. `inverse_mass` has one entry per node of `x` and
/// is zero for fixed nodes.
///
/// With K̃ = −M^{-½} K M^{-½} and D̃ likewise, a mode y of one step has
/// λ² − (2 − hd − h²κ)λ + 1 − hd = 0, d = yᵀD̃y, κ = yᵀK̃y. Both roots stay in the unit circle up to
/// the h at which λ = −1, that is where the largest eigenvalue of 2hD̃ + h²K̃ reaches 4. For
/// D̃ = (c/k)K̃ this is h = 2(√(1 + ζ²) − ζ)/ω_max with ζ = cω_max/2k.
///
/// ```
/// use stickslip::{Vec3, dynamics::stability::explicit_step_limit, model::springs::{Spring, Springs}};
///
/// let limit = |stiffness: f64, damping: f64| {
///     let spring = Spring { nodes: [0, 1], stiffness, damping, rest_length: 1.0 };
///     let springs = Springs::new(2, &[spring]);
///     explicit_step_limit(&springs, &[Vec3::zeros(), Vec3::x()], &[0.0, 100.0], 0.0) // 10 g on a wall
/// };
/// let omega = (100.0_f64 / 0.01).sqrt();
/// assert!((limit(100.0, 0.0).omega / omega - 1.0).abs() < 1e-6);
/// assert!((limit(100.0, 0.0).step * omega / 2.0 - 1.0).abs() < 1e-6); // h = 2/ω
/// let zeta = 0.5 * omega / (2.0 * 100.0); // c = 0.5 N·s/m
/// let damped = 2.0 * ((1.0 + zeta * zeta).sqrt() - zeta) / omega;
/// assert!((limit(100.0, 0.5).step / damped - 1.0).abs() < 1e-6);
/// ```
pub fn explicit_step_limit(springs: &Springs, x: &[Vec3], inverse_mass: &[f64], drag: f64) -> StepLimit {
    let pencil = Pencil::new(springs, x, inverse_mass, drag);
    // Starting from the stiffest mode, each refinement weighs damping by the step found last.
    let mut mode = pencil.start();
    let mut step = 1.0;
    let mut kappa = 0.0;
    for refinement in 0..REFINEMENTS {
        let damping_share = if refinement == 0 { 0.0 } else { 2.0 / step };
        let (d, k) = pencil.critical_mode(damping_share, &mut mode);
        kappa = k;
        // h²κ + 2hd = 4, in the form that does not cancel.
        step = 4.0 / (d + (d * d + 4.0 * k).sqrt());
    }
    StepLimit { step, omega: kappa.sqrt() }
}

/// Returns a lower bound on the limit of [`explicit_step_limit`], without iteration: by Gershgorin's theorem for blocks, no
/// eigenvalue of K̃ exceeds the largest Σⱼ ‖kᵢⱼ‖ (1/mᵢ + 1/√(mᵢmⱼ)) over the nodes i, and likewise for D̃. A step below the
/// bound is stable.
///
/// ```
/// use stickslip::dynamics::stability::{explicit_step_limit, explicit_step_bound};
/// use stickslip::{pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let network = simulation.network();
/// let bound = explicit_step_bound(&network.springs, &network.rest, &network.inverse_mass, 0.0);
/// let limit = explicit_step_limit(&network.springs, &network.rest, &network.inverse_mass, 0.0);
/// assert!(bound.step <= limit.step && limit.step < 3.0 * bound.step, "{} {}", bound.step, limit.step);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
pub fn explicit_step_bound(springs: &Springs, x: &[Vec3], inverse_mass: &[f64], drag: f64) -> StepLimit {
    let mut rows = vec![(0.0_f64, 0.0_f64); x.len()];
    for spring in springs.iter() {
        let [i, j] = spring.nodes.map(|node| node as usize);
        // k[uuᵀ + (1 − L/ℓ)Π] and c uuᵀ have these norms.
        let stretch = 1.0 - spring.rest_length / (x[j] - x[i]).norm();
        let (k, c) = (spring.stiffness * stretch.abs().max(1.0), spring.damping);
        let mixed = (inverse_mass[i] * inverse_mass[j]).sqrt();
        for node in [i, j] {
            rows[node].0 += k * (inverse_mass[node] + mixed);
            rows[node].1 += c * (inverse_mass[node] + mixed);
        }
    }
    let kappa = rows.iter().map(|row| row.0).fold(0.0, f64::max);
    let drags = inverse_mass.iter().map(|w| drag * w);
    let d = rows.iter().zip(drags).map(|(row, drag)| row.1 + drag).fold(0.0, f64::max);
    StepLimit { step: 4.0 / (d + (d * d + 4.0 * kappa).sqrt()), omega: kappa.sqrt() }
}

/// The matrices K̃ and D̃, applied spring by spring.
struct Pencil {
    blocks: Vec<([usize; 2], crate::Mat3, crate::Mat3)>,
    root_inverse_mass: Vec<f64>,
    drag: f64,
}

impl Pencil {
    fn new(springs: &Springs, x: &[Vec3], inverse_mass: &[f64], drag: f64) -> Self {
        let blocks = springs
            .iter()
            .map(|spring| {
                let nodes = spring.nodes.map(|node| node as usize);
                let (k, d) = spring.jacobian(x[nodes[1]] - x[nodes[0]], Vec3::zeros(), TangentKind::Exact);
                (nodes, k, d)
            })
            .collect();
        Self { blocks, root_inverse_mass: inverse_mass.iter().map(|w| w.sqrt()).collect(), drag }
    }

    /// Returns a random start vector, in which no mode is missing.
    fn start(&self) -> Vec<Vec3> {
        let mut seed = 1_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        self.root_inverse_mass
            .iter()
            .map(|&w| if w > 0.0 { Vec3::from_fn(|_, _| noise()) } else { Vec3::zeros() })
            .collect()
    }

    /// Finds the mode with the largest κ + share·d, refined from `mode`; returns its (d, κ).
    fn critical_mode(&self, share: f64, mode: &mut Vec<Vec3>) -> (f64, f64) {
        let (mut d, mut kappa, mut last) = (0.0, 0.0, f64::INFINITY);
        let mut product = vec![Vec3::zeros(); mode.len()];
        for _ in 0..ITERATIONS {
            let length = mode.iter().map(Vec3::norm_squared).sum::<f64>().sqrt();
            if !(length > 0.0) {
                return (0.0, 0.0);
            }
            mode.iter_mut().for_each(|y| *y /= length);
            product.fill(Vec3::zeros());
            (d, kappa) = (0.0, 0.0);
            for ((y, product), w) in mode.iter().zip(&mut product).zip(&self.root_inverse_mass) {
                let drag = self.drag * w * w;
                d += drag * y.norm_squared();
                *product += y * (share * drag);
            }
            for ([i, j], k, c) in &self.blocks {
                let (wi, wj) = (self.root_inverse_mass[*i], self.root_inverse_mass[*j]);
                let difference = mode[*j] * wj - mode[*i] * wi;
                let (elastic, damping) = (k * difference, c * difference);
                kappa += difference.dot(&elastic);
                d += difference.dot(&damping);
                let both = elastic + damping * share;
                product[*i] -= both * wi;
                product[*j] += both * wj;
            }
            std::mem::swap(mode, &mut product);
            let quotient = kappa + share * d;
            if (quotient - last).abs() <= CONVERGED * quotient {
                break;
            }
            last = quotient;
        }
        (d, kappa)
    }
}
