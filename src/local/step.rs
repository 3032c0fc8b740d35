//! Integration steps of the linear model as a whole: implicit Euler, the implicit midpoint rule, and the exact
//! solution.
//!
//! Between two hand-overs the linear model is M v̇ = f₀ + K(x − x₀) + D(v − v₀) + (t − t_k) g + F, ẋ = v, with
//! g = K_LE v_E₀ under a drifting exterior and F the contact's force, Λ/h over one tick. A free tick is then an affine
//! map of (x, v, t), built once with the model, and a tick with contact adds the response to Λ:
//! v = v* + A⁻¹WᵀΛ, x = x* + XWᵀΛ. With (x₋, v₋) the state before the tick and t its start:
//!
//! - *Implicit Euler*, forces at the tick's end: M(v − v₋) = h f(x₋ + hv, v, t + h) + Λ. Collecting v,
//!   A = M − hD − h²K; x = x₋ + hv, so X = hA⁻¹.
//! - *Implicit midpoint*, forces in the tick's middle: M(v − v₋) = h f(x₋ + h(v₋ + v)/4, (v₋ + v)/2, t + h/2) + Λ.
//!   Collecting v, A = M − hD/2 − h²K/4; x = x₋ + h(v₋ + v)/2, so X = hA⁻¹/2.
//! - *Exponential*: y = (x/h, v) obeys ẏ = Zy/h + …, Z = \[0 I; a d\], a = h²M⁻¹K, d = hM⁻¹D. A force that is constant
//!   over the tick adds φ₁(Z)(0; hM⁻¹F) to y, φ₁(Z) = ∫₀¹ e^{sZ} ds. With P and Q the blocks of φ₁(Z)(0; I) and
//!   F = Λ/h: A⁻¹ = QM⁻¹ and X = hPM⁻¹. The force at the tick's start enters in the same way; its growth within the
//!   tick, h(t' − t)g, adds φ₂(Z)(0; h²M⁻¹g); and e^Z multiplies the difference of the state from the model's start.
//!
//! For all three, G = WA⁻¹Wᵀ is thus the velocity that a unit impulse, spread over the tick, adds to the contact point
//! at its end. It is positive for the first two where K is semidefinite. The exact one has sin(hω)/hω in every mode of
//! frequency ω: it may vanish where hω > π, and then the contact cannot hold. A is not symmetric, since the damping
//! part of K is not.

use nalgebra::{DMatrix, DVector};

use super::error::ModelError;
use super::linearization::LinearForces;
use crate::surface::support::Support;
use crate::word::words;
use crate::{Mat3, Vec3};

/// Integrator of the local model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LocalIntegrator {
    /// Semi-implicit Euler (11)–(12), for every model.
    #[default]
    SemiImplicitEuler,
    /// First order, dissipative, stable at every step. Like all that follow, it requires a linear model.
    ImplicitEuler,
    /// Second order; conserves the energy of a linear model without dampers.
    ImplicitMidpoint,
    /// Exact solution of the linear model.
    Exponential,
}

words!(LocalIntegrator { SemiImplicitEuler = "semi-implicit-euler", ImplicitEuler = "implicit-euler", ImplicitMidpoint = "implicit-midpoint", Exponential = "exponential" });

