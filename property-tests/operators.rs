//! P, Q, P̃, Q̃: the paper's literal matrices compared with the closed form, and the properties of both.

use nalgebra::{DMatrix, DVector, Rotation3};
use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::contact::law::{Friction, Interface, Law, Mode};
use stickslip::contact::literal::{ContactFrame, LiteralOperators};
use stickslip::surface::support::{Metric, Support};
use stickslip::verify::residual::largest;

use crate::check::{Worst, runner};

/// Tolerance of projectors, whose entries are of order 1 in the coordinates that make the metric the identity, where
/// all comparisons are made; T and its inverse lose some digits when weights nearly vanish.
/// Measured: 1e-13.
const OPERATOR_TOLERANCE: f64 = 1e-12;
/// Tolerance of products of a few closed-form projections. Measured: 2e-15.
const ROUND_OFF: f64 = 1e-14;
/// Tolerance of a sum of up to 39 diagonal entries. Measured: 1.1e-14.
const TRACE_ROUND_OFF: f64 = 1e-13;

/// Contact point over a few nodes, three of which (or fewer, if some are fixed) carry weight; or, as on
/// a limit surface, over more nodes that all carry some.
#[derive(Debug, Clone)]
struct Case {
    frame: ContactFrame,
    /// Additional 3m-vectors.
    vectors: Vec<DVector<f64>>,
    rotation: [f64; 3],
}

impl Case {
    fn nodes(&self) -> usize {
        self.frame.weights.len()
    }

    fn support(&self) -> Support {
        let ContactFrame { weights, mass, metric, .. } = &self.frame;
        let mut support = Support::with_capacity(weights.len());
        let carrying = weights.iter().zip(mass).enumerate().filter(|(_, (w, _))| **w != 0.0);
        support.set(*metric, carrying.map(|(slot, (&w, &m))| (slot, w, 1.0 / m)));
        support
    }

    fn closed_form(&self) -> LiteralOperators {
        let support = self.support();
        let n = self.frame.normal;
        let matrix = |apply: &dyn Fn(&mut [Vec3])| {
            let dof = 3 * self.nodes();
            let columns: Vec<DVector<f64>> = (0..dof)
                .map(|j| {
                    let mut v = vec![Vec3::zeros(); self.nodes()];
                    v[j / 3][j % 3] = 1.0;
                    apply(&mut v);
                    DVector::from_iterator(dof, v.iter().flat_map(|v| v.iter().copied()))
                })
                .collect();
            DMatrix::from_columns(&columns)
        };
        // P̃ f = Wᵀλ: the negative of λ is subtracted from zero.
        let shared_out = |f: &mut [Vec3], direction: &dyn Fn(Vec3) -> Vec3| {
            let force = direction(support.reaction(f));
            f.fill(Vec3::zeros());
            support.subtract_contact_force(-force, f);
        };
        LiteralOperators {
            p: matrix(&|v| support.project_sticking(v)),
            q: matrix(&|v| support.project_sliding(n, v)),
            p_tilde: matrix(&|f| shared_out(f, &|force| force)),
            q_tilde: matrix(&|f| shared_out(f, &|force| n * n.dot(&force))),
        }
    }

    fn w(&self) -> DMatrix<f64> {
        DMatrix::from_fn(3, 3 * self.nodes(), |i, j| if j % 3 == i { self.frame.weights[j / 3] } else { 0.0 })
    }

    /// Returns √M (mass metric) or I: in the coordinates y = √M v the projectors are symmetric.
    fn root(&self) -> DVector<f64> {
        DVector::from_fn(3 * self.nodes(), |i, _| match self.frame.metric {
            Metric::Euclidean => 1.0,
            Metric::Mass => self.frame.mass[i / 3].sqrt(),
        })
    }

    /// Transforms a velocity operator to the coordinates in which its metric is the identity.
    fn scaled(&self, operator: &DMatrix<f64>) -> DMatrix<f64> {
        let root = self.root();
        DMatrix::from_fn(root.len(), root.len(), |i, j| operator[(i, j)] * root[i] / root[j])
    }

