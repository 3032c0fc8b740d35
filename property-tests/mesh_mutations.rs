//! Mesh files with words, lines and bytes changed at random: every file is either accepted or refused.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use proptest::prelude::*;

use super::mesh_formats::{COMPONENTS, LEGACY, PIECE, cubes, divided, made, tunnel, vtu};

/// A change of a word, a line or a piece of a file.
#[derive(Debug, Clone)]
enum Mutation {
    Number { at: usize, value: i64 },
    Drop { at: usize, count: usize },
    Repeat { at: usize, count: usize },
    Swap { at: usize, with: usize },
    Byte { at: usize, value: u8 },
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let value = prop_oneof![-3..70_i64, Just(i64::MAX), Just(i64::MIN), Just(1 << 32), Just(1 << 20)];
    prop_oneof![
        (any::<usize>(), value).prop_map(|(at, value)| Mutation::Number { at, value }),
        (any::<usize>(), 1..40_usize).prop_map(|(at, count)| Mutation::Drop { at, count }),
        (any::<usize>(), 1..40_usize).prop_map(|(at, count)| Mutation::Repeat { at, count }),
        (any::<usize>(), any::<usize>()).prop_map(|(at, with)| Mutation::Swap { at, with }),
        (any::<usize>(), any::<u8>()).prop_map(|(at, value)| Mutation::Byte { at, value }),
    ]
}

fn mutated(mut bytes: Vec<u8>, mutations: &[Mutation]) -> Vec<u8> {
    for mutation in mutations {
        let length = bytes.len().max(1);
        match *mutation {
            Mutation::Number { at, value } => {
                // The next number from there on.
                let at = at % length;
                let digit = |byte: &u8| byte.is_ascii_digit();
                if let Some(start) = bytes[at..].iter().position(digit).map(|start| at + start) {
                    let end =
                        bytes[start..].iter().position(|byte| !digit(byte)).map_or(bytes.len(), |end| start + end);
                    bytes.splice(start..end, value.to_string().bytes());
                }
            }
            Mutation::Drop { at, count } => {
                let at = at % length;
                bytes.drain(at..(at + count).min(bytes.len()));
            }
            Mutation::Repeat { at, count } => {
                let at = at % length;
                let piece = bytes[at..(at + count).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            Mutation::Swap { at, with } => bytes.swap(at % length, with % length),
            Mutation::Byte { at, value } => bytes[at % length] = value,
        }
    }
    bytes
}

/// Seeds of the mutations: the smallest files of each format.
fn seeds() -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/meshes/formats");
    let files = fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path());
    let mut seeds: Vec<(String, Vec<u8>)> = files
        .map(|path| {
            (path.file_name().expect("a name").to_string_lossy().into_owned(), fs::read(&path).expect("a file"))
        })
        .collect();
    seeds.sort();
    seeds.extend([("x.vtk".to_owned(), LEGACY.into()), ("x.vtk".to_owned(), tunnel().into())]);
    seeds.push(("x.vtu".to_owned(), vtu("", "", PIECE, COMPONENTS, "").into()));
    seeds.push(("cubes.vtk".to_owned(), cubes(|cube| divided([0, 1, 3][cube * 5 % 3])).into()));
    seeds
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is done to a file, it is accepted or refused, without a panic and within its memory. (The machine stops
    /// what takes more, and the test runner an endless loop.)
    #[test]
    fn mutated_files_never_panic(seed in any::<usize>(), mutations in prop::collection::vec(mutation(), 1..5), is_repaired: bool) {
        let seeds = seeds();
        let (name, bytes) = &seeds[seed % seeds.len()];
        if let Ok(made) = made(mutated(bytes.clone(), &mutations), name, is_repaired) {
            prop_assert!(made.mesh.nodes.iter().all(|x| x.iter().all(|x| x.is_finite())));
            // An accepted mesh is closed: every edge has two faces.
            let mut edges: HashMap<[u32; 2], usize> = HashMap::new();
            for &[a, b, c] in &made.mesh.triangles {
                [[a, b], [b, c], [c, a]].into_iter().for_each(|[i, j]| *edges.entry([i.min(j), i.max(j)]).or_default() += 1);
            }
            prop_assert!(edges.values().all(|&count| count == 2));
        }
    }
}
