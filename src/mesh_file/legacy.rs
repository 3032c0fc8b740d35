//! VTK's legacy format, as text and binary (big-endian), versions 1 to 5.1: unstructured grids, and poly data of
//! triangles.

use super::Cells;
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use super::vtk::{CellList, POLYGON};
use crate::Vec3;

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let first = cursor.line().unwrap_or_default();
    let version = first
        .strip_prefix(b"# vtk DataFile Version ")
        .ok_or_else(|| cursor.expected("# vtk DataFile Version", first))?;
    // From version 5 on cells have offsets.
    let has_offsets = version.first().is_some_and(|&digit| digit >= b'5');
    cursor.line();
    cursor.encoding = match cursor.line().unwrap_or_default() {
        b"ASCII" => Encoding::Text,
        b"BINARY" => Encoding::Big,
        other => return Err(cursor.expected("ASCII or BINARY", other)),
    };
    let dataset = cursor.full_line().unwrap_or_default();
    if !matches!(dataset, b"DATASET UNSTRUCTURED_GRID" | b"DATASET POLYDATA") {
        return Err(cursor.expected("DATASET UNSTRUCTURED_GRID or DATASET POLYDATA", dataset));
    }

    let mut points = Vec::new();
    let mut list = CellList::default();
    while let Some(word) = cursor.next_word() {
        match word {
            b"POINTS" => points = positions(&mut cursor)?,
            b"CELLS" => cell_list(&mut cursor, has_offsets, &mut list)?,
            b"CELL_TYPES" => {
                let count = cursor.word("the number of cells")?;
                cursor.line();
                list.types = cursor.indices(Number::I32, count, "the type of a cell")?;
            }
            b"POLYGONS" => {
                cell_list(&mut cursor, has_offsets, &mut list)?;
                list.types = vec![POLYGON; list.ends.len()];
            }
            b"VERTICES" | b"LINES" => cell_list(&mut cursor, has_offsets, &mut CellList::default())?,
            b"FIELD" => field(&mut cursor)?,
            b"METADATA" => {
                // The section ends at the next empty line; the rest of this line does not count.
                cursor.line();
                while cursor.line().is_some_and(|line| !line.is_empty()) {}
            }
            // Data of points and cells come last, and are not needed.
            b"POINT_DATA" | b"CELL_DATA" => break,
            other => return Err(cursor.expected("POINTS, CELLS, CELL_TYPES or POLYGONS", other)),
        }
    }
    list.cells(points)
}

fn number(cursor: &mut Cursor) -> Result<Number, Flaw> {
    let name: String = cursor.word("the type of numbers")?;
    Ok(match name.to_ascii_lowercase().as_str() {
        "char" | "vtktypeint8" => Number::I8,
        "unsigned_char" | "vtktypeuint8" => Number::U8,
        "short" | "vtktypeint16" => Number::I16,
        "unsigned_short" | "vtktypeuint16" => Number::U16,
        "int" | "vtktypeint32" | "vtkidtype" => Number::I32,
        "unsigned_int" | "vtktypeuint32" => Number::U32,
        "long" | "long_long" | "vtktypeint64" => Number::I64,
        "unsigned_long" | "unsigned_long_long" | "vtktypeuint64" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return Err(cursor.flaw(MeshProblem::Variety(format!("VTK with numbers of the type {name}")))),
    })
}

fn positions(cursor: &mut Cursor) -> Result<Vec<Vec3>, Flaw> {
    let count: u64 = cursor.word("the number of points")?;
    let number = number(cursor)?;
    cursor.line();
    let mut points = Vec::new();
    for _ in 0..count {
        let mut position = Vec3::zeros();
        for axis in 0..3 {
            position[axis] = cursor.real(number, "a coordinate")?;
        }
        points.push(position);
    }
    Ok(points)
}

fn cell_list(cursor: &mut Cursor, has_offsets: bool, list: &mut CellList) -> Result<(), Flaw> {
    let first: u64 = cursor.word("the number of cells")?;
    let second: u64 = cursor.word("the size of the list of cells")?;
    cursor.line();
    if has_offsets {
        let offsets = array(cursor, "OFFSETS", first)?;
        // Offsets give where each cell begins, and where the last one ends.
        list.ends = offsets.get(1..).unwrap_or_default().to_vec();
        list.connectivity = array(cursor, "CONNECTIVITY", second)?;
        return Ok(());
    }
    (list.ends, list.connectivity) = Default::default();
    for _ in 0..first {
        let corners = cursor.index(Number::I32, "the number of a cell's nodes")?;
        list.connectivity.extend(cursor.indices(Number::I32, corners, "a node of a cell")?);
        list.ends.push(list.connectivity.len() as u64);
    }
    Ok(())
}

fn array(cursor: &mut Cursor, name: &'static str, count: u64) -> Result<Vec<u64>, Flaw> {
    let word = cursor.next_word().unwrap_or_default();
    if word != name.as_bytes() {
        return Err(cursor.expected(name, word));
    }
    let number = number(cursor)?;
    cursor.line();
    cursor.indices(number, count, name)
}

/// Skips arrays before the points, such as the time, which are not needed.
fn field(cursor: &mut Cursor) -> Result<(), Flaw> {
    cursor.word::<String>("the name of a field")?;
    let arrays: u64 = cursor.word("the number of arrays")?;
    for _ in 0..arrays {
        cursor.word::<String>("the name of an array")?;
        let components: u64 = cursor.word("a number of components")?;
        let tuples: u64 = cursor.word("a number of tuples")?;
        let number = number(cursor)?;
        cursor.line();
        cursor.skip(number, components.saturating_mul(tuples), "a number of a field")?;
    }
    Ok(())
}