    /// Transforms an operator on forces to those coordinates.
    fn scaled_force(&self, operator: &DMatrix<f64>) -> DMatrix<f64> {
        let root = self.root();
        DMatrix::from_fn(root.len(), root.len(), |i, j| operator[(i, j)] / root[i] * root[j])
    }
}

fn difference(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).norm()
}

/// Barycentric weights inside, on edges, at corners and next to them.
fn weights() -> impl Strategy<Value = [f64; 3]> {
    let inside = (0.0..1.0, 0.0..1.0).prop_map(|(a, b): (f64, f64)| {
        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        [1.0 - a - b, a, b]
    });
    let near = prop_oneof![Just(0.0), Just(1e-15), Just(1e-9), Just(1e-5), Just(-1e-9)];
    let edge = (0.0..1.0, near.clone()).prop_map(|(a, e): (f64, f64)| [a, 1.0 - a - e, e]);
    let corner = (near.clone(), near).prop_map(|(a, b)| [1.0 - a - b, a, b]);
    (prop_oneof![inside, edge, corner], 0..3_usize).prop_map(|(mut w, turn)| {
        w.rotate_left(turn);
        w
    })
}

fn case() -> impl Strategy<Value = Case> {
    prop_oneof![3..6_usize, 7..14_usize].prop_flat_map(|nodes| {
        let mass = prop::collection::vec((-3.0..3.0_f64).prop_map(|e| 10.0_f64.powf(e)), nodes);
        let vectors = prop::collection::vec(prop::collection::vec(-1.0..1.0_f64, 3 * nodes), 3 * nodes);
        let direction =
            prop::array::uniform3(-1.0..1.0_f64).prop_filter_map("a direction", |d| Vec3::from(d).try_normalize(1e-2));
        let metric = prop_oneof![Just(Metric::Euclidean), Just(Metric::Mass)];
        // These flags state which of the three are fixed; at least one with weight stays free.
        let fixed = prop_oneof![4 => Just([false; 3]), 1 => any::<[bool; 3]>()];
        let rotation = prop::array::uniform3(-3.0..3.0_f64);
        let weights = if nodes < 6 {
            weights().prop_map(move |three| [&three[..], &vec![0.0; nodes - 3]].concat()).boxed()
        } else {
            let positive = prop::collection::vec(1e-3..1.0_f64, nodes);
            positive.prop_map(|w| w.iter().map(|x| x / w.iter().sum::<f64>()).collect()).boxed()
        };
        (mass, vectors, direction, metric, weights, fixed, rotation).prop_filter_map(
            "a free node that carries weight",
            |(mass, vectors, normal, metric, mut weights, fixed, rotation)| {
                weights.iter_mut().zip(fixed).filter(|(_, fixed)| *fixed).for_each(|(weight, _)| *weight = 0.0);
                let s: f64 = weights.iter().map(|w| w * w).sum();
                let vectors = vectors.into_iter().map(DVector::from_vec).collect();
                (s > 0.04).then_some(Case { frame: ContactFrame { weights, mass, normal, metric }, vectors, rotation })
            },
        )
    })
}

fn literal(case: &Case) -> Result<LiteralOperators, TestCaseError> {
    case.frame.operators(&[]).ok_or_else(|| TestCaseError::fail("T cannot be inverted"))
}

#[test]
fn literal_operators_are_the_closed_form() {
    let worst = Worst::new("literal T, U (7)-(21)", "P, Q, P~, Q~ in closed form", OPERATOR_TOLERANCE);
    let run = runner(400).run(&case(), |case| {
        let (literal, closed) = (literal(&case)?, case.closed_form());
        worst.case(difference(&case.scaled(&literal.p), &case.scaled(&closed.p)))?;
        worst.case(difference(&case.scaled(&literal.q), &case.scaled(&closed.q)))?;
        worst.case(difference(&case.scaled_force(&literal.p_tilde), &case.scaled_force(&closed.p_tilde)))?;
        worst.case(difference(&case.scaled_force(&literal.q_tilde), &case.scaled_force(&closed.q_tilde)))
    });
    run.unwrap();
}

