//! Wavefront's OBJ: vertices and faces, line by line. Normals, textures, groups and materials are not needed, nor are points and
//! lines; every group shares the vertices.

use super::cells::{Cells, Shape};
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use crate::Vec3;

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let mut cells = Cells::default();
    // Faces may come before their vertices.
    let mut faces: Vec<(Vec<u64>, Cursor)> = Vec::new();
    while let Some(word) = cursor.next_word() {
        match word {
            b"v" => {
                let mut position = Vec3::zeros();
                for axis in 0..3 {
                    position[axis] = cursor.real(Number::F64, "a coordinate")?;
                }
                cells.nodes.push(position);
                // A weight or a colour may follow.
                cursor.rest_of_line();
            }
            b"f" => {
                let place = cursor.clone();
                let mut corners = Vec::new();
                while let Some(word) = cursor.word_on_line() {
                    corners.push(
                        vertex(word, cells.nodes.len()).ok_or_else(|| cursor.expected("a vertex of a face", word))?,
                    );
                }
                faces.push((corners, place));
            }
            _ => cursor.rest_of_line(),
        }
    }
    if cells.nodes.is_empty() {
        return Err(MeshProblem::Missing("vertices (`v`)").into());
    }
    for (face, (corners, place)) in faces.iter().enumerate() {
        cells.add(face, Shape::Polygon, corners).map_err(|problem| place.flaw(problem))?;
    }
    Ok(cells)
}

/// Returns the index of a vertex from `vertex`, `vertex/texture` or `vertex/texture/normal`. Numbers count from 1 or, if
/// negative, back from the last vertex so far.
fn vertex(word: &[u8], so_far: usize) -> Option<u64> {
    let number = word.split(|&byte| byte == b'/').next()?;
    let number: i64 = std::str::from_utf8(number).ok()?.parse().ok()?;
    match number {
        0 => None,
        1.. => u64::try_from(number - 1).ok(),
        _ => u64::try_from(so_far).ok()?.checked_sub(number.unsigned_abs()),
    }
}
