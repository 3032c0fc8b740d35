//! Implicit and exact steps of the linear model, compared with a dense solution that shares no formula with them:
//! order, energy, stability, and the laws at the end of a tick.

use nalgebra::{DMatrix, DVector};
use std::sync::Arc;
use stickslip::contact::law::{Friction, Interface, Law, Mode};
use stickslip::contact::rules::Scheme;
use stickslip::dynamics::constraint::Unconstrained;
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::dynamics::stability::explicit_step_limit;
use stickslip::local::error::ModelError;
use stickslip::local::linearization::LinearForces;
use stickslip::local::model::{ExteriorKind, Linearization, LocalModel, LocalModelBuilder, LocalSettings, LocalState};
use stickslip::local::patch::{Extent, PatchSelector};
use stickslip::local::step::{ContactResponse, LinearStep, LocalIntegrator};
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::springs::{Spring, TangentKind};
use stickslip::model::state::State;
use stickslip::model::topology::Surface;
use stickslip::output::summary::Recorder;
use stickslip::pipeline::{self, TickView};
use stickslip::scene::Scene;
use stickslip::surface::geometry::{ContactSurface, SurfaceModel};
use stickslip::surface::support::{Metric, Support};
use stickslip::verify::residual::larger;
use stickslip::verify::residual::largest;
use stickslip::{Mat3, Vec3};

use crate::check::{Worst, scene, shipped};

const IMPLICIT: [LocalIntegrator; 3] =
    [LocalIntegrator::ImplicitEuler, LocalIntegrator::ImplicitMidpoint, LocalIntegrator::Exponential];
const H: f64 = 1e-3;
/// Amplitude of the initial velocities of free motions, m/s.
const START_SPEED: f64 = 0.05;
const LAWS: [Law; 3] = [Law::Sliding, Law::Sticking, Law::StickSlip { friction: Friction::single(0.5) }];

/// Materials of a block of unequal masses, and its approximation.
#[derive(Clone, Copy)]
struct Setup {
    stiffness: f64,
    damping: f64,
    drag: f64,
    gravity: Vec3,
    tangent: TangentKind,
    exterior: ExteriorKind,
}

const DAMPED: Setup = Setup {
    stiffness: 100.0,
    damping: 0.5,
    drag: 0.05,
    gravity: Vec3::new(0.5, 0.0, -9.81),
    tangent: TangentKind::Exact,
    exterior: ExteriorKind::Drifting,
};
const UNDAMPED: Setup = Setup { damping: 0.0, drag: 0.0, exterior: ExteriorKind::Fixed, ..DAMPED };

/// Patch of one ring of a moving, deformed block, for ticks of h.
fn moving(setup: Setup, integrator: LocalIntegrator, h: f64) -> (LocalModel, LocalState) {
    let block = Block { nodes: [5, 4, 3], spacing: 0.0125, stencil: Stencil::Shear };
    let mesh = block.mesh();
    let count = mesh.nodes.len();
    let Setup { stiffness, damping, drag, gravity, tangent, exterior } = setup;
    let node_mass = (0..count).map(|i| 0.01 + 0.002 * (i % 7) as f64).collect();
    let material = Material { node_mass, stiffness: stiffness.into(), damping: damping.into(), drag, gravity };
    let network = Network::new(&mesh, &material, (0..count).map(|i| block.is_bottom(i)).collect())
        .expect("a value for each node");
    let mut state = network.rest_state();
    for i in (0..count).filter(|&i| !network.fixed[i]) {
        let wave = |k: f64| (k * (i as f64 + 1.0)).sin();
        state.x[i] += Vec3::new(wave(1.3), wave(2.1), wave(3.1)) * 1e-3;
        state.v[i] = Vec3::new(wave(1.7), wave(2.9), wave(0.7)) * START_SPEED;
    }
    let surface = Arc::new(Surface::new(&mesh).expect("a block has a surface"));
    let settings = LocalSettings { extent: Extent::Rings(1), linearization: Linearization::Tangent(tangent), exterior };
    LocalModelBuilder::new(&network, SurfaceModel::faceted(surface), settings)
        .with_integrator(integrator, h)
        .build(&network, &state, state.x[count - 8], None)
        .expect("its step has a solution")
}

