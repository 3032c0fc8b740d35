//! The predicted stability-limit time step of explicit integration compared with the spectral radius of the one-step
//! matrix, and with simulations.

use nalgebra::DMatrix;
use stickslip::Vec3;
use stickslip::dynamics::constraint::Unconstrained;
use stickslip::dynamics::integrators::{GlobalIntegrator, Stepper};
use stickslip::dynamics::stability::explicit_step_limit;
use stickslip::local::step::LocalIntegrator;
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::state::ExternalForce;
use stickslip::verify::residual::largest;
use stickslip::verify::stability_map::{Axis, EXTERIORS, MapError, MapPoint, TOLERANCE, Touching, boundaries};

use crate::check::{Worst, small_scene};
use crate::network::dense_jacobian;

fn network(damping: f64, drag: f64) -> Network {
    let block = Block { nodes: [3, 3, 3], spacing: 0.0125, stencil: Stencil::Shear };
    let mesh = block.mesh();
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: (0..count).map(|i| 0.01 * (1.0 + (i % 5) as f64)).collect(),
        stiffness: 100.0.into(),
        damping: damping.into(),
        drag,
        gravity: Vec3::zeros(),
    };
    Network::new(&mesh, &material, (0..count).map(|i| block.is_bottom(i)).collect()).expect("a value for each node")
}

/// Returns the largest |eigenvalue| of one step of semi-implicit Euler over the free nodes.
fn spectral_radius(network: &Network, h: f64) -> f64 {
    let (k, d) = dense_jacobian(network);
    let free: Vec<usize> = (0..k.nrows()).filter(|i| !network.fixed[i / 3]).collect();
    let n = free.len();
    let drag = network.external.iter().map(|force| match force {
        ExternalForce::Drag(b) => *b,
        ExternalForce::Gravity(_) => 0.0,
    });
    let drag: f64 = drag.sum();
    let scaled = |matrix: &DMatrix<f64>, diagonal: f64| {
        DMatrix::from_fn(n, n, |i, j| {
            let value = matrix[(free[i], free[j])] - if i == j { diagonal } else { 0.0 };
            value * network.inverse_mass[free[i] / 3]
        })
    };
    let (a, b) = (scaled(&k, 0.0), scaled(&d, drag));
    let identity = DMatrix::<f64>::identity(n, n);
    let velocity_from_x = &a * h;
    let velocity_from_v = &identity + &b * h;
    let mut step = DMatrix::zeros(2 * n, 2 * n);
    step.view_mut((n, 0), (n, n)).copy_from(&velocity_from_x);
    step.view_mut((n, n), (n, n)).copy_from(&velocity_from_v);
    step.view_mut((0, 0), (n, n)).copy_from(&(&identity + &velocity_from_x * h));
    step.view_mut((0, n), (n, n)).copy_from(&(&velocity_from_v * h));
    largest(step.complex_eigenvalues().iter().map(|value| value.norm()))
}

#[test]
fn predicted_limit_is_where_the_spectral_radius_reaches_one() {
    // Tolerance of power iteration's Rayleigh quotient after 400 steps, and the width of the bracket. Measured:
    // the bracket holds at 1e-5.
    let bracket = 1e-4;
    for (damping, drag) in [(0.0, 0.0), (0.5, 0.0), (0.5, 0.4), (3.0, 0.0)] {
        let network = network(damping, drag);
        let limit = explicit_step_limit(&network.springs, &network.rest, &network.inverse_mass, drag).step;
        let below = spectral_radius(&network, limit * (1.0 - bracket));
        let above = spectral_radius(&network, limit * (1.0 + bracket));
        println!(
            "RESIDUAL | one-step matrix | spectral radius at the limit, c = {damping}, b = {drag} | {bracket:.0e} | {:.1e} ms, {below:.6}..{above:.6}",
            1e3 * limit
        );
        // Undamped modes are on the unit circle at every stable step.
        assert!(below <= 1.0 + 1e-9, "c = {damping}, b = {drag}: {below} just below the limit");
        assert!(above > 1.0 + 1e-6, "c = {damping}, b = {drag}: {above} just above the limit");
    }
}

