//! Basis functions of the Loop limit surface.

use std::collections::HashMap;

use proptest::prelude::*;
use stickslip::Vec3;
use stickslip::model::mesh::{Block, Mesh, Stencil};
use stickslip::model::topology::Surface;
use stickslip::surface::subdivision::{Jet, LimitSurface};
use stickslip::verify::residual::largest;

use crate::check::{Worst, runner};

/// Surface with positions.
struct Sheet {
    surface: Surface,
    x: Vec<Vec3>,
    limit: LimitSurface,
}

impl Sheet {
    fn new(x: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let surface = Surface::new(&Mesh { nodes: x.clone(), triangles, ..Mesh::default() }).expect("a surface");
        let limit = LimitSurface::new(&surface).expect("no crowded triangle");
        Self { surface, x, limit }
    }

    /// Returns value and derivatives of the surface.
    fn point(&self, triangle: u32, weights: [f64; 3]) -> [Vec3; 6] {
        self.sum(triangle, &self.limit.jet(triangle, weights))
    }

    fn sum(&self, triangle: u32, jet: &Jet) -> [Vec3; 6] {
        let mut sums = [Vec3::zeros(); 6];
        for (&vertex, entry) in self.limit.support(triangle).iter().zip(jet.entries()) {
            let node = self.surface.vertex_node[vertex as usize];
            sums.iter_mut().zip(entry).for_each(|(sum, w)| *sum += self.x[node as usize] * *w);
        }
        sums
    }

    fn normal(&self, triangle: u32, weights: [f64; 3]) -> Vec3 {
        let [_, pb, pg, ..] = self.point(triangle, weights);
        pb.cross(&pg).normalize()
    }
}

/// Builds an open sheet of the regular lattice with a wavy height, its triangles' corners rotated
/// by `turn`.
fn lattice(size: usize, turn: usize, height: impl Fn(f64, f64) -> f64) -> Sheet {
    let at = |i: usize, j: usize| (j * (size + 1) + i) as u32;
    let mut x = Vec::new();
    for j in 0..=size {
        for i in 0..=size {
            let (a, b) = (i as f64 + 0.5 * j as f64, 0.75_f64.sqrt() * j as f64);
            x.push(Vec3::new(a, b, height(a, b)));
        }
    }
    let mut triangles = Vec::new();
    for j in 0..size {
        for i in 0..size {
            triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    triangles.iter_mut().for_each(|t| t.rotate_left(turn));
    Sheet::new(x, triangles)
}

fn wave(a: f64, b: f64) -> f64 {
    0.3 * (1.3 * a).sin() + 0.2 * (0.7 * a - 1.1 * b).cos()
}

/// Builds a fan of n triangles around a vertex of valence n, with two more rings, closed below.
fn fan(n: usize, bend: f64) -> Sheet {
    let mut x = vec![Vec3::new(0.0, 0.0, bend)];
    let rings = 4;
    for ring in 1..=rings {
        for k in 0..n * ring {
            let angle = std::f64::consts::TAU * k as f64 / (n * ring) as f64;
            let r = ring as f64;
            x.push(Vec3::new(
                r * angle.cos(),
                r * angle.sin(),
                bend * (0.6 * r).cos() + 0.1 * bend * (2.0 * angle).sin() * r,
            ));
        }
    }
    let start = |ring: usize| if ring == 0 { 0 } else { 1 + n * ring * (ring - 1) / 2 };
    let at = |ring: usize, k: usize| (start(ring) + if ring == 0 { 0 } else { k % (n * ring) }) as u32;
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for sector in 0..n {
            for k in 0..=ring {
                let (outer, inner) = (sector * (ring + 1) + k, sector * ring + k);
                triangles.push([at(ring, inner), at(ring + 1, outer), at(ring + 1, outer + 1)]);
                if k < ring {
                    triangles.push([at(ring, inner), at(ring + 1, outer + 1), at(ring, inner + 1)]);
                }
            }
        }
    }
    Sheet::new(x, triangles)
}

/// Builds a dented block: closed, with vertices of three to six and more neighbours.
fn block() -> Sheet {
    let mesh = Block { nodes: [5, 4, 3], spacing: 0.25, stencil: Stencil::Shear }.mesh();
    let x = mesh.nodes.iter().map(|p| p + Vec3::new(wave(p.y, p.z), wave(p.z, p.x), wave(p.x, p.y)) * 0.2).collect();
    Sheet::new(x, mesh.triangles)
}

/// Builds a fin of one strip of triangles: every vertex is on the border, some with a single triangle.
fn strip() -> Sheet {
    let x: Vec<Vec3> =
        (0..8).map(|i| Vec3::new(f64::from(i / 2), f64::from(i % 2), 0.1 * f64::from(i * i % 5))).collect();
    let triangles = (0..6_u32).map(|i| if i % 2 == 0 { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] }).collect();
    Sheet::new(x, triangles)
}

