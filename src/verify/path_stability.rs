//! Stability of a scene's local models along its path: the stability-limit time step of every model that a run uses, and
//! the growth of its fastest-growing mode.
//!
//! A cycle of a local model is a linear map of small displacements and velocities. The map is a power of that of its free
//! tick, with the contact point held in the directions in which the contact holds it. Its eigenvalue of the largest
//! magnitude, by Arnoldi's method, is the factor by which a perturbation grows until the next model arrives. A model with a
//! factor above 1 diverges if it is kept.

use nalgebra::{DMatrix, DVector, Schur};
use serde::Serialize;

use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::report::TickReport;
use crate::contact::simulation::LocalSimulation;
use crate::dynamics::stability::explicit_step_limit;
use crate::local::model::{LocalModel, LocalState};
use crate::local::step::LocalIntegrator;
use crate::output::summary::{Recorder, Summary};
use crate::output::verdict::Verdict;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};
use crate::surface::support::{Metric, Support};

/// Dimensions of the two Krylov spaces, whose eigenvalues have to agree.
const KRYLOV: [usize; 2] = [16, 24];
/// Largest number of ticks over which the growth is computed; in longer cycles it is extrapolated.
const MOST_TICKS: u32 = 200;
/// Largest displacement of a node in the difference of two ticks, as a share of the mesh's spacing: far above rounding, and
/// far below a length over which springs turn.
const PERTURBATION: f64 = 1e-6;
/// Relative difference between the two Krylov spaces above which the growth is not known.
const SETTLED: f64 = 0.05;
/// Growth within a cycle above which a model counts as unstable: rounding leaves a millionth of an undamped mode's 1.
const GROWS: f64 = 1.01;

/// A local model that a run used.
#[derive(Debug, Clone, Serialize)]
pub struct ModelStability {
    /// First tick of the model.
    pub tick: u64,
    /// Contact mode of that tick.
    pub mode: &'static str,
    /// Stability-limit time step of explicit integration at the model's state, with the exterior fixed, s; absent where there
    /// is none.
    pub limit_s: Option<f64>,
    /// Factor by which the fastest-growing mode grows within a cycle; below 1 it decays.
    pub growth_per_cycle: f64,
    /// Growth rate of that mode, 1/s; negative if it decays.
    pub growth_rate_per_s: f64,
    /// Whether the two Krylov spaces agree on the growth.
    pub settled: bool,
}

impl ModelStability {
    fn is_unstable(&self) -> bool {
        !(self.growth_per_cycle <= GROWS)
    }
}

/// Stability of a scene along its path.
#[derive(Debug, Clone, Serialize)]
pub struct PathStability {
    /// Verdict on the path.
    pub verdict: Verdict,
    /// The finding with its numbers, and what would help.
    pub reason: String,
    /// Local tick, s.
    pub step_s: f64,
    /// Models in the order of their use.
    pub models: Vec<ModelStability>,
}

impl PathStability {
    /// Runs a scene and analyses every local model that it uses. The whole network at the haptic rate is analysed at its
    /// state once a cycle.
    ///
    /// # Errors
    /// If the scene cannot start.
    ///
    /// ```
    /// use stickslip::output::verdict::Verdict;
    /// use stickslip::{scene::Scene, verify::path_stability::PathStability};
    ///
    /// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program").with_ticks(400);
    /// let stable = PathStability::of(&scene, &mut |_| ())?;
    /// assert_eq!((stable.models.len(), stable.verdict), (4, Verdict::Pass));
    /// // Springs a hundred times as stiff need shorter ticks.
    /// let mut stiff = scene.clone();
    /// stiff.material.stiffness *= 100.0;
    /// stiff.material.damping *= 100.0;
    /// let diverged = PathStability::of(&stiff, &mut |_| ())?;
    /// assert_eq!(diverged.verdict, Verdict::Fail);
    /// assert!(diverged.models[0].growth_per_cycle > 1e3 && diverged.models[0].limit_s < Some(scene.tick_s()));
    /// # Ok::<(), stickslip::SceneError>(())
    /// ```
    pub fn of(scene: &Scene, progress: &mut impl FnMut(u64)) -> Result<Self, SceneError> {
        let simulation = Simulation::prepare(scene)?;
        let cycle = u64::from(scene.ticks_per_cycle());
        let mut models = Vec::new();
        let mut recorder = Recorder::default();
        let fault = simulation
            .run(|view| {
                recorder.record(view);
                progress(view.tick + 1);
                let begins = if scene.is_full() { view.tick % cycle == 0 } else { view.model_age == 0 };
                if begins {
                    models.push(look(scene, view.local, view.report, view.tick));
                }
            })
            .err();
        let summary = recorder.summary(scene, fault.as_ref(), 0.0);
        let (verdict, reason) = judge(scene, &summary, &models);
        Ok(Self { verdict, reason, step_s: scene.tick_s(), models })
    }
}

