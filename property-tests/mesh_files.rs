//! Meshes from files: every format gives the same mesh, a valid mesh becomes a body, and an invalid one is refused with
//! a named error. Damaged files are refused too, and no count in them is trusted.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use stickslip::Vec3;
use stickslip::mesh_file::{FileMesh, Layers, MeshFile, MeshProblem};
use stickslip::verify::residual::{larger, largest};

/// Memory limit, bytes; far more than any file here takes.
const BUDGET: u64 = 1 << 26;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/meshes")
}

/// Returns the files in every format whose names begin so.
fn formats(start: &str) -> Vec<PathBuf> {
    let files = fs::read_dir(folder().join("formats")).expect("a folder");
    let mut paths: Vec<PathBuf> = files.map(|file| file.expect("a file").path()).collect();
    paths.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(start)));
    paths.sort();
    paths
}

fn read(path: &Path) -> MeshFile {
    MeshFile::read(path, BUDGET).unwrap_or_else(|error| panic!("{error}"))
}

fn distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    largest(a.iter().zip(b).flat_map(|(a, b)| (a - b).iter().map(|d| d.abs()).collect::<Vec<_>>()))
}

/// Returns a triangle from its lowest node on: equal for all of its starting corners, but not if it is inverted.
fn rotated(triangle: [u32; 3]) -> [u32; 3] {
    let lowest = (0..3).min_by_key(|&i| triangle[i]).unwrap_or(0);
    [0, 1, 2].map(|i| triangle[(lowest + i) % 3])
}

fn enclosed(mesh: &FileMesh) -> f64 {
    let corner = |node: u32| mesh.mesh.nodes[node as usize];
    mesh.mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
}

/// Files by Gmsh, VTK and meshio: MSH 2.2 and 4.1, legacy VTK 4.2 and 5.1, XML; text, bytes in either order, base64,
/// appended, raw, compressed. Text has ten digits from VTK, sixteen from Gmsh.
#[test]
fn every_format_gives_the_same_mesh() {
    let paths = formats("solid");
    assert!(paths.len() >= 20, "{} files", paths.len());
    let expected = read(&folder().join("formats/solid-2.2-bytes.msh")).solid(0.001).expect("a body");
    let mut worst = 0.0_f64;
    for path in paths {
        let mesh = read(&path).solid(0.001).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(mesh.mesh.tetrahedra, expected.mesh.tetrahedra, "{}", path.display());
        assert_eq!(mesh.mesh.edges, expected.mesh.edges, "{}", path.display());
        assert_eq!(mesh.mesh.triangles, expected.mesh.triangles, "{}", path.display());
        let off = distance(&mesh.mesh.nodes, &expected.mesh.nodes);
        let is_rounded = path.to_string_lossy().contains("text");
        if is_rounded {
            worst = larger(worst, off);
        } else {
            assert!(off == 0.0, "{}: {off:e} m", path.display());
        }
        assert!(off <= 1e-11, "{}: {off:e} m", path.display());
    }
    println!("RESIDUAL | text of ten digits | nodes of a body of 54 mm, m | 1e-11 | {worst:.1e}");
}

#[test]
fn every_format_gives_the_same_surface() {
    let solid = read(&folder().join("formats/solid-4.1-bytes.msh")).solid(0.001).expect("a body");
    let outside: HashSet<_> = (solid.mesh.triangles.iter())
        .map(|triangle| {
            rotated(*triangle).map(|node| solid.mesh.nodes[node as usize].map(|x| (x * 1e9).round() as i64))
        })
        .collect();
    let paths = formats("surface");
    assert!(paths.len() >= 6, "{} files", paths.len());
    for path in paths {
        let file = read(&path);
        assert!(file.is_surface());
        let shell = file.shell(0.001, Layers { count: 1, depth: 0.001 }).unwrap_or_else(|error| panic!("{error}"));
        let volume = enclosed(&shell);
        assert!((volume - 24e-6).abs() <= 1e-15, "{}: {volume:e} m³", path.display());
        let vertex = |node: u32| shell.mesh.nodes[node as usize].map(|x| (x * 1e9).round() as i64);
        // The nodes' numbering differs, so a triangle's first corner may: all three rotations are compared.
        for &[a, b, c] in &shell.mesh.triangles {
            let turns = [[a, b, c], [b, c, a], [c, a, b]].map(|turn| turn.map(vertex));
            assert!(turns.iter().any(|turn| outside.contains(turn)), "{}: {turns:?}", path.display());
        }
        assert_eq!(shell.mesh.triangles.len(), outside.len(), "{}", path.display());
    }
}

