//! Jacobians and linear patch forces compared with independent derivatives.

use nalgebra::Complex;
use proptest::prelude::*;
use std::sync::Arc;
use stickslip::Vec3;
use stickslip::local::linearization::LinearForces;
use stickslip::local::model::{ExteriorKind, Linearization, LocalModelBuilder, LocalSettings};
use stickslip::local::patch::{Extent, PatchSelector};
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::springs::{Spring, TangentKind};
use stickslip::model::state::State;
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;
use stickslip::verify::residual::largest;

use crate::check::{Worst, runner};

/// Tolerance of two exact derivatives: round-off, amplified by L/ℓ ≤ 100.
/// Measured: 6e-16.
const EXACT_TOLERANCE: f64 = 1e-14;
/// Tolerance of central differences with a step of 1e-6 of the length: truncation of the order 1e-12, round-off
/// of the order 1e-16/1e-6, both amplified by L/ℓ. Measured: 4e-10.
const DIFFERENCE_TOLERANCE: f64 = 1e-8;

type C3 = [Complex<f64>; 3];

/// Returns f_i of one spring, written out separately over complex numbers.
fn force(d: C3, omega: C3, spring: &Spring) -> C3 {
    // There is no conjugation: the function must stay analytic.
    let dot = |a: C3, b: C3| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let length = dot(d, d).sqrt();
    let u = d.map(|d| d / length);
    let tension = (length - spring.rest_length) * spring.stiffness + dot(omega, u) * spring.damping;
    u.map(|u| u * tension)
}

fn complex(v: Vec3) -> C3 {
    [v.x, v.y, v.z].map(Complex::from)
}

/// Differentiates along an axis by a complex step: no difference is formed, so the step can be tiny.
fn derivative(axis: usize, at: Vec3, f: impl Fn(C3) -> C3) -> Vec3 {
    const STEP: f64 = 1e-30;
    let mut z = complex(at);
    z[axis].im = STEP;
    Vec3::from(f(z).map(|f| f.im / STEP))
}

#[derive(Debug, Clone)]
struct Case {
    spring: Spring,
    d: Vec3,
    omega: Vec3,
}

fn case() -> impl Strategy<Value = Case> {
    let vector = || prop::array::uniform3(-1.0..1.0_f64).prop_map(Vec3::from);
    let direction = vector().prop_filter_map("a direction", |d| d.try_normalize(1e-2));
    let decades = |from: f64, to: f64| (from..to).prop_map(|e| 10.0_f64.powf(e));
    (direction, vector(), decades(-3.0, -1.0), decades(-1.0, 1.0), decades(0.0, 4.0), decades(-3.0, 1.0)).prop_map(
        |(direction, omega, rest_length, stretch, stiffness, damping)| Case {
            spring: Spring { nodes: [0, 1], stiffness, damping, rest_length },
            d: direction * (rest_length * stretch),
            omega,
        },
    )
}

#[test]
fn spring_jacobians_are_those_of_complex_steps() {
    let worst = Worst::new("complex step", "df/dx and df/dv of a spring, relative", EXACT_TOLERANCE);
    let run = runner(1000).run(&case(), |Case { spring, d, omega }| {
        let (along_x, along_v) = spring.jacobian(d, omega, TangentKind::Exact);
        for axis in 0..3 {
            let by_x = derivative(axis, d, |d| force(d, complex(omega), &spring));
            let by_v = derivative(axis, omega, |omega| force(complex(d), omega, &spring));
            worst.case((along_x.column(axis) - by_x).norm() / along_x.norm())?;
            worst.case((along_v.column(axis) - by_v).norm() / along_v.norm())?;
        }
        Ok(())
    });
    run.unwrap();
}