/// One tick of a linear model over its m nodes.
///
/// ```
/// use stickslip::surface::support::{Metric, Support};
/// use stickslip::local::step::{ContactResponse, LinearStep, LocalIntegrator};
/// use stickslip::{Mat3, Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let (patch, state) = (&local.model().patch, local.state());
/// let forces = local.model().linear_forces().expect("the scene says tangent");
/// assert_eq!(LocalIntegrator::ALL[0].name(), "semi-implicit-euler");
/// assert!(LinearStep::new(LocalIntegrator::SemiImplicitEuler, forces, &patch.mass, 1e-3)?.is_none());
/// let step = LinearStep::new(LocalIntegrator::ImplicitEuler, forces, &patch.mass, 1e-3)?.expect("it is implicit");
/// assert!(step.dissipates() && step.products() == 1);
///
/// // At rest it stays at rest.
/// let (mut x, mut v, mut offset) = (state.x.clone(), state.v.clone(), vec![0.0; step.offset_len()]);
/// step.predict(0.0, [&state.x, &state.v], &mut offset, [&mut x, &mut v]);
/// assert!(v.iter().all(|v| v.norm() < 1e-12));
///
/// // An impulse of 1 mN·s on one node changes its velocity by GΛ; G is definite, and less than for the mass alone.
/// let mut support = Support::with_capacity(1);
/// support.set(Metric::Mass, [(0, 1.0, patch.inverse_mass[0])]);
/// let mut response = ContactResponse::new(patch.len());
/// step.respond(&support, &mut response);
/// let [g, _] = response.at_contact(&support);
/// let impulse = Vec3::z() * 1e-3;
/// let before = v[0];
/// response.push([Vec3::zeros(), impulse], &mut x, &mut v);
/// assert!((v[0] - before - g * impulse).norm() < 1e-15);
/// assert!(g.cholesky().is_some() && (Mat3::identity() * patch.inverse_mass[0] - g).cholesky().is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct LinearStep {
    /// Velocity v* as a map of (x, v, t).
    velocity: LinearForces,
    position: Position,
    /// A⁻¹, 1/kg, in 3 × 3 blocks, column by column. It is stored in full: three columns for each node of a support are
    /// needed in every tick of contact, and reading them takes 0.1 to 0.8 µs at 42 rows and 2.5 to 9 µs at 300, 14 to
    /// 105 times less than solving.
    response: Vec<Mat3>,
    /// Whether the step dissipates the energy ½ΔvᵀMΔv.
    dissipates: bool,
}

/// Update of the positions by a step.
#[derive(Debug, Clone)]
enum Position {
    /// Combination x = x₋ + old v₋ + new v, both factors in s.
    Along { old: f64, new: f64 },
    /// Map x* of (x, v, t), and X, s/kg, in blocks like A⁻¹.
    Own { map: LinearForces, response: Vec<Mat3> },
}

/// A⁻¹Wᵀ and XWᵀ of one contact point, one block per node of the patch.
#[derive(Debug, Clone, Default)]
pub struct ContactResponse {
    velocity: Vec<Mat3>,
    displacement: Vec<Mat3>,
}

/// The dense matrices of one linear model.
struct Dense {
    k: DMatrix<f64>,
    d: DMatrix<f64>,
    f0: DVector<f64>,
    v0: DVector<f64>,
    x0: DVector<f64>,
    /// Force rate g, N/s.
    growth: DVector<f64>,
    mass: DVector<f64>,
}

/// An affine map of (x, v, t) under construction: constant + by_x (x − x₀) + by_v (v − v₀) + growth (t − t_k).
struct Affine {
    constant: DVector<f64>,
    by_x: DMatrix<f64>,
    by_v: DMatrix<f64>,
    growth: DVector<f64>,
}

impl LinearStep {
    /// Builds the step of length h, s, of a model with these forces and node masses; `None` for the explicit
    /// integrator.
    ///
    /// # Errors
    /// If A has no inverse or the step is not finite.
    pub fn new(
        integrator: LocalIntegrator,
        forces: &LinearForces,
        mass: &[f64],
        h: f64,
    ) -> Result<Option<Self>, ModelError> {
        let model = || Dense::new(forces, mass);
        let step = match integrator {
            LocalIntegrator::SemiImplicitEuler => return Ok(None),
            LocalIntegrator::ImplicitEuler => model().implicit(forces, h, 1.0),
            LocalIntegrator::ImplicitMidpoint => model().implicit(forces, h, 0.5),
            LocalIntegrator::Exponential => Some(model().exponential(forces, h)),
        };
        match step.filter(Self::is_finite) {
            Some(step) => Ok(Some(step)),
            None => Err(ModelError::NoStep { integrator: integrator.name(), rows: 3 * mass.len() }),
        }
    }

