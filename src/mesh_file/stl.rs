//! STL: triangles without a list of nodes, as text or binary. Corners at exactly the same place become one node.

use std::collections::HashMap;

use super::cells::Cells;
use super::error::Flaw;
use super::numbers::{Cursor, Encoding, Number};
use crate::Vec3;

/// Bytes before the triangles of a binary file: a comment and the number of triangles.
const HEADER: usize = 84;
/// Bytes of a triangle: normal and corners in 32 bits, and two bytes of attributes.
const TRIANGLE: usize = 50;

/// Reads a whole file. A binary one may begin with `solid` like text, but its size is that of its triangles.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut mesh = Joined::default();
    let count = bytes.get(HEADER - 4..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let is_binary = count.is_some_and(|count| bytes.len() as u64 == HEADER as u64 + TRIANGLE as u64 * u64::from(count));
    let starts_as_text = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    if is_binary || !starts_as_text {
        binary(bytes, &mut mesh)?;
    } else {
        text(bytes, &mut mesh)?;
    }
    Ok(mesh.cells)
}

fn binary(bytes: &[u8], mesh: &mut Joined) -> Result<(), Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Little);
    cursor.take(HEADER - 4, "`solid`, or the comment of a binary file")?;
    let count = cursor.index(Number::U32, "the number of triangles")?;
    for _ in 0..count {
        cursor.skip(Number::F32, 3, "the normal of a triangle")?;
        mesh.triangle(&mut cursor)?;
        cursor.skip(Number::U16, 1, "the attributes of a triangle")?;
    }
    Ok(())
}

/// Reads the words of one solid after the other; normals are not needed.
fn text(bytes: &[u8], mesh: &mut Joined) -> Result<(), Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    while let Some(word) = cursor.next_word() {
        match word.to_ascii_lowercase().as_slice() {
            // The rest of the line is a name.
            b"solid" | b"endsolid" => cursor.rest_of_line(),
            b"facet" => {
                keyword(&mut cursor, "normal")?;
                cursor.skip(Number::F32, 3, "the normal of a triangle")?;
                keyword(&mut cursor, "outer")?;
                keyword(&mut cursor, "loop")?;
                mesh.triangle(&mut cursor)?;
                keyword(&mut cursor, "endloop")?;
                keyword(&mut cursor, "endfacet")?;
            }
            other => return Err(cursor.expected("facet or endsolid", other)),
        }
    }
    Ok(())
}

fn keyword(cursor: &mut Cursor, word: &'static str) -> Result<(), Flaw> {
    let found = cursor.next_word().unwrap_or_default();
    if found.eq_ignore_ascii_case(word.as_bytes()) { Ok(()) } else { Err(cursor.expected(word, found)) }
}

/// Triangles whose equal corners are one node.
#[derive(Default)]
struct Joined {
    cells: Cells,
    /// Node at each position, by its bits.
    index: HashMap<[u64; 3], u32>,
}

impl Joined {
    fn triangle(&mut self, cursor: &mut Cursor) -> Result<(), Flaw> {
        let mut corners = [0; 3];
        for corner in &mut corners {
            if cursor.encoding == Encoding::Text {
                keyword(cursor, "vertex")?;
            }
            let mut position = Vec3::zeros();
            for axis in 0..3 {
                // Adding zero makes −0 equal to 0.
                position[axis] = cursor.real(Number::F32, "a coordinate")? + 0.0;
            }
            *corner = *self.index.entry(position.map(f64::to_bits).into()).or_insert_with(|| {
                self.cells.nodes.push(position);
                self.cells.nodes.len() as u32 - 1
            });
        }
        self.cells.triangles.push(corners);
        Ok(())
    }
}