#[test]
fn operators_do_not_depend_on_the_completion() {
    let worst = Worst::new("literal T, U (7)-(21)", "P, Q with another Gram-Schmidt completion", OPERATOR_TOLERANCE);
    let run = runner(200).run(&case(), |case| {
        let other = case.frame.operators(&case.vectors).ok_or_else(|| TestCaseError::fail("T cannot be inverted"))?;
        let plain = literal(&case)?;
        worst.case(difference(&case.scaled(&plain.p), &case.scaled(&other.p)))?;
        worst.case(difference(&case.scaled(&plain.q), &case.scaled(&other.q)))
    });
    run.unwrap();
}

#[test]
fn operators_are_projectors_of_the_right_rank() {
    let idempotent = Worst::new("algebra", "P² = P, Q² = Q, P~² = P~, Q~² = Q~", ROUND_OFF);
    let adjoint = Worst::new("algebra", "P, Q self-adjoint in their metric", ROUND_OFF);
    let rank = Worst::new("algebra", "rank I-P = 3, rank I-Q = 1 (as a trace)", TRACE_ROUND_OFF);
    let nested = Worst::new("algebra", "PQ = QP = P", ROUND_OFF);
    let stopped = Worst::new("algebra", "WP = 0, n'WQ = 0", ROUND_OFF);
    let dual = Worst::new("algebra", "P~ = I - P', Q~ = I - Q'", ROUND_OFF);
    let run = runner(400).run(&case(), |case| {
        let LiteralOperators { p, q, p_tilde, q_tilde } = case.closed_form();
        let identity = DMatrix::identity(p.nrows(), p.nrows());
        let (sp, sq) = (case.scaled(&p), case.scaled(&q));
        let (fp, fq) = (case.scaled_force(&p_tilde), case.scaled_force(&q_tilde));
        for projector in [&sp, &sq, &fp, &fq] {
            idempotent.case(difference(&(projector * projector), projector))?;
            adjoint.case(difference(&projector.transpose(), projector))?;
        }
        // A projector's rank is its trace.
        rank.case((p.nrows() as f64 - sp.trace() - 3.0).abs())?;
        rank.case((p.nrows() as f64 - sq.trace() - 1.0).abs())?;
        nested.case(difference(&(&sp * &sq), &sp))?;
        nested.case(difference(&(&sq * &sp), &sp))?;
        // In the metric's coordinates W has rows W/√M, of length √s.
        let root = case.root();
        let w = DMatrix::from_fn(3, root.len(), |i, j| case.w()[(i, j)] / root[j]);
        let length = w.row(0).norm();
        let n = case.frame.normal;
        stopped.case((&w * &sp).norm() / length)?;
        stopped.case((n.transpose() * (&w * &sq)).norm() / length)?;
        dual.case(difference(&fp, &(&identity - sp.transpose())))?;
        dual.case(difference(&fq, &(&identity - sq.transpose())))
    });
    run.unwrap();
}

#[test]
fn operators_follow_rotations_and_renumbering() {
    let worst = Worst::new("algebra", "equivariance under rotation and renumbering", ROUND_OFF);
    let run = runner(200).run(&case(), |case| {
        let closed = case.closed_form();
        let rotation = Rotation3::from_euler_angles(case.rotation[0], case.rotation[1], case.rotation[2]);
        let mut turned = case.clone();
        turned.frame.normal = rotation * case.frame.normal;
        let dof = closed.p.nrows();
        let r = DMatrix::from_fn(dof, dof, |i, j| if i / 3 == j / 3 { rotation[(i % 3, j % 3)] } else { 0.0 });
        let there = turned.closed_form();
        for (a, b) in [(&closed.p, &there.p), (&closed.q, &there.q)] {
            worst.case(difference(&case.scaled(&(&r * a * r.transpose())), &case.scaled(b)))?;
        }
        let mut reversed = case.clone();
        reversed.frame.weights.reverse();
        reversed.frame.mass.reverse();
        let n = case.nodes();
        let flip = DMatrix::from_fn(dof, dof, |i, j| f64::from(u8::from(i / 3 == n - 1 - j / 3 && i % 3 == j % 3)));
        let there = reversed.closed_form();
        for (a, b) in [(&closed.p, &there.p), (&closed.q, &there.q)] {
            worst.case(difference(&reversed.scaled(&(&flip * a * flip.transpose())), &reversed.scaled(b)))?;
        }
        Ok(())
    });
    run.unwrap();
}

