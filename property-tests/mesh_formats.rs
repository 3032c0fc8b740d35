//! Mesh files as programs write them: any way gives the same body, repairs are counted, and refusals name their line.

use std::fs;
use std::path::Path;

use stickslip::Vec3;
use stickslip::mesh_file::{Changes, FileMesh, Layers, MeshFile, MeshProblem};
use stickslip::verify::residual::larger;

/// Memory limit, bytes.
const BUDGET: u64 = 1 << 26;

pub fn made(bytes: impl AsRef<[u8]>, name: &str, is_repaired: bool) -> Result<FileMesh, (String, &'static str)> {
    let file = MeshFile::parse(bytes.as_ref(), Path::new(name), BUDGET);
    let made = file.and_then(|file| {
        let file = file.repaired(is_repaired);
        if file.is_surface() { file.shell(1.0, Layers { count: 1, depth: 1e-3 }) } else { file.solid(1.0) }
    });
    made.map_err(|error| (error.to_string(), error.problem().advice()))
}

fn body(bytes: impl AsRef<[u8]>, name: &str) -> FileMesh {
    made(bytes, name, false).unwrap_or_else(|error| panic!("{error:?}"))
}

/// Volume that the surface encloses.
fn enclosed(mesh: &FileMesh) -> f64 {
    let corner = |node: u32| mesh.mesh.nodes[node as usize];
    mesh.mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
}

/// Legacy VTK of two tetrahedra.
pub const LEGACY: &str = "# vtk DataFile Version 3.0\ntwo\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n";

/// VTK 9.7 was tried with each of these files, and reads them all.
#[test]
fn legacy_files_are_read_as_vtk_reads_them() {
    let expected = body(LEGACY, "x.vtk").mesh;
    let before_points = |field: &str| LEGACY.replacen("POINTS", &format!("{field}\nPOINTS"), 1);
    let (head, data) = LEGACY.split_once("POINTS").expect("points");
    let cases = [
        ("lower case", LEGACY.to_lowercase().replacen("# vtk datafile version", "# vtk DataFile Version", 1)),
        ("one line", format!("{head}POINTS{}", data.replace('\n', " "))),
        ("data on the keyword's line", LEGACY.replacen("double\n", "double ", 1).replacen("2 10\n", "2 10 ", 1)),
        (
            "blank lines",
            LEGACY.replacen("two\n", "\n\n", 1).replace("DATASET", "\nDATASET\n").replace("CELLS", "\n\nCELLS"),
        ),
        ("no version", LEGACY.replacen(" 3.0", "", 1)),
        ("numbers in a field", before_points("FIELD F 2\ntime 1 1 double\n0.5\norigin 3 1 int\n1 2 3")),
        ("strings in a field", before_points("FIELD F 1\nname 1 3 string\nhealthy liver\n\nleft lobe")),
        ("bits and a missing array", before_points("FIELD F 2\nNULL_ARRAY\nmask 1 3 bit\n1 0 1")),
        ("METADATA in a field", before_points("FIELD F 2\na 1 1 int\n3\nMETADATA\nINFORMATION 0\n\nb 1 1 int\n4")),
        ("METADATA", before_points("METADATA\nCOMPONENT_NAMES\nx\n\n")),
        ("data behind the cells", LEGACY.to_owned() + "CELL_DATA 2\nSCALARS a int 1\nLOOKUP_TABLE default\n1\n2\n"),
    ];
    for (what, text) in cases {
        assert_eq!(made(&text, "x.vtk", false).map(|made| made.mesh), Ok(expected.clone()), "{what}:\n{text}");
    }
    // Strings in binary have their length before them, in one to eight bytes.
    let reals: Vec<u8> =
        expected.nodes.iter().flat_map(|x| x.iter().flat_map(|x| x.to_be_bytes()).collect::<Vec<_>>()).collect();
    let ints = |values: &[i32]| values.iter().flat_map(|value| value.to_be_bytes()).collect::<Vec<u8>>();
    let bytes = [
        b"# vtk DataFile Version 4.2\n\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD F 2\nname 1 2 string\n".as_slice(),
        b"\xc5liver\x80\x05heart\nmask 1 9 bit\n\xff\x80\nPOINTS 5 double\n",
        &reals,
        b"\nCELLS 2 10\n",
        &ints(&[4, 0, 1, 2, 3, 4, 1, 2, 3, 4]),
        b"\nCELL_TYPES 2\n",
        &ints(&[10, 10]),
    ];
    assert_eq!(body(bytes.concat(), "x.vtk").mesh, expected);
}

