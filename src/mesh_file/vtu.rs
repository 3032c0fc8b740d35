//! VTK's XML format for unstructured grids: numbers as text, in base64 or raw, inline or appended, uncompressed or
//! compressed with zlib.

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use roxmltree::{Document, Node};

use super::Cells;
use super::error::{Flaw, MeshProblem, Place};
use super::numbers::{Cursor, Encoding, Number};
use super::vtk::CellList;
use crate::Vec3;

/// Reads a whole file. No array may take more than `budget` bytes.
pub fn read(bytes: &[u8], budget: usize) -> Result<Cells, Flaw> {
    let (text, appended) = split(bytes)?;
    let document = Document::parse(&text).map_err(|error| Flaw {
        place: Place::Line(error.pos().row as usize),
        problem: MeshProblem::Expected { what: "XML", found: error.to_string() },
    })?;
    let file = document.root_element();
    if file.attribute("type") != Some("UnstructuredGrid") {
        let found = file.attribute("type").unwrap_or_default().to_owned();
        return Err(MeshProblem::Expected { what: "VTKFile of type UnstructuredGrid", found }.into());
    }
    let pieces: Vec<Node> = file.descendants().filter(|node| node.has_tag_name("Piece")).collect();
    let &[piece] = pieces.as_slice() else {
        return Err(MeshProblem::Variety(format!("VTK XML of {} pieces", pieces.len())).into());
    };
    let arrays = Arrays::new(file, appended, budget)?;

    let points = child(piece, "Points")?;
    let points = points.children().find(|node| node.has_tag_name("DataArray"));
    let points = points.ok_or(MeshProblem::Missing("points"))?;
    let coordinates = arrays.read(points, |cursor, number, what| cursor.real(number, what))?;
    let cells = child(piece, "Cells")?;
    let named = |name: &'static str| {
        let found = cells.children().find(|node| node.attribute("Name") == Some(name));
        arrays.read(found.ok_or(MeshProblem::Missing(name))?, |cursor, number, what| cursor.index(number, what))
    };
    let list = CellList { connectivity: named("connectivity")?, ends: named("offsets")?, types: named("types")? };
    let (positions, rest) = coordinates.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(MeshProblem::Missing("three coordinates for every point").into());
    }
    list.cells(positions.iter().copied().map(Vec3::from).collect())
}

fn child<'a>(node: Node<'a, 'a>, name: &'static str) -> Result<Node<'a, 'a>, MeshProblem> {
    node.children().find(|node| node.has_tag_name(name)).ok_or(MeshProblem::Missing(name))
}

/// Splits off the appended data. Returns the XML without it, as it need not be text, and the appended data from behind
/// its `_` on.
fn split(bytes: &[u8]) -> Result<(String, Option<&[u8]>), Flaw> {
    const TAG: &[u8] = b"<AppendedData";
    const WHAT: &str = "appended data";
    let mut cursor = Cursor::new(bytes, Encoding::Little);
    let tag = bytes.windows(TAG.len()).position(|window| window == TAG);
    let (head, appended) = match tag {
        None => (bytes, None),
        Some(tag) => {
            cursor.take(tag, WHAT)?;
            cursor.skip_past(b">", WHAT)?;
            let head = &bytes[..cursor.position()];
            cursor.skip_past(b"_", WHAT)?;
            (head, Some(&bytes[cursor.position()..]))
        }
    };
    let text = std::str::from_utf8(head).map_err(|error| Flaw {
        place: Place::Byte(error.valid_up_to()),
        problem: MeshProblem::Expected { what: "XML", found: "bytes that are not text".to_owned() },
    })?;
    let closing = if appended.is_some() { "</AppendedData></VTKFile>" } else { "" };
    Ok((text.to_owned() + closing, appended))
}

/// Settings by which the arrays of this file are read.
struct Arrays<'a> {
    encoding: Encoding,
    /// Type of the byte counts.
    header: Number,
    is_compressed: bool,
    appended: Option<&'a [u8]>,
    is_raw: bool,
    budget: usize,
}

impl<'a> Arrays<'a> {
    fn new(file: Node, appended: Option<&'a [u8]>, budget: usize) -> Result<Self, MeshProblem> {
        let variety = |what: &str, value: &str| Err(MeshProblem::Variety(format!("VTK XML with {what} {value:?}")));
        let encoding = match file.attribute("byte_order").unwrap_or("LittleEndian") {
            "LittleEndian" => Encoding::Little,
            "BigEndian" => Encoding::Big,
            other => return variety("byte_order", other),
        };
        let header = match file.attribute("header_type").unwrap_or("UInt32") {
            "UInt32" => Number::U32,
            "UInt64" => Number::U64,
            other => return variety("header_type", other),
        };
        let is_compressed = match file.attribute("compressor") {
            None => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => return variety("compressor", other),
        };
        let data = file.children().find(|node| node.has_tag_name("AppendedData"));
        let is_raw = match data.and_then(|node| node.attribute("encoding")) {
            None | Some("base64") => false,
            Some("raw") => true,
            Some(other) => return variety("encoding", other),
        };
        Ok(Self { encoding, header, is_compressed, appended, is_raw, budget })
    }