/// Integrates one free tick.
fn tick(model: &LocalModel, state: &mut LocalState, elapsed: f64) {
    let step = model.step.as_ref().expect("not the explicit integrator");
    model.predict(step, elapsed, state);
    std::mem::swap(&mut state.x, &mut state.x_predicted);
    std::mem::swap(&mut state.v, &mut state.v_predicted);
}

/// Finds M v̇ = Kx + Dv + c + t g over the patch by probing the forces: they are affine, so that differences are exact
/// except for rounding.
struct Dense {
    mass: DVector<f64>,
    k: DMatrix<f64>,
    d: DMatrix<f64>,
    constant: DVector<f64>,
    growth: DVector<f64>,
}

impl Dense {
    fn probe(model: &LocalModel, state: &LocalState) -> Self {
        let mut probe = state.clone();
        let n = 3 * model.patch.len();
        let mut forces = |elapsed: f64, x: Option<usize>, v: Option<usize>| {
            probe.x.fill(Vec3::zeros());
            probe.v.fill(Vec3::zeros());
            x.into_iter().for_each(|i| probe.x[i / 3][i % 3] = 1.0);
            v.into_iter().for_each(|i| probe.v[i / 3][i % 3] = 1.0);
            model.evaluate_forces(elapsed, &mut probe);
            DVector::from_fn(n, |i, _| probe.f[i / 3][i % 3])
        };
        let constant = forces(0.0, None, None);
        let growth = forces(1.0, None, None) - &constant;
        let columns = |columns: Vec<DVector<f64>>| DMatrix::from_columns(&columns);
        Self {
            k: columns((0..n).map(|i| forces(0.0, Some(i), None) - &constant).collect()),
            d: columns((0..n).map(|i| forces(0.0, None, Some(i)) - &constant).collect()),
            mass: DVector::from_fn(n, |i, _| model.patch.mass[i / 3]),
            constant,
            growth,
        }
    }

    /// Builds F of z' = Fz over z = (x, v, 1, t), with a constant force added.
    fn system(&self, force: &DVector<f64>) -> DMatrix<f64> {
        let n = self.mass.len();
        let mut f = DMatrix::zeros(2 * n + 2, 2 * n + 2);
        for i in 0..n {
            f[(i, n + i)] = 1.0;
            for j in 0..n {
                f[(n + i, j)] = self.k[(i, j)] / self.mass[i];
                f[(n + i, n + j)] = self.d[(i, j)] / self.mass[i];
            }
            f[(n + i, 2 * n)] = (self.constant[i] + force[i]) / self.mass[i];
            f[(n + i, 2 * n + 1)] = self.growth[i] / self.mass[i];
        }
        f[(2 * n + 1, 2 * n)] = 1.0;
        f
    }

    /// Returns z after a tick: z₁ = e^{hF}z₀, or (1 − θhF)z₁ = (1 + (1 − θ)hF)z₀ for forces at the fraction θ of it.
    fn propagator(&self, integrator: LocalIntegrator, h: f64, force: &DVector<f64>) -> DMatrix<f64> {
        let f = self.system(force) * h;
        let one = DMatrix::identity(f.nrows(), f.nrows());
        let theta = match integrator {
            LocalIntegrator::Exponential => return f.exp(),
            LocalIntegrator::ImplicitMidpoint => 0.5,
            _ => 1.0,
        };
        (&one - &f * theta).lu().solve(&(one + f * (1.0 - theta))).expect("it has a solution")
    }
}

fn stacked(state: &LocalState, m: usize, elapsed: f64) -> DVector<f64> {
    let mut z = DVector::zeros(6 * m + 2);
    for i in 0..3 * m {
        (z[i], z[3 * m + i]) = (state.x[i / 3][i % 3], state.v[i / 3][i % 3]);
    }
    (z[6 * m], z[6 * m + 1]) = (1.0, elapsed);
    z
}

/// Returns the largest difference of positions over the largest position, or of velocities over the largest speed, at
/// least that of the start: decayed motion is compared with its initial size.
fn difference(a: &DVector<f64>, b: &DVector<f64>, m: usize) -> f64 {
    let part = |at: usize, least: f64| {
        let apart = a.rows(at, 3 * m) - b.rows(at, 3 * m);
        largest(apart.iter().map(|d| d.abs())) / b.rows(at, 3 * m).amax().max(least)
    };
    larger(part(0, 0.0), part(3 * m, START_SPEED))
}