/// A `.vtu` file of two tetrahedra, with other texts in its places.
pub fn vtu(before: &str, attributes: &str, piece: &str, points: &str, behind: &str) -> String {
    format!(
        "{before}<VTKFile type=\"UnstructuredGrid\" {attributes}>\n<UnstructuredGrid>\n<Piece {piece}>\n<Points>\n\
         <DataArray type=\"Float64\" {points} format=\"ascii\">\n0 0 0 1 0 0 0 1 0\n0 0 1 1 1 1\n</DataArray>\n</Points>\n\
         <Cells>\n<DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 3 1 2 3 4</DataArray>\n\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4 8</DataArray>\n\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10 10</DataArray>\n</Cells>\n</Piece>\n{behind}\
         </UnstructuredGrid>\n</VTKFile>\n"
    )
}

pub const PIECE: &str = "NumberOfPoints=\"5\" NumberOfCells=\"2\"";
pub const COMPONENTS: &str = "NumberOfComponents=\"3\"";

#[test]
fn xml_files_are_read_as_vtk_reads_them() {
    let expected = body(LEGACY, "x.vtk").mesh;
    let empty = "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"></Piece>\n";
    let cases = [
        ("plain", vtu("<?xml version=\"1.0\"?>\n", "", PIECE, COMPONENTS, "")),
        ("no declaration", vtu("", "", PIECE, COMPONENTS, "")),
        ("DOCTYPE", vtu("<?xml version=\"1.0\"?>\n<!DOCTYPE VTKFile SYSTEM \"vtk.dtd\">\n", "", PIECE, COMPONENTS, "")),
        ("byte-order mark", vtu("\u{feff}<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n", "", PIECE, COMPONENTS, "")),
        ("no compressor", vtu("", "compressor=\"\"", PIECE, COMPONENTS, "")),
        ("an empty piece", vtu("", "", PIECE, COMPONENTS, empty)),
        ("spaces in numbers", vtu("", "", "NumberOfPoints=\"  5 \" NumberOfCells=\" 2\"", COMPONENTS, "")),
    ];
    for (what, text) in cases {
        assert_eq!(made(&text, "x.vtu", false).map(|made| made.mesh), Ok(expected.clone()), "{what}:\n{text}");
    }
    let mut latin =
        vtu("<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n<!-- rate -->", "", PIECE, COMPONENTS, "").into_bytes();
    let at = latin.windows(4).position(|window| window == b"rate").expect("a word");
    latin[at + 1] = 0xe2;
    assert_eq!(body(&latin, "x.vtu").mesh, expected, "Latin-1");

    // Appended data, at offsets padded with spaces: raw if it is declared so, else in base64.
    let reals: Vec<u8> =
        expected.nodes.iter().flat_map(|x| x.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()).collect();
    let longs = |values: &[i64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let arrays = [reals, longs(&[0, 1, 2, 3, 1, 2, 3, 4]), longs(&[4, 8]), vec![10, 10]];
    for encoding in ["raw", "base64", "Base64", ""] {
        let mut data: Vec<u8> = Vec::new();
        let mut offsets = Vec::new();
        for array in &arrays {
            offsets.push(format!("{:>12}", data.len()));
            let bytes = [&(array.len() as u32).to_le_bytes(), array.as_slice()].concat();
            data.extend(if encoding == "raw" { bytes } else { base64(&bytes).into_bytes() });
        }
        let array = |kind: &str, name: &str, at: usize| {
            format!("<DataArray type=\"{kind}\" Name=\"{name}\" format=\"appended\" offset=\"{}\"/>\n", offsets[at])
        };
        let head = format!(
            "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece {PIECE}><Points>{}</Points><Cells>{}{}{}</Cells></Piece>\
             </UnstructuredGrid>\n<AppendedData {}>\n  _",
            array("Float64", "Points", 0),
            array("Int64", "connectivity", 1),
            array("Int64", "offsets", 2),
            array("UInt8", "types", 3),
            if encoding.is_empty() { String::new() } else { format!("encoding=\"{encoding}\"") },
        );
        let bytes = [head.as_bytes(), &data, b"\n</AppendedData>\n</VTKFile>\n"].concat();
        assert_eq!(body(bytes, "x.vtu").mesh, expected, "{encoding:?}");
    }
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = (0..3).fold(0, |bits, i| bits << 8 | u32::from(group.get(i).copied().unwrap_or(0)));
        let letter = |i: usize| char::from(LETTERS[(bits >> (18 - 6 * i)) as usize & 63]);
        text.extend((0..4).map(|i| if i <= group.len() { letter(i) } else { '=' }));
    }
    text
}

