//! How long a step of the linear local model may be: measured on the running model by bisection, and
//! predicted as the step at which the spectral radius of its one-step matrix reaches 1.

use std::sync::Arc;

use nalgebra::DMatrix;
use serde::Serialize;
use thiserror::Error;

use crate::Vec3;
use crate::contact::law::{Law, Mode};
use crate::contact::operators::{Metric, Support};
use crate::contact::subdivision::LARGEST_SUPPORT;
use crate::contact::surface::{ContactGeometry, ContactPoint};
use crate::contact::tick::{ContactRules, Deformation, LocalSimulation, RIGID_BELOW, Scheme};
use crate::dynamics::stability::explicit_step_limit;
use crate::model::condensation::{Condensation, Reach};
use crate::model::local::{
    ExteriorKind, Linearization, LocalModel, LocalModelBuilder, LocalSettings, LocalState, ModelError,
};
use crate::model::network::Network;
use crate::model::patch::Extent;
use crate::model::springs::TangentKind;
use crate::model::surface::Surface;
use crate::scene::Scene;

/// Steps that are tried, s.
const SHORTEST: f64 = 1e-9;
const LONGEST: f64 = 10.0;
/// Halvings of the logarithm of that range: the boundary is known to 4e-4.
const HALVINGS: usize = 15;
/// Ticks of a measurement.
const TICKS: usize = 1000;
/// A perturbation grows if its kinetic energy does by this factor from the first half to the second.
const GROWN: f64 = 4.0;
/// Squarings of the one-step matrix that its spectral radius is taken from.
const SQUARINGS: u32 = 22;
/// What they leave of the norm where modes stay on the unit circle, as undamped ones do.
const ON_THE_CIRCLE: f64 = 1e-5;
/// Measured over predicted, minus one.
pub const TOLERANCE: f64 = 0.02;
/// A patch with more nodes is replaced by one of one ring: powers cost the cube of it.
const LARGEST_PATCH: usize = 60;
/// How deep the held contact is pressed in, in spacings, and the share of the work done that the
/// perturbation gets: little enough never to pull.
const PRESSED: f64 = 0.1;
const PERTURBATION: f64 = 1e-6;

/// What the local model is stepped with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// (11).
    SemiImplicitEuler,
}

impl Integrator {
    /// All, with their names in scenes.
    pub const ALL: [(&str, Self); 1] = [("semi-implicit-euler", Self::SemiImplicitEuler)];
}

/// Exteriors that a model may have, with their names in scenes. A drifting one adds a force that grows with
/// time to the K and D of a fixed one, so that its boundary is the same.
pub const EXTERIORS: [(&str, ExteriorKind); 2] = [
    ("fixed", ExteriorKind::Fixed),
    ("condensed", ExteriorKind::Condensed(Condensation { tangent: TangentKind::Exact, reach: Reach::All })),
];

/// What is varied; the rest is the scene's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// k of every spring, N/m.
    Stiffness,
    /// How much lighter than it was the node is that carries most of the contact point.
    MassRatio,
    /// ζ = cω_max/2k of the free patch with a fixed exterior.
    DampingRatio,
}

impl Axis {
    /// All.
    pub const ALL: [Self; 3] = [Self::Stiffness, Self::MassRatio, Self::DampingRatio];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Axis::Stiffness => "stiffness (N/m)",
            Axis::MassRatio => "mass ratio",
            Axis::DampingRatio => "damping ratio",
        }
    }

    /// Where it is measured.
    pub fn values(self) -> &'static [f64] {
        match self {
            Axis::Stiffness => &[1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8],
            Axis::MassRatio => &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6],
            Axis::DampingRatio => &[0.0, 0.1, 0.3, 1.0, 3.0, 10.0],
        }
    }
}

