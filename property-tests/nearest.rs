//! The side of the surface on which a point lies, next to edges and vertices.

use std::sync::Arc;

use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::contact::shape::Shape;
use stickslip::local::model::{LocalModelBuilder, LocalSettings};
use stickslip::model::mesh::Mesh;
use stickslip::model::network::{Material, Network};
use stickslip::model::topology::Surface;
use stickslip::surface::geometry::SurfaceModel;

use crate::check::runner;

/// A few nanometres from an edge or a vertex of a convex body several triangles tie for the nearest, within the tolerance.
/// A point is outside there if it lies above the plane of any face, which only the pseudonormal of its nearest feature
/// tells: that of a triangle which merely ties may face the other way.
#[test]
fn a_point_next_to_an_edge_is_on_its_own_side() {
    let mesh = Mesh {
        nodes: vec![Vec3::zeros(), Vec3::x() * 0.04, Vec3::new(0.01, 0.05, 0.0), Vec3::new(0.015, 0.015, 0.02)],
        edges: vec![[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        tetrahedra: vec![],
    };
    let material = Material::uniform(4, 0.01, 100.0, 0.0);
    let network = Network::new(&mesh, &material, vec![false; 4]).expect("a value for each node");
    let surface = SurfaceModel::faceted(Arc::new(Surface::new(&mesh).expect("closed")));
    let mut builder = LocalModelBuilder::new(&network, surface.clone(), LocalSettings::FULL);
    let (model, state) = builder.build(&network, &network.rest_state(), Vec3::zeros(), None).expect("explicit");
    let shape = Shape { surface: &surface, model: &model, x: &state.x, elapsed: 0.0 };
    let height = |[a, b, c]: [u32; 3], q: Vec3| {
        let [a, b, c] = [a, b, c].map(|node| mesh.nodes[node as usize]);
        (b - a).cross(&(c - a)).normalize().dot(&(q - a))
    };

    let (mut inside, mut outside) = (0, 0);
    let nm = -3e-9..3e-9_f64;
    let strategy = (0..6_usize, prop_oneof![Just(0.0), Just(1.0), 0.0..1.0_f64], [nm.clone(), nm.clone(), nm]);
    runner(20_000)
        .run(&strategy, |(edge, along, offset)| {
            let [from, to] = mesh.edges[edge].map(|node| mesh.nodes[node as usize]);
            let q = from + (to - from) * along + Vec3::from(offset);
            let highest = mesh.triangles.iter().map(|&t| height(t, q)).fold(f64::NEG_INFINITY, f64::max);
            // Within the round-off of positions of 5 cm the side is undecided.
            if highest.abs() < 1e-16 {
                return Ok(());
            }
            prop_assert_eq!(shape.is_outside(q), highest > 0.0, "{:?}: {:e} m above the highest face", q, highest);
            Ok(())
        })
        .expect("every point is on its own side");
    for offset in [2e-10, -2e-10] {
        let middle = (mesh.nodes[1] + mesh.nodes[3]) * 0.5;
        let outwards = (middle - Vec3::new(0.016, 0.016, 0.005)).normalize();
        let side = shape.is_outside(middle + outwards * offset);
        (inside, outside) = (inside + u32::from(!side), outside + u32::from(side));
    }
    assert_eq!((inside, outside), (1, 1), "0.2 nm to either side of an edge");
}