fn tetrahedron() -> Sheet {
    let x = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
    Sheet::new(x, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
}

fn sheets() -> Vec<(&'static str, Sheet)> {
    let mut sheets =
        vec![("lattice", lattice(6, 0, wave)), ("block", block()), ("strip", strip()), ("tetrahedron", tetrahedron())];
    for n in 3..=9 {
        sheets.push(("fan", fan(n, 1.0)));
    }
    sheets
}

/// Barycentric coordinates anywhere in a triangle, often near its corners and edges.
fn weights() -> impl Strategy<Value = [f64; 3]> {
    let near = (0.0..1.0_f64, 0.0..1.0_f64, 0.0..14.0_f64, 0..3_usize).prop_map(|(a, b, decades, corner)| {
        let r = 10.0_f64.powf(-decades);
        let mut w = [1.0 - r, r * a, r * (1.0 - a)];
        if b < 0.1 {
            w = [1.0 - r, r, 0.0];
        }
        w.rotate_right(corner);
        w
    });
    let anywhere = prop::array::uniform3(1e-3..1.0_f64).prop_map(|w| w.map(|x| x / w.iter().sum::<f64>()));
    prop_oneof![near, anywhere]
}

#[test]
fn weights_sum_to_one_and_derivatives_to_zero() {
    // Derivatives are small near a vertex with few neighbours and large near one with many: residuals are
    // relative to the first derivatives, those of second ones also to the distance from the corner over which
    // they change. Measured: 4e-16 and 5e-15.
    let one = Worst::new("subdivision", "sum of weights - 1", 1e-14);
    let zero = Worst::new("subdivision", "sum of derivatives, relative", 5e-14);
    let sheets = sheets();
    let run =
        runner(4000).run(&(weights(), any::<prop::sample::Index>(), any::<prop::sample::Index>()), |(w, s, t)| {
            let (_, sheet) = s.get(&sheets);
            let triangle = t.index(sheet.surface.triangles.len()) as u32;
            let jet = sheet.limit.jet(triangle, w);
            let sum = |k: usize| jet.entries().iter().map(|entry| entry[k]).sum::<f64>();
            let size = |k: usize| jet.entries().iter().map(|entry| entry[k].abs()).sum::<f64>();
            one.case((sum(0) - 1.0).abs())?;
            // Loop's basis functions are non-negative everywhere.
            prop_assert!(jet.entries().iter().all(|entry| entry[0] >= -1e-15));
            let first = size(1) + size(2);
            let from_corner = 1.0 - w.into_iter().fold(0.0, f64::max);
            for k in 1..6 {
                let scale = if k < 3 { first } else { first / from_corner.max(1e-14) };
                zero.case(sum(k).abs() / scale)?;
            }
            Ok(())
        });
    run.unwrap();
}

/// On the regular lattice a linear function of the lattice position is its own limit.
#[test]
fn linear_functions_are_reproduced() {
    // Round-off of twelve terms of size 6. Measured: 3e-15.
    let position = Worst::new("subdivision", "regular patch: p - linear", 1e-14);
    let tangent = Worst::new("subdivision", "regular patch: dp - constant", 1e-13);
    let second = Worst::new("subdivision", "regular patch: ddp", 1e-13);
    let sheet = lattice(6, 0, |a, b| 0.3 * a - 0.7 * b);
    let inner = |t: &[u32; 3]| t.iter().all(|&v| (1..6).contains(&(v % 7)) && (1..6).contains(&(v / 7)));
    let triangles: Vec<u32> = (0..72).filter(|&t| inner(&sheet.surface.triangles[t as usize])).collect();
    let run = runner(500).run(&(weights(), any::<prop::sample::Index>()), |(w, t)| {
        let t = *t.get(&triangles);
        let [a, b, c] = sheet.surface.triangle_nodes(t).map(|n| sheet.x[n as usize]);
        let [p, pb, pg, seconds @ ..] = sheet.point(t, w);
        position.case((p - (a * w[0] + b * w[1] + c * w[2])).norm())?;
        tangent.case(largest([(pb - (b - a)).norm(), (pg - (c - a)).norm()]))?;
        second.case(largest(seconds.iter().map(|s| s.norm())))
    });
    run.unwrap();
}

/// Every derivative compared with central differences of the one below it.
#[test]
fn derivatives_are_those_of_the_values() {
    // Differences over 1e-5 have a truncation of 1e-10 times third derivatives, which grow near irregular
    // vertices; hence the points are away from corners. Measured: 5e-10 and 5e-9.
    let first = Worst::new("subdivision", "first derivatives - differences", 1e-8);
    let second = Worst::new("subdivision", "second derivatives - differences", 1e-8);
    let sheets = sheets();
    let away = prop::array::uniform3(0.15..1.0_f64).prop_map(|w| w.map(|x| x / w.iter().sum::<f64>()));
    let run =
        runner(2000).run(&(away, any::<prop::sample::Index>(), any::<prop::sample::Index>()), |([_, b, g], s, t)| {
            let (_, sheet) = s.get(&sheets);
            let t = t.index(sheet.surface.triangles.len()) as u32;
            let h = 1e-5;
            // The patches inside an irregular triangle are joined with C² only: no differences cross them.
            let grid = [b, g, 1.0 - b - g].map(|w| (w * 64.0 - (w * 64.0).round()).abs() / 64.0);
            prop_assume!(grid.iter().all(|&d| d > 4.0 * h));
            let at = |db: f64, dg: f64| sheet.point(t, [1.0 - b - db - g - dg, b + db, g + dg]);
            let (bp, bm, gp, gm) = (at(h, 0.0), at(-h, 0.0), at(0.0, h), at(0.0, -h));
            let d = |p: Vec3, m: Vec3| (p - m) / (2.0 * h);
            let [_, pb, pg, pbb, pbg, pgg] = at(0.0, 0.0);
            first.case(largest([(d(bp[0], bm[0]) - pb).norm(), (d(gp[0], gm[0]) - pg).norm()]))?;
            second.case(largest([(d(bp[1], bm[1]) - pbb).norm(), (d(gp[2], gm[2]) - pgg).norm()]))?;
            second.case(largest([(d(bp[2], bm[2]) - pbg).norm(), (d(gp[1], gm[1]) - pbg).norm()]))
        });
    run.unwrap();
}

/// Refines a whole mesh by one step of Loop's scheme, written separately: (2.) vertices, edges, triangles.
fn refine(x: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut apexes: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            let (i, j) = (t[k], t[(k + 1) % 3]);
            apexes.entry((i.min(j), i.max(j))).or_default().push(t[(k + 2) % 3]);
        }
    }
    let mut ring = vec![Vec::new(); x.len()];
    let mut border = vec![Vec::new(); x.len()];
    for (&(i, j), apexes) in &apexes {
        ring[i as usize].push(j);
        ring[j as usize].push(i);
        if apexes.len() == 1 {
            border[i as usize].push(j);
            border[j as usize].push(i);
        }
    }
    let at = |i: u32| x[i as usize];
    let mut fine: Vec<Vec3> = (0..x.len())
        .map(|i| match border[i][..] {
            [a, b] => x[i] * 0.75 + (at(a) + at(b)) * 0.125,
            _ => {
                let n = ring[i].len() as f64;
                let beta = (5.0 / 8.0 - (3.0 / 8.0 + (std::f64::consts::TAU / n).cos() / 4.0).powi(2)) / n;
                x[i] * (1.0 - n * beta) + ring[i].iter().map(|&j| at(j)).sum::<Vec3>() * beta
            }
        })
        .collect();
    let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
    let mut edges: Vec<_> = apexes.into_iter().collect();
    edges.sort_unstable();
    for ((i, j), apexes) in edges {
        middle.insert((i, j), fine.len() as u32);
        fine.push(match apexes[..] {
            [a, b] => (at(i) + at(j)) * 0.375 + (at(a) + at(b)) * 0.125,
            _ => (at(i) + at(j)) * 0.5,
        });
    }
    let m = |i: u32, j: u32| middle[&(i.min(j), i.max(j))];
    let children = triangles.iter().flat_map(|&[a, b, c]| {
        [[a, m(a, b), m(a, c)], [m(a, b), b, m(b, c)], [m(a, c), m(b, c), c], [m(b, c), m(a, c), m(a, b)]]
    });
    (fine, children.collect())
}

