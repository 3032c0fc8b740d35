//! VTK's legacy format, as text and binary (big-endian), versions 1 to 5.1: unstructured grids and poly data. Keywords are
//! case-insensitive, and text may continue on any line, as in VTK's own reader (`vtkDataReader.cxx`).

use super::cells::Cells;
use super::error::{Flaw, MeshProblem};
use super::numbers::{Cursor, Encoding, Number};
use super::vtk::{CellList, POLYGON, STRIP};
use crate::Vec3;

/// Reads a whole file.
pub fn read(bytes: &[u8]) -> Result<Cells, Flaw> {
    let mut cursor = Cursor::new(bytes, Encoding::Text);
    let first = cursor.line().unwrap_or_default();
    let version = first
        .strip_prefix(b"# vtk DataFile Version")
        .ok_or_else(|| cursor.expected("# vtk DataFile Version", first))?;
    // From version 5 on cells have offsets.
    let has_offsets = version.trim_ascii().first().is_some_and(|&digit| digit >= b'5');
    // The title.
    cursor.line();
    let encoding = match keyword(&mut cursor).as_slice() {
        b"ascii" => Encoding::Text,
        b"binary" => Encoding::Big,
        other => return Err(cursor.expected("ASCII or BINARY", other)),
    };
    let dataset = keyword(&mut cursor);
    if dataset != b"dataset" {
        return Err(cursor.expected("DATASET", &dataset));
    }
    match keyword(&mut cursor).as_slice() {
        b"unstructured_grid" | b"polydata" => {}
        b"structured_points" => return Err(variety(&cursor, "VTK's DATASET STRUCTURED_POINTS")),
        b"structured_grid" => return Err(variety(&cursor, "VTK's DATASET STRUCTURED_GRID")),
        b"rectilinear_grid" => return Err(variety(&cursor, "VTK's DATASET RECTILINEAR_GRID")),
        other => return Err(cursor.expected("UNSTRUCTURED_GRID or POLYDATA", other)),
    }
    cursor.encoding = encoding;

    let mut points = Vec::new();
    let mut list = CellList::default();
    loop {
        match keyword(&mut cursor).as_slice() {
            b"points" => points = positions(&mut cursor)?,
            b"cells" => cell_list(&mut cursor, has_offsets, &mut list)?,
            b"cell_types" => {
                let count = cursor.word("the number of cells")?;
                cursor.begin_data();
                list.types = cursor.indices(Number::I32, count, "the type of a cell")?;
            }
            b"polygons" => polygons(&mut cursor, has_offsets, &mut list, POLYGON)?,
            b"triangle_strips" => polygons(&mut cursor, has_offsets, &mut list, STRIP)?,
            b"vertices" | b"lines" => cell_list(&mut cursor, has_offsets, &mut CellList::default())?,
            b"field" => field(&mut cursor)?,
            b"metadata" => metadata(&mut cursor),
            // Data of points and cells come last, and are not needed.
            b"" | b"point_data" | b"cell_data" => break,
            other => return Err(cursor.expected("POINTS, CELLS, CELL_TYPES or POLYGONS", other)),
        }
    }
    list.cells(points)
}

/// Returns the next word in lower case; empty at the end of the file.
fn keyword(cursor: &mut Cursor) -> Vec<u8> {
    cursor.next_word().unwrap_or_default().to_ascii_lowercase()
}

fn variety(cursor: &Cursor, name: &str) -> Flaw {
    cursor.flaw(MeshProblem::Variety(name.to_owned()))
}

fn number(cursor: &mut Cursor) -> Result<Number, Flaw> {
    let name: String = cursor.word("the type of numbers")?;
    Ok(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" | "vtktypeint8" => Number::I8,
        "unsigned_char" | "vtktypeuint8" => Number::U8,
        "short" | "vtktypeint16" => Number::I16,
        "unsigned_short" | "vtktypeuint16" => Number::U16,
        "int" | "vtktypeint32" | "vtkidtype" => Number::I32,
        "unsigned_int" | "vtktypeuint32" => Number::U32,
        "long" | "long_long" | "vtktypeint64" => Number::I64,
        "unsigned_long" | "unsigned_long_long" | "vtktypeuint64" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return Err(variety(cursor, &format!("VTK with numbers of the type {name}"))),
    })
}

