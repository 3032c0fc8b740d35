//! Local model at a point of a map: its one-step matrix and its running simulation.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::{Axis, LONGEST, MapError, MapPoint, Touching, scheme};
use crate::Vec3;
use crate::contact::law::{Law, Mode};
use crate::contact::rules::{ContactRules, Deformation, RIGID_BELOW, Scheme};
use crate::contact::simulation::LocalSimulation;
use crate::dynamics::stability::explicit_step_limit;
use crate::local::model::{ExteriorKind, Linearization, LocalModel, LocalModelBuilder, LocalSettings, LocalState};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::network::Network;
use crate::model::springs::TangentKind;
use crate::model::topology::Surface;
use crate::scene::Scene;
use crate::surface::geometry::{ContactPoint, SurfaceModel};
use crate::surface::support::{Metric, Support};

/// Ticks of a measurement.
const TICKS: usize = 1000;
/// Factor of the kinetic energy from the first half to the second above which a perturbation counts as growing.
const GROWN: f64 = 4.0;
/// Squarings of the one-step matrix from which its spectral radius is estimated.
const SQUARINGS: u32 = 22;
/// Norm of a power of the one-step matrix below which no further powers are needed.
const SHRUNK: f64 = 0.1;
/// Excess over 1 that the estimate keeps where modes stay on the unit circle, as undamped ones do.
pub(super) const ON_THE_CIRCLE: f64 = 1e-5;
/// Share of an impulse's velocity left at the tick's end below which rounding decides whether it holds the contact.
const ROUNDED: f64 = 1e-10;

/// Number of nodes above which a patch is replaced by one of one ring: the cost of powers is cubic in it.
const LARGEST_PATCH: usize = 60;
/// Depth of the held contact, in spacings, and the share of the work done that the perturbation has:
/// small enough that the contact never pulls.
const PRESSED: f64 = 0.1;
const PERTURBATION: f64 = 1e-6;

/// Linear local model at rest, its one-step matrices, and the data to run it.
pub(super) struct Subject {
    integrator: LocalIntegrator,
    rules: ContactRules,
    surface: SurfaceModel,
    model: LocalModel,
    at_rest: LocalState,
    /// State pressed in, in equilibrium with the tip.
    pressed: LocalState,
    contact: ContactPoint,
    /// Tip of the pressed contact, m.
    tip: Vec3,
    /// Normal of the pressed contact.
    normal: Vec3,
    /// Force that presses the contact in, N, up to its sign: K u = Wᵀ push for the pressed displacements u.
    push: DVector<f64>,
    /// Work of the pressing, J.
    work: f64,
    /// M^{-½} K M^{-½}, 1/s².
    pub(super) stiffness: DMatrix<f64>,
    /// M^{-½} D M^{-½}, 1/s.
    damping: DMatrix<f64>,
    /// W M^{-½}.
    w: DMatrix<f64>,
    /// M^½ times the displacements of the nodes by the geometric scheme, per displacement of the contact point.
    deformation: DMatrix<f64>,
    /// M^½ times the direction along which P removes the contact point's velocity.
    response: DMatrix<f64>,
}

/// Matrices of a linear local model and its contact point in coordinates scaled by M^½.
struct ScaledMatrices {
    stiffness: DMatrix<f64>,
    damping: DMatrix<f64>,
    w: DMatrix<f64>,
    deformation: DMatrix<f64>,
    response: DMatrix<f64>,
}