    /// Length of the workspace that [`predict`](Self::predict) needs.
    pub fn offset_len(&self) -> usize {
        self.velocity.offset_len()
    }

    /// Number of products with a 3m × 6m matrix in a free tick.
    pub fn products(&self) -> u64 {
        match self.position {
            Position::Along { .. } => 1,
            Position::Own { .. } => 2,
        }
    }

    /// Whether a tick dissipates the energy ½ΔvᵀMΔv, as every Euler step does.
    pub fn dissipates(&self) -> bool {
        self.dissipates
    }

    /// Predicts x* and v* of a free tick that starts `elapsed` seconds after the state the model was built from.
    pub fn predict(
        &self,
        elapsed: f64,
        [x, v]: [&[Vec3]; 2],
        offset: &mut [f64],
        [x_after, v_after]: [&mut [Vec3]; 2],
    ) {
        self.velocity.evaluate(elapsed, x, v, offset, v_after);
        match &self.position {
            Position::Along { old, new } => {
                let nodes = x.iter().zip(v).zip(v_after).take(self.node_count());
                for (x_after, ((x, v), v_after)) in x_after.iter_mut().zip(nodes) {
                    *x_after = x + v * *old + *v_after * *new;
                }
            }
            Position::Own { map, .. } => map.evaluate(elapsed, x, v, offset, x_after),
        }
    }

    /// Computes A⁻¹Wᵀ and XWᵀ of a contact point.
    pub fn respond(&self, support: &Support, response: &mut ContactResponse) {
        let m = self.node_count();
        gather(&self.response, m, support, &mut response.velocity);
        match &self.position {
            Position::Along { new, .. } => {
                for (displacement, velocity) in response.displacement.iter_mut().zip(&response.velocity) {
                    *displacement = velocity * *new;
                }
            }
            Position::Own { response: own, .. } => gather(own, m, support, &mut response.displacement),
        }
    }

    fn node_count(&self) -> usize {
        self.response.len().isqrt()
    }

    fn is_finite(&self) -> bool {
        let maps = match &self.position {
            Position::Along { .. } => None,
            Position::Own { map, .. } => Some(map),
        };
        self.velocity.is_finite()
            && maps.is_none_or(LinearForces::is_finite)
            && self.response.iter().flat_map(|block| block.iter()).all(|entry| entry.is_finite())
    }
}

/// Sums Σ_j w_j A⁻¹_(·,j) over the nodes of a support.
fn gather(blocks: &[Mat3], m: usize, support: &Support, into: &mut [Mat3]) {
    into.fill(Mat3::zeros());
    for node in support.nodes() {
        let column = &blocks[node.slot * m..(node.slot + 1) * m];
        into.iter_mut().zip(column).for_each(|(sum, block)| *sum += block * node.weight);
    }
}

impl ContactResponse {
    /// Allocates for a patch of m nodes.
    pub fn new(m: usize) -> Self {
        Self { velocity: vec![Mat3::zeros(); m], displacement: vec![Mat3::zeros(); m] }
    }

    /// Returns G = WA⁻¹Wᵀ, 1/kg, and WXWᵀ, s/kg.
    pub fn at_contact(&self, support: &Support) -> [Mat3; 2] {
        [&self.velocity, &self.displacement]
            .map(|blocks| support.nodes().iter().map(|node| blocks[node.slot] * node.weight).sum())
    }

    /// Applies v += A⁻¹WᵀΛ and x += XWᵀΛ', with impulses in N·s.
    pub fn push(&self, [on_x, on_v]: [Vec3; 2], x: &mut [Vec3], v: &mut [Vec3]) {
        x.iter_mut().zip(&self.displacement).for_each(|(x, block)| *x += block * on_x);
        v.iter_mut().zip(&self.velocity).for_each(|(v, block)| *v += block * on_v);
    }
}