/// The surface is the limit of repeated subdivision of the whole mesh: refined once or twice, it
/// does not change.
#[test]
fn refining_the_mesh_does_not_change_the_surface() {
    // Exact but for round-off, since both are evaluated in the limit. Measured: 2e-15 of coordinates up to 6.
    let same = Worst::new("subdivision", "p of the refined mesh - p", 2e-14);
    for (_, sheet) in sheets() {
        let nodes =
            (0..sheet.surface.triangles.len() as u32).map(|t| sheet.surface.triangle_nodes(t)).collect::<Vec<_>>();
        let (x, triangles) = refine(&sheet.x, &nodes);
        let (x2, triangles2) = refine(&x, &triangles);
        let (once, twice) = (Sheet::new(x, triangles), Sheet::new(x2, triangles2));
        let run = runner(200).run(&(weights(), any::<prop::sample::Index>()), |(w, t)| {
            let t = t.index(sheet.surface.triangles.len()) as u32;
            let child = |w: [f64; 3]| match (0..3).find(|&k| w[k] >= 0.5) {
                Some(k) => {
                    let mut c = w.map(|x| 2.0 * x);
                    c[k] = 2.0 * w[k] - 1.0;
                    (k as u32, c)
                }
                None => (3, w.map(|x| 1.0 - 2.0 * x)),
            };
            let (k, w1) = child(w);
            let (l, w2) = child(w1);
            let p = sheet.point(t, w)[0];
            same.case((once.point(4 * t + k, w1)[0] - p).norm())?;
            same.case((twice.point(16 * t + 4 * k + l, w2)[0] - p).norm())
        });
        run.unwrap();
    }
}