/// Judges a run and its models.
fn judge(scene: &Scene, summary: &Summary, models: &[ModelStability]) -> (Verdict, String) {
    let worst = models.iter().max_by(|a, b| a.growth_per_cycle.total_cmp(&b.growth_per_cycle));
    let at = |model: &ModelStability| {
        format!("tick {} ({:.3} s, {})", model.tick, model.tick as f64 * scene.tick_s(), model.mode)
    };
    let turning = models.iter().find(|model| model.is_unstable());
    if let Some(fault) = &summary.fault {
        let turned = turning.map_or_else(
            || {
                "no model grows by itself: contact and hand-overs excite each other; give a higher `global.rate` or \
                `contact.scheme = \"massless\"`"
                    .to_owned()
            },
            |model| {
                let (factor, help) = (model.growth_per_cycle, help(scene, model));
                format!("the model from {} on grows by a factor of {factor:.2e} within a cycle: {help}", at(model))
            },
        );
        return (Verdict::Fail, format!("the run ends in a fault ({fault}); {turned}"));
    }
    if let Some(model) = turning {
        let grown = models.iter().filter(|model| model.is_unstable()).count();
        let (factor, help) = (model.growth_per_cycle, help(scene, model));
        let largest = worst.map_or(factor, |worst| worst.growth_per_cycle);
        let reason = format!(
            "the run completes, but {grown} of {} models would diverge if they were kept: the first, from {} on, grows by a \
             factor of {factor:.3} within a cycle, the largest factor is {largest:.3}; {help}",
            models.len(),
            at(model)
        );
        return (Verdict::Inconclusive, reason);
    }
    let open = models.iter().filter(|model| !model.settled).count();
    if open > 0 {
        let reason = format!(
            "the largest growth of {open} of {} models is not known: {} and {} Krylov vectors do not agree",
            models.len(),
            KRYLOV[0],
            KRYLOV[1]
        );
        return (Verdict::Inconclusive, reason);
    }
    let shortest = models.iter().filter_map(|model| model.limit_s).fold(f64::INFINITY, f64::min);
    let limit = match (scene.integrator, shortest.is_finite()) {
        (LocalIntegrator::SemiImplicitEuler, true) => format!(
            "; the shortest stability-limit time step is {:.3} ms, the local tick {:.3} ms",
            1e3 * shortest,
            1e3 * scene.tick_s()
        ),
        _ => String::new(),
    };
    let factor = worst.map_or(0.0, |worst| worst.growth_per_cycle);
    (
        Verdict::Pass,
        format!("no mode of {} models grows: the largest factor within a cycle is {factor:.3}{limit}", models.len()),
    )
}

/// Returns what would help against a growing model.
fn help(scene: &Scene, model: &ModelStability) -> String {
    match model.limit_s {
        Some(limit) if scene.integrator == LocalIntegrator::SemiImplicitEuler && !(scene.tick_s() <= limit) => format!(
            "its stability-limit time step is {:.3} ms and the local tick {:.3} ms; give a higher `local.rate` or an implicit \
             `local.integrator`",
            1e3 * limit,
            1e3 * scene.tick_s()
        ),
        _ => "its steps are short enough, but its stiffness is indefinite: give `local.tangent = \"stabilised\"`, \
              `local.linearization = \"none\"`, a higher `global.rate` or a smaller drag"
            .to_owned(),
    }
}

