//! Condensation of the exterior into C: blocks of about 1,000, 4,096 and 10,000 nodes, a patch of 50 nodes, one core.
//!
//! `cargo bench --bench condensation`. *Known patch*: assembly and factorisation, as in a cycle with the patch of the
//! previous one. *New patch*: also the order of elimination and the analysis of the pattern.

use std::hint::black_box;

use criterion::Criterion;
use stickslip::Vec3;
use stickslip::local::condensation::{Condensation, Condenser, FarField, Reach};
use stickslip::local::patch::{Extent, PatchSelector};
use stickslip::model::mesh::{Block, Stencil};
use stickslip::model::network::{Material, Network};
use stickslip::model::springs::TangentKind;
use stickslip::model::topology::Surface;

fn main() {
    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    let coarse = |rings| Reach::Rings { rings, far_field: FarField::Coarse };
    let fixed = |rings| Reach::Rings { rings, far_field: FarField::Fixed };
    for nodes in [[10, 10, 10], [16, 16, 16], [22, 22, 21]] {
        let count: usize = nodes.iter().product();
        let block = Block { nodes, spacing: 0.0125, stencil: Stencil::Shear };
        let mesh = block.mesh();
        let surface = Surface::new(&mesh).expect("a block has a surface");
        let material = Material {
            node_mass: vec![0.01; count],
            stiffness: 100.0.into(),
            damping: 0.5.into(),
            drag: 0.0,
            gravity: Vec3::zeros(),
        };
        let network = Network::new(&mesh, &material, (0..count).map(|node| block.is_bottom(node)).collect())
            .expect("a value for each node");
        let x = &network.rest;
        let mut selector = PatchSelector::new(&network, &surface);
        let mut patch =
            |at: f64| selector.select(&network, &surface, x, Vec3::new(at, 0.0, 0.0), &[], Extent::Rings(2));
        let [here, there] = [patch(0.0), patch(0.0125)];
        let mut group = criterion.benchmark_group(format!("{count} nodes, patch of {}", here.len()));
        for (name, reach) in [("all", Reach::All), ("4 rings", fixed(4)), ("4 rings, coarse beyond", coarse(4))] {
            let mut condenser = Condenser::new(&network, Condensation { tangent: TangentKind::Exact, reach });
            let size = condenser.condense(&network, &here, x).size;
            eprintln!("{count} nodes, {name}: {size:?}");
            group.bench_function(format!("{name}, known patch"), |bencher| {
                bencher.iter(|| black_box(condenser.condense(&network, &here, x)));
            });
            group.bench_function(format!("{name}, new patch"), |bencher| {
                let mut turn = [&here, &there].into_iter().cycle();
                bencher.iter(|| {
                    let patch = turn.next().expect("it goes round");
                    black_box(condenser.condense(&network, patch, x))
                });
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