#[test]
fn spring_jacobians_are_those_of_differences() {
    let worst = Worst::new("central differences", "df/dx and df/dv of a spring, relative", DIFFERENCE_TOLERANCE);
    let run = runner(1000).run(&case(), |Case { spring, d, omega }| {
        let (along_x, along_v) = spring.jacobian(d, omega, TangentKind::Exact);
        let at = |d: Vec3, omega: Vec3| Vec3::from(force(complex(d), complex(omega), &spring).map(|f| f.re));
        let (step_x, step_v) = (1e-6 * d.norm(), 1e-3);
        for axis in 0..3 {
            let e = Vec3::ith(axis, 1.0);
            let by_x = (at(d + e * step_x, omega) - at(d - e * step_x, omega)) / (2.0 * step_x);
            let by_v = (at(d, omega + e * step_v) - at(d, omega - e * step_v)) / (2.0 * step_v);
            worst.case((along_x.column(axis) - by_x).norm() / along_x.norm())?;
            // f is linear in ω, but a small part of it.
            worst.case(
                (along_v.column(axis) - by_v).norm() * step_v / at(d, omega).norm().max(step_v * along_v.norm()),
            )?;
        }
        Ok(())
    });
    run.unwrap();
}

#[test]
fn stabilised_elastic_jacobian_is_never_indefinite() {
    // Lowest eigenvalue of a symmetric 3 × 3 block, relative to k. Measured: 2e-16.
    let worst = Worst::new("algebra", "stabilised tangent: most negative eigenvalue / k", 1e-14);
    let run = runner(500).run(&case(), |Case { spring, d, .. }| {
        let (k, _) = spring.jacobian(d, Vec3::zeros(), TangentKind::Stabilised);
        let least = k.symmetric_eigenvalues().min() / spring.stiffness;
        worst.case(-least)
    });
    run.unwrap();
}

/// Builds a block in some state of motion, with gravity and drag.
fn moving_block(damping: f64, drag: f64) -> (Network, Arc<Surface>, State) {
    let block = Block { nodes: [4, 4, 3], spacing: 0.0125, stencil: Stencil::Shear };
    let mesh = block.mesh();
    let count = mesh.nodes.len();
    let material = Material {
        node_mass: (0..count).map(|i| 0.005 + 0.0002 * i as f64).collect(),
        stiffness: 100.0.into(),
        damping: damping.into(),
        drag,
        gravity: Vec3::new(0.3, 0.0, -9.8),
    };
    let network = Network::new(&mesh, &material, (0..count).map(|i| block.is_bottom(i)).collect())
        .expect("a value for each node");
    let mut state = network.rest_state();
    for i in (0..count).filter(|&i| !block.is_bottom(i)) {
        let wave = |k: f64| (k * (i as f64 + 1.0)).sin();
        state.x[i] += Vec3::new(wave(1.1), wave(2.3), wave(3.7)) * 0.002;
        state.v[i] = Vec3::new(wave(0.7), wave(1.9), wave(2.9)) * 0.05;
    }
    (network, Arc::new(Surface::new(&mesh).unwrap()), state)
}

/// Returns the forces of the whole network on the patch, at a displaced state of the patch.
fn patch_forces(network: &Network, nodes: &[u32], x: &[Vec3], v: &[Vec3]) -> Vec<Vec3> {
    let mut f = vec![Vec3::zeros(); network.node_count()];
    network.forces(x, v, &mut f);
    nodes.iter().map(|&node| f[node as usize]).collect()
}

#[test]
fn linear_patch_forces_are_the_networks_tangent() {
    // The cases have a D, a D of drag alone, and none.
    for (damping, drag) in [(0.5, 0.05), (0.0, 0.05), (0.0, 0.0)] {
        check_tangent(damping, drag);
    }
}