/// A body agrees with its elements: volumes add up, edges are the tetrahedra's, and faces between two are inside.
#[test]
fn a_solid_is_a_body() {
    for name in ["ellipsoid-500.msh", "liver-500.msh", "ellipsoid-5000.vtu", "liver-5000.vtu"] {
        let solid = read(&folder().join(name)).solid(1.0).unwrap_or_else(|error| panic!("{error}"));
        let mesh = &solid.mesh;
        let mut faces: HashMap<[u32; 3], usize> = HashMap::new();
        let mut edges = HashSet::new();
        let mut sum = 0.0;
        for &[a, b, c, d] in &mesh.tetrahedra {
            let [p, q, r, s] = [a, b, c, d].map(|node| mesh.nodes[node as usize]);
            let volume = (q - p).cross(&(r - p)).dot(&(s - p)) / 6.0;
            assert!(volume > 0.0);
            sum += volume;
            for mut face in [[a, b, c], [a, b, d], [a, c, d], [b, c, d]] {
                face.sort_unstable();
                *faces.entry(face).or_default() += 1;
            }
            for [i, j] in [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]] {
                edges.insert([i.min(j), i.max(j)]);
            }
        }
        let mut expected: Vec<_> = edges.into_iter().collect();
        expected.sort_unstable();
        assert_eq!(mesh.edges, expected, "{name}");
        let mut outside: Vec<_> = faces.into_iter().filter(|&(_, count)| count == 1).map(|(face, _)| face).collect();
        let mut surface = mesh.triangles.clone();
        surface.iter_mut().for_each(|triangle| triangle.sort_unstable());
        outside.sort_unstable();
        surface.sort_unstable();
        assert_eq!(surface, outside, "{name}");
        let (inside, shares) = (enclosed(&solid), solid.node_volumes.iter().sum::<f64>());
        let off = larger(((inside - sum) / sum).abs(), ((shares - sum) / sum).abs());
        println!("RESIDUAL | {name} | volume by surface, tetrahedra and nodes, relative | 5e-14 | {off:.1e}");
        // Sums over some thousand elements. Measured: 5e-15.
        assert!(off <= 5e-14, "{name}: {off:e}");
    }
}

/// Builds an MSH 2.2 text with given numbers of nodes.
fn msh(nodes: &[(u64, [f64; 3])], elements: &[(u32, &[u64])]) -> String {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", nodes.len());
    for (number, [x, y, z]) in nodes {
        text += &format!("{number} {x} {y} {z}\n");
    }
    text += &format!("$EndNodes\n$Elements\n{}\n", elements.len());
    for (i, (kind, nodes)) in elements.iter().enumerate() {
        let nodes: Vec<String> = nodes.iter().map(ToString::to_string).collect();
        text += &format!("{} {kind} 2 0 1 {}\n", i + 1, nodes.join(" "));
    }
    text + "$EndElements\n"
}

const CORNERS: [(u64, [f64; 3]); 5] =
    [(1, [0.0, 0.0, 0.0]), (2, [1.0, 0.0, 0.0]), (3, [0.0, 1.0, 0.0]), (4, [0.0, 0.0, 1.0]), (5, [1.0, 1.0, 1.0])];
const TETRAHEDRON: (u32, &[u64]) = (4, &[1, 2, 3, 4]);
/// Tetrahedron on the other side of the first one's slanting face.
const SECOND: (u32, &[u64]) = (4, &[2, 3, 4, 5]);
/// Outward faces of the first tetrahedron.
const FACES: [(u32, &[u64]); 4] = [(2, &[1, 3, 2]), (2, &[1, 2, 4]), (2, &[1, 4, 3]), (2, &[2, 3, 4])];

fn made(text: &str) -> Result<FileMesh, MeshProblemText> {
    made_of(text.as_bytes(), "x.msh", 1.0, Layers { count: 1, depth: 0.01 })
}

/// Returns the words of an error, and its advice.
type MeshProblemText = (String, String);

fn made_of(bytes: &[u8], name: &str, scale: f64, layers: Layers) -> Result<FileMesh, MeshProblemText> {
    let file = MeshFile::parse(bytes, Path::new(name), BUDGET);
    let made = file.and_then(|file| if file.is_surface() { file.shell(scale, layers) } else { file.solid(scale) });
    made.map_err(|error| (error.to_string(), error.problem().advice().to_owned()))
}