/// The θ-methods as one linear system in (x, v) agree with their elimination to A only if nothing was lost on the
/// way; e^{hF} of the second-order system is the exact solution.
#[test]
fn free_ticks_are_those_of_the_dense_solution() {
    // Round-off of 100 ticks, of a dense solution in which x and v stand in one vector. Measured: 2e-12.
    let worst = Worst::new("dense linear model", "100 free ticks, relative", 1e-11);
    for setup in [DAMPED, UNDAMPED] {
        for integrator in IMPLICIT {
            for h in [H, 0.05] {
                let (model, mut state) = moving(setup, integrator, h);
                let m = model.patch.len();
                let propagator = Dense::probe(&model, &state).propagator(integrator, h, &DVector::zeros(3 * m));
                let mut z = stacked(&state, m, 0.0);
                for n in 0..100 {
                    tick(&model, &mut state, f64::from(n) * h);
                    z = &propagator * z;
                }
                worst.check(difference(&stacked(&state, m, 100.0 * h), &z, m));
            }
        }
    }
}

#[test]
fn free_order_is_one_two_and_exact() {
    let end = 0.04;
    for integrator in IMPLICIT {
        let errors = [40, 80, 160].map(|ticks| {
            let h = end / f64::from(ticks);
            let (model, mut state) = moving(DAMPED, integrator, h);
            let m = model.patch.len();
            let exact =
                Dense::probe(&model, &state).propagator(LocalIntegrator::Exponential, end, &DVector::zeros(3 * m))
                    * stacked(&state, m, 0.0);
            (0..ticks).for_each(|n| tick(&model, &mut state, f64::from(n) * h));
            difference(&stacked(&state, m, end), &exact, m)
        });
        let orders = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
        println!(
            "RESIDUAL | convergence | {}, free: error, orders | 0.1 | {:.1e}, {orders:.2?}",
            integrator.name(),
            errors[2]
        );
        let expected = match integrator {
            LocalIntegrator::ImplicitMidpoint => 2.0,
            LocalIntegrator::Exponential => {
                // Round-off. Measured: 4e-13.
                assert!(errors.iter().all(|&error| error <= 1e-11), "{errors:?}");
                continue;
            }
            _ => 1.0,
        };
        assert!((orders[1] - expected).abs() <= 0.1, "{}: {orders:?}", integrator.name());
    }
}

/// G and the effect of an impulse on positions, compared with two dense ticks that differ by a unit impulse.
#[test]
fn response_is_that_of_a_unit_impulse() {
    // Round-off of a difference of two ticks. Measured: 7e-14.
    let worst = Worst::new("dense linear model", "WA⁻¹Wᵀ and WXWᵀ by differences, relative", 1e-12);
    for setup in [DAMPED, UNDAMPED] {
        for integrator in IMPLICIT {
            let (model, state) = moving(setup, integrator, H);
            let m = model.patch.len();
            let mut support = Support::with_capacity(3);
            let weights = [(0, 0.5), (2, 0.3), (m - 1, 0.2)];
            support.set(Metric::Mass, weights.map(|(slot, w)| (slot, w, model.patch.inverse_mass[slot])));
            let mut response = ContactResponse::new(m);
            let step = model.step.as_ref().expect("not the explicit integrator");
            step.respond(&support, &mut response);
            let [g, gx] = response.at_contact(&support);
            let dense = Dense::probe(&model, &state);
            let after = |axis: Option<usize>| {
                let mut force = DVector::zeros(3 * m);
                if let Some(axis) = axis {
                    weights.iter().for_each(|&(slot, w)| force[3 * slot + axis] = w / H);
                }
                dense.propagator(integrator, H, &force) * stacked(&state, m, 0.0)
            };
            let free = after(None);
            for axis in 0..3 {
                let change = after(Some(axis)) - &free;
                let at = |first: usize| -> Vec3 {
                    weights.iter().map(|&(slot, w)| Vec3::from_fn(|a, _| change[first + 3 * slot + a]) * w).sum()
                };
                worst.check((at(3 * m) - g.column(axis)).norm() / g.norm());
                worst.check((at(0) - gx.column(axis)).norm() / gx.norm());
            }
        }
    }
}