fn check_tangent(damping: f64, drag: f64) {
    // Central differences over 1e-7 m and 1e-4 m/s of forces of order 1 N. Measured: 3e-11.
    let worst = Worst::new("central differences", "K and D of a patch, relative to the largest entry", 1e-9);
    let value = Worst::new("full network", "f0 of a patch, relative", 1e-14);
    let (network, surface, mut state) = moving_block(damping, drag);
    let mut selector = PatchSelector::new(&network, &surface);
    let patch = selector.select(&network, &surface, &state.x, state.x[37], &surface.triangles[0], Extent::Rings(1));
    assert!(patch.len() > 8 && !patch.boundary.is_empty());
    // As in the paper, the exterior is at rest.
    for i in 0..network.node_count() as u32 {
        if !patch.nodes.contains(&i) {
            state.v[i as usize] = Vec3::zeros();
        }
    }
    let slots: Vec<u32> = patch.nodes.iter().chain(&patch.boundary).copied().collect();
    let of = |values: &[Vec3]| slots.iter().map(|&node| values[node as usize]).collect::<Vec<_>>();
    let linear = LinearForces::new(&patch, &network.external, &of(&state.x), &of(&state.v), None, TangentKind::Exact);

    let f0 = patch_forces(&network, &patch.nodes, &state.x, &state.v);
    let mut f = vec![Vec3::zeros(); patch.len()];
    linear.evaluate(0.0, &of(&state.x), &of(&state.v), &mut vec![0.0; linear.offset_len()], &mut f);
    for (f, f0) in f.iter().zip(&f0) {
        value.check((f - f0).norm() / f0.norm());
    }

    let dof = 3 * patch.len();
    let entries = |block: usize| (0..dof * dof).map(move |i| (i / dof, block * dof + i % dof));
    for (block, step) in [(0, 1e-7), (1, 1e-4)] {
        let largest = entries(block).map(|(i, j)| linear.entry(i, j).abs()).fold(0.0, f64::max);
        for column in 0..dof {
            let node = patch.nodes[column / 3] as usize;
            let shifted = |sign: f64| {
                let mut there = state.clone();
                let moved = if block == 0 { &mut there.x[node] } else { &mut there.v[node] };
                moved[column % 3] += sign * step;
                patch_forces(&network, &patch.nodes, &there.x, &there.v)
            };
            let (ahead, behind) = (shifted(1.0), shifted(-1.0));
            for row in 0..dof {
                let slope = (ahead[row / 3][row % 3] - behind[row / 3][row % 3]) / (2.0 * step);
                // Without D, nothing depends on v.
                worst.check((slope - linear.entry(row, block * dof + column)).abs() / largest.max(f64::MIN_POSITIVE));
            }
        }
    }
}

#[test]
fn moving_one_node_is_the_matrix_column() {
    let worst = Worst::new("matrix-vector product", "forces after a displacement, relative", 1e-14);
    let (network, surface, state) = moving_block(0.5, 0.05);
    for exterior in [ExteriorKind::Fixed, ExteriorKind::Drifting] {
        for linearization in [Linearization::Tangent(TangentKind::Exact), Linearization::None] {
            let settings = LocalSettings { extent: Extent::Rings(1), linearization, exterior };
            let mut builder = LocalModelBuilder::new(&network, SurfaceModel::faceted(surface.clone()), settings);
            let (model, mut local) =
                builder.build(&network, &state, state.x[37], None).expect("explicit steps need no solution");
            let delta = Vec3::new(1e-3, -2e-3, 5e-4);
            model.evaluate_forces(0.02, &mut local);
            local.x[2] += delta;
            model.update_forces(0.02, &mut local, [(2, delta)].into_iter());
            let updated = local.f.clone();
            model.evaluate_forces(0.02, &mut local);
            for (a, b) in updated.iter().zip(&local.f).take(model.patch.len()) {
                worst.check((a - b).norm() / b.norm());
            }
        }
    }
}

/// Under a drifting exterior the tangent model is of second order in time: halving the time
/// quarters its difference from the nonlinear springs.
#[test]
fn drifting_exterior_is_right_to_first_order_in_time() {
    let (network, surface, state) = moving_block(0.5, 0.05);
    let build = |linearization| {
        let settings = LocalSettings { extent: Extent::Rings(1), linearization, exterior: ExteriorKind::Drifting };
        LocalModelBuilder::new(&network, SurfaceModel::faceted(surface.clone()), settings)
            .build(&network, &state, state.x[37], None)
            .expect("explicit steps need no solution")
    };
    let (tangent, mut linear) = build(Linearization::Tangent(TangentKind::Exact));
    let (springs, mut nonlinear) = build(Linearization::None);
    let mut missed = |time: f64| {
        tangent.evaluate_forces(time, &mut linear);
        springs.evaluate_forces(time, &mut nonlinear);
        let pairs = linear.f.iter().zip(&nonlinear.f).take(tangent.patch.len());
        largest(pairs.map(|(a, b)| (a - b).norm()))
    };
    assert!(missed(0.0) <= 1e-14, "at the start they agree: {:e}", missed(0.0));
    let order = (missed(2e-3) / missed(1e-3)).log2();
    println!(
        "RESIDUAL | nonlinear springs | order in time of a drifting tangent (2) | 0.1 | {:.2}",
        (order - 2.0).abs()
    );
    assert!((order - 2.0).abs() <= 0.1, "order {order}");
}
