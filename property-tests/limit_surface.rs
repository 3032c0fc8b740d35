//! Contact with the limit surface: nearest points, sides, passages, borders, and degenerate
//! shapes.

use std::sync::Arc;

use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::contact::law::{Law, Mode};
use stickslip::contact::rules::{ContactRules, Scheme, Wall};
use stickslip::contact::shape::{Projection, Shape, Touch, Visited};
use stickslip::contact::simulation::LocalSimulation;
use stickslip::local::model::{LocalModel, LocalModelBuilder, LocalSettings, LocalState};
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::topology::Surface;
use stickslip::output::measures::is_tunnelling;
use stickslip::pipeline::RunError;
use stickslip::surface::geometry::{ContactPoint, ContactSurface, SurfaceModel};
use stickslip::surface::support::{Metric, Support};

use crate::check::{Worst, runner, scene};

const SPACING: f64 = 0.01;

/// A surface as a tick sees it, with all nodes free.
struct Body {
    surface: SurfaceModel,
    model: LocalModel,
    state: LocalState,
}

impl Body {
    fn new(mesh: &Mesh, moved: impl Fn(Vec3) -> Vec3) -> Self {
        let count = mesh.nodes.len();
        let material = Material {
            node_mass: vec![0.01; count],
            stiffness: 100.0.into(),
            damping: 0.5.into(),
            drag: 0.0,
            gravity: Vec3::zeros(),
        };
        let network = Network::new(mesh, &material, vec![false; count]).expect("a value for each node");
        let mut state = network.rest_state();
        state.x.iter_mut().for_each(|x| *x = moved(*x));
        let surface = Arc::new(Surface::new(mesh).expect("a surface"));
        let surface = SurfaceModel::new(ContactSurface::Subdivision, surface).expect("no crowded triangle");
        let mut builder = LocalModelBuilder::new(&network, surface.clone(), LocalSettings::FULL);
        let (model, state) =
            builder.build(&network, &state, Vec3::zeros(), None).expect("explicit steps need no solution");
        Self { surface, model, state }
    }

    fn shape(&self) -> Shape<'_> {
        Shape { surface: &self.surface, model: &self.model, x: &self.state.x, elapsed: 0.0 }
    }

    fn triangles(&self) -> u32 {
        self.surface.topology.triangles.len() as u32
    }

    fn touch(&self, point: &ContactPoint) -> Touch {
        self.shape().touch(Metric::Mass, point, &mut Support::with_capacity(32))
    }

    /// Returns the least distance of q from a fine sample of every triangle, m.
    fn sampled_distance(&self, q: Vec3, samples: usize) -> f64 {
        let shape = self.shape();
        let points = (0..self.triangles()).flat_map(|triangle| {
            (0..=samples).flat_map(move |i| {
                (0..=samples - i).map(move |j| {
                    let part = |k: usize| k as f64 / samples as f64;
                    ContactPoint { triangle, weights: [part(samples - i - j), part(i), part(j)] }
                })
            })
        });
        points.map(|point| (shape.position(&point) - q).norm()).fold(f64::INFINITY, f64::min)
    }

    fn simulation(self, scheme: Scheme, law: Law) -> LocalSimulation {
        let rules = ContactRules { law, scheme, adhesion_n: 0.0, wall: Wall { stiffness: 1000.0, damping: 0.0 } };
        LocalSimulation::new(rules, 1e-3, self.surface, self.model, self.state)
    }
}

fn block() -> Mesh {
    Block { nodes: [7, 7, 3], spacing: SPACING, stencil: Stencil::Shear }.mesh()
}

fn dented() -> Body {
    Body::new(&block(), |x| {
        let dent = 0.003 * (-(x.x * x.x + x.y * x.y) / 1.5e-4).exp();
        if x.z > -0.005 { x - Vec3::z() * dent } else { x }
    })
}

/// Builds one layer of triangles with a border.
fn sheet() -> Body {
    let (n, mut nodes, mut triangles) = (5_u32, Vec::new(), Vec::new());
    for j in 0..n {
        for i in 0..n {
            nodes.push(Vec3::new(f64::from(i), f64::from(j), 0.0) * SPACING);
        }
    }
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let at = |i: u32, j: u32| j * n + i;
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let edges = (0..n * n - 1).map(|i| [i, i + 1]).collect();
    Body::new(&Mesh { nodes, edges, triangles, ..Mesh::default() }, |x| x + Vec3::z() * 0.001 * (200.0 * x.x).sin())
}

fn point() -> impl Strategy<Value = ContactPoint> {
    let weights = prop::array::uniform3(1e-6..1.0_f64).prop_map(|w| w.map(|x| x / w.iter().sum::<f64>()));
    (0..240_u32, weights).prop_map(|(triangle, weights)| ContactPoint { triangle, weights })
}