/// Gmsh's versions and sections, as text.
#[test]
fn msh_of_every_version_is_read() {
    let expected = body(LEGACY, "x.vtk").mesh;
    let nodes = "5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n";
    let elements = "2\n1 4 2 1 1 1 2 3 4\n2 4 2 1 1 2 3 4 5\n";
    let v2 = |version: &str| {
        format!(
            "$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Nodes\n{nodes}$EndNodes\n$Elements\n{elements}$EndElements\n"
        )
    };
    let parametric = "5\n1 0 0 0 0 1\n2 1 0 0 1 4 0.5\n3 0 1 0 2 7 0.5 0.25\n4 0 0 1 3 1\n5 1 1 1 3 1\n";
    let cases = [
        ("2", v2("2")),
        ("2.0", v2("2.0")),
        ("2.1", v2("2.1")),
        ("comments first", format!("$Comments\nby hand\n$EndComments\n{}", v2("2.2"))),
        ("groups", v2("2.2").replacen("$Nodes", "$PhysicalNames\n1\n3 1 \"the $End\"\n$EndPhysicalNames\n$Nodes", 1)),
        (
            "parameters",
            v2("2.2").replace(nodes, parametric).replace("$Nodes", "$ParametricNodes").replace("$EndNodes", "$EndParametricNodes"),
        ),
        (
            "1",
            format!("$NOD\n{nodes}$ENDNOD\n$ELM\n2\n1 4 1 1 4 1 2 3 4\n2 4 1 1 4 2 3 4 5\n$ENDELM\n"),
        ),
        (
            "4.0",
            "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n2 5\n1 2 1 2\n1 0 0 0 0.5 0.5\n2 1 0 0 0.5 1\n1 3 0 3\n3 0 1 0\n4 0 0 1\n\
             5 1 1 1\n$EndNodes\n$Elements\n1 2\n1 3 4 2\n1 1 2 3 4\n2 2 3 4 5\n$EndElements\n"
                .to_owned(),
        ),
    ];
    for (what, text) in cases {
        assert_eq!(made(&text, "x.msh", false).map(|made| made.mesh), Ok(expected.clone()), "{what}:\n{text}");
    }
    // A tetrahedron in two groups, and one that is turned round.
    let twice = v2("2.2").replacen("2\n1 4 2", "3\n7 4 2 2 1 1 3 2 4\n1 4 2", 1);
    let twice = body(twice, "x.msh");
    assert_eq!((twice.mesh.tetrahedra.len(), twice.changes.repeated, twice.changes.turned), (2, 1, 1));
    assert_eq!(twice.mesh.triangles.len(), expected.triangles.len());
}

/// A grid of 3 × 3 × 3 cubes, each of which is one or more cells of VTK types, with nodes numbered without an order.
pub fn cubes(cells: impl Fn(usize) -> Vec<(u64, Vec<usize>)>) -> String {
    const N: usize = 4;
    // A permutation of the 64 nodes, since 37 and 64 have no common factor, and of 27 nodes at the centres behind them.
    let number = |node: usize| if node < N * N * N { (37 * node + 11) % (N * N * N) } else { node };
    let mut points = vec![[0.0; 3]; N * N * N + 27];
    for (node, point) in points.iter_mut().enumerate() {
        *point = if node < N * N * N {
            [node % N, node / N % N, node / N / N].map(|i| i as f64)
        } else {
            let cube = node - N * N * N;
            [cube % 3, cube / 3 % 3, cube / 9].map(|i| i as f64 + 0.5)
        };
    }
    let mut places = points.clone();
    (0..points.len()).for_each(|node| places[number(node)] = points[node]);
    let mut lists = Vec::new();
    for cube in 0..27 {
        let [x, y, z] = [cube % 3, cube / 3 % 3, cube / 9];
        let corner = |i: usize| {
            // VTK's order of a hexahedron's corners; the ninth is the centre.
            let [dx, dy, dz] =
                [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [9, 9, 9]][i];
            number(if i == 8 { N * N * N + cube } else { (x + dx) + N * ((y + dy) + N * (z + dz)) })
        };
        lists.extend(
            cells(cube).into_iter().map(|(kind, corners)| (kind, corners.into_iter().map(corner).collect::<Vec<_>>())),
        );
    }
    let size: usize = lists.iter().map(|(_, nodes)| nodes.len() + 1).sum();
    let mut text =
        format!("# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n", places.len());
    places.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    text += &format!("CELLS {} {size}\n", lists.len());
    for (_, nodes) in &lists {
        text += &format!("{} {}\n", nodes.len(), nodes.iter().map(usize::to_string).collect::<Vec<_>>().join(" "));
    }
    text += &format!("CELL_TYPES {}\n", lists.len());
    lists.iter().for_each(|(kind, _)| text += &format!("{kind}\n"));
    text
}