    /// Reads all numbers of an array.
    fn read<T>(
        &self,
        array: Node,
        next: impl Fn(&mut Cursor, Number, &'static str) -> Result<T, Flaw>,
    ) -> Result<Vec<T>, Flaw> {
        const WHAT: &str = "a number of an array";
        let variety = |value: &str| MeshProblem::Variety(format!("VTK XML with an array of {value:?}"));
        let number = match array.attribute("type").unwrap_or_default() {
            "Int8" => Number::I8,
            "UInt8" => Number::U8,
            "Int16" => Number::I16,
            "UInt16" => Number::U16,
            "Int32" => Number::I32,
            "UInt32" => Number::U32,
            "Int64" => Number::I64,
            "UInt64" => Number::U64,
            "Float32" => Number::F32,
            "Float64" => Number::F64,
            other => return Err(variety(other).into()),
        };
        let written: String = array.children().filter(Node::is_text).filter_map(|node| node.text()).collect();
        let (data, encoding) = match array.attribute("format").unwrap_or("ascii") {
            "ascii" => (written.as_bytes().to_vec(), Encoding::Text),
            "binary" => (self.payload(&decoded(written.as_bytes())?)?, self.encoding),
            "appended" => {
                let offset = array.attribute("offset").and_then(|offset| offset.parse::<usize>().ok());
                let start = self.appended.zip(offset).and_then(|(data, offset)| data.get(offset..));
                let start = start.ok_or(MeshProblem::Missing("appended data for every array"))?;
                let data = if self.is_raw { self.payload(start)? } else { self.payload(&decoded(start)?)? };
                (data, self.encoding)
            }
            other => return Err(variety(other).into()),
        };
        // Reading ends at the array's own end, so an error states the line of its element.
        let place = Place::Line(array.document().text_pos_at(array.range().start).row as usize);
        let placed = |flaw: Flaw| Flaw { place, ..flaw };
        let mut cursor = Cursor::new(&data, encoding);
        let mut numbers = Vec::new();
        while !cursor.is_at_end() {
            numbers.push(next(&mut cursor, number, WHAT).map_err(placed)?);
        }
        Ok(numbers)
    }

    /// Returns the data behind the header, which holds the number of bytes, or of blocks with their sizes before and
    /// after compression.
    fn payload(&self, bytes: &[u8]) -> Result<Vec<u8>, Flaw> {
        const WHAT: &str = "the data that the header of an array announces";
        let mut cursor = Cursor::new(bytes, self.encoding);
        let size = |value: u64| usize::try_from(value).unwrap_or(usize::MAX);
        if !self.is_compressed {
            let count = cursor.index(self.header, WHAT)?;
            return Ok(cursor.take(size(count), WHAT)?.to_vec());
        }
        let blocks = cursor.index(self.header, WHAT)?;
        cursor.skip(self.header, 2, WHAT)?;
        let sizes = cursor.indices(self.header, blocks, WHAT)?;
        let mut data = Vec::new();
        for compressed in sizes {
            let block = cursor.take(size(compressed), WHAT)?;
            let left = self.budget.saturating_sub(data.len());
            let block = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(block, left).map_err(|error| {
                match error.status {
                    miniz_oxide::inflate::TINFLStatus::HasMoreOutput => super::too_large(self.budget),
                    _ => MeshProblem::Expected { what: "a block compressed with zlib", found: error.to_string() },
                }
            })?;
            data.extend(block);
        }
        Ok(data)
    }
}

/// Decodes base64. Header and data may each have been encoded, and padded, separately.
fn decoded(text: &[u8]) -> Result<Vec<u8>, Flaw> {
    const ENGINE: GeneralPurpose = GeneralPurpose::new(
        &STANDARD,
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
    );
    let text: Vec<u8> = text.iter().copied().filter(|byte| !byte.is_ascii_whitespace()).collect();
    // Appended text ends where the element does.
    let text = text.split(|&byte| byte == b'<').next().unwrap_or_default();
    let mut bytes = Vec::new();
    for part in text.split(|&byte| byte == b'=').filter(|part| !part.is_empty()) {
        let decoded = ENGINE.decode(part);
        bytes.extend(decoded.map_err(|error| MeshProblem::Expected { what: "base64", found: error.to_string() })?);
    }
    Ok(bytes)
}