/// Vertices of a mesh refined k times converge to the surface as 4⁻ᵏ.
#[test]
fn control_meshes_converge_to_the_surface() {
    for (name, sheet) in sheets() {
        let (mut x, mut triangles) = (
            sheet.x.clone(),
            (0..sheet.surface.triangles.len() as u32).map(|t| sheet.surface.triangle_nodes(t)).collect::<Vec<_>>(),
        );
        let mut errors = Vec::new();
        for _ in 0..5 {
            (x, triangles) = refine(&x, &triangles);
            // The first child of each first child keeps the first corner of the triangle.
            let level = errors.len() as u32 + 1;
            let distance = (0..sheet.surface.triangles.len() as u32)
                .map(|t| {
                    let corner = triangles[(t * 4_u32.pow(level)) as usize][0];
                    (x[corner as usize] - sheet.point(t, [1.0, 0.0, 0.0])[0]).norm()
                })
                .fold(0.0, f64::max);
            errors.push(distance);
        }
        let order = (errors[3] / errors[4]).log2();
        // The factor is the eigenvalue of the symmetric part without the limit: 1/4 for a regular
        // vertex, 1/16 for one with three neighbours, up to 0.4 for nine.
        println!("RESIDUAL | subdivision | {name}: order of k-fold refinement | 1..4.1 | {order:.2}");
        assert!((1.0..=4.1).contains(&order), "{name}: {errors:?}");
    }
}

/// Pairs of points on both sides of every shared edge, at equal distance from it in the dyadic parameters.
fn across_edges(sheet: &Sheet, mut compare: impl FnMut(u32, [f64; 3], u32, [f64; 3])) {
    for (t, neighbors) in sheet.surface.neighbors.iter().enumerate() {
        for (opposite, neighbor) in neighbors.iter().enumerate() {
            let Some(neighbor) = *neighbor else { continue };
            let here = sheet.surface.triangles[t];
            let there = sheet.surface.triangles[neighbor as usize];
            for along in [0.013, 0.25, 0.41, 0.5, 0.77] {
                let mut w = [0.0; 3];
                (w[(opposite + 1) % 3], w[(opposite + 2) % 3]) = (along, 1.0 - along);
                let v = there.map(|vertex| here.iter().position(|&h| h == vertex).map_or(0.0, |k| w[k]));
                compare(t as u32, w, neighbor, v);
            }
        }
    }
}