/// One cube as a hexahedron, a voxel, two wedges of either orientation, or six pyramids.
pub fn divided(way: usize) -> Vec<(u64, Vec<usize>)> {
    match way {
        0 => vec![(12, vec![0, 1, 2, 3, 4, 5, 6, 7])],
        1 => vec![(11, vec![0, 1, 3, 2, 4, 5, 7, 6])],
        2 => vec![(13, vec![0, 1, 2, 4, 5, 6]), (13, vec![0, 3, 2, 4, 7, 6])],
        _ => [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
            .iter()
            .map(|face| (14, face.iter().copied().chain([8]).collect()))
            .collect(),
    }
}

/// Faces match whatever the shapes of the neighbours are: the surface that remains is that of the whole cube. Wedges have a
/// diagonal of their own on two faces, so they are in a separate layer, between faces without one.
#[test]
fn cells_of_every_shape_become_matching_tetrahedra() {
    let mixtures: [(&str, &dyn Fn(usize) -> usize); 6] = [
        ("hexahedra", &|_| 0),
        ("voxels", &|_| 1),
        ("wedges", &|_| 2),
        ("pyramids", &|_| 3),
        ("hexahedra, voxels and pyramids", &|cube| [0, 1, 3][cube * 5 % 3]),
        ("hexahedra beside columns of wedges", &|cube| if cube % 9 == 4 { 2 } else { 3 * (cube % 2) }),
    ];
    for (what, way) in mixtures {
        let made = body(cubes(|cube| divided(way(cube))), "x.vtk");
        let mesh = &made.mesh;
        // There are two triangles on each of 54 squares, and the reader has checked that they are closed.
        assert_eq!(mesh.triangles.len(), 108, "{what}");
        let sum: f64 = mesh.tetrahedra.iter().map(|&t| mesh.tetrahedron_volume(t)).sum();
        let off = larger((enclosed(&made) - 27.0).abs(), (sum - 27.0).abs());
        println!("RESIDUAL | {what} | volume of 27 cells | 1e-12 | {off:.1e}");
        assert!(off <= 1e-12, "{what}: {off:e}");
        assert!(mesh.tetrahedra.iter().all(|&t| mesh.tetrahedron_volume(t) > 0.0), "{what}");
        assert_eq!(made.changes.turned, 0, "{what}");
        assert!(made.changes.cut >= 27, "{what}");
    }
}

/// Cells of second order are used by their corners, and the nodes between these are omitted.
#[test]
fn second_order_is_read_by_its_corners() {
    let expected = body(LEGACY, "x.vtk").mesh;
    let middles: String = (0..12).map(|i| format!("{} 0.5 0.25\n", f64::from(i) / 16.0)).collect();
    let text = LEGACY
        .replacen("POINTS 5", "POINTS 17", 1)
        .replacen("CELLS", &format!("{middles}CELLS"), 1)
        .replacen("2 10\n4 0 1 2 3\n4 1 2 3 4\n", "2 22\n10 0 1 2 3 5 6 7 8 9 10\n10 1 2 3 4 6 11 12 13 14 15\n", 1)
        .replacen("2\n10\n10\n", "2\n24\n24\n", 1);
    let made = body(text, "x.vtk");
    assert_eq!(made.mesh, expected);
    assert_eq!(made.changes, Changes { by_corners: 2, unused_nodes: 12, ..Changes::default() });
    let nodes: String = (1..=17).map(|i| format!("{i} {} 0.5 0.25\n", f64::from(i) / 16.0)).collect();
    let nodes: Vec<&str> = nodes.lines().skip(5).collect();
    let text = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n17\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n{}\n$EndNodes\n$Elements\n2\n\
         1 11 0 1 2 3 4 6 7 8 9 10 11\n2 11 0 2 3 4 5 7 12 13 14 15 16\n$EndElements\n",
        nodes.join("\n")
    );
    let made = body(text, "x.msh");
    assert_eq!((&made.mesh, made.changes.by_corners, made.changes.unused_nodes), (&expected, 2, 12));
}