impl ScaledMatrices {
    /// Returns `None` where the model is not linear.
    fn new(model: &LocalModel, support: &Support, scheme: Scheme) -> Option<Self> {
        let mass = &model.patch.mass;
        let dof = 3 * mass.len();
        let root = |i: usize| mass[i / 3].sqrt();
        let forces = model.linear_forces()?;
        let scaled =
            |column: usize| DMatrix::from_fn(dof, dof, |i, j| forces.entry(i, column + j) / (root(i) * root(j)));
        // Builds a matrix with one column for each direction of the contact point from a number per support node.
        let columns = |of: &dyn Fn(usize, f64) -> f64| {
            let mut matrix = DMatrix::zeros(dof, 3);
            for node in support.nodes() {
                for a in 0..3 {
                    matrix[(3 * node.slot + a, a)] = of(node.slot, node.weight);
                }
            }
            matrix
        };
        let (square, free_weight) = (support.square_weight(), support.free_weight());
        let deformation = match scheme {
            Scheme::Geometric { deformation: Deformation::Rigid, .. } => {
                columns(&|slot, _| root(3 * slot) / free_weight)
            }
            Scheme::Geometric { deformation: Deformation::LeastNorm, .. } => {
                columns(&|slot, weight| root(3 * slot) * weight / square)
            }
            Scheme::Velocity | Scheme::Massless => DMatrix::zeros(dof, 3),
        };
        let response = match scheme.metric() {
            Metric::Euclidean => columns(&|slot, weight| root(3 * slot) * weight / square),
            Metric::Mass => columns(&|slot, weight| weight / root(3 * slot) / support.scale()),
        };
        let w = columns(&|slot, weight| weight / root(3 * slot)).transpose();
        Some(Self { stiffness: scaled(0), damping: scaled(dof), w, deformation, response })
    }
}

impl Subject {
    pub(super) fn new(scene: &Scene, point: &MapPoint) -> Result<Self, MapError> {
        let mesh = scene.mesh.mesh();
        let surface = Arc::new(Surface::new(&mesh)?);
        let surface = SurfaceModel::new(scene.surface, surface)?;
        let surface = surface.spread(scene.contact_radius, &mesh.nodes, &scene.fixed)?;
        let mut material = scene.material.clone();
        material.gravity = Vec3::zeros();
        if point.axis == Axis::Stiffness {
            material.stiffness = point.value.into();
        }
        let tangent = match scene.local().linearization {
            Linearization::Tangent(kind) => kind,
            Linearization::None => TangentKind::Exact,
        };
        let build = |material: &_, exterior, extent, touched| {
            let network = Network::new(&mesh, material, scene.fixed.clone())?;
            let settings = LocalSettings { extent, linearization: Linearization::Tangent(tangent), exterior };
            let mut builder = LocalModelBuilder::new(&network, surface.clone(), settings);
            Ok::<_, MapError>(builder.build(&network, &network.rest_state(), scene.path.at(0.0), touched)?)
        };
        let scheme = scheme(scene, point.integrator);
        let rules = ContactRules { law: Law::Sticking, scheme, ..scene.contact };
        let mut extent = scene.local().extent;
        let (mut model, mut state) = build(&material, ExteriorKind::Fixed, extent, None)?;
        if extent == Extent::All || model.patch.len() > LARGEST_PATCH {
            extent = Extent::Rings(1);
            (model, state) = build(&material, ExteriorKind::Fixed, extent, None)?;
        }
        let simulation = LocalSimulation::new(rules, 1.0, surface.clone(), model, state);
        let contact = simulation.shape().nearest(scene.path.at(0.0)).ok_or(MapError::NoSurface)?;
        let (model, _) = build(&material, ExteriorKind::Fixed, extent, Some(contact.triangle))?;

        let mut support = Support::with_capacity(surface.geometry.largest_support());
        let metric = scheme.metric();
        simulation.shape().touch(metric, &contact, &mut support);
        let heaviest = support.nodes().iter().max_by(|a, b| a.weight.total_cmp(&b.weight));
        match (point.axis, heaviest) {
            (Axis::MassRatio, Some(heaviest)) => {
                let node = simulation.model().patch.node(heaviest.slot);
                material.node_mass[node as usize] /= point.value;
            }
            (Axis::DampingRatio, _) => {
                let patch = &model.patch;
                let mut inverse_mass = patch.inverse_mass.clone();
                inverse_mass.resize(patch.len() + patch.boundary.len(), 0.0);
                let x: Vec<Vec3> = (0..inverse_mass.len()).map(|slot| mesh.nodes[patch.node(slot) as usize]).collect();
                let mut undamped = material.clone();
                undamped.damping = 0.0.into();
                let (undamped, _) = build(&undamped, ExteriorKind::Fixed, extent, Some(contact.triangle))?;
                let omega = explicit_step_limit(&undamped.patch.springs, &x, &inverse_mass, 0.0).omega;
                material.damping = material.stiffness.clone();
                material.damping *= 2.0;
                material.damping *= point.value;
                material.damping /= omega;
            }
            (Axis::Stiffness | Axis::MassRatio, _) => {}
        }

        let (model, at_rest) = build(&material, point.exterior.1, extent, Some(contact.triangle))?;
        let simulation = LocalSimulation::new(rules, 1.0, surface.clone(), model, at_rest.clone());
        let touch = simulation.shape().touch(metric, &contact, &mut support);
        let free_weight = support.free_weight();
        if !(free_weight >= RIGID_BELOW) {
            return Err(MapError::Rigid { free_weight });
        }
        let model = simulation.model().clone();
        let matrices = ScaledMatrices::new(&model, &support, scheme).ok_or(MapError::NotHeld)?;
        let ScaledMatrices { stiffness, damping, w, deformation, response } = matrices;
        let mass = &model.patch.mass;
        let dof = 3 * mass.len();
        let root = |i: usize| mass[i / 3].sqrt();

        // K u = Wᵀλ with W u = −δ n̂, in the scaled coordinates.
        let depth = PRESSED * scene.mesh.spacing();
        let compliance = stiffness.clone().lu().solve(&w.transpose()).ok_or(MapError::NotHeld)?;
        let push = (&w * &compliance).lu().solve(&DVector::from_column_slice((touch.normal * -depth).as_slice()));
        let push = push.ok_or(MapError::NotHeld)?;
        let displacement = compliance * &push;
        let mut pressed = at_rest.clone();
        for i in 0..dof {
            pressed.x[i / 3][i % 3] += displacement[i] / root(i);
        }
        let work = 0.5 * depth * push.norm();
        if !(work > 0.0 && work.is_finite()) {
            return Err(MapError::NotHeld);
        }
        let tip = touch.position - touch.normal * depth;
        Ok(Self {
            integrator: point.integrator,
            rules,
            surface,
            model,
            at_rest,
            pressed,
            contact,
            tip,
            normal: touch.normal,
            push,
            work,
            stiffness,
            damping,
            w,
            deformation,
            response,
        })
    }