#[test]
fn tangent_planes_agree_across_every_edge() {
    // Round-off. Measured: 2e-15 and 4e-15.
    let position = Worst::new("subdivision", "across edges: p", 1e-14);
    let normal = Worst::new("subdivision", "across edges: normal", 1e-13);
    for (_, sheet) in sheets() {
        across_edges(&sheet, |t, w, u, v| {
            position.check((sheet.point(t, w)[0] - sheet.point(u, v)[0]).norm());
            normal.check((sheet.normal(t, w) - sheet.normal(u, v)).norm());
        });
    }
}

/// At a vertex all its triangles have one tangent plane: at 1e-6 from it, and at the vertex itself.
#[test]
fn tangent_planes_agree_around_every_vertex() {
    // Loop's surface is C¹ at extraordinary vertices. At 1e-6 of an edge the normals may still differ as
    // (1e-6)^s with s = log(μ/λ) / log ½, 0.3 or more up to nine neighbours, times the bend of the mesh.
    // Measured: 8e-4, and 1.4e-7 at 2^-48.
    let near = Worst::new("subdivision", "around vertices: normal at 1e-6", 5e-3);
    let at = Worst::new("subdivision", "around vertices: normal at 2^-48", 1e-6);
    for (_, sheet) in sheets() {
        let mut normals: HashMap<u32, (Vec3, Vec3)> = HashMap::new();
        for (t, triangle) in sheet.surface.triangles.iter().enumerate() {
            for (k, &vertex) in triangle.iter().enumerate() {
                let mut close = [5e-7; 3];
                close[k] = 1.0 - 1e-6;
                let mut exact = [0.0; 3];
                exact[k] = 1.0;
                let found = (sheet.normal(t as u32, close), sheet.normal(t as u32, exact));
                let first = normals.entry(vertex).or_insert(found);
                near.check((first.0 - found.0).norm());
                at.check((first.1 - found.1).norm());
            }
        }
    }
}

/// Across interior edges of regular patches the lattice coordinates continue, and so do second
/// derivatives.
#[test]
fn curvatures_agree_across_regular_edges() {
    // Round-off of second derivatives of size 1. Measured: 3e-15.
    let second = Worst::new("subdivision", "across regular edges: second derivatives", 1e-13);
    let sheet = lattice(6, 0, wave);
    let inner = |t: u32| {
        sheet.surface.triangles[t as usize].iter().all(|&v| (1..6).contains(&(v % 7)) && (1..6).contains(&(v / 7)))
    };
    let place = |v: u32| [f64::from(v % 7), f64::from(v / 7)];
    // Second derivatives along the lattice's two directions.
    let in_lattice = |t: u32, w: [f64; 3]| {
        let [a, b, c] = sheet.surface.triangles[t as usize].map(place);
        let jacobian = nalgebra::Matrix2::new(b[0] - a[0], c[0] - a[0], b[1] - a[1], c[1] - a[1]);
        let inverse = jacobian.try_inverse().expect("lattice triangles are not degenerate");
        let [.., bb, bg, gg] = sheet.point(t, w);
        (0..3)
            .map(|axis| {
                let hessian = nalgebra::Matrix2::new(bb[axis], bg[axis], bg[axis], gg[axis]);
                inverse.transpose() * hessian * inverse
            })
            .collect::<Vec<_>>()
    };
    let mut edges = 0;
    across_edges(&sheet, |t, w, u, v| {
        if inner(t) && inner(u) {
            edges += 1;
            for (h, g) in in_lattice(t, w).iter().zip(in_lattice(u, v)) {
                second.check((h - g).norm());
            }
        }
    });
    assert!(edges > 100, "{edges} edges");
}