/// Returns ½vᵀMv − ½xᵀKx − cᵀx, which a linear model without dampers conserves.
fn linear_energy(dense: &Dense, z: &DVector<f64>) -> f64 {
    let n = dense.mass.len();
    let (x, v) = (z.rows(0, n), z.rows(n, n));
    let kinetic: f64 = (0..n).map(|i| 0.5 * dense.mass[i] * v[i] * v[i]).sum();
    kinetic - 0.5 * x.dot(&(&dense.k * x)) - dense.constant.dot(&x)
}

#[test]
fn midpoint_and_exact_ticks_keep_the_energy_without_dampers() {
    // Round-off of 1,000 ticks relative to the energy of the motion. Measured: 3e-12.
    let worst = Worst::new("linear model", "energy without dampers, 1,000 ticks, relative", 3e-11);
    for integrator in [LocalIntegrator::ImplicitMidpoint, LocalIntegrator::Exponential] {
        let (model, mut state) = moving(Setup { gravity: Vec3::zeros(), ..UNDAMPED }, integrator, H);
        let m = model.patch.len();
        let dense = Dense::probe(&model, &state);
        let start = linear_energy(&dense, &stacked(&state, m, 0.0));
        let kinetic: f64 = model.kinetic_energy(&state.v);
        for n in 0..1000 {
            tick(&model, &mut state, f64::from(n) * H);
            worst.check((linear_energy(&dense, &stacked(&state, m, 0.0)) - start).abs() / kinetic);
        }
    }
}

/// A stabilised K is negative semidefinite, and implicit Euler takes energy from every mode, at every step length.
#[test]
fn implicit_euler_never_gains_energy_however_stiff() {
    for stiffness in [100.0, 1e8] {
        let setup = Setup { stiffness, tangent: TangentKind::Stabilised, gravity: Vec3::zeros(), ..UNDAMPED };
        for h in [1e-4, H, 0.1] {
            let (model, mut state) = moving(setup, LocalIntegrator::ImplicitEuler, h);
            let m = model.patch.len();
            let dense = Dense::probe(&model, &state);
            // The energy is relative to the equilibrium, where the quadratic form has its least value.
            let rest = dense.k.clone().lu().solve(&-&dense.constant).expect("held by the exterior");
            let energy = |state: &LocalState| {
                let z = stacked(state, m, 0.0);
                let (x, v) = (z.rows(0, 3 * m) - &rest, z.rows(3 * m, 3 * m));
                let kinetic: f64 = (0..3 * m).map(|i| 0.5 * dense.mass[i] * v[i] * v[i]).sum();
                kinetic - 0.5 * x.dot(&(&dense.k * &x))
            };
            let start = energy(&state);
            let mut last = start;
            for n in 0..200 {
                tick(&model, &mut state, f64::from(n) * h);
                let now = energy(&state);
                // Round-off of the form. Measured: no growth above 1e-16 of the start.
                assert!(now <= last + 1e-14 * start, "k = {stiffness}, h = {h}, tick {n}: {last:e} to {now:e}");
                last = now;
            }
            assert!(last < start, "k = {stiffness}, h = {h}: {last:e} of {start:e} is left");
        }
    }
}

/// An A that is singular or not finite ends in a named error, not in NaN.
#[test]
fn a_step_without_a_solution_is_named() {
    // One node beside a fixed one, at half the spring's length: laterally K = +k, and M − h²K = 1 − 1 = 0.
    let solve = |stiffness: f64, integrator| {
        let spring = Spring { nodes: [0, 1], stiffness, damping: 0.0, rest_length: 2.0 };
        let mesh = Block { nodes: [2, 2, 2], spacing: 1.0, stencil: Stencil::Structural }.mesh();
        let mut fixed = vec![true; 8];
        fixed[0] = false;
        let network = Network::from_parts(mesh.nodes.clone(), vec![1.0; 8], fixed, &[spring], vec![]);
        let surface = Surface::new(&mesh).expect("a block has a surface");
        let patch = PatchSelector::new(&network, &surface).select(
            &network,
            &surface,
            &network.rest,
            Vec3::zeros(),
            &[],
            Extent::All,
        );
        let x = [network.rest[0], network.rest[1]];
        let forces = LinearForces::new(&patch, &[], &x, &[Vec3::zeros(); 2], None, TangentKind::Exact);
        LinearStep::new(integrator, &forces, &patch.mass, 1.0).map(|_| ())
    };
    for (stiffness, integrator) in [
        (1.0, LocalIntegrator::ImplicitEuler),
        (4.0, LocalIntegrator::ImplicitMidpoint),
        (f64::MAX, LocalIntegrator::ImplicitEuler),
        (f64::INFINITY, LocalIntegrator::ImplicitMidpoint),
        (f64::INFINITY, LocalIntegrator::Exponential),
    ] {
        let expected = ModelError::NoStep { integrator: integrator.name(), rows: 3 };
        assert_eq!(solve(stiffness, integrator), Err(expected), "k = {stiffness}");
    }
    assert_eq!(solve(0.5, LocalIntegrator::ImplicitEuler), Ok(()));
}