/// Elements of the opposite orientation are turned one by one, in solids and in surfaces.
#[test]
fn mixed_orientation_is_mended() {
    let expected = body(LEGACY, "x.vtk");
    let mixed = body(LEGACY.replacen("4 1 2 3 4", "4 2 1 3 4", 1), "x.vtk");
    assert_eq!(mixed.changes.turned, 1);
    assert!((enclosed(&mixed) - enclosed(&expected)).abs() <= 1e-15);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/meshes/formats/closed.obj");
    let text = fs::read_to_string(path).expect("a file");
    let (volume, mut faces) = (enclosed(&body(&text, "x.obj")), 0);
    let turned: Vec<String> = (text.lines())
        .map(|line| match line.split(' ').collect::<Vec<_>>().as_slice() {
            ["f", a, b, c] => {
                faces += 1;
                // Three in ten.
                if faces % 10 < 3 { format!("f {b} {a} {c}") } else { line.to_owned() }
            }
            _ => line.to_owned(),
        })
        .collect();
    let mended = body(turned.join("\n"), "x.obj");
    assert_eq!(mended.changes.turned, (1..=faces).filter(|face| face % 10 < 3).count());
    assert!((enclosed(&mended) / volume - 1.0).abs() <= 1e-14);
}

/// Two layers of 2 × 2 voxels, joined by two voxels that touch at an edge; both ends of the edge lie within one part.
pub fn tunnel() -> String {
    let node = |x: usize, y: usize, z: usize| x + 3 * (y + 3 * z);
    let mut cells = Vec::new();
    for (x, y, z) in (0..12).map(|cube| (cube % 2, cube / 2 % 2, cube / 4)) {
        if z != 1 || x == y {
            let corners = (0..8).map(|i| node(x + i % 2, y + i / 2 % 2, z + i / 4).to_string());
            cells.push(format!("8 {}\n", corners.collect::<Vec<_>>().join(" ")));
        }
    }
    let points: String = (0..36).map(|i| format!("{} {} {}\n", i % 3, i / 3 % 3, i / 9)).collect();
    format!(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 36 double\n{points}CELLS {0} {1}\n{2}CELL_TYPES \
         {0}\n{3}",
        cells.len(),
        9 * cells.len(),
        cells.concat(),
        "11\n".repeat(cells.len())
    )
}

#[test]
fn parts_that_touch_are_named_and_separated_on_request() {
    let (message, advice) = made(tunnel(), "x.vtk", false).expect_err("two parts touch");
    assert!(
        message.contains("4 faces of the surface meet at the edge from node 13 at [1.0, 1.0, 1.0] m to node 22"),
        "{message}"
    );
    assert!(advice.contains("`mesh.repair = true`"), "{advice}");
    let separated = made(tunnel(), "x.vtk", true).expect("separated");
    // Each part has a node in the middle of the edge.
    assert_eq!(separated.changes.split, 2);
    assert!((enclosed(&separated) - 10.0).abs() <= 1e-13);
    let middles = separated.mesh.nodes.iter().filter(|x| (*x - Vec3::new(1.0, 1.0, 1.5)).norm() == 0.0).count();
    assert_eq!(middles, 2);

    // Two tetrahedra that share an edge and nothing else.
    let two = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 6 double\n0 0 0\n0 0 1\n1 0 0.5\n0.5 1 0.5\n\
                -1 0 0.5\n-0.5 -1 0.5\nCELLS 2 10\n4 0 1 2 3\n4 0 1 4 5\nCELL_TYPES 2\n10\n10\n";
    let (message, advice) = made(two, "x.vtk", true).expect_err("nothing else joins the two");
    assert!(message.contains("is 2 separate pieces, of 4, 4 nodes") && advice.contains("largest"), "{message}");
}