/// A point of a map, measured free and held.
#[derive(Debug, Clone, Copy)]
pub struct MapPoint {
    /// Of the local model.
    pub integrator: (&'static str, Integrator),
    /// Of the local model.
    pub exterior: (&'static str, ExteriorKind),
    /// What is varied.
    pub axis: Axis,
    /// To this.
    pub value: f64,
}

/// Every point of every map.
pub fn points() -> Vec<MapPoint> {
    let mut points = Vec::new();
    for integrator in Integrator::ALL {
        for exterior in EXTERIORS {
            for axis in Axis::ALL {
                points.extend(axis.values().iter().map(|&value| MapPoint { integrator, exterior, axis, value }));
            }
        }
    }
    points
}

/// Whether the patch is touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Touching {
    /// No contact.
    Free,
    /// A tip that stands still holds its point.
    Held,
}

/// A boundary, predicted and measured.
#[derive(Debug, Clone, Serialize)]
pub struct Boundary {
    /// Of the local model.
    pub integrator: &'static str,
    /// Of the local model.
    pub exterior: &'static str,
    /// Whether the patch is touched.
    pub touching: Touching,
    /// What is varied.
    pub axis: Axis,
    /// To this.
    pub value: f64,
    /// s; 0 where no step is stable, none where all are.
    pub predicted_s: Option<f64>,
    /// s; likewise.
    pub measured_s: Option<f64>,
    /// Measured over predicted; 1 where neither has a limit.
    pub ratio: f64,
    /// Whether that is 1 within [`TOLERANCE`].
    pub agrees: bool,
    /// Why it does not agree, where that is known.
    pub reason: Option<String>,
}

/// Why a scene has no maps.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MapError {
    /// The surface cannot be built.
    #[error("the mesh has no surface that can be touched")]
    NoSurface,
    /// Rigid contact.
    #[error("below the tip's first place the patch carries {free_weight:.2} of the contact point, less than half")]
    Rigid {
        /// Σ_free w.
        free_weight: f64,
    },
    /// K is singular.
    #[error("the patch can move without a force: nothing holds it against the tip")]
    NotHeld,
    /// The local model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// The boundary at a point of a map, free and held.
///
/// # Errors
/// If the scene's tip does not start above a patch that can be pressed.
pub fn boundaries(scene: &Scene, point: &MapPoint) -> Result<[Boundary; 2], MapError> {
    let model = Subject::new(scene, point)?;
    Ok([Touching::Free, Touching::Held].map(|touching| {
        let integrator = point.integrator.1;
        let predicted_s = longest_stable(|h| model.spectral_radius(integrator, touching, h) <= 1.0 + ON_THE_CIRCLE);
        let measured_s = longest_stable(|h| !model.grows(touching, h));
        let ratio = match (measured_s, predicted_s) {
            (Some(measured), Some(predicted)) if measured == predicted => 1.0,
            (Some(measured), Some(predicted)) => measured / predicted,
            (None, None) => 1.0,
            (None, Some(_)) => f64::INFINITY,
            (Some(_), None) => 0.0,
        };
        let agrees = (ratio - 1.0).abs() <= TOLERANCE;
        let reason = if agrees { None } else { model.reason(integrator, touching, measured_s) };
        Boundary {
            integrator: point.integrator.0,
            exterior: point.exterior.0,
            touching,
            axis: point.axis,
            value: point.value,
            predicted_s,
            measured_s,
            ratio,
            agrees,
            reason,
        }
    }))
}

/// The step up to which `stable` holds, found by bisection of its logarithm: 0 if it never does, `None` if
/// it always does.
fn longest_stable(mut stable: impl FnMut(f64) -> bool) -> Option<f64> {
    if stable(LONGEST) {
        return None;
    }
    let (mut below, mut above) = (SHORTEST.ln(), LONGEST.ln());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (below + above);
        if stable(middle.exp()) {
            below = middle;
        } else {
            above = middle;
        }
    }
    Some(if below > SHORTEST.ln() { (0.5 * (below + above)).exp() } else { 0.0 })
}

/// A linear local model at rest, its one-step matrices, and what it takes to run it.
struct Subject {
    rules: ContactRules,
    model: LocalModel,
    at_rest: LocalState,
    /// Pressed in, in equilibrium with the tip.
    pressed: LocalState,
    contact: ContactPoint,
    /// Of the pressed contact, m.
    tip: Vec3,
    /// Work that pressing took, J.
    work: f64,
    /// M^{-½} K M^{-½}, 1/s².
    stiffness: DMatrix<f64>,
    /// M^{-½} D M^{-½}, 1/s.
    damping: DMatrix<f64>,
    /// W M^{-½}.
    w: DMatrix<f64>,
    /// M^½ times what the geometric scheme moves the nodes by, per displacement of the contact point.
    deformation: DMatrix<f64>,
    /// M^½ times the direction in which P takes out the contact point's velocity.
    response: DMatrix<f64>,
}