/// Returns a shipped scene with another integrator of its patch.
fn drag(name: &str, surface: ContactSurface, law: Law, integrator: LocalIntegrator) -> Scene {
    let mut scene = shipped(name);
    (scene.surface, scene.contact.scheme, scene.contact.law) = (surface, Scheme::Velocity, law);
    scene.integrator = integrator;
    scene
}

fn completes(scene: &Scene, observe: impl FnMut(&TickView)) {
    pipeline::run(scene, observe).unwrap_or_else(|error| panic!("{} {}: {error}", scene.name, scene.integrator.name()));
}

/// Sticking takes the contact point to the tip, sliding into its tangent plane, and slip keeps to the cone.
#[test]
fn ticks_keep_the_law() {
    // Round-off of positions up to 0.05 m. Measured: 2e-17 m.
    let sticks = Worst::new("implicit steps", "sticking: p - q1 at the end of a tick, m", 1e-16);
    let slides = Worst::new("implicit steps", "sliding, slipping: (p - q1).n at the end of a tick, m", 1e-16);
    // Arithmetic of the law. Measured: 7e-16.
    let cone = Worst::new("implicit steps", "slipping: F_T / (μ F_N) - 1", 1e-14);
    for integrator in IMPLICIT {
        for surface in [ContactSurface::Faceted, ContactSurface::Subdivision] {
            for law in LAWS {
                let mut touched = 0;
                let mut scene = drag("fig5-stick-slip", surface, law, integrator);
                // Later, the exact tangent of the stuck block is indefinite, and exact ticks diverge with it.
                scene = scene.with_ticks(900);
                completes(&scene, |view| {
                    let Some(touch) = view.report.touch.filter(|_| !view.report.rigid) else { return };
                    touched += 1;
                    assert!(view.report.normal_force > 0.0, "tick {} pulls", view.tick);
                    let gap = view.local.shape().position(&touch.point) - view.tip;
                    match view.report.mode {
                        Mode::Stick => sticks.check(gap.norm()),
                        Mode::Slide | Mode::Slip => slides.check(gap.dot(&touch.normal).abs()),
                        Mode::Free => {}
                    }
                    let (tangential, bound) = (view.report.tangential_force(), 0.5 * view.report.normal_force);
                    match (view.report.mode, law) {
                        (Mode::Slip, _) => cone.check((tangential / bound - 1.0).abs()),
                        (Mode::Stick, Law::StickSlip { .. }) => assert!(tangential <= bound * (1.0 + 1e-12)),
                        _ => {}
                    }
                });
                assert!(touched > 700, "{} {surface:?} {law:?}: {touched} ticks in contact", integrator.name());
            }
        }
    }
}

/// With a G that turns impulses, where sticking would pull, or slip push backwards, sliding is solved and reported.
#[test]
fn a_law_without_a_solution_is_solved_as_sliding() {
    let n = Vec3::z();
    let r = Vec3::new(1.0, 0.0, -0.1);
    // Sticking to r needs a pull: G is symmetric positive definite, with strong coupling of x and z.
    let pulls = Mat3::new(1.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.5, 0.0, 1.0);
    assert!((pulls.try_inverse().expect("regular") * r).z < -0.1, "it pushes");
    let turned = Mat3::new(1.0, 0.0, -0.5, 0.0, 1.0, 0.0, -0.5, 0.0, 1.0);
    assert!((turned.try_inverse().expect("regular") * r).z > 0.0, "it pulls");
    for law in [Law::Sticking, Law::StickSlip { friction: Friction::single(1.0) }] {
        let push = law.impulse(&turned, r, n, 1e-3, Interface::NEW);
        assert!(push.fell_back && push.mode == Mode::Slide, "{push:?}");
        // n(n·r)/(n·Gn)
        assert_eq!(push.value, n * -0.1);
        assert!(!law.impulse(&Mat3::identity(), Vec3::new(0.01, 0.0, -1.0), n, 1e-3, Interface::NEW).fell_back);
    }
    // Sticking pushes, beyond the cone, and slip would have to push backwards. That takes a response against the push
    // (n·Gn < 0: n·GΛ = n·r < 0 otherwise bounds it), which exact steps of fast modes can have; sliding then pulls.
    let against = Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, -0.5);
    let push = Law::StickSlip { friction: Friction::single(0.4) }.impulse(
        &against,
        Vec3::new(1.0, 0.0, -0.5),
        n,
        1e-3,
        Interface::NEW,
    );
    assert!(push.fell_back && push.mode == Mode::Slide && push.value.z > 0.0, "{push:?}");
}

