//! Gmsh's MSH format, versions 1, 2, 4.0 and 4.1, as text and binary (Geuzaine & Remacle, Gmsh Reference Manual, chapter
//! "Gmsh file formats"). All versions have numbered nodes, and elements that refer to these numbers, in named
//! sections; they differ in the layout of a section.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::cells::{Cells, Shape};
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use crate::Vec3;

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    const HEADER: &str = "$MeshFormat";
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let mut layout = None;
    let mut reader = Reader::default();
    while let Some(line) = cursor.full_line() {
        match (line, layout) {
            (b"$MeshFormat", _) => layout = Some(header(&mut cursor)?),
            // Version 1 has no header.
            (b"$NOD", _) => reader.nodes_2(&mut cursor, false)?,
            (b"$ELM", _) => reader.elements_1(&mut cursor)?,
            (b"$Nodes", Some(Layout::V2)) => reader.nodes_2(&mut cursor, false)?,
            (b"$ParametricNodes", Some(Layout::V2)) => reader.nodes_2(&mut cursor, true)?,
            (b"$Nodes", Some(Layout::V40)) => reader.nodes_40(&mut cursor)?,
            (b"$Nodes", Some(Layout::V41)) => reader.nodes_41(&mut cursor)?,
            (b"$Elements", Some(Layout::V2)) => reader.elements_2(&mut cursor)?,
            (b"$Elements", Some(layout)) => reader.elements_4(&mut cursor, layout)?,
            (b"$Nodes" | b"$Elements" | b"$ParametricNodes", None) => return Err(cursor.expected(HEADER, line)),
            // Comments, names, geometry and data are not needed.
            ([b'$', name @ ..], _) => {
                cursor.skip_past(&[b"$End", name].concat(), "the end of a section")?;
                continue;
            }
            (other, None) => return Err(cursor.expected(HEADER, other)),
            (other, Some(_)) => return Err(cursor.expected("a section", other)),
        }
        end_section(&mut cursor, &line[1..])?;
    }
    if layout.is_none() && reader.nodes.is_empty() {
        return Err(cursor.expected(HEADER, b""));
    }
    reader.cells()
}

/// Layout of the sections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    V2,
    V40,
    V41,
}

