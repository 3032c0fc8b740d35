//! The condensed exterior compared with independent dense algebra, and with the network
//! in equilibrium.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::local::condensation::{Condensation, CondensationOutcome, Condensed, Condenser, FarField, Reach};
use stickslip::local::model::{ExteriorKind, Linearization, LocalModelBuilder, LocalSettings};
use stickslip::local::patch::{Extent, Patch, PatchSelector};
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::network::Network;
use stickslip::model::springs::{Spring, TangentKind};
use stickslip::model::state::State;
use stickslip::model::topology::Surface;
use stickslip::pipeline;
use stickslip::surface::geometry::SurfaceModel;
use stickslip::verify::residual::largest;

use crate::check::{PRESS_AND_DRAG, Worst, relative_rms, run, runner, shipped, small_scene};

/// Tolerance of C against dense LU: round-off, with a factor of ten for other vector instructions. Measured: 2e-15.
const SAME_MATRIX: f64 = 2e-14;
/// Tolerance of the inverse of K + C against a part of the inverse of the whole: the condition of both.
/// Measured: 2e-15.
const SAME_COMPLIANCE: f64 = 2e-14;
/// Tolerance of the lowest eigenvalue of a semidefinite matrix, relative to k: round-off.
/// Measured: 5e-16.
const SEMIDEFINITE: f64 = 5e-15;

const ALL_EXACT: Condensation = Condensation { tangent: TangentKind::Exact, reach: Reach::All };
const ALL_STABILISED: Condensation = Condensation { tangent: TangentKind::Stabilised, reach: Reach::All };

/// Network with a patch of one ring, and a state.
struct Case {
    network: Network,
    surface: Arc<Surface>,
    x: Vec<Vec3>,
    patch: Patch,
}

impl Case {
    /// Builds a block of unequal springs around a point; every node is displaced from rest by up to `noise`, m.
    fn new(nodes: [usize; 3], stencil: Stencil, noise: f64, touch: Vec3, rings: u32, seed: f64) -> Self {
        let block = Block { nodes, spacing: 0.0125, stencil };
        let fixed = (0..nodes.iter().product()).map(|node| block.is_bottom(node)).collect();
        Self::of(block.mesh(), fixed, noise, touch, rings, seed)
    }

    fn of(mesh: Mesh, fixed: Vec<bool>, noise: f64, touch: Vec3, rings: u32, seed: f64) -> Self {
        let surface = Arc::new(Surface::new(&mesh).expect("a block has a surface"));
        let springs: Vec<Spring> = (mesh.edges.iter().enumerate())
            .map(|(i, &nodes)| {
                let rest_length = (mesh.nodes[nodes[1] as usize] - mesh.nodes[nodes[0] as usize]).norm();
                Spring { nodes, stiffness: 100.0 * (1.0 + 0.5 * (i as f64 * seed).sin()), damping: 0.5, rest_length }
            })
            .collect();
        let wave = |i: usize, k: f64| (k * seed * (i as f64 + 1.0)).sin();
        let moved = |(i, x): (usize, &Vec3)| {
            let free = f64::from(u8::from(!fixed[i]));
            x + Vec3::new(wave(i, 1.1), wave(i, 2.3), wave(i, 3.7)) * (noise * free)
        };
        let x: Vec<Vec3> = mesh.nodes.iter().enumerate().map(moved).collect();
        let network = Network::from_parts(mesh.nodes.clone(), vec![0.01; x.len()], fixed, &springs, Vec::new());
        let patch =
            PatchSelector::new(&network, &surface).select(&network, &surface, &x, touch, &[], Extent::Rings(rings));
        Self { network, surface, x, patch }
    }

    fn condense(&self, settings: Condensation) -> Condensed {
        Condenser::new(&self.network, settings).condense(&self.network, &self.patch, &self.x)
    }