    /// Returns the largest |eigenvalue| of one step, in the coordinates (M^½ x, h M^½ v). It is infinite where there is
    /// no step, or where the step does not hold the contact, and only a bound below 1 where a power of the step
    /// contracts.
    pub(super) fn spectral_radius(&self, touching: Touching, h: f64) -> f64 {
        let Some(step) = self.one_step(touching, h) else { return f64::INFINITY };
        // Gelfand's formula: the 2ᵏ-th root of the norm of the 2ᵏ-th power, far cheaper than eigenvalues.
        let (mut power, mut logarithm) = (step, 0.0);
        for squaring in 0..=SQUARINGS {
            let norm = power.norm();
            if !(norm > 0.0 && norm.is_finite()) {
                return norm;
            }
            logarithm += norm.ln() / f64::from(1 << squaring);
            // The logarithm is that of the norm of the power before its normalisation.
            if logarithm * f64::from(1 << squaring) < SHRUNK.ln() {
                break;
            }
            power /= norm;
            power = &power * &power;
        }
        logarithm.exp()
    }

    fn one_step(&self, touching: Touching, h: f64) -> Option<DMatrix<f64>> {
        let [free, answer] = self.free_step(h)?;
        match (touching, self.rules.scheme) {
            (Touching::Free, _) => Some(free),
            (Touching::Held, Scheme::Velocity | Scheme::Massless) => self.held(&free, &answer),
            (Touching::Held, Scheme::Geometric { .. }) => Some(self.deformed(h)),
        }
    }

    /// Returns the matrix of a free tick, and the effect of an impulse hΛ spread over it (2n × 3).
    fn free_step(&self, h: f64) -> Option<[DMatrix<f64>; 2]> {
        match self.integrator {
            LocalIntegrator::SemiImplicitEuler => self.euler(h, 0.0, [0.0, 1.0]),
            LocalIntegrator::ImplicitEuler => self.euler(h, 1.0, [0.0, 1.0]),
            LocalIntegrator::ImplicitMidpoint => self.euler(h, 0.5, [0.5, 0.5]),
            LocalIntegrator::Exponential => Some(self.exponential(h)),
        }
    }

