//! Gmsh's MSH format, versions 2.2 and 4.1, as text and binary (Geuzaine & Remacle, Gmsh Reference Manual, chapter
//! "Gmsh file formats"). Both versions have numbered nodes, and elements that refer to these numbers, in named
//! sections; they differ in the layout of a section.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::Cells;
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use crate::Vec3;

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let first = cursor.full_line().unwrap_or_default();
    if first != b"$MeshFormat" {
        return Err(cursor.expected("$MeshFormat", first));
    }
    let layout = header(&mut cursor)?;
    end_section(&mut cursor, b"MeshFormat")?;

    let mut reader = Reader::default();
    while let Some(line) = cursor.full_line() {
        match (line, layout) {
            (b"$Nodes", Layout::V2) => reader.nodes_2(&mut cursor)?,
            (b"$Nodes", Layout::V4) => reader.nodes_4(&mut cursor)?,
            (b"$Elements", Layout::V2) => reader.elements_2(&mut cursor)?,
            (b"$Elements", Layout::V4) => reader.elements_4(&mut cursor)?,
            // Names, geometry and data are not needed.
            ([b'$', name @ ..], _) => cursor.skip_past(&[b"$End", name].concat(), "the end of a section")?,
            (other, _) => return Err(cursor.expected("a section", other)),
        }
        if matches!(line, b"$Nodes" | b"$Elements") {
            end_section(&mut cursor, &line[1..])?;
        }
    }
    reader.cells()
}

/// Layout of the sections.
#[derive(Debug, Clone, Copy)]
enum Layout {
    V2,
    V4,
}

/// Reads the version, the encoding and the size of a number; then, in binary files, a 1 that shows the byte order.
fn header(cursor: &mut Cursor) -> Result<Layout, Flaw> {
    let version: String = cursor.word("a version")?;
    let layout = match version.as_str() {
        "2" | "2.1" | "2.2" => Layout::V2,
        "4.1" => Layout::V4,
        _ => return Err(cursor.flaw(MeshProblem::Variety(format!("MSH {version}")))),
    };
    let is_binary = cursor.word::<u8>("0 for text or 1 for binary")? != 0;
    if cursor.word::<u8>("the size of a number")? != 8 {
        return Err(cursor.flaw(MeshProblem::Variety("MSH with numbers of other than 8 bytes".to_owned())));
    }
    if is_binary {
        cursor.line();
        cursor.encoding = match cursor.take(4, "a 1 that shows the byte order")? {
            [1, 0, 0, 0] => Encoding::Little,
            [0, 0, 0, 1] => Encoding::Big,
            other => return Err(cursor.expected("a 1 that shows the byte order", other)),
        };
    }
    Ok(layout)
}

fn end_section(cursor: &mut Cursor, name: &[u8]) -> Result<(), Flaw> {
    const WHAT: &str = "the end of the section";
    let line = cursor.full_line().ok_or_else(|| cursor.flaw(MeshProblem::Ended(WHAT)))?;
    if line.strip_prefix(b"$End") == Some(name) { Ok(()) } else { Err(cursor.expected(WHAT, line)) }
}

/// Kind of an element.
enum Kind {
    /// A point or a line with this many nodes, which serves only the geometry.
    LeftAside(u64),
    Triangle,
    Tetrahedron,
}

#[derive(Default)]
struct Reader {
    nodes: Vec<Vec3>,
    /// Index of each node, by its number.
    index: HashMap<u64, u32>,
    elements: usize,
    /// Element index and node numbers of each tetrahedron.
    tetrahedra: Vec<(usize, [u64; 4])>,
    triangles: Vec<(usize, [u64; 3])>,
}

impl Reader {
    fn nodes_2(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let count: u64 = cursor.word("the number of nodes")?;
        cursor.line();
        for _ in 0..count {
            let number = cursor.index(Number::I32, "the number of a node")?;
            let position = position(cursor)?;
            self.node(cursor, number, position)?;
        }
        Ok(())
    }

    fn nodes_4(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let blocks = cursor.index(Number::U64, "the number of blocks of nodes")?;
        cursor.skip(Number::U64, 3, "the numbers of nodes")?;
        for _ in 0..blocks {
            let dimension = cursor.index(Number::I32, "a dimension")?;
            cursor.skip(Number::I32, 1, "the number of an entity")?;
            let is_parametric = cursor.index(Number::I32, "0, or 1 for parametric nodes")? != 0;
            let count = cursor.index(Number::U64, "the number of nodes of a block")?;
            let numbers = cursor.indices(Number::U64, count, "the number of a node")?;
            for number in numbers {
                let position = position(cursor)?;
                if is_parametric {
                    cursor.skip(Number::F64, dimension, "the parameters of a node")?;
                }
                self.node(cursor, number, position)?;
            }
        }
        Ok(())
    }

    fn node(&mut self, cursor: &Cursor, number: u64, position: Vec3) -> Result<(), Flaw> {
        match self.index.entry(number) {
            Entry::Occupied(_) => Err(cursor.flaw(MeshProblem::RepeatedNumber(number))),
            Entry::Vacant(place) => {
                place.insert(self.nodes.len() as u32);
                self.nodes.push(position);
                Ok(())
            }
        }
    }

