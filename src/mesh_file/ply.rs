//! PLY: elements with named properties, which the header declares, as text or binary in either byte order (G. Turk, "The
//! PLY Polygon File Format", 1994). Vertices and faces are read, and other elements skipped.

use super::cells::{Cells, Shape};
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use crate::Vec3;

/// An element of the header.
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// Type of the length of a list; `None` for a single number.
    length: Option<Number>,
    number: Number,
}

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let (encoding, elements) = header(&mut cursor)?;
    cursor.encoding = encoding;
    let mut cells = Cells::default();
    let mut faces: Vec<u64> = Vec::new();
    let mut ends: Vec<usize> = Vec::new();
    for element in &elements {
        // Elements without properties take no bytes, so any number of them could be announced.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        for _ in 0..count {
            match element.name.as_str() {
                "vertex" => cells.nodes.push(vertex(&mut cursor, element)?),
                "face" => {
                    face(&mut cursor, element, &mut faces)?;
                    ends.push(faces.len());
                }
                _ => element.properties.iter().try_for_each(|property| skip(&mut cursor, property))?,
            }
        }
    }
    if cells.nodes.is_empty() {
        return Err(MeshProblem::Missing("vertices").into());
    }
    let mut start = 0;
    for (face, end) in ends.into_iter().enumerate() {
        cells.add(face, Shape::Polygon, &faces[start..end])?;
        start = end;
    }
    Ok(cells)
}

fn header(cursor: &mut Cursor) -> Result<(Encoding, Vec<Element>), Flaw> {
    const WHAT: &str = "format, comment, element, property or end_header";
    let first = cursor.line().unwrap_or_default();
    if first != b"ply" {
        return Err(cursor.expected("ply", first));
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        match cursor.next_word().ok_or_else(|| cursor.ended(WHAT))? {
            b"format" => {
                encoding = Some(match cursor.next_word().unwrap_or_default() {
                    b"ascii" => Encoding::Text,
                    b"binary_little_endian" => Encoding::Little,
                    b"binary_big_endian" => Encoding::Big,
                    other => return Err(cursor.expected("ascii, binary_little_endian or binary_big_endian", other)),
                });
                cursor.rest_of_line();
            }
            b"comment" | b"obj_info" => cursor.rest_of_line(),
            b"element" => {
                let name = cursor.word("the name of an element")?;
                let count = cursor.word("the number of elements")?;
                elements.push(Element { name, count, properties: Vec::new() });
            }
            word @ b"property" => {
                let element = elements.last_mut().ok_or_else(|| cursor.expected("element", word))?;
                let is_list = cursor.clone().next_word() == Some(b"list");
                if is_list {
                    cursor.next_word();
                }
                let length = if is_list { Some(number(cursor)?) } else { None };
                let number = number(cursor)?;
                element.properties.push(Property { name: cursor.word("the name of a property")?, length, number });
            }
            b"end_header" => {
                cursor.line();
                let encoding = encoding.ok_or_else(|| cursor.flaw(MeshProblem::Missing("format")))?;
                return Ok((encoding, elements));
            }
            other => return Err(cursor.expected(WHAT, other)),
        }
    }
}

fn number(cursor: &mut Cursor) -> Result<Number, Flaw> {
    Ok(match cursor.next_word().unwrap_or_default() {
        b"char" | b"int8" => Number::I8,
        b"uchar" | b"uint8" => Number::U8,
        b"short" | b"int16" => Number::I16,
        b"ushort" | b"uint16" => Number::U16,
        b"int" | b"int32" => Number::I32,
        b"uint" | b"uint32" => Number::U32,
        b"float" | b"float32" => Number::F32,
        b"double" | b"float64" => Number::F64,
        other => return Err(cursor.expected("a type of PLY", other)),
    })
}

fn vertex(cursor: &mut Cursor, element: &Element) -> Result<Vec3, Flaw> {
    let mut position = [None; 3];
    for property in &element.properties {
        match ["x", "y", "z"].iter().position(|axis| *axis == property.name) {
            Some(axis) if property.length.is_none() => {
                position[axis] = Some(cursor.real(property.number, "a coordinate")?);
            }
            _ => skip(cursor, property)?,
        }
    }
    let [Some(x), Some(y), Some(z)] = position else {
        return Err(MeshProblem::Missing("x, y and z of a vertex").into());
    };
    Ok(Vec3::new(x, y, z))
}

fn face(cursor: &mut Cursor, element: &Element, nodes: &mut Vec<u64>) -> Result<(), Flaw> {
    for property in &element.properties {
        match property.length {
            Some(length) if matches!(property.name.as_str(), "vertex_indices" | "vertex_index") => {
                for _ in 0..cursor.index(length, "the number of a face's vertices")? {
                    nodes.push(cursor.index(property.number, "a vertex of a face")?);
                }
            }
            _ => skip(cursor, property)?,
        }
    }
    Ok(())
}

fn skip(cursor: &mut Cursor, property: &Property) -> Result<(), Flaw> {
    let count = match property.length {
        Some(length) => cursor.index(length, "the length of a list")?,
        None => 1,
    };
    cursor.skip(property.number, count, "a property")
}