#[test]
fn fallbacks_are_counted() {
    let mut scene = scene(include_str!("../fixtures/crosscheck/implicit-euler-drifting.toml"));
    for (integrator, expected) in [(LocalIntegrator::ImplicitEuler, true), (LocalIntegrator::SemiImplicitEuler, false)]
    {
        scene.integrator = integrator;
        let (mut recorder, mut counted) = (Recorder::default(), 0);
        completes(&scene, |view| {
            recorder.record(view);
            counted += u64::from(view.report.fell_back);
        });
        let summary = recorder.summary(&scene, None, 0.0);
        assert_eq!(summary.fallback_ticks, counted);
        assert_eq!(counted > 0, expected, "{}: {counted}", integrator.name());
    }
}

/// In a network of 1e8 N/m and 10 g nodes, a hundred times too stiff for an explicit tick, pressed and dragged, every
/// commanded force is finite. Implicit Euler completes. The midpoint rule and exact ticks keep the contact's energy in
/// modes that turn many times within a tick; such a run may end, with a named fault.
#[test]
fn stiff_scenes_command_finite_forces() {
    for integrator in IMPLICIT {
        for law in LAWS {
            let mut scene = crate::check::small_scene(
                "law = \"sliding\"\nscheme = \"velocity\"\nsurface = \"subdivision\"",
                "tangent = \"stabilised\"",
                crate::check::PRESS_AND_DRAG,
            );
            (scene.material.stiffness, scene.integrator, scene.contact.law) = (1e8.into(), integrator, law);
            (scene.global.integrator, scene.global.substeps) = (GlobalIntegrator::ImplicitEuler, 10);
            scene.force_limit_n = f64::MAX;
            let run = crate::check::run(&scene);
            let largest = run.force.iter().map(Vec3::norm).fold(0.0, f64::max);
            let end = run.fault.map_or("completed".to_owned(), |fault| format!("tick {}: {}", fault.tick, fault.cause));
            println!(
                "RESIDUAL | stiff scene | {}, {law:?}: largest force (N), end | - | {largest:.1e} {end}",
                integrator.name()
            );
            assert!(run.force.iter().all(|force| force.iter().all(|f| f.is_finite())), "{}", integrator.name());
            assert!(largest > 1e5, "{}: {largest} N is no contact", integrator.name());
            assert!(integrator != LocalIntegrator::ImplicitEuler || run.fault.is_none(), "{law:?}: {end}");
        }
    }
}

/// A block that swings without a contact.
fn swinging(stiffness: f64) -> (Network, State) {
    let block = Block { nodes: [4, 3, 3], spacing: 0.0125, stencil: Stencil::Shear };
    let mesh = block.mesh();
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: (0..count).map(|i| 0.01 + 0.002 * (i % 7) as f64).collect(),
        stiffness: stiffness.into(),
        damping: 0.5.into(),
        drag: 0.05,
        gravity: Vec3::new(0.5, 0.0, -9.81),
    };
    let network = Network::new(&mesh, &material, (0..count).map(|i| block.is_bottom(i)).collect())
        .expect("a value for each node");
    let mut state = network.rest_state();
    for (i, v) in state.v.iter_mut().enumerate().filter(|(i, _)| !network.fixed[*i]) {
        let wave = |k: f64| (k * (i as f64 + 1.0)).sin();
        *v = Vec3::new(wave(1.7), wave(2.9), wave(0.7)) * START_SPEED;
    }
    (network, state)
}