    /// Returns −K over some nodes, spring by spring, with all other nodes fixed.
    fn stiffness(&self, nodes: &[u32], kind: TangentKind) -> DMatrix<f64> {
        let at = |node: u32| nodes.iter().position(|&other| other == node);
        let mut stiffness = DMatrix::zeros(3 * nodes.len(), 3 * nodes.len());
        for spring in self.network.springs.iter() {
            let [i, j] = spring.nodes;
            let (block, _) = spring.jacobian(self.x[j as usize] - self.x[i as usize], Vec3::zeros(), kind);
            for (row, column, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
                if let (Some(row), Some(column)) = (at(row), at(column)) {
                    let mut entry = stiffness.fixed_view_mut::<3, 3>(3 * row, 3 * column);
                    entry += block * sign;
                }
            }
        }
        stiffness
    }

    fn exterior(&self) -> Vec<u32> {
        let free = (0..self.network.node_count() as u32).filter(|&node| !self.network.fixed[node as usize]);
        free.filter(|node| !self.patch.nodes.contains(node)).collect()
    }

    /// Returns C = A_LE A_EE⁻¹ A_EL with A = −K, densely, for an exterior of these nodes.
    fn dense(&self, exterior: &[u32], kind: TangentKind) -> DMatrix<f64> {
        let nodes: Vec<u32> = self.patch.nodes.iter().chain(exterior).copied().collect();
        let all = self.stiffness(&nodes, kind);
        let (m, e) = (3 * self.patch.len(), 3 * exterior.len());
        let between = all.view((m, 0), (e, m)).into_owned();
        let follows = all.view((m, m), (e, e)).into_owned().lu().solve(&between).expect("the exterior is held");
        between.transpose() * follows
    }

    /// Returns the nodes within `rings` rings of the patch's centre by definition: one pass over all springs for
    /// each ring.
    fn reached(&self, rings: u32) -> Vec<bool> {
        let mut reached = vec![false; self.network.node_count()];
        reached[self.patch.centre.expect("a free node") as usize] = true;
        for _ in 0..rings {
            let before = reached.clone();
            for spring in self.network.springs.iter() {
                let [i, j] = spring.nodes.map(|node| node as usize);
                reached[i] |= before[j];
                reached[j] |= before[i];
            }
        }
        reached
    }

    fn own(&self, kind: TangentKind) -> DMatrix<f64> {
        self.stiffness(&self.patch.nodes, kind)
    }
}

fn stiffness(condensed: Condensed) -> DMatrix<f64> {
    condensed.stiffness.expect("the exterior can be condensed")
}

fn distance(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    largest((a - b).iter().map(|entry| entry.abs())) / b.amax()
}

#[test]
fn c_is_the_dense_schur_complement() {
    let worst = Worst::new("nalgebra, dense LU", "C of a condensed exterior, relative", SAME_MATRIX);
    let cases = (5..7_usize, 4..7_usize, 3..5_usize, 0.0..1.5e-3_f64, 0.5..2.0_f64, 1..3_u32, prop::bool::ANY);
    let result = runner(24).run(&cases, |(nx, ny, nz, noise, seed, rings, full)| {
        let stencil = if full { Stencil::Full } else { Stencil::Shear };
        let case = Case::new([nx, ny, nz], stencil, noise, Vec3::new(0.02, -0.004, 0.0), rings, seed);
        let condensed = case.condense(ALL_STABILISED);
        prop_assert_eq!(condensed.outcome, CondensationOutcome::AsAsked);
        let c = stiffness(condensed);
        prop_assert_eq!(&c, &c.transpose());
        worst.case(distance(&c, &case.dense(&case.exterior(), TangentKind::Stabilised)))?;
        let condensed = case.condense(ALL_EXACT);
        if condensed.outcome == CondensationOutcome::AsAsked {
            worst.case(distance(&stiffness(condensed), &case.dense(&case.exterior(), TangentKind::Exact)))?;
        }
        Ok(())
    });
    result.unwrap();
}