impl Dense {
    fn new(forces: &LinearForces, mass: &[f64]) -> Self {
        let dof = 3 * mass.len();
        let vector = |values: &[Vec3]| DVector::from_column_slice(bytemuck::cast_slice(values));
        let (x0, v0) = forces.start();
        Self {
            k: DMatrix::from_fn(dof, dof, |i, j| forces.entry(i, j)),
            d: DMatrix::from_fn(dof, dof, |i, j| forces.entry(i, dof + j)),
            f0: DVector::from_column_slice(forces.constant()),
            growth: forces.drift().map_or_else(|| DVector::zeros(dof), vector),
            mass: DVector::from_fn(dof, |i, _| mass[i / 3]),
            x0: vector(x0),
            v0: vector(v0),
        }
    }

    /// Builds the step with forces at the fraction θ of the tick: 1 is implicit Euler, ½ the midpoint rule. With
    /// z = v₋ − v₀ and v_θ = v₋ + θ(v − v₋),
    /// A v = Mv₋ + h\[f₀ + K(x₋ − x₀ + θh(1 − θ)v₋) + D((1 − θ)v₋ − v₀) + (t + θh − t_k)g\],
    /// A = M − θhD − θ²h²K: x at θ is x₋ + θh v_θ. Returns `None` if A is singular.
    fn implicit(&self, forces: &LinearForces, h: f64, theta: f64) -> Option<LinearStep> {
        let mass = DMatrix::from_diagonal(&self.mass);
        let a = &mass - &self.d * (theta * h) - &self.k * (theta * theta * h * h);
        let inverse = a.try_inverse()?;
        let rest = 1.0 - theta;
        let by_v = &mass + (&self.d * rest + &self.k * (theta * rest * h)) * h;
        let constant = &by_v * &self.v0 + (&self.f0 - &self.d * &self.v0 + &self.growth * (theta * h)) * h;
        let velocity = Affine {
            constant: &inverse * constant,
            by_x: &inverse * &self.k * h,
            by_v: &inverse * by_v,
            growth: &inverse * &self.growth * h,
        };
        Some(LinearStep {
            velocity: velocity.over(forces),
            position: Position::Along { old: rest * h, new: theta * h },
            response: blocks(&inverse),
            dissipates: theta == 1.0,
        })
    }

    fn exponential(&self, forces: &LinearForces, h: f64) -> LinearStep {
        let by_mass = |matrix: &DMatrix<f64>, scale: f64| {
            DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * (scale / self.mass[i]))
        };
        let (a, d) = (by_mass(&self.k, h * h), by_mass(&self.d, h));
        let growth = self.growth.component_div(&self.mass) * (h * h);
        let Phi { e, one, two } = Phi::new(&a, &d, &growth);
        let n = a.nrows();
        let [p, q] = [0, n].map(|at| one.rows(at, n).into_owned());
        let [growth_x, growth_v] = [0, n].map(|at| two.rows(at, n).into_owned());
        let block = |i: usize, j: usize| e.view((i * n, j * n), (n, n));
        let from_mass = |matrix: &DMatrix<f64>, scale: f64| {
            DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * (scale / self.mass[j]))
        };
        // Response of v and of x to forces at the tick's start.
        let (force_v, force_x) = (from_mass(&q, h), from_mass(&p, h * h));
        let velocity = Affine {
            constant: &force_v * &self.f0 + (block(1, 1) - &q * &d) * &self.v0 + growth_v,
            by_x: block(1, 0) / h,
            by_v: block(1, 1).into_owned(),
            growth: &force_v * &self.growth,
        };
        let position = Affine {
            constant: &self.x0 + &force_x * &self.f0 + ((block(0, 1) - &p * &d) * &self.v0 + growth_x) * h,
            by_x: block(0, 0).into_owned(),
            by_v: block(0, 1) * h,
            growth: &force_x * &self.growth,
        };
        LinearStep {
            velocity: velocity.over(forces),
            position: Position::Own { map: position.over(forces), response: blocks(&(force_x / h)) },
            response: blocks(&(force_v / h)),
            dissipates: false,
        }
    }
}