    fn elements_2(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let count: u64 = cursor.word("the number of elements")?;
        cursor.line();
        if cursor.encoding == Encoding::Text {
            for _ in 0..count {
                cursor.skip(Number::I32, 1, "the number of an element")?;
                let kind = self.kind(cursor)?;
                let tags = cursor.index(Number::I32, "the number of tags")?;
                cursor.skip(Number::I32, tags, "a tag")?;
                self.element(cursor, &kind, Number::I32)?;
            }
            return Ok(());
        }
        // In binary files, elements of one type and number of tags stand together.
        let mut left = count;
        while left > 0 {
            let kind = self.kind(cursor)?;
            let following = cursor.index(Number::I32, "the number of elements of a block")?;
            let tags = cursor.index(Number::I32, "the number of tags")?;
            if !(1..=left).contains(&following) {
                let found = following.to_string();
                return Err(cursor.expected("at least one element, and no more than announced", found.as_bytes()));
            }
            for _ in 0..following {
                cursor.skip(Number::I32, 1 + tags, "the number and the tags of an element")?;
                self.element(cursor, &kind, Number::I32)?;
            }
            left -= following;
        }
        Ok(())
    }

    fn elements_4(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let blocks = cursor.index(Number::U64, "the number of blocks of elements")?;
        cursor.skip(Number::U64, 3, "the numbers of elements")?;
        for _ in 0..blocks {
            cursor.skip(Number::I32, 2, "the entity of a block")?;
            let kind = self.kind(cursor)?;
            let count = cursor.index(Number::U64, "the number of elements of a block")?;
            for _ in 0..count {
                cursor.skip(Number::U64, 1, "the number of an element")?;
                self.element(cursor, &kind, Number::U64)?;
            }
        }
        Ok(())
    }

    /// Returns the kind of an element from the number of its type (Gmsh Reference Manual, "MSH file format").
    fn kind(&self, cursor: &mut Cursor) -> Result<Kind, Flaw> {
        let number = cursor.index(Number::I32, "the type of an element")?;
        let name = match number {
            15 => return Ok(Kind::LeftAside(1)),
            1 => return Ok(Kind::LeftAside(2)),
            // Lines of second to fifth order.
            8 => return Ok(Kind::LeftAside(3)),
            26..=28 => return Ok(Kind::LeftAside(number - 22)),
            2 => return Ok(Kind::Triangle),
            4 => return Ok(Kind::Tetrahedron),
            3 | 10 | 16 => "quadrangle",
            5 | 12 | 17 => "hexahedron",
            6 | 13 | 18 => "prism",
            7 | 14 | 19 => "pyramid",
            9 => "second-order triangle",
            11 => "second-order tetrahedron",
            20..=25 => "higher-order triangle",
            29..=31 => "higher-order tetrahedron",
            _ => "cell of unknown type",
        };
        Err(cursor.flaw(MeshProblem::Element { element: self.elements, name: format!("{name} (Gmsh type {number})") }))
    }

    fn element(&mut self, cursor: &mut Cursor, kind: &Kind, number: Number) -> Result<(), Flaw> {
        const WHAT: &str = "a node of an element";
        match kind {
            Kind::LeftAside(nodes) => cursor.skip(number, *nodes, WHAT)?,
            Kind::Triangle => {
                let mut nodes = [0; 3];
                for node in &mut nodes {
                    *node = cursor.index(number, WHAT)?;
                }
                self.triangles.push((self.elements, nodes));
            }
            Kind::Tetrahedron => {
                let mut nodes = [0; 4];
                for node in &mut nodes {
                    *node = cursor.index(number, WHAT)?;
                }
                self.tetrahedra.push((self.elements, nodes));
            }
        }
        self.elements += 1;
        Ok(())
    }

    /// Builds the cells once all nodes are known: elements may come before them.
    fn cells(self) -> Result<Cells, Flaw> {
        if self.nodes.is_empty() {
            return Err(MeshProblem::Missing("nodes").into());
        }
        let tetrahedra = indexed(&self.index, &self.tetrahedra)?;
        let triangles = indexed(&self.index, &self.triangles)?;
        Ok(Cells { nodes: self.nodes, tetrahedra, triangles })
    }
}

fn position(cursor: &mut Cursor) -> Result<Vec3, Flaw> {
    let mut position = Vec3::zeros();
    for axis in 0..3 {
        position[axis] = cursor.real(Number::F64, "a coordinate")?;
    }
    Ok(position)
}

fn indexed<const N: usize>(
    index: &HashMap<u64, u32>,
    elements: &[(usize, [u64; N])],
) -> Result<Vec<[u32; N]>, MeshProblem> {
    let indexed = |&(element, numbers): &(usize, [u64; N])| {
        let mut nodes = [0; N];
        for (node, number) in nodes.iter_mut().zip(numbers) {
            *node = *index.get(&number).ok_or(MeshProblem::UnknownNode { element, node: number })?;
        }
        Ok(nodes)
    };
    elements.iter().map(indexed).collect()
}