#[test]
fn proportional_damping_has_its_closed_form() {
    // ω_max of the power iteration compared with that of a dense eigenvalue. Measured: 3e-12.
    let worst = Worst::new("closed form", "2(√(1+ζ²)-ζ)/ω_max, relative", 3e-11);
    for damping in [0.0, 0.5, 3.0] {
        let network = network(damping, 0.0);
        let (k, _) = dense_jacobian(&network);
        let dof = k.nrows();
        let root = |i: usize| network.inverse_mass[i / 3].sqrt();
        let stiffness = DMatrix::from_fn(dof, dof, |i, j| -k[(i, j)] * root(i) * root(j));
        let omega = stiffness.symmetric_eigenvalues().max().sqrt();
        let zeta = damping * omega / 200.0;
        let expected = 2.0 * ((1.0 + zeta * zeta).sqrt() - zeta) / omega;
        let limit = explicit_step_limit(&network.springs, &network.rest, &network.inverse_mass, 0.0);
        worst.check((limit.step / expected - 1.0).abs());
    }
}

/// A poke decays just below the limit and grows just above it.
#[test]
fn the_limit_separates_decay_from_growth() {
    let network = network(0.5, 0.0);
    let limit = explicit_step_limit(&network.springs, &network.rest, &network.inverse_mass, 0.0).step;
    let grown = |h: f64| {
        let mut state = network.rest_state();
        (0..27).for_each(|i| state.v[i] += Vec3::new((i as f64).sin(), (2.0 * i as f64).sin(), 0.1) * 1e-6);
        state.v.iter_mut().zip(&network.fixed).filter(|(_, fixed)| **fixed).for_each(|(v, _)| *v = Vec3::zeros());
        let mut stepper = Stepper::new(&network);
        (0..3000)
            .for_each(|_| stepper.step(GlobalIntegrator::SemiImplicitEuler, &network, &mut state, h, &Unconstrained));
        largest(state.v.iter().map(Vec3::norm))
    };
    assert!(grown(0.99 * limit) < 1e-8, "just below: {:e}", grown(0.99 * limit));
    let above = grown(1.02 * limit);
    assert!(!(above < 1e-3), "just above: {above:e}");
}

/// The running local model compared with its one-step matrix, free and held, at the ends of every axis. The
/// program measures all of them.
#[test]
fn local_models_are_stable_up_to_the_predicted_step() {
    // The tolerance covers bisection to 7e-4, and growth that has to show within 1000 ticks.
    let worst = Worst::new("one-step matrix", "longest stable step, measured over predicted, minus 1", TOLERANCE);
    let cases = [
        ("law = \"sticking\"", &LocalIntegrator::ALL[..1]),
        ("law = \"sticking\"\nscheme = \"velocity\"\nsurface = \"subdivision\"", &LocalIntegrator::ALL[..]),
    ];
    let points = [(Axis::Stiffness, 1e8), (Axis::MassRatio, 1e6), (Axis::DampingRatio, 10.0)];
    for (contact, integrators) in cases {
        let scene = small_scene(contact, "rings = 1", PRESS);
        for (&integrator, exterior) in integrators.iter().flat_map(|i| EXTERIORS.map(|e| (i, e))) {
            for (axis, value) in points {
                let point = MapPoint { integrator, exterior, axis, value };
                for boundary in boundaries(&scene, &point).expect("a patch that can be pressed") {
                    println!(
                        "RESIDUAL | one-step matrix | longest step, measured over predicted: {}, {}, {}, {:?}, {:?} {:e} | {TOLERANCE} off 1 | {:.4}{}",
                        boundary.integrator,
                        boundary.scheme,
                        boundary.exterior,
                        boundary.touching,
                        boundary.axis,
                        boundary.value,
                        boundary.ratio,
                        if boundary.agrees { "" } else { ", for a known reason" },
                    );
                    assert!(boundary.agrees || boundary.reason.is_some(), "{contact}: {boundary:?}");
                    if boundary.agrees {
                        worst.check((boundary.ratio - 1.0).abs());
                    }
                    let limited = match integrator {
                        LocalIntegrator::SemiImplicitEuler => true,
                        LocalIntegrator::ImplicitEuler | LocalIntegrator::ImplicitMidpoint => false,
                        LocalIntegrator::Exponential => boundary.touching == Touching::Held,
                    };
                    assert_eq!(boundary.measured_s.is_some(), limited, "{boundary:?}");
                }
            }
        }
    }
}

/// A tip above rigid ground has no map, and the error states why.
#[test]
fn a_scene_without_a_patch_to_press_says_so() {
    let mut scene = small_scene("law = \"sticking\"", "rings = 1", PRESS);
    scene.fixed.fill(true);
    let point = MapPoint {
        integrator: LocalIntegrator::SemiImplicitEuler,
        exterior: EXTERIORS[0],
        axis: Axis::Stiffness,
        value: 100.0,
    };
    assert!(matches!(boundaries(&scene, &point), Err(MapError::Rigid { .. })));
}

const PRESS: &str = "[[0.0, 0.003, 0.002, 0.001], [0.1, 0.003, 0.002, -0.002]]";