/// Two cubes that touch at one corner, as a surface: each gets a node of its own, and the two are separate pieces.
#[test]
fn surfaces_that_touch_at_a_node_are_separated() {
    let mut text = String::new();
    let mut faces = String::new();
    for cube in 0..2_usize {
        let number = |i: usize| if cube == 1 && i == 0 { 7 + 1 } else { 8 * cube + i + 1 };
        for i in 0..8 {
            let x = [i % 2, i / 2 % 2, i / 4].map(|x| (x + cube).to_string()).join(" ");
            text += &format!("v {x}\n");
        }
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]] {
            faces += &format!("f {}\n", face.map(|i| number(i).to_string()).join(" "));
        }
    }
    text += &faces;
    let (message, advice) = made(&text, "x.obj", false).expect_err("they touch");
    assert!(
        message.contains("touch only at node 7 at [1.0, 1.0, 1.0] m") && advice.contains("mesh.repair"),
        "{message}"
    );
    let (message, _) = made(&text, "x.obj", true).expect_err("two cubes");
    assert!(message.contains("is 2 separate pieces, of 8, 8 nodes"), "{message}");
}

/// STL, OBJ, PLY and `.vtp` files of one surface, written by VTK in 32 and 64 bits, give the same body.
#[test]
fn formats_of_surfaces_give_the_same_body() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/meshes/formats");
    let mut worst = 0.0_f64;
    let mut files = 0;
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("a file").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if !name.starts_with("closed") {
            continue;
        }
        files += 1;
        let made = body(fs::read(&path).expect("a file"), &name);
        assert_eq!((made.innermost.len(), made.mesh.triangles.len()), (60, 116), "{name}");
        worst = larger(worst, (enclosed(&made) / 24_000.0 - 1.0).abs());
    }
    assert!(files >= 7, "{files} files");
    // Coordinates of 32 bits are off by 6e-8 of their size.
    println!("RESIDUAL | surfaces by VTK | volume, relative | 1e-7 | {worst:.1e}");
    assert!(worst <= 1e-7, "{worst:e}");
}