/// K_LL + C is the Schur complement of the whole, the inverse of the patch's part of the inverse. A
/// force on the patch therefore moves it, in equilibrium, as in the whole linear network.
#[test]
fn a_force_on_the_patch_moves_it_as_in_the_whole_network() {
    let worst = Worst::new("whole linear network", "static compliance of a condensed patch, relative", SAME_COMPLIANCE);
    for noise in [0.0, 1e-3] {
        let case = Case::new([7, 6, 4], Stencil::Shear, noise, Vec3::new(0.01, 0.0, 0.0), 1, 1.3);
        let mut nodes = case.patch.nodes.clone();
        nodes.extend(case.exterior());
        let m = 3 * case.patch.len();
        let whole = case.stiffness(&nodes, TangentKind::Exact).try_inverse().expect("the bottom is held");
        let c = stiffness(case.condense(ALL_EXACT));
        let local = (case.own(TangentKind::Exact) - &c).try_inverse().expect("the patch is held");
        worst.check(distance(&local, &whole.view((0, 0), (m, m)).into_owned()));
        // The condensed exterior yields and does not push: the patch is softer than with a fixed exterior.
        let fixed = case.own(TangentKind::Exact).try_inverse().expect("the patch is held");
        assert!((0..m).all(|i| local[(i, i)] >= fixed[(i, i)]));
    }
}

#[test]
fn the_stabilised_model_is_never_unstable() {
    let worst = Worst::new("algebra", "stabilised K + C: largest eigenvalue / k", SEMIDEFINITE);
    let result = runner(12).run(&(0.0..4e-3_f64, 0.5..2.0_f64), |(noise, seed)| {
        let case = Case::new([5, 5, 4], Stencil::Shear, noise, Vec3::zeros(), 1, seed);
        let c = stiffness(case.condense(ALL_STABILISED));
        let stiffest = (case.own(TangentKind::Stabilised) - &c).symmetric_eigenvalues().min() / 100.0;
        worst.case(-stiffest)?;
        worst.case(-c.symmetric_eigenvalues().min() / 100.0)
    });
    result.unwrap();
}

/// In the haptic loop a tangent model has K + C, and one of springs adds C(x − x₀).
#[test]
fn the_local_model_feels_the_exterior_follow() {
    let worst = Worst::new("C times the displacement", "forces that a condensed exterior adds, relative", 2e-14);
    let case = Case::new([6, 6, 4], Stencil::Shear, 5e-4, Vec3::zeros(), 1, 0.9);
    let state = State { x: case.x.clone(), v: vec![Vec3::new(0.01, -0.02, 0.005); case.x.len()] };
    let c = stiffness(case.condense(ALL_STABILISED));
    let m = case.patch.len();
    for linearization in [Linearization::Tangent(TangentKind::Stabilised), Linearization::None] {
        let force = |exterior| {
            let settings = LocalSettings { extent: Extent::Rings(1), linearization, exterior };
            let mut builder =
                LocalModelBuilder::new(&case.network, SurfaceModel::faceted(case.surface.clone()), settings);
            let (model, mut local) =
                builder.build(&case.network, &state, Vec3::zeros(), None).expect("an explicit model");
            assert_eq!(model.patch.nodes, case.patch.nodes);
            let moved: Vec<Vec3> = (0..m).map(|i| Vec3::new(1.0, -0.5, 0.3) * (1e-3 * (i as f64).cos())).collect();
            local.x.iter_mut().zip(&moved).for_each(|(x, moved)| *x += moved);
            model.evaluate_forces(0.01, &mut local);
            (DVector::from_iterator(3 * m, local.f[..m].iter().flatten().copied()), moved)
        };
        let (fixed, moved) = force(ExteriorKind::Fixed);
        let (condensed, _) = force(ExteriorKind::Condensed(ALL_STABILISED));
        let expected = &c * DVector::from_iterator(3 * m, moved.iter().flatten().copied());
        worst.check((condensed - fixed - &expected).norm() / expected.norm());
    }
}