/// Reads the version, the encoding and the size of a number; then, in binary files, a 1 that shows the byte order.
fn header(cursor: &mut Cursor) -> Result<Layout, Flaw> {
    let version: String = cursor.word("a version")?;
    let layout = match version.parse::<f64>() {
        Ok(version) if (2.0..3.0).contains(&version) => Layout::V2,
        Ok(4.0) => Layout::V40,
        Ok(4.1) => Layout::V41,
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
    let line = cursor.full_line().ok_or_else(|| cursor.ended(WHAT))?;
    let closed = line.strip_prefix(b"$End").or_else(|| line.strip_prefix(b"$END"));
    if closed == Some(name) { Ok(()) } else { Err(cursor.expected(WHAT, line)) }
}

/// Type of an element.
#[derive(Debug, Clone, Copy)]
struct Kind {
    /// Shape; `None` for points and lines, which serve only the geometry.
    shape: Option<Shape>,
    /// Number of nodes.
    nodes: u64,
}

#[derive(Default)]
struct Reader {
    nodes: Vec<Vec3>,
    /// Index of each node, by its number.
    index: HashMap<u64, u32>,
    /// Number of elements read, whatever their shape.
    elements: usize,
    /// Index and shape of each element that is used, and the end of its nodes in `connectivity`.
    used: Vec<(u32, Shape, usize)>,
    /// Node numbers of all elements, one element after the other.
    connectivity: Vec<u64>,
}

impl Reader {
    fn nodes_2(&mut self, cursor: &mut Cursor, is_parametric: bool) -> Result<(), Flaw> {
        let count: u64 = cursor.word("the number of nodes")?;
        cursor.begin_data();
        for _ in 0..count {
            let number = cursor.index(Number::I32, "the number of a node")?;
            let position = position(cursor)?;
            self.node(cursor, number, position)?;
            if is_parametric {
                let dimension = cursor.index(Number::I32, "the dimension of an entity")?;
                cursor.skip(Number::I32, 1, "the number of an entity")?;
                // Nodes on a line have one parameter, those on a surface two.
                let parameters = if dimension < 3 { dimension } else { 0 };
                cursor.skip(Number::F64, parameters, "the parameters of a node")?;
            }
        }
        Ok(())
    }

    fn nodes_40(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let blocks = cursor.index(Number::U64, "the number of blocks of nodes")?;
        cursor.skip(Number::U64, 1, "the number of nodes")?;
        for _ in 0..blocks {
            cursor.skip(Number::I32, 1, "the number of an entity")?;
            let dimension = cursor.index(Number::I32, "a dimension")?;
            let is_parametric = cursor.index(Number::I32, "0, or 1 for parametric nodes")? != 0;
            let count = cursor.index(Number::U64, "the number of nodes of a block")?;
            for _ in 0..count {
                let number = cursor.index(Number::I32, "the number of a node")?;
                let position = position(cursor)?;
                self.node(cursor, number, position)?;
                if is_parametric {
                    cursor.skip(Number::F64, dimension, "the parameters of a node")?;
                }
            }
        }
        Ok(())
    }

    fn nodes_41(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
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

    fn elements_1(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let count: u64 = cursor.word("the number of elements")?;
        for _ in 0..count {
            cursor.skip(Number::I32, 1, "the number of an element")?;
            let kind = self.kind(cursor)?;
            cursor.skip(Number::I32, 2, "the regions of an element")?;
            let nodes = cursor.index(Number::I32, "the number of an element's nodes")?;
            if nodes != kind.nodes {
                return Err(cursor.flaw(MeshProblem::Count {
                    what: "nodes of an element",
                    announced: nodes,
                    found: kind.nodes,
                }));
            }
            self.element(cursor, kind, Number::I32)?;
        }
        Ok(())
    }

    fn elements_2(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let count: u64 = cursor.word("the number of elements")?;
        cursor.begin_data();
        if cursor.encoding == Encoding::Text {
            for _ in 0..count {
                cursor.skip(Number::I32, 1, "the number of an element")?;
                let kind = self.kind(cursor)?;
                let tags = cursor.index(Number::I32, "the number of tags")?;
                cursor.skip(Number::I32, tags, "a tag")?;
                self.element(cursor, kind, Number::I32)?;
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
                self.element(cursor, kind, Number::I32)?;
            }
            left -= following;
        }
        Ok(())
    }

    fn elements_4(&mut self, cursor: &mut Cursor, layout: Layout) -> Result<(), Flaw> {
        let blocks = cursor.index(Number::U64, "the number of blocks of elements")?;
        let is_40 = layout == Layout::V40;
        cursor.skip(Number::U64, if is_40 { 1 } else { 3 }, "the numbers of elements")?;
        let number = if is_40 { Number::I32 } else { Number::U64 };
        for _ in 0..blocks {
            cursor.skip(Number::I32, 2, "the entity of a block")?;
            let kind = self.kind(cursor)?;
            let count = cursor.index(Number::U64, "the number of elements of a block")?;
            for _ in 0..count {
                cursor.skip(number, 1, "the number of an element")?;
                self.element(cursor, kind, number)?;
            }
        }
        Ok(())
    }

    /// Returns the type of an element from its number (Gmsh Reference Manual, "MSH file format").
    fn kind(&self, cursor: &mut Cursor) -> Result<Kind, Flaw> {
        let number = cursor.index(Number::I32, "the type of an element")?;
        let (shape, nodes) = match number {
            15 => (None, 1),
            1 => (None, 2),
            // Lines of second to fifth order.
            8 => (None, 3),
            26..=28 => (None, number - 22),
            2 => (Some(Shape::Triangle), 3),
            9 => (Some(Shape::Triangle), 6),
            // Triangles of third to fifth order, some without nodes inside.
            20 => (Some(Shape::Triangle), 9),
            21 => (Some(Shape::Triangle), 10),
            22 => (Some(Shape::Triangle), 12),
            23 | 24 => (Some(Shape::Triangle), 15),
            25 => (Some(Shape::Triangle), 21),
            3 => (Some(Shape::Quadrangle), 4),
            10 => (Some(Shape::Quadrangle), 9),
            16 => (Some(Shape::Quadrangle), 8),
            4 => (Some(Shape::Tetrahedron), 4),
            11 => (Some(Shape::Tetrahedron), 10),
            29 => (Some(Shape::Tetrahedron), 20),
            30 => (Some(Shape::Tetrahedron), 35),
            31 => (Some(Shape::Tetrahedron), 56),
            5 => (Some(Shape::Hexahedron), 8),
            12 => (Some(Shape::Hexahedron), 27),
            17 => (Some(Shape::Hexahedron), 20),
            6 => (Some(Shape::Wedge), 6),
            13 => (Some(Shape::Wedge), 18),
            18 => (Some(Shape::Wedge), 15),
            7 => (Some(Shape::Pyramid), 5),
            14 => (Some(Shape::Pyramid), 14),
            19 => (Some(Shape::Pyramid), 13),
            _ => {
                let name = format!("cell of Gmsh's type {number}");
                return Err(cursor.flaw(MeshProblem::Element { element: self.elements, name }));
            }
        };
        Ok(Kind { shape, nodes })
    }

    fn element(&mut self, cursor: &mut Cursor, kind: Kind, number: Number) -> Result<(), Flaw> {
        const WHAT: &str = "a node of an element";
        match kind.shape {
            None => cursor.skip(number, kind.nodes, WHAT)?,
            Some(shape) => {
                for _ in 0..kind.nodes {
                    self.connectivity.push(cursor.index(number, WHAT)?);
                }
                self.used.push((self.elements as u32, shape, self.connectivity.len()));
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
        let mut cells = Cells { nodes: self.nodes, ..Cells::default() };
        let mut start = 0;
        let mut nodes = Vec::new();
        for (element, shape, end) in self.used {
            nodes.clear();
            for node in &self.connectivity[start..end] {
                let unknown = MeshProblem::UnknownNode { element: element as usize, node: *node };
                nodes.push(u64::from(*self.index.get(node).ok_or(unknown)?));
            }
            cells.add(element as usize, shape, &nodes)?;
            start = end;
        }
        Ok(cells)
    }
}

fn position(cursor: &mut Cursor) -> Result<Vec3, Flaw> {
    let mut position = Vec3::zeros();
    for axis in 0..3 {
        position[axis] = cursor.real(Number::F64, "a coordinate")?;
    }
    Ok(position)
}