/// The surface does not depend on which corner of a triangle comes first.
#[test]
fn the_order_of_corners_does_not_matter() {
    // Round-off of twelve terms in another order. Measured: 2e-15.
    let same = Worst::new("subdivision", "corners in another order: p", 1e-14);
    let (first, second) = (lattice(6, 0, wave), lattice(6, 1, wave));
    let run = runner(500).run(&(weights(), 0..72_u32), |(w, t)| {
        let mut turned = w;
        turned.rotate_left(1);
        same.case((first.point(t, w)[0] - second.point(t, turned)[0]).norm())
    });
    run.unwrap();
}

/// On a border the surface is the cubic B-spline of the border vertices.
#[test]
fn borders_are_cubic_b_splines() {
    // Round-off. Measured: 2e-15.
    let same = Worst::new("subdivision", "border: p - cubic B-spline", 1e-14);
    for sheet in [lattice(6, 0, wave), strip()] {
        for (t, neighbors) in sheet.surface.neighbors.iter().enumerate() {
            for opposite in (0..3).filter(|&k| neighbors[k].is_none()) {
                let [a, b] = [1, 2].map(|k| sheet.surface.triangles[t][(opposite + k) % 3]);
                // These are the border vertices before a and after b.
                let beyond = |from: u32, at: u32| {
                    let edges = sheet.surface.neighbors.iter().zip(&sheet.surface.triangles).flat_map(|(n, t)| {
                        (0..3).filter(|&k| n[k].is_none()).map(|k| (t[(k + 1) % 3], t[(k + 2) % 3]))
                    });
                    edges
                        .flat_map(|(i, j)| [(i, j), (j, i)])
                        .find(|&(i, j)| i == at && j != from)
                        .expect("a closed border")
                        .1
                };
                let controls = [beyond(b, a), a, b, beyond(a, b)].map(|v| sheet.x[v as usize]);
                for s in [0.0, 0.1, 0.35, 0.5, 0.8, 1.0_f64] {
                    let r = 1.0 - s;
                    let spline = (controls[0] * r.powi(3)
                        + controls[1] * (4.0 - 6.0 * s * s + 3.0 * s.powi(3))
                        + controls[2] * (4.0 - 6.0 * r * r + 3.0 * r.powi(3))
                        + controls[3] * s.powi(3))
                        / 6.0;
                    let mut w = [0.0; 3];
                    (w[(opposite + 1) % 3], w[(opposite + 2) % 3]) = (r, s);
                    same.check((sheet.point(t as u32, w)[0] - spline).norm());
                }
            }
        }
    }
}

/// Returns the limit position of a vertex: (1 − nχ) x + χ Σ neighbours, χ = 1 / (n + 3/(8β)).
#[test]
fn vertices_go_to_their_known_limit() {
    // The surface is evaluated 2⁻⁴⁸ of a triangle away. Measured: 2e-11 for nine neighbours.
    let same = Worst::new("subdivision", "vertex: p - limit mask", 1e-11);
    for n in 3..=9 {
        let sheet = fan(n, 1.0);
        let valence = n as f64;
        let beta = (5.0 / 8.0 - (3.0 / 8.0 + (std::f64::consts::TAU / valence).cos() / 4.0).powi(2)) / valence;
        let chi = 1.0 / (valence + 3.0 / (8.0 * beta));
        let expected = sheet.x[0] * (1.0 - valence * chi) + sheet.x[1..=n].iter().sum::<Vec3>() * chi;
        let t = sheet.surface.triangles.iter().position(|t| t.contains(&0)).expect("the centre") as u32;
        let w = sheet.surface.triangles[t as usize].map(|v| if v == 0 { 1.0 } else { 0.0 });
        same.check((sheet.point(t, w)[0] - expected).norm());
    }
}

#[test]
fn a_vertex_with_too_many_neighbours_is_named() {
    let n = 40;
    let mut x = vec![Vec3::zeros()];
    x.extend((0..n).map(|k| {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
        Vec3::new(angle.cos(), angle.sin(), 0.0)
    }));
    let triangles = (0..n as u32).map(|k| [0, 1 + k, 1 + (k + 1) % n as u32]).collect();
    let surface = Surface::new(&Mesh { nodes: x, triangles, ..Mesh::default() }).unwrap();
    let error = LimitSurface::new(&surface).unwrap_err().to_string();
    assert!(error.contains("has 41 vertices around it") && error.contains("at most 32"), "{error}");
}