/// Along the normal, at less than any radius of curvature, the nearest point is the starting point.
#[test]
fn distance_along_the_normal_is_the_signed_distance() {
    // Round-off of positions up to 0.05 m; the search ends at steps of 1e-12 of an edge. Measured: 2e-17.
    let distance = Worst::new("limit surface", "signed distance of p + d n, minus d, m", 1e-15);
    let place = Worst::new("limit surface", "nearest point of p + d n, minus p, m", 1e-13);
    let body = dented();
    assert_eq!(body.triangles(), 240);
    let run = runner(3000).run(&(point(), -0.0008..0.0008_f64), |(point, d)| {
        let Touch { position, normal, .. } = body.touch(&point);
        let q = position + normal * d;
        distance.case((body.shape().signed_distance(q) - d).abs())?;
        let nearest = body.shape().nearest(q).expect("a finite surface");
        place.case((body.shape().position(&nearest) - position).norm())
    });
    run.unwrap();
}

/// No sample of the surface within an edge of q is nearer than the nearest point.
#[test]
fn no_other_point_is_nearer() {
    // The search starts from the nearest point of the control mesh. Measured: 0, always at least as near.
    let nearer = Worst::new("limit surface", "nearest distance - least of 11,000 samples, m", 1e-15);
    let body = dented();
    let near = (-0.035..0.035, -0.035..0.035, -0.026..0.006).prop_map(|(x, y, z)| Vec3::new(x, y, z));
    let run = runner(300).run(&near, |q| {
        let distance = body.shape().signed_distance(q).abs();
        // Deep inside a slab two sides are equally near, and either is valid for a tip.
        prop_assume!(distance < 0.006);
        nearer.case(distance - body.sampled_distance(q, 10))
    });
    run.unwrap();
}

/// A projection walks to the nearest point from any start on its side.
#[test]
fn projections_end_where_the_offset_is_normal() {
    // The search ends at a step of 1e-12 of an edge, 2e-14 m; where the second-order model is not convex,
    // the next step would be of that order. Measured: 1.5e-14.
    let worst = Worst::new("limit surface", "projection: tangential part of q - p, m", 3e-14);
    let body = dented();
    let tip = (-0.02..0.02, -0.02..0.02, -0.002..0.002);
    let run = runner(2000).run(&(tip, 0..72_u32), |((x, y, above), start)| {
        let q = Vec3::new(x, y, above - 0.003 * (-(x * x + y * y) / 1.5e-4_f64).exp());
        let from = ContactPoint { triangle: start, weights: [1.0 / 3.0; 3] };
        let Projection::Found(point) = body.shape().project(&from, q, &mut Visited::new(240)) else {
            return Err(TestCaseError::fail("a closed surface has no border"));
        };
        let touch = body.touch(&point);
        let offset = q - touch.position;
        worst.case((offset - touch.normal * offset.dot(&touch.normal)).norm())
    });
    run.unwrap();
}

/// The first passage of a free tip through a moving body, compared with 4,000 samples of the tick.
#[test]
fn passages_are_found_when_they_happen() {
    // A sample is 1/4000 of a tick wide.
    let worst = Worst::new("limit surface", "time of collision - sampled, ticks", 1.01 / 4000.0);
    // The nearest point, and with it a distance near zero, is known to some 1e-14 m. Measured: 1.2e-14.
    let height = Worst::new("limit surface", "distance at the time of collision, m", 1e-13);
    let run = runner(60).run(
        &(prop::array::uniform2(-0.02..0.02), 0.0005..0.004_f64, -0.004..0.001_f64, prop::array::uniform3(-2.0..2.0)),
        |([x, y], above, below, wind)| {
            let mut body = dented();
            // Each node has its own velocity, m/s.
            for (i, v) in body.state.v.iter_mut().enumerate() {
                *v = Vec3::from(wind) * (0.5 + 0.5 * (i as f64 * 1.7).sin());
            }
            let start = body.state.x.clone();
            let (q0, q1) = (Vec3::new(x, y, above), Vec3::new(x + 0.001, y, below));
            prop_assume!(body.shape().signed_distance(q0) > 0.0);
            let mut simulation = body.simulation(Scheme::Velocity, Law::Sliding);
            let (model, mut state) = (simulation.model().clone(), simulation.state().clone());
            model.evaluate_forces(0.0, &mut state);
            let mass = 0.01;
            let end: Vec<Vec3> =
                (0..start.len()).map(|i| start[i] + (state.v[i] + state.f[i] * (1e-3 / mass)) * 1e-3).collect();
            let surface = simulation.surface().clone();
            let distance = |time: f64| {
                let x: Vec<Vec3> = start.iter().zip(&end).map(|(a, b)| a + (b - a) * time).collect();
                Shape { surface: &surface, model: &model, x: &x, elapsed: 0.0 }.signed_distance(q0 + (q1 - q0) * time)
            };
            let sampled = (1..=4000).map(|i| f64::from(i) / 4000.0).find(|&time| distance(time) < 0.0);
            let found = simulation.tick(q0, q1).collision_time;
            prop_assert_eq!(found.is_some(), sampled.is_some(), "found {:?}, sampled {:?}", found, sampled);
            if let (Some(found), Some(sampled)) = (found, sampled) {
                worst.case((found - sampled).abs())?;
                height.case(distance(found).abs())?;
            }
            Ok(())
        },
    );
    run.unwrap();
}