#[test]
fn rings_condense_what_they_reach() {
    let worst = Worst::new("nalgebra, dense LU", "C of three rings, relative", SAME_MATRIX);
    let case = Case::new([9, 8, 4], Stencil::Shear, 5e-4, Vec3::zeros(), 1, 1.1);
    let of = |reach| stiffness(case.condense(Condensation { tangent: TangentKind::Exact, reach }));
    let rings = |rings| of(Reach::Rings { rings, far_field: FarField::Fixed });

    let reached = case.reached(3);
    let near: Vec<u32> = case.exterior().into_iter().filter(|&node| reached[node as usize]).collect();
    worst.check(distance(&rings(3), &case.dense(&near, TangentKind::Exact)));
    // Enough rings are the whole exterior, and fewer yield less.
    assert_eq!(rings(1000), of(Reach::All));
    let traces = [2, 3, 4, 1000].map(|count| rings(count).trace());
    assert!(traces.is_sorted_by(|a, b| a < b), "{traces:?}");
}

/// Relative errors of the compliance at the patch's centre, compared with full condensation, tangential and
/// normal: (fixed, coarse).
fn far_field_errors(case: &Case, rings: u32) -> [[f64; 2]; 2] {
    let own = case.own(TangentKind::Exact);
    let middle = case.patch.nodes.iter().position(|&node| Some(node) == case.patch.centre).expect("in the patch");
    let compliance = |reach| {
        let c = stiffness(case.condense(Condensation { tangent: TangentKind::Exact, reach }));
        let inverse = (&own - c).try_inverse().expect("the patch is held");
        [inverse[(3 * middle, 3 * middle)], inverse[(3 * middle + 2, 3 * middle + 2)]]
    };
    let full = compliance(Reach::All);
    [FarField::Fixed, FarField::Coarse].map(|far_field| {
        let some = compliance(Reach::Rings { rings, far_field });
        [0, 1].map(|axis| (some[axis] / full[axis] - 1.0).abs())
    })
}

#[test]
fn a_coarse_far_field_keeps_the_compliance() {
    // Effect of a coarse grid of four springs. Measured: 1.3 % tangential and 0.4 % normal at four
    // rings; with a fixed far field 13 % and 3 %.
    const COMPLIANCE: f64 = 0.03;
    let worst = Worst::new("full condensation", "point compliance with a coarse far field, relative", COMPLIANCE);
    let case = Case::new([17, 17, 9], Stencil::Shear, 2e-4, Vec3::zeros(), 2, 1.7);
    let [fixed, coarse] = far_field_errors(&case, 4);
    println!("compliance off by (tangential, normal): fixed {fixed:?}, coarse {coarse:?}");
    coarse.iter().for_each(|&error| worst.check(error));
    assert!(fixed[0] > 3.0 * coarse[0], "it would not be worth having: {fixed:?}, {coarse:?}");
}

/// Dense coarse field: displacements of the far nodes are hat functions of the vertices' on a lattice of four times
/// the spacing.
#[test]
fn a_coarse_far_field_is_a_galerkin_projection() {
    // The ground under the vertices has 1e-8 of k, compared with a softest mode of the order 1e-2 k.
    // Measured: 1.4e-9.
    let worst = Worst::new("nalgebra, dense LU", "C with a coarse far field, relative", 1e-8);
    let case = Case::new([9, 9, 5], Stencil::Shear, 4e-4, Vec3::zeros(), 1, 1.1);
    let reached = case.reached(2);
    let (near, far): (Vec<u32>, Vec<u32>) = case.exterior().into_iter().partition(|&node| reached[node as usize]);
    let cell = 4.0 * 0.0125;
    let hat = |node: u32, vertex: Vec3| {
        (case.network.rest[node as usize] - vertex).iter().map(|d| (1.0 - d.abs() / cell).max(0.0)).product::<f64>()
    };
    let lattice =
        (0..18).map(|i| Vec3::new(f64::from(i % 3 - 1), f64::from(i / 3 % 3 - 1), f64::from(i / 9 - 1)) * cell);
    let moves = |&vertex: &Vec3| far.iter().any(|&node| hat(node, vertex) > 1e-9);
    let vertices: Vec<Vec3> = lattice.filter(moves).collect();

    let mut follow = DMatrix::zeros(3 * (near.len() + far.len()), 3 * (near.len() + vertices.len()));
    for axis in 0..3 {
        for node in 0..near.len() {
            follow[(3 * node + axis, 3 * node + axis)] = 1.0;
        }
        for (row, &node) in (near.len()..).zip(&far) {
            for (column, &vertex) in (near.len()..).zip(&vertices) {
                follow[(3 * row + axis, 3 * column + axis)] = hat(node, vertex);
            }
        }
    }
    let nodes: Vec<u32> = case.patch.nodes.iter().chain(&near).chain(&far).copied().collect();
    let all = case.stiffness(&nodes, TangentKind::Exact);
    let (m, e) = (3 * case.patch.len(), follow.nrows());
    let between = follow.transpose() * all.view((m, 0), (e, m));
    let within = follow.transpose() * all.view((m, m), (e, e)) * &follow;
    let expected = between.transpose() * within.lu().solve(&between).expect("the bottom is held");

    let reach = Reach::Rings { rings: 2, far_field: FarField::Coarse };
    let condensed = case.condense(Condensation { tangent: TangentKind::Exact, reach });
    assert_eq!((condensed.size.nodes, condensed.size.vertices), (near.len(), vertices.len()));
    worst.check(distance(&stiffness(condensed), &expected));
}