impl Subject {
    fn new(scene: &Scene, point: &MapPoint) -> Result<Self, MapError> {
        let mesh = scene.block.mesh();
        let surface = Arc::new(Surface::new(&mesh).map_err(|_| MapError::NoSurface)?);
        let geometry = ContactGeometry::new(scene.surface, &surface).map_err(|_| MapError::NoSurface)?;
        let mut material = scene.material.clone();
        material.gravity = Vec3::zeros();
        if point.axis == Axis::Stiffness {
            material.stiffness = point.value;
        }
        let tangent = match scene.local.linearization {
            Linearization::Tangent(kind) => kind,
            Linearization::None => TangentKind::Exact,
        };
        let build = |material: &_, exterior, extent, touched| {
            let network = Network::new(&mesh, material, scene.fixed.clone());
            let settings = LocalSettings { extent, linearization: Linearization::Tangent(tangent), exterior };
            let mut builder = LocalModelBuilder::new(&network, surface.clone(), geometry.clone(), settings);
            builder.build(&network, &network.rest_state(), scene.path.at(0.0), touched)
        };
        let rules = ContactRules { law: Law::Sticking, ..scene.contact };
        let mut extent = scene.local.extent;
        let (mut model, mut state) = build(&material, ExteriorKind::Fixed, extent, None)?;
        if extent == Extent::All || model.patch.len() > LARGEST_PATCH {
            extent = Extent::Rings(1);
            (model, state) = build(&material, ExteriorKind::Fixed, extent, None)?;
        }
        let simulation = LocalSimulation::new(rules, 1.0, model, state);
        let contact = simulation.shape().nearest(scene.path.at(0.0)).ok_or(MapError::NoSurface)?;
        let (model, _) = build(&material, ExteriorKind::Fixed, extent, Some(contact.triangle))?;

        let mut support = Support::with_capacity(LARGEST_SUPPORT);
        let metric = scene.contact.scheme.metric();
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
                undamped.damping = 0.0;
                let (undamped, _) = build(&undamped, ExteriorKind::Fixed, extent, Some(contact.triangle))?;
                let omega = explicit_step_limit(&undamped.patch.springs, &x, &inverse_mass, 0.0).omega;
                material.damping = 2.0 * material.stiffness * point.value / omega;
            }
            (Axis::Stiffness | Axis::MassRatio, _) => {}
        }

        let (model, at_rest) = build(&material, point.exterior.1, extent, Some(contact.triangle))?;
        let simulation = LocalSimulation::new(rules, 1.0, model, at_rest.clone());
        let touch = simulation.shape().touch(metric, &contact, &mut support);
        let free_weight = support.free_weight();
        if !(free_weight >= RIGID_BELOW) {
            return Err(MapError::Rigid { free_weight });
        }
        let model = simulation.model().clone();
        let mass = &model.patch.mass;
        let dof = 3 * mass.len();
        let root = |i: usize| mass[i / 3].sqrt();
        let forces = model.linear_forces().ok_or(MapError::NotHeld)?;
        let scaled =
            |column: usize| DMatrix::from_fn(dof, dof, |i, j| forces.entry(i, column + j) / (root(i) * root(j)));
        let (stiffness, damping) = (scaled(0), scaled(dof));
        // One column for each direction of the contact point, from a number per support node.
        let columns = |of: &dyn Fn(usize, f64) -> f64| {
            let mut matrix = DMatrix::zeros(dof, 3);
            for node in support.nodes() {
                for a in 0..3 {
                    matrix[(3 * node.slot + a, a)] = of(node.slot, node.weight);
                }
            }
            matrix
        };
        let square = support.square_weight();
        let w = columns(&|slot, weight| weight / root(3 * slot)).transpose();
        let deformation = match scene.contact.scheme {
            Scheme::Geometric { deformation: Deformation::Rigid, .. } => {
                columns(&|slot, _| root(3 * slot) / free_weight)
            }
            Scheme::Geometric { deformation: Deformation::LeastNorm, .. } => {
                columns(&|slot, weight| root(3 * slot) * weight / square)
            }
            Scheme::Velocity => DMatrix::zeros(dof, 3),
        };
        let response = match metric {
            Metric::Euclidean => columns(&|slot, weight| root(3 * slot) * weight / square),
            Metric::Mass => columns(&|slot, weight| weight / root(3 * slot) / support.scale()),
        };

        // K u = Wᵀλ with W u = −δ n̂, in the scaled coordinates.
        let depth = PRESSED * scene.block.spacing;
        let compliance = stiffness.clone().lu().solve(&w.transpose()).ok_or(MapError::NotHeld)?;
        let push =
            (&w * &compliance).lu().solve(&(DMatrix::from_column_slice(3, 1, (touch.normal * -depth).as_slice())));
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
        Ok(Self { rules, model, at_rest, pressed, contact, tip, work, stiffness, damping, w, deformation, response })
    }

    /// Largest |eigenvalue| of one step, in the coordinates (M^½ x, h M^½ v).
    fn spectral_radius(&self, integrator: Integrator, touching: Touching, h: f64) -> f64 {
        let step = match integrator {
            Integrator::SemiImplicitEuler => self.semi_implicit_euler(touching, h),
        };
        // Gelfand: the 2ᵏ-th root of the norm of the 2ᵏ-th power, far cheaper than eigenvalues.
        let (mut power, mut logarithm) = (step, 0.0);
        for squaring in 0..=SQUARINGS {
            let norm = power.norm();
            if !(norm > 0.0 && norm.is_finite()) {
                return norm;
            }
            logarithm += norm.ln() / f64::from(1 << squaring);
            power /= norm;
            power = &power * &power;
        }
        logarithm.exp()
    }

    /// x′ = X x + v′ with X = I, or under the geometric scheme what the deformation leaves;
    /// v′ = P(v + h²K X x + hD v), under the velocity scheme less what the contact point has to go back.
    fn semi_implicit_euler(&self, touching: Touching, h: f64) -> DMatrix<f64> {
        let n = self.stiffness.nrows();
        let identity = DMatrix::<f64>::identity(n, n);
        let follows = touching == Touching::Held && self.rules.scheme == Scheme::Velocity;
        let (x_from_x, p) = match touching {
            Touching::Free => (identity.clone(), identity.clone()),
            Touching::Held => (&identity - &self.deformation * &self.w, &identity - &self.response * &self.w),
        };
        let mut v_from_x = &p * (&self.stiffness * &x_from_x) * (h * h);
        if follows {
            v_from_x -= &self.response * &self.w;
        }
        let v_from_v = &p * (&identity + &self.damping * h);
        let mut step = DMatrix::zeros(2 * n, 2 * n);
        step.view_mut((0, 0), (n, n)).copy_from(&(&x_from_x + &v_from_x));
        step.view_mut((0, n), (n, n)).copy_from(&v_from_v);
        step.view_mut((n, 0), (n, n)).copy_from(&v_from_x);
        step.view_mut((n, n), (n, n)).copy_from(&v_from_v);
        step
    }

    /// Whether a small random velocity grows in the running model.
    fn grows(&self, touching: Touching, h: f64) -> bool {
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
        let mass = &self.model.patch.mass;
        for (v, m) in state.v.iter_mut().zip(mass) {
            *v = Vec3::from_fn(|_, _| noise()) * (PERTURBATION * self.work / (m * mass.len() as f64)).sqrt();
        }
        let start = self.model.kinetic_energy(&state.v);
        let mut simulation = LocalSimulation::new(self.rules, h, self.model.clone(), state);
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
            // A contact that lets go has grown by more than the margin it started with.
            if !(mode == expected && energy <= start * 1e12) {
                return true;
            }
            let half = &mut largest[2 * tick / TICKS];
            *half = half.max(energy);
        }
        largest[1] > GROWN * largest[0]
    }

    /// Why the measured boundary is another one, if the matrix says so.
    fn reason(&self, integrator: Integrator, touching: Touching, measured_s: Option<f64>) -> Option<String> {
        let radius = self.spectral_radius(integrator, touching, measured_s?);
        let growth = radius.powi(TICKS as i32);
        (radius > 1.0 && growth < GROWN).then(|| {
            format!("at the measured boundary a mode grows by {growth:.2} in {TICKS} ticks, too little to be seen")
        })
    }
}