/// Solves v₁ = v₀ + hM⁻¹f(x₀ + hv₁, v₁) by Newton's method with a dense Jacobian of differences, which shares only the
/// forces with the sparse one.
fn dense_implicit_euler(network: &Network, state: &mut State, h: f64) {
    let free: Vec<usize> = (0..3 * network.node_count()).filter(|i| !network.fixed[i / 3]).collect();
    let residual = |v: &DVector<f64>| {
        let mut at = state.clone();
        let mut f = vec![Vec3::zeros(); network.node_count()];
        for (value, &i) in v.iter().zip(&free) {
            at.v[i / 3][i % 3] = *value;
            at.x[i / 3][i % 3] += h * value;
        }
        network.forces(&at.x, &at.v, &mut f);
        DVector::from_fn(free.len(), |row, _| {
            let i = free[row];
            v[row] - state.v[i / 3][i % 3] - h * f[i / 3][i % 3] * network.inverse_mass[i / 3]
        })
    };
    let mut v = DVector::from_fn(free.len(), |row, _| state.v[free[row] / 3][free[row] % 3]);
    for _ in 0..30 {
        let now = residual(&v);
        let step = 1e-7;
        let jacobian = DMatrix::from_columns(
            &(0..free.len())
                .map(|column| {
                    let [mut ahead, mut behind] = [v.clone(), v.clone()];
                    ahead[column] += step;
                    behind[column] -= step;
                    (residual(&ahead) - residual(&behind)) / (2.0 * step)
                })
                .collect::<Vec<_>>(),
        );
        let change = jacobian.lu().solve(&now).expect("regular");
        v -= &change;
        if change.amax() < 1e-15 {
            break;
        }
    }
    for (value, &i) in v.iter().zip(&free) {
        state.v[i / 3][i % 3] = *value;
        state.x[i / 3][i % 3] += h * value;
    }
}

fn state_distance(a: &State, b: &State) -> f64 {
    let apart = |a: &[Vec3], b: &[Vec3]| largest(a.iter().zip(b).map(|(a, b)| (a - b).norm()));
    larger(apart(&a.x, &b.x) / 0.0125, apart(&a.v, &b.v) / START_SPEED)
}

#[test]
fn global_implicit_euler_is_the_dense_solution() {
    // Newton's remainder and round-off over 20 steps. Measured: 8e-15 and, with other kernels, 2e-13.
    let worst = Worst::new("dense Newton", "20 implicit Euler steps of the network, relative", 2e-12);
    for h in [1e-3, 1e-2] {
        let (network, mut sparse) = swinging(100.0);
        let mut dense = sparse.clone();
        let mut stepper = Stepper::new(&network);
        for _ in 0..20 {
            stepper.step(GlobalIntegrator::ImplicitEuler, &network, &mut sparse, h, &Unconstrained);
            dense_implicit_euler(&network, &mut dense, h);
            assert_eq!(stepper.failure(), None);
            worst.check(state_distance(&sparse, &dense));
        }
    }
}

/// Implicit steps ten times beyond the explicit limit, and at 1e8 N/m.
#[test]
fn global_implicit_euler_is_stable_where_explicit_steps_explode() {
    for stiffness in [100.0, 1e8] {
        let (network, start) = swinging(stiffness);
        let limit = explicit_step_limit(&network.springs, &network.rest, &network.inverse_mass, 0.05).step;
        let fastest = |integrator| {
            let mut state = start.clone();
            let mut stepper = Stepper::new(&network);
            (0..200).for_each(|_| stepper.step(integrator, &network, &mut state, 10.0 * limit, &Unconstrained));
            assert_eq!(stepper.failure(), None, "{stiffness}");
            largest(state.v.iter().map(Vec3::norm))
        };
        let (implicit, explicit) =
            (fastest(GlobalIntegrator::ImplicitEuler), fastest(GlobalIntegrator::SemiImplicitEuler));
        println!(
            "RESIDUAL | explicit limit | k = {stiffness:e}: largest speed after 200 steps of 10 limits, implicit and explicit (m/s) | - | {implicit:.1e} {explicit:.1e}"
        );
        assert!(implicit < START_SPEED, "{implicit}");
        assert!(!(explicit < 1e3 * START_SPEED), "{explicit}");
    }
}