/// A tetrahedron in each surface format, in all the ways in which it may be written.
#[test]
fn surfaces_are_read_however_they_are_written() {
    let facet = |[a, b, c]: [&str; 3]| {
        format!("facet normal 0 0 0\n outer loop\n  vertex {a}\n  vertex {b}\n  vertex {c}\n endloop\nendfacet\n")
    };
    let [o, x, y, z] = ["0 0 0", "1.0 0 -0.0", "0 1e0 0", "0 0 +1"];
    let facets = [[o, y, x], [o, x, z], [o, z, y], [x, y, z]].map(facet);
    let binary = |comment: &str| {
        let mut bytes = comment.as_bytes().to_vec();
        bytes.resize(80, b' ');
        bytes.extend(4_u32.to_le_bytes());
        let [o, x, y, z] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0_f32]];
        for corners in [[o, y, x], [o, x, z], [o, z, y], [x, y, z]] {
            bytes.extend([[0.0; 3]].iter().chain(&corners).flatten().flat_map(|x: &f32| x.to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    };
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0 1.0\nv 0 0 1 0.5 0.5 0.5\n";
    let ply = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty float32 z\n\
               property uchar red\nelement face 4\nproperty uchar flags\nproperty list uchar int vertex_indices\nelement edge 1\n\
               property list uchar int8 ends\nend_header\n0 0 0 1\n1. 0 0 2\n0 1 .0 3\n0 0 1\n4\n0 3 0 2 1\n0 3 0 1 3\n0 3 0 3 2\n\
               0 3 1 2 3\n2 0 1\n";
    let cases: Vec<(&str, &str, Vec<u8>)> = vec![
        ("x.stl", "text", format!("solid a b\n{}endsolid a b\n", facets.concat()).into()),
        (
            "x.stl",
            "two solids",
            format!("solid\n{}endsolid\nsolid\n{}endsolid\n", facets[..2].concat(), facets[2..].concat()).into(),
        ),
        ("x.stl", "upper case", format!("SOLID\n{}ENDSOLID\n", facets.concat().to_uppercase()).into()),
        ("x.stl", "bytes", binary("by hand")),
        ("x.stl", "bytes that begin like text", binary("solid by a CAD program")),
        ("x.obj", "triangles", format!("{vertices}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n").into()),
        ("x.obj", "faces first", format!("f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n{vertices}").into()),
        (
            "x.obj",
            "from the end",
            format!("# x\n{vertices}g a\nf -4 -2 -3\nf -4 -3 -1\ng b\nf -4 -1 -2\nf -3 -2 -1\n").into(),
        ),
        (
            "x.obj",
            "textures, normals",
            format!("{vertices}vt 0 0\nvn 0 0 1\nf 1/1/1 3/1/1 2/1/1\nf 1//1 2//1 4//1\nf 1/1 4/1 \\\n3/1\nf 2 3 4\n")
                .into(),
        ),
        ("x.ply", "text", ply.into()),
        ("x.ply", "Windows", ply.replace('\n', "\r\n").into()),
    ];
    for (name, what, bytes) in cases {
        let made = made(&bytes, name, false).unwrap_or_else(|error| panic!("{what}: {error:?}"));
        assert_eq!((made.innermost.len(), made.mesh.triangles.len()), (4, 4), "{name}: {what}");
        assert!((enclosed(&made) - 1.0 / 6.0).abs() <= 1e-15, "{name}: {what}");
    }
    // A concave polygon is cut from a corner that sees all others; one that no corner sees is refused.
    let prism = |outline: &[[i32; 2]]| {
        let count = outline.len();
        let mut text: String =
            (0..2).flat_map(|z| outline.iter().map(move |[x, y]| format!("v {x} {y} {z}\n"))).collect();
        let face = |corners: &mut dyn Iterator<Item = usize>| {
            format!("f {}\n", corners.map(|i| (i + 1).to_string()).collect::<Vec<_>>().join(" "))
        };
        text += &face(&mut (0..count).rev());
        text += &face(&mut (count..2 * count));
        text.extend(
            (0..count).map(|i| face(&mut [i, (i + 1) % count, count + (i + 1) % count, count + i].into_iter())),
        );
        text
    };
    let arrow = body(prism(&[[0, 0], [4, 4], [0, 8], [1, 4]]), "x.obj");
    assert!((enclosed(&arrow) - 12.0).abs() <= 1e-13);
    let cross = [[0, 1], [1, 1], [1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2]];
    let (message, advice) = made(prism(&cross), "x.obj", false).expect_err("no corner sees all others");
    assert!(message.contains(":25: element 0 is a polygon of 12 corners that is not convex"), "{message}");
    assert!(advice.contains("triangulate()"), "{advice}");
}

/// Announced numbers have to match the data, and are checked before the data are unpacked.
#[test]
fn announced_numbers_are_checked() {
    let plain = |piece: &str, points: &str| vtu("", "", piece, points, "");
    let types = |text: String| text.replacen("10 10</DataArray>", "10 10 10</DataArray>", 1);
    let cases = [
        (
            plain("NumberOfPoints=\"4000000000\" NumberOfCells=\"2\"", COMPONENTS),
            "announces 12000000000 coordinates of points, but has 15",
        ),
        (
            plain("NumberOfPoints=\"4\" NumberOfCells=\"2\"", COMPONENTS),
            "announces 12 coordinates of points, but has 15",
        ),
        (plain("NumberOfPoints=\"5\" NumberOfCells=\"7\"", COMPONENTS), "announces 7 offsets of cells, but has 2"),
        (types(plain(PIECE, COMPONENTS)), "announces 2 types of cells, but has 3"),
        (plain(PIECE, "NumberOfComponents=\"2\""), ":5: expected points of 3 components, found \"2\""),
        (plain("NumberOfPoints=\"-1\" NumberOfCells=\"2\"", COMPONENTS), ":3: expected NumberOfPoints, found \"-1\""),
        (plain("NumberOfCells=\"2\"", COMPONENTS), ":3: has no NumberOfPoints"),
        (
            plain(PIECE, COMPONENTS).replacen("0 0 1 1 1 1", "0 0 one 1 1 1", 1),
            ":7: expected coordinates of points, found \"one\"",
        ),
        (
            plain(PIECE, COMPONENTS).replacen("<VTK", "<!DOCTYPE x [\n<!ENTITY a \"b\">\n]><VTK", 1),
            ":2: is in VTK XML with entities",
        ),
        (
            plain(PIECE, &format!("{COMPONENTS} {}", "a=\"\" ".repeat(1000))),
            ":5: is in VTK XML with a tag of more than",
        ),
    ];
    for (text, words) in cases {
        let (message, _) = made(&text, "x.vtu", false).expect_err("refused");
        assert!(message.contains(words), "{words:?} is not in {message:?}");
    }
    // 40 MB of zeros in 40 kB: the header alone shows that they are not the 15 coordinates announced.
    let packed = miniz_oxide::deflate::compress_to_vec_zlib(&vec![0; 40_000_000], 9);
    let header = [1_u32, 40_000_000, 0, packed.len() as u32].map(u32::to_le_bytes).concat();
    let bomb = |points: u64| {
        format!(
            "<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid><Piece NumberOfPoints=\"{points}\" \
             NumberOfCells=\"2\"><Points><DataArray type=\"Int8\" NumberOfComponents=\"3\" format=\"binary\">{}{}</DataArray></Points>\
             </Piece></UnstructuredGrid></VTKFile>",
            base64(&header),
            base64(&packed)
        )
    };
    let (message, _) = made(bomb(5), "x.vtu", false).expect_err("refused");
    assert!(message.contains("announces 15 coordinates of points, but has 40000000"), "{message}");
    // With the right announcement, they take more memory than the budget has.
    let error = MeshFile::parse(bomb(40_000_000 / 3).as_bytes(), Path::new("x.vtu"), BUDGET).expect_err("refused");
    assert!(matches!(error.problem(), MeshProblem::Count { .. }), "{error}");
    let bomb = bomb(13_000_000).replace(
        &base64(&header),
        &base64(&[1_u32, 39_000_000, 0, packed.len() as u32].map(u32::to_le_bytes).concat()),
    );
    let error = MeshFile::parse(bomb.as_bytes(), Path::new("x.vtu"), BUDGET).expect_err("refused");
    assert!(matches!(error.problem(), MeshProblem::TooLarge { .. }), "{error}");
}

/// Every message about a text file names the line that it is about. Cases: file, contents, line and words.
#[test]
fn lines_are_right_to_the_line() {
    let msh = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 x\n$EndNodes\n";
    let stl =
        "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n0 0 z\n";
    let cases: &[(&str, String, &str)] = &[
        ("x.msh", msh.to_owned(), ":6: expected a coordinate, found \"x\""),
        ("x.msh", msh.replacen("2.2 0", "2.2 two", 1), ":2: expected 0 for text or 1 for binary, found \"two\""),
        ("x.msh", msh.replacen(" x\n$EndNodes", " 0\n\n$EndElements", 1), ":8: expected the end of the section"),
        ("x.msh", msh.replacen(" x\n$EndNodes\n", "\n\n\n", 1), ":6: ends where a coordinate is expected"),
        ("x.msh", "\n\nsolid\n".to_owned(), ":3: expected $MeshFormat, found \"solid\""),
        ("x.vtk", LEGACY.replacen("0 1 0\n", "0 one 0\n", 1), ":8: expected a coordinate, found \"one\""),
        ("x.vtk", LEGACY.replacen("ASCII", "UTF8", 1), ":3: expected ASCII or BINARY, found \"utf8\""),
        ("x.vtk", LEGACY.replacen("CELLS 2 10", "CELL 2 10", 1), ":11: expected POINTS, CELLS"),
        (
            "x.vtk",
            LEGACY.replacen("UNSTRUCTURED_GRID", "RECTILINEAR_GRID", 1),
            ":4: is in VTK's DATASET RECTILINEAR_GRID",
        ),
        ("x.vtk", LEGACY.replacen("double", "quad", 1), ":5: is in VTK with numbers of the type quad"),
        ("x.stl", stl.to_owned(), ":6: expected a coordinate, found \"vertex\""),
        ("x.stl", stl.replacen("outer loop", "outer\nring", 1), ":4: expected loop, found \"ring\""),
        ("x.obj", "v 0 0 0\nv 1 0\nv 0 1 0\n".to_owned(), ":3: expected a coordinate, found \"v\""),
        (
            "x.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 9\n".to_owned(),
            ":5: element 0 names node 8, which does not exist",
        ),
        ("x.obj", "v 0 0 0\n# zero\nf 1 0 1\n".to_owned(), ":3: expected a vertex of a face, found \"0\""),
        ("x.obj", "v 0 0 0\nv 0 1 0\nf 1 2\n".to_owned(), ":3: element 0 is a cell of 2 nodes"),
        ("x.ply", ply.to_owned(), ":9: expected a coordinate, found \"z\""),
        ("x.ply", ply.replacen("float y", "real y", 1), ":5: expected a type of PLY, found \"real\""),
        ("x.ply", ply.replacen("end_header", "header_end", 1), ":7: expected format, comment"),
        ("x.ply", ply.replacen("0 0 z\n", "0 0\n", 1), ":9: ends where a coordinate is expected"),
    ];
    for (name, text, words) in cases {
        let (message, advice) = made(text, name, false).expect_err("refused");
        assert!(message.contains(words) && !advice.is_empty(), "{words:?} is not in {message:?}:\n{text}");
    }
}