/// Analyses the model in use after its first tick.
fn look(scene: &Scene, local: &LocalSimulation, report: &TickReport, tick: u64) -> ModelStability {
    let model = local.model();
    let mut inverse_mass = model.patch.inverse_mass.clone();
    inverse_mass.resize(model.patch.len() + model.patch.boundary.len(), 0.0);
    let limit = explicit_step_limit(&model.patch.springs, &local.state().x, &inverse_mass, scene.material.drag);
    let ticks = scene.ticks_per_cycle().min(MOST_TICKS);
    let [early, late] = TickMap::new(scene, local, report).largest_growth(ticks);
    // A strongly damped model decays in either space, so its exact factor need not agree.
    let settled = (early.max(0.5) / late.max(0.5) - 1.0).abs() <= SETTLED;
    let growth_rate_per_s = late.ln() / (f64::from(ticks) * scene.tick_s());
    let growth_per_cycle = (growth_rate_per_s / scene.global_rate_hz()).exp();
    ModelStability {
        tick,
        mode: report.mode.name(),
        limit_s: limit.step.is_finite().then_some(limit.step),
        growth_per_cycle,
        growth_rate_per_s,
        settled,
    }
}

/// The directions in which a contact holds its point.
enum Held {
    Nothing,
    Normal(Vec3),
    Point,
}

/// The map of small displacements and velocities over a tick.
struct TickMap<'a> {
    model: &'a LocalModel,
    state: &'a LocalState,
    /// Largest displacement in a difference of two ticks, m.
    step_m: f64,
    tick_s: f64,
    held: Held,
    support: Support,
}

impl<'a> TickMap<'a> {
    fn new(scene: &Scene, local: &'a LocalSimulation, report: &TickReport) -> Self {
        let mut support = Support::with_capacity(local.surface().geometry.largest_support());
        let mut held = Held::Nothing;
        if let Some(contact) = local.contact() {
            let touch = local.shape().touch(Metric::Mass, &contact.point, &mut support);
            if support.scale() > 0.0 {
                held = match report.mode {
                    Mode::Free => Held::Nothing,
                    Mode::Stick => Held::Point,
                    Mode::Slide | Mode::Slip => Held::Normal(touch.normal),
                };
            }
        }
        let step_m = PERTURBATION * scene.mesh.spacing();
        Self { model: local.model(), state: local.state(), step_m, tick_s: scene.tick_s(), held, support }
    }

    fn nodes(&self) -> usize {
        self.model.patch.len()
    }

    /// Removes what the contact holds from displacements or velocities.
    fn project(&self, values: &mut [Vec3]) {
        match self.held {
            Held::Nothing => {}
            Held::Normal(normal) => self.support.project_sliding(normal, values),
            Held::Point => self.support.project_sticking(values),
        }
    }

    /// Returns the displacements and velocities after a free tick from a perturbed state.
    fn free_tick(&self, x: &[Vec3], v: &[Vec3], factor: f64) -> (Vec<Vec3>, Vec<Vec3>) {
        let n = self.nodes();
        let mut state = self.state.clone();
        for i in 0..n {
            state.x[i] += x[i] * factor;
            state.v[i] += v[i] * factor;
        }
        if let Some(step) = &self.model.step {
            self.model.predict(step, 0.0, &mut state);
            return (state.x_predicted[..n].to_vec(), state.v_predicted[..n].to_vec());
        }
        self.model.evaluate_forces(0.0, &mut state);
        for i in 0..n {
            state.v[i] += state.f[i] * (self.tick_s * self.model.patch.inverse_mass[i]);
            state.x[i] += state.v[i] * self.tick_s;
        }
        (state.x[..n].to_vec(), state.v[..n].to_vec())
    }