/// A mesh that is no block: a block sheared and bent, its nodes numbered at random.
#[test]
fn a_coarse_far_field_needs_no_block() {
    // Interpolation follows the mesh's rest shape, so a bent one is no worse, here at three rings.
    // Measured: 1.2 %.
    let worst = Worst::new("full condensation", "point compliance, coarse far field, bent mesh, relative", 0.05);
    let block = Block { nodes: [15, 13, 7], spacing: 0.0125, stencil: Stencil::Full };
    let mut mesh = block.mesh();
    let count = mesh.nodes.len() as u32;
    let number = |node: u32| (node * 367) % count;
    assert!(!count.is_multiple_of(367), "a permutation");
    let mut nodes = mesh.nodes.clone();
    for (node, x) in mesh.nodes.iter().enumerate() {
        let jitter = 0.001 * (node as f64 * 7.7).sin();
        nodes[number(node as u32) as usize] =
            Vec3::new(x.x + 0.3 * x.z + jitter, x.y - jitter, x.z * 1.2 + 3.0 * x.x * x.x);
    }
    mesh.nodes = nodes;
    mesh.triangles.iter_mut().for_each(|nodes| *nodes = nodes.map(number));
    mesh.edges.iter_mut().for_each(|nodes| *nodes = nodes.map(number));
    let mut fixed = vec![false; count as usize];
    (0..count).filter(|&node| block.is_bottom(node as usize)).for_each(|node| fixed[number(node) as usize] = true);
    let case = Case::of(mesh, fixed, 0.0, Vec3::zeros(), 1, 1.2);
    let [_, coarse] = far_field_errors(&case, 3);
    coarse.iter().for_each(|&error| worst.check(error));
}

/// A flattened exterior buckles: the exact Jacobian is indefinite, and the model is built with
/// the stabilised one.
#[test]
fn a_compressed_exterior_falls_back_to_the_stabilised_tangent() {
    let worst = Worst::new("nalgebra, dense LU", "C after falling back, relative", SAME_MATRIX);
    let mut case = Case::new([5, 5, 4], Stencil::Shear, 2e-4, Vec3::zeros(), 1, 1.3);
    case.x.iter_mut().for_each(|x| *x = Vec3::new(0.6 * x.x, 0.6 * x.y, 0.8 * x.z));
    let exterior = case.exterior();
    let least = case.stiffness(&exterior, TangentKind::Exact).symmetric_eigenvalues().min();
    assert!(least < -1.0, "it is not compressed: {least}");

    let mut condenser = Condenser::new(&case.network, ALL_EXACT);
    let condensed = condenser.condense(&case.network, &case.patch, &case.x);
    assert_eq!((condensed.outcome, condensed.tangent), (CondensationOutcome::Stabilised, TangentKind::Stabilised));
    assert_eq!(condenser.counts().stabilised, 1);
    worst.check(distance(&stiffness(condensed), &case.dense(&exterior, TangentKind::Stabilised)));
}