/// Beyond the border of an open surface a contact ends, and the nearest point is on the border.
#[test]
fn a_border_ends_the_contact() {
    let body = sheet();
    let from = ContactPoint { triangle: 12, weights: [1.0 / 3.0; 3] };
    let mut visited = Visited::new(body.triangles() as usize);
    let inner = Vec3::new(0.021, 0.018, 0.0005);
    assert!(matches!(body.shape().project(&from, inner, &mut visited), Projection::Found(_)));
    for beyond in [Vec3::new(0.05, 0.02, 0.0), Vec3::new(-0.01, 0.013, 0.001), Vec3::new(0.06, 0.06, 0.0)] {
        assert_eq!(body.shape().project(&from, beyond, &mut visited), Projection::OverBorder, "{beyond}");
        let nearest = body.shape().nearest(beyond).expect("a finite surface");
        let distance = (body.shape().position(&nearest) - beyond).norm();
        // A sample of the border is 1/200 of an edge apart.
        let sampled = body.sampled_distance(beyond, 200);
        assert!(distance <= sampled + 1e-12 && distance >= sampled - 1e-5, "{beyond}: {distance} against {sampled}");
    }
    let mut simulation = body.simulation(Scheme::Velocity, Law::Sliding);
    let mut q = Vec3::new(0.02, 0.02, 0.004);
    let mut modes = Vec::new();
    for tick in 0..400 {
        let next = if tick < 100 { q - Vec3::z() * 5e-5 } else { q + Vec3::x() * 1e-4 };
        modes.push(simulation.tick(q, next).mode);
        q = next;
    }
    assert!(modes.contains(&Mode::Slide) && modes.last() == Some(&Mode::Free), "slides, then is over the border");
}

/// The limit surface rounds a block by known amounts, in units of its spacing.
#[test]
fn edges_and_corners_are_rounded_by_known_amounts() {
    let body = Body::new(&block(), |x| x);
    let depth = |q: Vec3| body.shape().signed_distance(q) / SPACING;
    let half = 0.03;
    let face = depth(Vec3::new(0.001, 0.002, 0.0));
    let edges = [Vec3::new(half, 0.002, 0.0), Vec3::new(0.002, half, 0.0), Vec3::new(half, half, -0.01)];
    let corners = [-1.0, 1.0].map(|s| [-1.0, 1.0].map(|r| Vec3::new(s * half, r * half, 0.0)));
    for edge in edges {
        let distance = depth(edge);
        println!(
            "RESIDUAL | limit surface | sharp edge of a block: distance to the surface, spacings | 0.1..0.4 | {distance:.3}"
        );
        assert!(distance > 0.1 && distance < 0.4, "{distance}");
    }
    for corner in corners.into_iter().flatten() {
        let distance = depth(corner);
        println!(
            "RESIDUAL | limit surface | corner of a block: distance to the surface, spacings | 0.2..1 | {distance:.3}"
        );
        assert!(distance > 0.2 && distance < 1.0, "{distance}");
    }
    // The surface is flat where its support is.
    assert!(face.abs() <= 1e-14, "{face}");
}

/// A tip presses on the irregular vertices of a block, from straight above.
#[test]
fn vertices_of_every_kind_can_be_pressed() {
    let mesh = block();
    let template = Body::new(&mesh, |x| x);
    let surface = template.surface.topology.clone();
    for (vertex, &node) in surface.vertex_node.iter().enumerate() {
        let valence = surface.incident(vertex as u32).len();
        if valence == 6 || mesh.nodes[node as usize].z < -0.015 {
            continue;
        }
        let triangle = surface.incident(vertex as u32)[0];
        let weights = surface.triangles[triangle as usize].map(|v| if v as usize == vertex { 1.0 } else { 0.0 });
        let Touch { position, normal, .. } = template.touch(&ContactPoint { triangle, weights });
        assert!(normal.norm() > 0.5, "vertex {vertex} of valence {valence} has the normal {normal}");
        for scheme in [Scheme::Velocity] {
            let mut simulation = Body::new(&mesh, |x| x).simulation(scheme, Law::Sliding);
            let mut q = position + normal * 0.0005;
            for _ in 0..40 {
                let next = q - normal * 3e-5;
                let report = simulation.tick(q, next);
                assert!(report.force.iter().all(|f| f.is_finite()), "vertex {vertex}: {report:?}");
                q = next;
            }
            assert!(simulation.contact().is_some(), "vertex {vertex} of valence {valence} was not felt");
        }
    }
}