impl Affine {
    fn over(&self, forces: &LinearForces) -> LinearForces {
        forces.with_coefficients(&self.constant, [&self.by_x, &self.by_v], &self.growth)
    }
}

/// Splits a matrix into 3 × 3 blocks, one column of blocks after another.
fn blocks(matrix: &DMatrix<f64>) -> Vec<Mat3> {
    let m = matrix.nrows() / 3;
    let block = |at: usize| matrix.fixed_view::<3, 3>(3 * (at % m), 3 * (at / m)).into_owned();
    (0..m * m).map(block).collect()
}

/// The matrices e^Z, φ₁(Z)(0; I) and φ₂(Z)(0; ĝ) for Z = \[0 I; a d\].
struct Phi {
    e: DMatrix<f64>,
    one: DMatrix<f64>,
    two: DVector<f64>,
}

/// Number of terms of the Taylor series: the first omitted is below 2⁻⁵³ of the first for |Z| ≤ ½.
const TERMS: u32 = 14;

impl Phi {
    /// Computes Taylor's series for Z/2^s, then s doublings: φ₂(2Z) = ¼(e^Z φ₂(Z) + φ₁(Z) + φ₂(Z)),
    /// φ₁(2Z) = ½(e^Z φ₁(Z) + φ₁(Z)), e^{2Z} = e^Z e^Z. φ₁ is not taken from e^Z − I, which cancels in slow modes, nor
    /// e^Z from I + φ₁Z: in fast modes every doubling would multiply its rounding by |Z|, which doubles itself.
    fn new(a: &DMatrix<f64>, d: &DMatrix<f64>, growth: &DVector<f64>) -> Self {
        let n = a.nrows();
        let identity = DMatrix::<f64>::identity(n, n);
        // Norm of Z in units of x that give its blocks the same size.
        let size = row_sum(a).sqrt() + row_sum(d);
        let doublings = (2.0 * size).log2().ceil().clamp(0.0, f64::from(f64::MAX_EXP));
        let scale = (-doublings).exp2();

        let (mut p, mut q) = (DMatrix::zeros(n, n), identity.clone());
        let mut ramp = [DVector::zeros(n), growth * 0.5];
        for term in (2..=TERMS).rev() {
            let share = scale / f64::from(term);
            (p, q) = (&q * share, &identity + (a * &p + d * &q) * share);
        }
        for term in (3..=TERMS).rev() {
            let share = scale / f64::from(term);
            ramp = [&ramp[1] * share, growth * 0.5 + (a * &ramp[0] + d * &ramp[1]) * share];
        }
        // I + φ₁Z on (I; 0), I + Zφ₁ on (0; I): here |Z| is small.
        let mut e = DMatrix::identity(2 * n, 2 * n);
        for (at, block) in [((0, 0), &p * a), ((0, n), q.clone()), ((n, 0), &q * a), ((n, n), a * &p + d * &q)] {
            e.view_mut(at, (n, n)).zip_apply(&block, |e, block| *e += block * scale);
        }
        let mut one = DMatrix::zeros(2 * n, n);
        one.rows_mut(0, n).copy_from(&p);
        one.rows_mut(n, n).copy_from(&q);
        let mut two = DVector::zeros(2 * n);
        two.rows_mut(0, n).copy_from(&ramp[0]);
        two.rows_mut(n, n).copy_from(&ramp[1]);
        for _ in 0..doublings as u32 {
            two = (&e * &two + &one * growth + &two) * 0.25;
            one = (&e * &one + &one) * 0.5;
            e = &e * &e;
        }
        Self { e, one, two }
    }
}

/// Largest row sum of absolute values.
fn row_sum(matrix: &DMatrix<f64>) -> f64 {
    matrix.row_iter().map(|row| row.iter().map(|entry| entry.abs()).sum()).fold(0.0, f64::max)
}