fn positions(cursor: &mut Cursor) -> Result<Vec<Vec3>, Flaw> {
    let count: u64 = cursor.word("the number of points")?;
    let number = number(cursor)?;
    cursor.begin_data();
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

/// Appends cells that have no types of their own.
fn polygons(cursor: &mut Cursor, has_offsets: bool, list: &mut CellList, kind: u64) -> Result<(), Flaw> {
    cell_list(cursor, has_offsets, list)?;
    list.types.resize(list.ends.len(), kind);
    Ok(())
}

fn cell_list(cursor: &mut Cursor, has_offsets: bool, list: &mut CellList) -> Result<(), Flaw> {
    let first: u64 = cursor.word("the number of cells")?;
    let second: u64 = cursor.word("the size of the list of cells")?;
    cursor.begin_data();
    let start = list.connectivity.len() as u64;
    if has_offsets {
        // Offsets give where each cell begins, and where the last one ends.
        let offsets = array(cursor, "OFFSETS", first)?;
        list.ends.extend(offsets.iter().skip(1).map(|end| end.saturating_add(start)));
        list.connectivity.extend(array(cursor, "CONNECTIVITY", second)?);
        return Ok(());
    }
    for _ in 0..first {
        let corners = cursor.index(Number::I32, "the number of a cell's nodes")?;
        list.connectivity.extend(cursor.indices(Number::I32, corners, "a node of a cell")?);
        list.ends.push(list.connectivity.len() as u64);
    }
    Ok(())
}

fn array(cursor: &mut Cursor, name: &'static str, count: u64) -> Result<Vec<u64>, Flaw> {
    let word = cursor.next_word().unwrap_or_default();
    if !word.eq_ignore_ascii_case(name.as_bytes()) {
        return Err(cursor.expected(name, word));
    }
    let number = number(cursor)?;
    cursor.begin_data();
    cursor.indices(number, count, name)
}

/// Skips a section of names and numbers, which ends at the next empty line; the rest of this line does not count.
fn metadata(cursor: &mut Cursor) {
    cursor.line();
    while cursor.line().is_some_and(|line| !line.is_empty()) {}
}

/// Skips arrays before the points, such as the time, which are not needed.
fn field(cursor: &mut Cursor) -> Result<(), Flaw> {
    const WHAT: &str = "a value of a field";
    cursor.word::<String>("the name of a field")?;
    let arrays: u64 = cursor.word("the number of arrays")?;
    for _ in 0..arrays {
        let mut name: String = cursor.word("the name of an array")?;
        // The metadata of an array may precede the name of the next one.
        while name.eq_ignore_ascii_case("metadata") {
            metadata(cursor);
            name = cursor.word("the name of an array")?;
        }
        if name == "NULL_ARRAY" {
            continue;
        }
        let components: u64 = cursor.word("a number of components")?;
        let tuples: u64 = cursor.word("a number of tuples")?;
        let count = components.saturating_mul(tuples);
        let mut peek = cursor.clone();
        match (keyword(&mut peek).as_slice(), cursor.encoding) {
            (b"string" | b"utf8_string", Encoding::Text) => {
                peek.line();
                for _ in 0..count {
                    peek.line().ok_or_else(|| peek.ended(WHAT))?;
                }
                *cursor = peek;
            }
            (b"string" | b"utf8_string", _) => {
                peek.line();
                for _ in 0..count {
                    let length = string_length(&mut peek)?;
                    peek.take(length, WHAT)?;
                }
                *cursor = peek;
            }
            (b"bit", Encoding::Text) => {
                peek.skip(Number::U8, count, WHAT)?;
                *cursor = peek;
            }
            (b"bit", _) => {
                peek.line();
                peek.skip(Number::U8, count.div_ceil(8), WHAT)?;
                *cursor = peek;
            }
            _ => {
                let number = number(cursor)?;
                cursor.begin_data();
                cursor.skip(number, count, WHAT)?;
            }
        }
    }
    Ok(())
}

/// Length of a string in binary: the first two bits give the size of the number that the others begin.
fn string_length(cursor: &mut Cursor) -> Result<usize, Flaw> {
    const WHAT: &str = "the length of a string";
    let first = cursor.take(1, WHAT)?[0];
    let following = match first >> 6 {
        3 => 0,
        2 => 1,
        1 => 3,
        _ => 7,
    };
    let start = u64::from(first & 0x3f);
    let length = cursor.take(following, WHAT)?.iter().fold(start, |length, &byte| length << 8 | u64::from(byte));
    Ok(usize::try_from(length).unwrap_or(usize::MAX))
}