/// If only the patch is compressed and the exterior is definite, K + C is indefinite, which is
/// counted and not repaired.
#[test]
fn an_indefinite_patch_is_counted() {
    let mut case = Case::new([6, 6, 4], Stencil::Shear, 0.0, Vec3::zeros(), 1, 1.3);
    let middle = case.x[case.patch.centre.expect("a free node") as usize];
    for &node in &case.patch.nodes {
        let x = &mut case.x[node as usize];
        *x = middle + (*x - middle) * 0.4;
    }
    let mut condenser = Condenser::new(&case.network, ALL_EXACT);
    let condensed = condenser.condense(&case.network, &case.patch, &case.x);
    let tangent = case.own(condensed.tangent) - condensed.stiffness.as_ref().expect("condensed");
    assert!(tangent.symmetric_eigenvalues().min() < -1.0);
    assert_eq!((condensed.outcome, condenser.counts().indefinite), (CondensationOutcome::AsAsked, 1));
}

/// The exterior can move without a force: two nodes hang on one spring each.
#[test]
fn an_exterior_without_hold_stays_fixed() {
    let block = Block { nodes: [3, 3, 3], spacing: 0.0125, stencil: Stencil::Shear };
    let mut mesh = block.mesh();
    let count = mesh.nodes.len();
    let fixed = |loose: usize| (0..count + loose).map(|node| node < count && block.is_bottom(node)).collect::<Vec<_>>();
    let below = mesh.nodes[26] + Vec3::new(0.0, 0.0, -0.005);

    // A loose piece that is not connected with the patch does no harm.
    mesh.nodes.extend([below, below + Vec3::new(0.0, 0.001, 0.0)]);
    mesh.edges.push([count as u32, count as u32 + 1]);
    let apart = Case::of(mesh.clone(), fixed(2), 0.0, Vec3::zeros(), 1, 1.0);
    let condensed = apart.condense(ALL_EXACT);
    assert_eq!((condensed.outcome, condensed.size.nodes), (CondensationOutcome::AsAsked, apart.exterior().len() - 2));

    // A piece connected with the patch by one spring has nothing that holds it laterally.
    mesh.edges.push([26, count as u32]);
    let hanging = Case::of(mesh, fixed(2), 0.0, Vec3::zeros(), 1, 1.0);
    let mut condenser = Condenser::new(&hanging.network, ALL_EXACT);
    let condensed = condenser.condense(&hanging.network, &hanging.patch, &hanging.x);
    assert_eq!((condensed.outcome, condensed.stiffness), (CondensationOutcome::Held, None));
    assert_eq!(condenser.counts().held, 1);
}

/// A diverged state still builds a model; the fail-safe then sees the state.
#[test]
fn a_state_that_is_not_finite_does_not_stop_the_cycle() {
    for wrong in [f64::NAN, f64::INFINITY, 1e200] {
        let mut case = Case::new([5, 5, 4], Stencil::Shear, 0.0, Vec3::zeros(), 1, 1.3);
        case.x[40].y = wrong;
        let condensed = case.condense(ALL_EXACT);
        let finite = condensed.stiffness.is_none_or(|c| c.iter().all(|c| c.is_finite()));
        assert!(finite, "{wrong}: {:?}", condensed.outcome);
    }
}

/// In a body that nothing holds the exterior follows the patch, and moving both takes no force.
#[test]
fn a_free_body_moves_as_a_whole() {
    let worst = Worst::new("rigid motion", "force of a condensed free body that is shifted, relative", 1e-14);
    let block = Block { nodes: [5, 5, 4], spacing: 0.0125, stencil: Stencil::Shear };
    let case = Case::of(block.mesh(), vec![false; 100], 0.0, Vec3::zeros(), 1, 1.4);
    let mut condenser = Condenser::new(&case.network, ALL_EXACT);
    let condensed = condenser.condense(&case.network, &case.patch, &case.x);
    assert_eq!((condensed.outcome, condenser.counts().indefinite), (CondensationOutcome::AsAsked, 0));
    let tangent = case.own(TangentKind::Exact) - stiffness(condensed);
    for axis in 0..3 {
        let shift = DVector::from_fn(3 * case.patch.len(), |i, _| f64::from(u8::from(i % 3 == axis)));
        worst.check(largest((&tangent * shift).iter().map(|entry| entry.abs())) / tangent.amax());
    }
}