    /// Integrates with forces at the fraction θ of the tick:
    /// (I − θhD − θ²h²K) v′ = (1 + (1 − θ)hD + θ(1 − θ)h²K) v + h²K x, x′ = x + old v + new v′.
    fn euler(&self, h: f64, theta: f64, [old, new]: [f64; 2]) -> Option<[DMatrix<f64>; 2]> {
        let n = self.stiffness.nrows();
        let identity = DMatrix::<f64>::identity(n, n);
        let (k, d) = (&self.stiffness * (h * h), &self.damping * h);
        let mut from = DMatrix::zeros(n, 2 * n + 3);
        from.columns_mut(0, n).copy_from(&k);
        from.columns_mut(n, n).copy_from(&(&identity + (&d + &k * theta) * (1.0 - theta)));
        from.columns_mut(2 * n, 3).copy_from(&self.w.transpose());
        let v = (&identity - (d + k * theta) * theta).lu().solve(&from)?;
        let mut step = DMatrix::zeros(2 * n, 2 * n + 3);
        step.view_mut((0, 0), (n, n)).fill_with_identity();
        step.view_mut((0, n), (n, n)).fill_diagonal(old);
        step.rows_mut(0, n).zip_apply(&v, |x, v| *x += new * v);
        step.rows_mut(n, n).copy_from(&v);
        Some([step.columns(0, 2 * n).into_owned(), step.columns(2 * n, 3).into_owned()])
    }

    /// Integrates exactly: e^Z of Z = [0 I 0; h²K hD Wᵀ; 0 0 0], in units of x in which the blocks of Z are of equal
    /// size.
    fn exponential(&self, h: f64) -> [DMatrix<f64>; 2] {
        let n = self.stiffness.nrows();
        let k = &self.stiffness * (h * h);
        let unit = k.norm().sqrt();
        let mut z = DMatrix::zeros(2 * n + 3, 2 * n + 3);
        z.view_mut((0, n), (n, n)).fill_diagonal(unit);
        z.view_mut((n, 0), (n, n)).copy_from(&(k / unit));
        z.view_mut((n, n), (n, n)).copy_from(&(&self.damping * h));
        z.view_mut((n, 2 * n), (n, 3)).copy_from(&self.w.transpose());
        let mut step = z.exp();
        step.rows_mut(0, n).scale_mut(1.0 / unit);
        step.columns_mut(0, n).scale_mut(unit);
        [step.view((0, 0), (2 * n, 2 * n)).into_owned(), step.view((0, 2 * n), (2 * n, 3)).into_owned()]
    }

    /// Returns the held step: v′ = v* + A⁻¹WᵀΛ so that hW v′ = −W x, and x′ = x* + XWᵀΛ′ so that W x′ = 0. `None` where
    /// an impulse does not move the contact point in every direction, or moves it against the force that presses it in.
    fn held(&self, free: &DMatrix<f64>, answer: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let n = self.stiffness.nrows();
        let [on_x, on_v] = [0, n].map(|at| answer.rows(at, n));
        let (gx, g) = (&self.w * on_x, &self.w * on_v);
        if !((&g * &self.push).dot(&self.normal) > 0.0) {
            return None;
        }
        let mut v_missing = &self.w * free.rows(n, n);
        v_missing.columns_mut(0, n).zip_apply(&self.w, |missing, w| *missing += w);
        let x_missing = &self.w * free.rows(0, n);
        let mut step = free.clone();
        step.rows_mut(0, n).gemm(-1.0, &on_x, &gx.lu().solve(&x_missing)?, 1.0);
        step.rows_mut(n, n).gemm(-1.0, &on_v, &g.lu().solve(&v_missing)?, 1.0);
        Some(step)
    }