    /// Applies the map to displacements, m, and velocities, m/s, of any size, by a central difference of two ticks, which
    /// is exact for a linear model.
    fn apply(&self, x: &mut [Vec3], v: &mut [Vec3]) {
        self.project(x);
        self.project(v);
        let size = x
            .iter()
            .map(Vec3::amax)
            .fold(0.0, f64::max)
            .max(self.tick_s * v.iter().map(Vec3::amax).fold(0.0, f64::max));
        if !(size > 0.0 && size.is_finite()) {
            return;
        }
        let factor = self.step_m / size;
        let ([x_up, v_up], [x_down, v_down]) =
            (<[_; 2]>::from(self.free_tick(x, v, factor)), <[_; 2]>::from(self.free_tick(x, v, -factor)));
        for i in 0..x.len() {
            x[i] = (x_up[i] - x_down[i]) / (2.0 * factor);
            v[i] = (v_up[i] - v_down[i]) / (2.0 * factor);
        }
        self.project(x);
        self.project(v);
    }

    /// Applies the map of `ticks` ticks in the coordinates (M^½ x, h M^½ v), in which an undamped mode keeps its length.
    fn cycle(&self, vector: &DVector<f64>, ticks: u32) -> DVector<f64> {
        let n = self.nodes();
        let mass = &self.model.patch.mass;
        let at = |i: usize| Vec3::new(vector[3 * i], vector[3 * i + 1], vector[3 * i + 2]);
        let mut x: Vec<Vec3> = (0..n).map(|i| at(i) / mass[i].sqrt()).collect();
        let mut v: Vec<Vec3> = (0..n).map(|i| at(n + i) / (self.tick_s * mass[i].sqrt())).collect();
        for _ in 0..ticks {
            self.apply(&mut x, &mut v);
        }
        let scaled = x.iter().zip(mass).map(|(x, m)| x * m.sqrt());
        let scaled = scaled.chain(v.iter().zip(mass).map(|(v, m)| v * (m.sqrt() * self.tick_s)));
        DVector::from_iterator(6 * n, scaled.flat_map(|value| [value.x, value.y, value.z]))
    }

    /// Returns the largest |eigenvalue| of `ticks` ticks, by two Krylov spaces, the smaller first.
    fn largest_growth(&self, ticks: u32) -> [f64; 2] {
        let size = 6 * self.nodes();
        let mut seed = 1_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        // One tick removes from the first vector what the contact holds and what decays at once.
        let mut start = self.cycle(&DVector::from_fn(size, |_, _| noise()), 1);
        let norm = start.norm();
        if !(norm > 0.0) {
            return [norm; 2];
        }
        start /= norm;
        let most = KRYLOV[1].min(size);
        let (mut basis, mut h) = (vec![start], DMatrix::<f64>::zeros(most + 1, most));
        let mut found = [f64::NAN; 2];
        for column in 0..most {
            let mut next = self.cycle(&basis[column], ticks);
            if !next.iter().all(|value| value.is_finite()) {
                return [f64::INFINITY; 2];
            }
            let length = next.norm();
            // Once more, since one pass of Gram and Schmidt loses orthogonality.
            for _ in 0..2 {
                for (row, vector) in basis.iter().enumerate() {
                    let along = vector.dot(&next);
                    h[(row, column)] += along;
                    next.axpy(-along, vector, 1.0);
                }
            }
            let rest = next.norm();
            h[(column + 1, column)] = rest;
            let (dimension, is_closed) = (column + 1, !(rest > f64::EPSILON * length));
            if is_closed || dimension == KRYLOV[0] || dimension == most {
                let radius = spectral_radius(h.view((0, 0), (dimension, dimension)).into_owned());
                if is_closed || dimension < KRYLOV[0] {
                    return [radius; 2];
                }
                found[usize::from(dimension != KRYLOV[0])] = radius;
            }
            basis.push(next / rest);
        }
        if found[1].is_nan() { [found[0]; 2] } else { found }
    }
}

/// Returns the largest |eigenvalue| of a small matrix; NaN if the iteration does not converge.
fn spectral_radius(matrix: DMatrix<f64>) -> f64 {
    const ITERATIONS: usize = 10_000;
    let Some(schur) = Schur::try_new(matrix, f64::EPSILON, ITERATIONS) else { return f64::NAN };
    schur.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max)
}