fn moved(number: u64, position: [f64; 3]) -> [(u64, [f64; 3]); 5] {
    CORNERS.map(|(n, x)| if n == number { (n, position) } else { (n, x) })
}

/// Cases: defect, file, and words of the message.
#[test]
fn what_is_no_body_is_refused_by_name() {
    let good = msh(&CORNERS, &[TETRAHEDRON, SECOND]);
    assert!(made(&good).is_ok());
    let apart: Vec<(u64, [f64; 3])> =
        (CORNERS.into_iter()).chain(CORNERS.map(|(n, [x, y, z])| (n + 5, [x + 9.0, y, z]))).collect();
    let cases: &[(&str, String, &str)] = &[
        ("no elements", msh(&CORNERS, &[]), "neither tetrahedra nor triangles"),
        ("only lines", msh(&CORNERS, &[(1, &[1, 2])]), "neither tetrahedra nor triangles"),
        ("no nodes", msh(&[], &[TETRAHEDRON]), "has no nodes"),
        ("unknown node", msh(&CORNERS, &[TETRAHEDRON, (4, &[1, 2, 3, 99])]), "element 1 names node 99"),
        ("one number twice", msh(&[CORNERS[0], CORNERS[0]], &[TETRAHEDRON]), "two nodes have the number 1"),
        ("not a number", good.replacen("1 0 0\n", "1 nan 0\n", 1), "node 1 lies at"),
        ("infinite", good.replacen("1 0 0\n", "1 inf 0\n", 1), "which is not finite"),
        (
            "two at one place",
            msh(&moved(5, [0.0, 1.0, 1e-10]), &[TETRAHEDRON, SECOND]),
            "nodes 2 and 4 lie at the same",
        ),
        (
            "a flat one",
            msh(&moved(5, [0.2, 0.3, 0.5]), &[TETRAHEDRON, SECOND]),
            "tetrahedron 1 with nodes [1, 2, 3, 4]",
        ),
        ("a node twice", msh(&CORNERS, &[TETRAHEDRON, (4, &[1, 2, 2, 5])]), "is flat"),
        (
            "two on one side",
            msh(&CORNERS, &[TETRAHEDRON, (4, &[1, 2, 3, 5])]),
            "tetrahedra 0 and 1 lie on the same side",
        ),
        ("two pieces", msh(&apart, &[TETRAHEDRON, SECOND, (4, &[6, 7, 8, 9])]), "is 2 separate pieces, of 5, 4 nodes"),
        (
            "an unknown type",
            msh(&CORNERS, &[TETRAHEDRON, (99, &[1, 2, 3, 4])]),
            "element 1 is a cell of Gmsh's type 99",
        ),
        ("an open surface", msh(&CORNERS, &FACES[..3]), "the surface is open"),
        ("a flat triangle", msh(&CORNERS, &[FACES[0], (2, &[1, 2, 2])]), "triangle 1 with nodes [0, 1, 1] is flat"),
        ("no inside", msh(&CORNERS, &[FACES[0], (2, &[1, 2, 3])]), "encloses no volume"),
        ("another version", good.replacen("2.2 0 8", "3.0 0 8", 1), "is in MSH 3.0"),
        (
            "a word for a number",
            good.replacen("\n1 4 2", "\n1 four 2", 1),
            ":14: expected the type of an element, found \"four\"",
        ),
        ("no MSH", "solid".to_owned(), "expected $MeshFormat"),
        ("nothing", String::new(), "expected $MeshFormat"),
        ("only a header", good.lines().take(3).map(|line| format!("{line}\n")).collect(), "has no nodes"),
    ];
    let mut wrong = Vec::new();
    for (what, text, words) in cases {
        match made(text) {
            Ok(_) => wrong.push(format!("{what}: it is taken")),
            Err((message, advice))
                if !message.contains(words) || advice.is_empty() || !message.starts_with("x.msh") =>
            {
                wrong.push(format!("{what}: {words:?} is not in {message:?}, {advice:?}"));
            }
            Err(_) => {}
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    for name in ["x.step", "x", "x.msh.gz"] {
        let (message, advice) = made_of(good.as_bytes(), name, 1.0, Layers { count: 1, depth: 0.01 }).unwrap_err();
        assert!(message.contains("not a mesh file by its extension") && advice.contains(".vtu"), "{message}");
    }
    // VTK counts nodes: a missing one is found when the cells are read.
    let vtk = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n\
               POINTS 4 double\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 1 5\n4 0 1 2 9\nCELL_TYPES 1\n10\n";
    let error = MeshFile::parse(vtk.as_bytes(), Path::new("x.vtk"), BUDGET).expect_err("there is no node 9");
    assert!(matches!(error.problem(), MeshProblem::UnknownNode { element: 0, node: 9 }), "{error}");
    let far = made_of(good.as_bytes(), "x.msh", 1e300, Layers { count: 1, depth: 0.01 });
    assert!(far.is_err(), "coordinates that overflow");
}

/// Two tetrahedra that touch at an edge, or at a node only.
#[test]
fn bodies_that_hang_by_a_thread_are_refused() {
    let far = |n: u64, [x, y, z]: [f64; 3]| (n, [x, y, z]);
    let nodes: Vec<_> = (CORNERS.into_iter().take(4))
        .chain([far(5, [-1.0, 0.0, 0.0]), far(6, [0.0, -1.0, 0.0]), far(7, [0.0, 0.0, -1.0])])
        .collect();
    let at_node: (u32, &[u64]) = (4, &[1, 6, 5, 7]);
    let at_edge: (u32, &[u64]) = (4, &[1, 4, 5, 6]);
    let place = "node 0 at [0.0, 0.0, 0.0] m";
    for (second, words) in [
        (at_node, format!("touch only at {place}")),
        (at_edge, format!("4 faces of the surface meet at the edge from {place} to node 3 at [0.0, 0.0, 1.0] m")),
    ] {
        let text = msh(&nodes, &[TETRAHEDRON, second]);
        // The second one may be oriented either way.
        let turned = msh(&nodes, &[TETRAHEDRON, (4, &[second.1[0], second.1[2], second.1[1], second.1[3]])]);
        for text in [text, turned] {
            let (message, advice) = made(&text).unwrap_err();
            assert!(message.contains(&words) && advice.contains("mesh.repair"), "{message}, {advice}");
        }
    }
}

/// Inverted tetrahedra are reoriented; node numbers are names, whatever their order; unused nodes are omitted, and
/// triangles beside tetrahedra do not matter.
#[test]
fn what_differs_in_writing_only_is_the_same_mesh() {
    let expected = made(&msh(&CORNERS, &[TETRAHEDRON, SECOND])).expect("a body");
    assert_eq!((expected.mesh.nodes.len(), expected.changes.unused_nodes), (5, 0));
    let inverted = made(&msh(&CORNERS, &[(4, &[1, 2, 4, 3]), (4, &[2, 3, 5, 4])])).expect("a body");
    assert_eq!(inverted.mesh, expected.mesh);
    let numbers = [70, 3, 12, 5, 4];
    let renumbered: Vec<_> = CORNERS.iter().zip(numbers).map(|((_, x), number)| (number, *x)).collect();
    let elements: [(u32, &[u64]); 2] = [(4, &[70, 3, 12, 5]), (4, &[3, 12, 5, 4])];
    assert_eq!(made(&msh(&renumbered, &elements)).expect("a body").mesh, expected.mesh);
    let mut with_unused = CORNERS.to_vec();
    with_unused.insert(2, (9, [7.0, 7.0, 7.0]));
    let with_unused = made(&msh(&with_unused, &[(15, &[9]), FACES[0], TETRAHEDRON, SECOND])).expect("a body");
    assert_eq!((&with_unused.mesh, with_unused.changes.unused_nodes), (&expected.mesh, 1));
    let outside = made(&msh(&CORNERS, &FACES)).expect("a surface");
    let turned = FACES.map(|(kind, nodes)| (kind, [nodes[0], nodes[2], nodes[1]]));
    let turned: Vec<(u32, &[u64])> = turned.iter().map(|(kind, nodes)| (*kind, nodes.as_slice())).collect();
    assert_eq!(made(&msh(&CORNERS, &turned)).expect("a surface").mesh, outside.mesh, "layers lie inside");
    let windows = msh(&CORNERS, &[TETRAHEDRON, SECOND]).replace('\n', "\r\n");
    assert_eq!(made(&windows).expect("a body").mesh, expected.mesh);
}

/// MSH in bytes of either order: Gmsh writes its machine's. In 4.1 the first three nodes belong to surface 7 and
/// have parameters, as Gmsh writes them on request.
fn msh_in_bytes(version: &str, is_big: bool) -> Vec<u8> {
    let int = |value: i32| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
    let ints = |values: &[i32]| values.iter().flat_map(|&value| int(value)).collect::<Vec<u8>>();
    let size = |value: u64| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
    let sizes = |values: &[u64]| values.iter().flat_map(|&value| size(value)).collect::<Vec<u8>>();
    let reals = |values: &[f64]| values.iter().flat_map(|value| size(value.to_bits())).collect::<Vec<u8>>();
    let begin = [format!("$MeshFormat\n{version} 1 8\n").into_bytes(), ints(&[1]), b"\n$EndMeshFormat\n".to_vec()];
    let mut bytes = begin.concat();
    let elements = [TETRAHEDRON, SECOND];
    if version == "2.2" {
        bytes.extend(b"$Nodes\n5\n");
        CORNERS.iter().for_each(|(number, x)| bytes.extend([ints(&[*number as i32]), reals(x)].concat()));
        bytes.extend(b"\n$EndNodes\n$Elements\n2\n");
        bytes.extend(ints(&[4, 2, 2]));
        for (number, (_, nodes)) in (1..).zip(elements) {
            bytes.extend(ints(&[number, 0, 1]));
            nodes.iter().for_each(|&node| bytes.extend(int(node as i32)));
        }
    } else {
        bytes.extend([b"$Nodes\n".to_vec(), sizes(&[2, 5, 1, 5]), ints(&[2, 7, 1]), sizes(&[3, 1, 2, 3])].concat());
        CORNERS[..3].iter().for_each(|(_, x)| bytes.extend([reals(x), reals(&[0.25, 0.5])].concat()));
        bytes.extend([ints(&[3, 1, 0]), sizes(&[2, 4, 5])].concat());
        CORNERS[3..].iter().for_each(|(_, x)| bytes.extend(reals(x)));
        bytes.extend(
            [b"\n$EndNodes\n$Elements\n".to_vec(), sizes(&[1, 2, 1, 2]), ints(&[3, 1, 4]), sizes(&[2])].concat(),
        );
        for (number, (_, nodes)) in (1..).zip(elements) {
            bytes.extend([sizes(&[number]), sizes(nodes)].concat());
        }
    }
    bytes.extend(b"\n$EndElements\n");
    bytes
}

#[test]
fn bytes_are_read_in_either_order() {
    let expected = made(&msh(&CORNERS, &[TETRAHEDRON, SECOND])).expect("a body");
    for version in ["2.2", "4.1"] {
        for is_big in [false, true] {
            let bytes = msh_in_bytes(version, is_big);
            let made = made_of(&bytes, "x.msh", 1.0, Layers { count: 1, depth: 0.01 });
            let made = made.unwrap_or_else(|error| panic!("MSH {version}, highest first: {is_big}: {error:?}"));
            assert_eq!(made.mesh, expected.mesh, "MSH {version}, highest first: {is_big}");
        }
    }
}

/// An icosahedron whose triangles are divided into four, with its corners on a sphere of 50 mm. Every corner lies on
/// an axis of symmetry, so normals at corners are radial.
fn ball() -> MeshFile {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut corners: Vec<Vec3> = Vec::new();
    for (one, other) in [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)] {
        corners.extend([Vec3::new(0.0, one, other), Vec3::new(one, other, 0.0), Vec3::new(other, 0.0, one)]);
    }
    let mut triangles: Vec<[u64; 3]> = Vec::new();
    for a in 0..12 {
        for b in 0..12 {
            for c in 0..12 {
                let [p, q, r] = [a, b, c].map(|i| corners[i]);
                let is_face = [(p - q), (q - r), (r - p)].iter().all(|edge| (edge.norm() - 2.0).abs() < 1e-9);
                // Each triangle occurs once, from its lowest corner on, outwards.
                if is_face && a < b && a < c && p.dot(&q.cross(&r)) > 0.0 {
                    let middle = |corners: &mut Vec<Vec3>, i: usize, j: usize| {
                        let middle = (corners[i] + corners[j]) / 2.0;
                        corners.iter().position(|x| (x - middle).norm() < 1e-9).unwrap_or_else(|| {
                            corners.push(middle);
                            corners.len() - 1
                        })
                    };
                    let [d, e, f] = [(a, b), (b, c), (c, a)].map(|(i, j)| middle(&mut corners, i, j));
                    let four = [[a, d, f], [d, b, e], [f, e, c], [d, e, f]];
                    triangles.extend(four.map(|triangle| triangle.map(|node| node as u64 + 1)));
                }
            }
        }
    }
    let nodes: Vec<_> = (1..).zip(corners.iter().map(|x| (x.normalize() * 0.05).into())).collect();
    let elements: Vec<(u32, &[u64])> = triangles.iter().map(|triangle| (2, triangle.as_slice())).collect();
    MeshFile::parse(msh(&nodes, &elements).as_bytes(), Path::new("ball.msh"), BUDGET).expect("a surface")
}

/// Layers of a ball are smaller balls, each at the given depth below the last, and fold over only at the centre.
#[test]
fn layers_of_a_ball_are_balls() {
    let (radius, layers) = (0.05, Layers { count: 3, depth: 0.01 });
    let sizes = layers.sizes(ball().cells());
    let shell = ball().shell(1.0, layers).expect("a shell");
    let count = shell.mesh.nodes.len() / 4;
    assert_eq!((count, shell.mesh.triangles.len()), (42, 80));
    assert_eq!(sizes, (shell.mesh.nodes.len() as u128, shell.mesh.edges.len() as u128));
    assert_eq!(shell.innermost, 3 * count..4 * count);
    assert!(shell.mesh.tetrahedra.is_empty() && shell.mesh.triangles.as_flattened().iter().all(|&i| i < count as u32));
    assert_eq!(shell.mesh.edges.len(), 4 * 120 + 3 * (count + 2 * 120));
    let mut worst = 0.0_f64;
    for (node, x) in shell.mesh.nodes.iter().enumerate() {
        worst = larger(worst, (x.norm() - (radius - 0.01 * (node / count) as f64)).abs());
    }
    println!("RESIDUAL | layers of a ball of 50 mm | radius, m | 1e-15 | {worst:.1e}");
    assert!(worst <= 1e-15, "{worst:e} m");
    // The innermost layer's share of the outermost one. The depth is given at the corners; between them the wall is up
    // to a tenth thinner.
    let wall = enclosed(&shell) * (1.0 - 0.4_f64.powi(3));
    let off = (shell.node_volumes.iter().sum::<f64>() - wall).abs() / wall;
    println!("RESIDUAL | layers of a ball of 50 mm | volume of the wall, relative | 0.1 | {off:.1e}");
    assert!(off <= 0.1, "{off:e}");

    assert!(ball().shell(1.0, Layers { count: 1, depth: 0.0499 }).is_ok());
    for depth in [0.0501, 0.2, 1e300] {
        let error = ball().shell(1.0, Layers { count: 1, depth }).expect_err("through the centre");
        let folds = matches!(error.problem(), MeshProblem::Folds { depth_m, .. } if *depth_m == depth);
        assert!(folds && error.problem().advice().contains("layer_depth"), "{error}");
    }
}

/// A damaged file never causes a panic. (A trusted count would abort, and an endless loop would hang the test.)
fn survive(bytes: &[u8], name: &str) -> bool {
    made_of(bytes, name, 0.001, Layers { count: 1, depth: 0.001 }).is_ok()
}

#[test]
fn cut_files_are_refused() {
    for path in formats("") {
        let bytes = fs::read(&path).expect("a file");
        let name = path.file_name().expect("a name").to_string_lossy();
        assert!(survive(&bytes, &name), "{name}");
        let step = (bytes.len() / 61).max(1);
        for length in (0..bytes.len()).step_by(step) {
            // The parts after the elements may be missing: VTK's tables of data, Gmsh's names.
            let is_taken = survive(&bytes[..length], &name);
            assert!(!is_taken || length > bytes.len() / 2, "{name}: {length} of {} bytes are enough", bytes.len());
        }
    }
}

#[test]
fn flipped_bits_never_panic() {
    let mut rng = ChaCha8Rng::seed_from_u64(20);
    let (mut refused, mut taken) = (0, 0);
    for path in formats("") {
        let bytes = fs::read(&path).expect("a file");
        let name = path.file_name().expect("a name").to_string_lossy();
        for _ in 0..150 {
            let mut bytes = bytes.clone();
            for _ in 0..1 + rng.next_u32() % 4 {
                // Headers are short: half of the flips go there.
                let range = if rng.next_u32() % 2 == 0 { bytes.len().min(400) } else { bytes.len() };
                let at = rng.next_u64() as usize % range;
                bytes[at] ^= 1 << (rng.next_u32() % 8);
            }
            if survive(&bytes, &name) { taken += 1 } else { refused += 1 }
        }
    }
    println!("RESIDUAL | flipped bits | files refused, taken (low bits of coordinates) | - | {refused}, {taken}");
    assert!(refused > taken, "{refused} refused, {taken} taken");
}

/// Counts that no file can hold, and structures without an end.
#[test]
fn announced_counts_are_not_believed() {
    const MANY: u64 = i64::MAX as u64;
    let msh4 = |blocks: u64, nodes: u64| {
        format!("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n{blocks} {nodes} 1 {nodes}\n3 1 0 {nodes}\n1\n0 0 0\n")
    };
    let bytes4 = [
        b"$MeshFormat\n4.1 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Nodes\n".as_slice(),
        &[1_u64, MANY, 1, MANY].map(u64::to_le_bytes).concat(),
        &[3_i32, 1, 0].map(i32::to_le_bytes).concat(),
        &MANY.to_le_bytes(),
        &[1; 64],
    ]
    .concat();
    let vtk = |kind: &str| {
        format!("# vtk DataFile Version 3.0\nx\n{kind}\nDATASET UNSTRUCTURED_GRID\nPOINTS {MANY} double\n1 2 3")
    };
    let vtu = |array: &str| {
        format!(
            "<VTKFile type='UnstructuredGrid' compressor='vtkZLibDataCompressor' header_type='UInt64'><UnstructuredGrid>\
             <Piece NumberOfPoints='{MANY}' NumberOfCells='1'><Points><DataArray type='Float64' \
             NumberOfComponents='3' {array}</DataArray></Points></Piece></UnstructuredGrid></VTKFile>"
        )
    };
    let nested = "<VTKFile type='UnstructuredGrid'>".to_owned() + &"<Piece>".repeat(200_000);
    let field = format!(
        "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD f {MANY}\na {MANY} {MANY} double\n"
    );
    let files: &[(&str, Vec<u8>)] = &[
        ("x.msh", msh(&CORNERS, &[TETRAHEDRON]).replacen("$Nodes\n5", &format!("$Nodes\n{MANY}"), 1).into()),
        ("x.msh", msh4(1, MANY).into()),
        ("x.msh", msh4(MANY, 1).into()),
        ("x.msh", bytes4),
        ("x.vtk", vtk("ASCII").into()),
        ("x.vtk", vtk("BINARY").into()),
        ("x.vtk", field.into()),
        // The cases are 2⁶³ − 1 blocks, and a block that claims to inflate to that size.
        ("x.vtu", vtu("format='binary'>/////////38AAAAAAAAAAAAAAAAAAAAA").into()),
        ("x.vtu", vtu("format='ascii'>1 2 3").into()),
        ("x.vtu", vtu("format='appended' offset='9223372036854775807'>").into()),
        ("x.vtu", nested.into()),
    ];
    for (name, bytes) in files {
        let refused = made_of(bytes, name, 1.0, Layers { count: 1, depth: 0.01 });
        let (message, _) = refused.expect_err("a file that is refused");
        println!("{}", message.chars().take(120).collect::<String>());
    }
}

/// A small file may inflate to a large size: it is refused before it does, by the budget.
#[test]
fn memory_is_asked_for_before_it_is_used() {
    let path = folder().join("liver-5000.vtu");
    let size = fs::metadata(&path).expect("a file").len();
    let error = MeshFile::read(&path, 4 * size).expect_err("too large");
    assert!(matches!(error.problem(), MeshProblem::TooLarge { .. }), "{error}");
    // The budget also applies where nothing is inflated, and the file alone would fit.
    let plain = folder().join("liver-500.msh");
    let error = MeshFile::read(&plain, 31 * fs::metadata(&plain).expect("a file").len()).expect_err("too large");
    assert!(matches!(error.problem(), MeshProblem::TooLarge { .. }), "{error}");
    // Inflated, the nodes alone of a file that compresses well exceed the memory that its own size allows for.
    let bytes = fs::read(&path).expect("a file");
    let error = MeshFile::parse(&bytes, &path, 32 * 100_000).expect_err("too large once inflated");
    assert!(matches!(error.problem(), MeshProblem::TooLarge { .. }), "{error}");
    assert!(MeshFile::read(&path, BUDGET).is_ok());
}