/// Returns v·M v.
fn energy(mass: &[f64], v: &DVector<f64>) -> f64 {
    v.iter().enumerate().map(|(i, v)| mass[i / 3] * v * v).sum()
}

#[test]
fn mass_metric_never_raises_kinetic_energy() {
    let worst = Worst::new("algebra", "mass metric: energy after P, Q / before, less 1", ROUND_OFF);
    let run = runner(400).run(&case(), |mut case| {
        case.frame.metric = Metric::Mass;
        let closed = case.closed_form();
        for v in &case.vectors {
            let before = energy(&case.frame.mass, v);
            worst.case(energy(&case.frame.mass, &(&closed.p * v)) / before - 1.0)?;
            worst.case(energy(&case.frame.mass, &(&closed.q * v)) / before - 1.0)?;
        }
        Ok(())
    });
    run.unwrap();
}

/// The recorded counter-example: two nodes with a mass ratio of a thousand, the light one moving.
/// The Euclidean P gives the heavy node a speed for which the light one has too little energy.
#[test]
fn euclidean_metric_raises_kinetic_energy_with_unequal_masses() {
    let mass = vec![1e-3, 1.0, 1.0];
    let frame =
        ContactFrame { weights: vec![0.5, 0.5, 0.0], mass: mass.clone(), normal: Vec3::z(), metric: Metric::Euclidean };
    let case = Case { frame, vectors: vec![], rotation: [0.0; 3] };
    let mut v = DVector::zeros(9);
    v[0] = 1.0;
    let ratio = energy(&mass, &(case.closed_form().p * &v)) / energy(&mass, &v);
    println!("RESIDUAL | algebra | Euclidean P, masses 1:1000: energy after / before | - | {ratio:.1}");
    assert!(ratio > 100.0, "energy after / before = {ratio}");
    let mass_metric = Case { frame: ContactFrame { metric: Metric::Mass, ..case.frame }, ..case };
    let ratio = energy(&mass, &(mass_metric.closed_form().p * &v)) / energy(&mass, &v);
    assert!(ratio <= 1.0, "energy after / before = {ratio}");
}

/// Node forces over twelve decades.
fn forces() -> impl Strategy<Value = Vec<Vec3>> {
    let component =
        (-6.0..6.0_f64, any::<bool>()).prop_map(|(e, minus)| 10.0_f64.powf(e) * if minus { -1.0 } else { 1.0 });
    prop::collection::vec(prop::array::uniform3(component).prop_map(Vec3::from), 14)
}

#[test]
fn node_forces_add_up_to_the_instruments() {
    let worst = Worst::new("algebra", "Σ f~ = λ Σ_free w, relative", ROUND_OFF);
    let run = runner(400).run(&(case(), forces()), |(case, mut f)| {
        f.truncate(case.nodes());
        let support = case.support();
        let reaction = support.reaction(&f);
        let mut shared = vec![Vec3::zeros(); f.len()];
        support.subtract_contact_force(-reaction, &mut shared);
        let sum: Vec3 = shared.iter().sum();
        let scale = shared.iter().map(Vec3::norm).sum::<f64>();
        worst.case((sum - reaction * support.free_weight()).norm() / scale)
    });
    run.unwrap();
}