/// A degenerate surface gives a result or a named fault, never a panic or a hang.
#[test]
fn degenerate_shapes_end_in_an_answer_or_a_fault() {
    type Squash = fn(Vec3) -> Vec3;
    let shapes: [(&str, Squash); 6] = [
        ("needles", |x| Vec3::new(x.x, x.y * 1e-9, x.z)),
        ("a line", |x| Vec3::new(x.x, 0.0, 0.0)),
        ("a point", |_| Vec3::zeros()),
        ("inside out", |x| -x),
        ("folded", |x| if x.x > 0.0 { Vec3::new(-x.x * 0.9, x.y, x.z + 0.002) } else { x }),
        ("not finite", |x| if x.x > 0.0 { Vec3::repeat(f64::NAN) } else { x }),
    ];
    for (name, squash) in shapes {
        let body = Body::new(&block(), squash);
        let shape = body.shape();
        let mut visited = Visited::new(240);
        for i in 0..200 {
            let t = f64::from(i);
            let q = Vec3::new((t * 0.7).sin(), (t * 1.3).cos(), (t * 0.3).sin()) * 0.02;
            let from = ContactPoint { triangle: i as u32 % 240, weights: [1.0 / 3.0; 3] };
            let (distance, projection) = (shape.signed_distance(q), shape.project(&from, q, &mut visited));
            if name != "not finite" {
                assert!(distance.is_finite(), "{name}: {distance}");
                let Projection::Found(point) = projection else { panic!("{name} has no border") };
                assert!(point.weights.iter().all(|w| (0.0..=1.0).contains(w)), "{name}: {point:?}");
            }
        }
    }
}

/// A soft block is crushed far beyond the load that its springs can bear.
#[test]
fn a_crushed_block_ends_in_an_answer_or_a_fault() {
    for scheme in ["geometric", "velocity"] {
        for law in ["\"sliding\"", "\"sticking\"", "\"stick-slip\"\nfriction = 1.0"] {
            let scene = scene(&format!(
                "name = 'crushed'\nduration = 0.4\n[mesh]\nnodes = [5, 5, 3]\nspacing = 0.0125\n[material]\n\
                 node_mass = 0.01\nstiffness = 100.0\ndamping = 0.5\n[local]\nmodel = 'full'\n\
                 [contact]\nlaw = {law}\nsurface = 'subdivision'\nscheme = '{scheme}'\n[instrument]\n\
                 waypoints = [[0.0, -0.012, 0.0013, 0.001], [0.2, -0.012, 0.0013, -0.03], [0.4, 0.05, 0.0, -0.04]]"
            ));
            let mut inside_unfelt = 0;
            let end = stickslip::pipeline::run(&scene, |view| {
                assert!(view.force.iter().all(|f| f.is_finite()));
                inside_unfelt += u32::from(is_tunnelling(view));
            });
            match end {
                Ok(()) => {
                    println!(
                        "RESIDUAL | limit surface | crushed, {law:?}, {scheme}: completes, ticks inside unfelt | 0 | {inside_unfelt}"
                    );
                    assert_eq!(inside_unfelt, 0, "{law:?}, {scheme}");
                }
                Err(RunError::Fault(fault)) => {
                    println!("RESIDUAL | limit surface | crushed, {law:?}, {scheme}: fault | - | {fault}")
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
}

/// A point held while the tip moves by 5 cm pulls the mesh into spikes: control vertices far from their
/// surface. Where the contact tears off, the tip stays outside until it touches again.
#[test]
fn a_tip_does_not_get_into_a_crumpled_surface_unfelt() {
    let scene = scene(
        r#"
        name = "crumpled"
        duration = 1.6
        [mesh]
        nodes = [9, 9, 4]
        spacing = 0.0125
        [material]
        node_mass = 0.01
        stiffness = 100.0
        damping = 0.5
        drag = 0.2
        [local]
        linearization = "none"
        exterior = "condensed"
        [contact]
        law = "sticking"
        scheme = "velocity"
        surface = "subdivision"
        [instrument]
        waypoints = [[0.0, -0.03, 0.0013, 0.001], [0.2, -0.03, 0.0013, -0.006], [1.2, 0.02, 0.0013, -0.006]]
        "#,
    );
    let run = crate::check::run(&scene);
    assert!(run.fault.is_none() && run.releases > 1, "it tears off: {} releases", run.releases);
    assert_eq!(run.tunnelling_ticks, 0);
}