    /// Returns the explicit step under the geometric scheme: x′ = X x + v′, where X is the remainder after the
    /// deformation, and v′ = P(v + h²K X x + hD v).
    fn deformed(&self, h: f64) -> DMatrix<f64> {
        let n = self.stiffness.nrows();
        let identity = DMatrix::<f64>::identity(n, n);
        let (x_from_x, p) = (&identity - &self.deformation * &self.w, &identity - &self.response * &self.w);
        let v_from_x = &p * (&self.stiffness * &x_from_x) * (h * h);
        let v_from_v = &p * (&identity + &self.damping * h);
        let mut step = DMatrix::zeros(2 * n, 2 * n);
        step.view_mut((0, 0), (n, n)).copy_from(&(&x_from_x + &v_from_x));
        step.view_mut((0, n), (n, n)).copy_from(&v_from_v);
        step.view_mut((n, 0), (n, n)).copy_from(&v_from_x);
        step.view_mut((n, n), (n, n)).copy_from(&v_from_v);
        step
    }

    /// Returns whether a small random velocity grows in the running model.
    pub(super) fn grows(&self, touching: Touching, h: f64) -> bool {
        let (state, tip) = match touching {
            Touching::Free => (&self.at_rest, self.tip + Vec3::z() * 1e6),
            Touching::Held => (&self.pressed, self.tip),
        };
        let mut state = state.clone();
        let mut seed = 1_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        // In long ticks the perturbation displaces the contact further, so its energy is reduced.
        let energy = PERTURBATION * self.work / (1.0 + self.stiffness.norm() * h * h);
        let mass = &self.model.patch.mass;
        for (v, m) in state.v.iter_mut().zip(mass) {
            *v = Vec3::from_fn(|_, _| noise()) * (energy / (m * mass.len() as f64)).sqrt();
        }
        let start = self.model.kinetic_energy(&state.v);
        let Ok((model, state)) = self.model.clone().integrated(state, self.integrator, h) else { return true };
        let mut simulation = LocalSimulation::new(self.rules, h, self.surface.clone(), model, state);
        if touching == Touching::Held {
            simulation.hold(self.contact);
        }
        let expected = match touching {
            Touching::Free => Mode::Free,
            Touching::Held => Mode::Stick,
        };
        let mut largest = [start, 0.0];
        for tick in 0..TICKS {
            let mode = simulation.tick(tip, tip).mode;
            let energy = self.model.kinetic_energy(&simulation.state().v);
            // A contact that is lost has grown by more than the margin it started with.
            if !(mode == expected && energy <= start * 1e12) {
                return true;
            }
            let half = &mut largest[2 * tick / TICKS];
            *half = half.max(energy);
        }
        largest[1] > GROWN * largest[0]
    }

    /// Returns the normal velocity of the pressed contact that is left of an impulse at the end of a tick, over that of a
    /// short tick.
    fn hold(&self, h: f64) -> Option<f64> {
        let [_, answer] = self.free_step(h)?;
        let along = |on: &DMatrix<f64>| (&self.w * on * &self.push).dot(&self.normal);
        let n = self.stiffness.nrows();
        Some(along(&answer.rows(n, n).into_owned()) / along(&self.w.transpose()))
    }

    /// Returns why the measured boundary differs from the predicted one, if the matrix shows it.
    pub(super) fn reason(
        &self,
        touching: Touching,
        measured_s: Option<f64>,
        predicted_s: Option<f64>,
    ) -> Option<String> {
        let measured = measured_s.unwrap_or(LONGEST);
        let radius = self.spectral_radius(touching, measured);
        let growth = radius.powi(TICKS as i32);
        if radius > 1.0 + ON_THE_CIRCLE && growth < GROWN {
            return Some(format!(
                "at the measured boundary a mode grows by a factor of {growth:.2} in {TICKS} ticks, too little to detect"
            ));
        }
        let hold = self.hold(measured.min(predicted_s.unwrap_or(LONGEST)));
        if let (Touching::Held, Some(hold)) = (touching, hold.filter(|hold| hold.abs() < ROUNDED)) {
            return Some(format!(
                "motion decays within a tick: {hold:.0e} of an impulse's velocity remains, and rounding decides"
            ));
        }
        let beyond =
            |share: u32| predicted_s.is_some_and(|h| self.grows(touching, h * (1.0 + 0.005 * f64::from(share))));
        (1..=4).any(beyond).then(|| {
            "perturbations also grow just beyond the predicted step: stable and unstable steps alternate".to_owned()
        })
    }
}