#[test]
fn coulombs_bound_holds_with_direction_and_normal_part_kept() {
    let bound = Worst::new("Coulomb", "|f_t| - μ f_n, relative", ROUND_OFF);
    let kept = Worst::new("Coulomb", "normal part and direction of the slip force, relative", ROUND_OFF);
    let strategy = (case(), forces(), (-9.0..6.0_f64).prop_map(|e| 10.0_f64.powf(e)));
    let run = runner(800).run(&strategy, |(case, f, friction)| {
        let n = case.frame.normal;
        let reaction = case.support().reaction(&f[..case.nodes()]);
        // The law is evaluated only under pressure.
        let reaction = if reaction.dot(&n) < 0.0 { -reaction } else { reaction };
        let normal = reaction.dot(&n);
        prop_assume!(normal > 0.0);
        let (mode, force) = Law::StickSlip { friction: friction.into() }.contact_force(reaction, n, Interface::NEW);
        let tangential = |f: Vec3| f - n * f.dot(&n);
        let size = reaction.norm();
        bound.case((tangential(force).norm() - friction * normal) / size)?;
        kept.case((force.dot(&n) - normal).abs() / size)?;
        match mode {
            Mode::Stick => kept.case((force - reaction).norm() / size),
            Mode::Slip => {
                // At the bound, along λ's tangential part.
                kept.case((tangential(force).norm() - friction * normal).abs() / size)?;
                let across = tangential(force).cross(&tangential(reaction)).norm();
                kept.case(across / size / size)
            }
            Mode::Free | Mode::Slide => Err(TestCaseError::fail(format!("{mode:?} under stick-slip"))),
        }
    });
    run.unwrap();
}

#[test]
fn no_tangential_force_never_slips() {
    for friction in [0.0, 1e-300, 1.0] {
        let (mode, force) =
            Law::StickSlip { friction: friction.into() }.contact_force(Vec3::z() * 3.0, Vec3::z(), Interface::NEW);
        assert_eq!((mode, force), (Mode::Stick, Vec3::z() * 3.0));
    }
}

/// Returns one step of velocities under a law: the tick's treatment of f, v and n̂.
fn constrained(law: Law, case: &Case, f: &[Vec3], v: &[Vec3]) -> (Vec3, Vec<Vec3>) {
    let h = 1e-3;
    let support = case.support();
    let n = case.frame.normal;
    let (mode, force) = law.contact_force(support.reaction(f), n, Interface::NEW);
    let (mut f, mut v) = (f.to_vec(), v.to_vec());
    if mode == Mode::Slip {
        support.subtract_contact_force(force, &mut f);
    }
    v.iter_mut().zip(&f).zip(&case.frame.mass).for_each(|((v, f), m)| *v += f * (h / m));
    mode.project_velocity(&support, n, &mut v);
    (force, v)
}

#[test]
fn friction_spans_sliding_to_sticking() {
    let frictionless = Worst::new("limits of μ", "μ = 0 against sliding, relative", ROUND_OFF);
    let run = runner(300).run(&(case(), forces(), forces()), |(case, f, v)| {
        let n = case.nodes();
        let reaction = case.support().reaction(&f[..n]);
        prop_assume!(reaction.dot(&case.frame.normal) > 1e-9 * reaction.norm());
        let scale = |f: &[Vec3], v: &[Vec3]| {
            let free = v.iter().zip(f).zip(&case.frame.mass).map(|((v, f), m)| v.norm() + f.norm() * 1e-3 / m);
            free.fold(0.0, f64::max)
        };
        let (sliding, v_sliding) = constrained(Law::Sliding, &case, &f[..n], &v[..n]);
        let (smooth, v_smooth) =
            constrained(Law::StickSlip { friction: Friction::single(0.0) }, &case, &f[..n], &v[..n]);
        frictionless.case((sliding - smooth).norm() / reaction.norm())?;
        // A frictionless slip takes the normal force from the mesh before Q stops the rest of the
        // normal motion; Q would have stopped all of it. In the metric's own inner product both are
        // equal: Wᵀn̂ F_N is in the kernel of Q M⁻¹ only there, or for equal masses.
        if case.frame.metric == Metric::Mass {
            let difference = largest(v_sliding.iter().zip(&v_smooth).map(|(a, b)| (a - b).norm()));
            frictionless.case(difference / scale(&f[..n], &v[..n]))?;
        }
        let sticking = constrained(Law::Sticking, &case, &f[..n], &v[..n]);
        let rough = constrained(Law::StickSlip { friction: Friction::single(1e30) }, &case, &f[..n], &v[..n]);
        prop_assert_eq!(sticking, rough);
        Ok(())
    });
    run.unwrap();
}