/// The plan that is kept from cycle to cycle changes no bit, whatever patches preceded.
#[test]
fn a_kept_plan_gives_what_a_fresh_one_gives() {
    for far_field in [FarField::Fixed, FarField::Coarse] {
        let reach = Reach::Rings { rings: 3, far_field };
        let settings = Condensation { tangent: TangentKind::Exact, reach };
        let mut first = Case::new([9, 7, 5], Stencil::Shear, 4e-4, Vec3::zeros(), 1, 1.1);
        let second = Case::new([9, 7, 5], Stencil::Shear, 4e-4, Vec3::new(0.026, 0.0, 0.0), 1, 1.1);
        assert_ne!(first.patch.nodes, second.patch.nodes);
        let mut kept = Condenser::new(&first.network, settings);
        for step in 0..6 {
            first.x.iter_mut().for_each(|x| *x *= 1.0 + 1e-3 * f64::from(step));
            let patch = if step % 4 == 3 { &second.patch } else { &first.patch };
            let again = kept.condense(&first.network, patch, &first.x);
            let fresh = Condenser::new(&first.network, settings).condense(&first.network, patch, &first.x);
            assert!(again.stiffness.is_some() && again.stiffness == fresh.stiffness, "step {step}");
        }
    }
}

/// In whole runs a condensed exterior is closer to the full network than a fixed one, also with few rings
/// and a coarse far field, and repeats bit for bit.
#[test]
fn a_condensed_exterior_comes_closer_to_the_full_network() {
    let scene = |local: &str| {
        let contact = "law = \"sliding\"\nsurface = \"shaded\"\ndeformation = \"least-norm\"";
        small_scene(contact, local, PRESS_AND_DRAG)
    };
    let reference = run(&scene("model = \"full\"")).force;
    let error = |local: &str| {
        let forces = run(&scene(local)).force;
        assert_eq!(forces, run(&scene(local)).force, "{local}");
        relative_rms(&forces, &reference)
    };
    let fixed = error("rings = 1");
    for local in [
        "exterior = \"condensed\"",
        "exterior = \"condensed\"\ncondense_rings = 3",
        "exterior = \"condensed\"\ncondense_rings = 2\nfar_field = \"coarse\"",
        "exterior = \"condensed\"\nlinearization = \"none\"\ntangent = \"stabilised\"",
    ] {
        let condensed = error(local);
        println!(
            "RESIDUAL | full network | {} : force, relative | {:.3} | {condensed:.3}",
            local.replace('\n', ", "),
            0.5 * fixed
        );
        assert!(condensed < 0.5 * fixed, "{local}: {condensed}, fixed {fixed}");
    }
}

/// A run in which models fall back reports it: sticking, drawn over 50 mm.
#[test]
fn falling_back_is_counted_in_a_run() {
    let scene = shipped("deep-sticking");
    let local = LocalSettings { exterior: ExteriorKind::Condensed(ALL_EXACT), ..scene.local() };
    let mut scene = scene.with_local_model(local);
    let far = [[0.0, -0.03, 0.0013, 0.002], [0.2, -0.03, 0.0013, -0.006], [1.2, 0.02, 0.0013, -0.006]];
    let waypoints = far.map(|[time, x, y, z]| Waypoint { time, position: Vec3::new(x, y, z) });
    scene.path = TipPath::new(waypoints.to_vec()).expect("ascending times");
    let mut counts = None;
    // A fault at its end does not matter here.
    let _ = pipeline::run(&scene, |view| counts = view.condensation);
    let counts = counts.expect("the exterior is condensed");
    assert!(counts.stabilised > 0 && counts.indefinite > 0 && counts.models == 12, "{counts}");
}
