//! VTK's XML formats for unstructured grids and poly data: numbers as text, in base64 or raw, inline or appended, plain or
//! compressed. Announced sizes are checked against the data before memory of that size is allocated.

use std::cell::Cell;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use roxmltree::{Document, Node, ParsingOptions};

use super::BYTES_PER_BYTE;
use super::cells::Cells;
use super::compression::Compressor;
use super::error::{Flaw, MeshProblem, Place};
use super::numbers::{Cursor, Encoding, Number};
use super::vtk::{CellList, POLYGON, STRIP};
use crate::Vec3;

/// Kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `.vtu`
    UnstructuredGrid,
    /// `.vtp`
    PolyData,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::UnstructuredGrid => "UnstructuredGrid",
            Kind::PolyData => "PolyData",
        }
    }
}

/// Reads a whole file. Reading may take `budget` bytes of memory.
pub fn read(bytes: &[u8], kind: Kind, budget: u64) -> Result<Cells, Flaw> {
    let (text, appended) = split(bytes)?;
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options).map_err(|error| Flaw {
        place: Place::Line(error.pos().row as usize),
        problem: MeshProblem::Expected { what: "XML", found: error.to_string() },
    })?;
    let file = document.root_element();
    if file.attribute("type") != Some(kind.name()) {
        let found = file.attribute("type").unwrap_or_default().to_owned();
        let what = match kind {
            Kind::UnstructuredGrid => "VTKFile of type UnstructuredGrid",
            Kind::PolyData => "VTKFile of type PolyData",
        };
        return Err(Flaw { place: line_of(file), problem: MeshProblem::Expected { what, found } });
    }
    let arrays = Arrays::new(file, appended, budget).map_err(|problem| Flaw { place: line_of(file), problem })?;
    let mut cells = Cells::default();
    for piece in file.descendants().filter(|node| node.has_tag_name("Piece")) {
        let points = count(piece, "NumberOfPoints")?;
        // ParaView writes pieces without points for processes that have no part of a body.
        if points == 0 {
            continue;
        }
        let first = cells.nodes.len() as u64;
        let array = child(piece, "Points")?.children().find(|node| node.has_tag_name("DataArray"));
        let array = array.ok_or_else(|| missing(piece, "array of points"))?;
        if let Some(components) = array.attribute("NumberOfComponents").filter(|text| text.trim() != "3") {
            let found = components.to_owned();
            let problem = MeshProblem::Expected { what: "points of 3 components", found };
            return Err(Flaw { place: line_of(array), problem });
        }
        let coordinates = arrays.read(array, "coordinates of points", points.saturating_mul(3), real)?;
        cells.nodes.extend(coordinates.as_chunks::<3>().0.iter().copied().map(Vec3::from));
        match kind {
            Kind::UnstructuredGrid => {
                let cells_in_piece = count(piece, "NumberOfCells")?;
                let mut list = arrays.cell_list(child(piece, "Cells")?, cells_in_piece)?;
                let types = array_named(child(piece, "Cells")?, "types")?;
                list.types = arrays.read(types, "types of cells", cells_in_piece, index)?;
                list.add_to(&mut cells, first)?;
            }
            Kind::PolyData => {
                for (number, name, kind) in [("NumberOfPolys", "Polys", POLYGON), ("NumberOfStrips", "Strips", STRIP)] {
                    let polygons = if piece.has_attribute(number) { count(piece, number)? } else { 0 };
                    if polygons > 0 {
                        let mut list = arrays.cell_list(child(piece, name)?, polygons)?;
                        list.types = vec![kind; list.ends.len()];
                        list.add_to(&mut cells, first)?;
                    }
                }
            }
        }
    }
    if cells.nodes.is_empty() {
        return Err(MeshProblem::Missing("points").into());
    }
    Ok(cells)
}

fn line_of(node: Node) -> Place {
    Place::Line(node.document().text_pos_at(node.range().start).row as usize)
}

fn missing(node: Node, what: &'static str) -> Flaw {
    Flaw { place: line_of(node), problem: MeshProblem::Missing(what) }
}

fn child<'a>(node: Node<'a, 'a>, name: &'static str) -> Result<Node<'a, 'a>, Flaw> {
    node.children().find(|child| child.has_tag_name(name)).ok_or_else(|| missing(node, name))
}

fn array_named<'a>(node: Node<'a, 'a>, name: &'static str) -> Result<Node<'a, 'a>, Flaw> {
    node.children().find(|child| child.attribute("Name") == Some(name)).ok_or_else(|| missing(node, name))
}

/// Returns a number that an attribute announces.
fn count(node: Node, name: &'static str) -> Result<u64, Flaw> {
    let text = node.attribute(name).ok_or_else(|| missing(node, name))?;
    let expected = || MeshProblem::Expected { what: name, found: text.to_owned() };
    text.trim().parse().map_err(|_| Flaw { place: line_of(node), problem: expected() })
}

/// Splits off the appended data. Returns the XML without the appended data, which need not be text, and the data after its
/// `_`.
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
    bounded(head)?;
    let text = match std::str::from_utf8(head) {
        Ok(text) => text.to_owned(),
        // Every byte of Latin-1 is the character with the same number.
        Err(_) if is_latin(head) => head.iter().copied().map(char::from).collect(),
        Err(error) => {
            let found = "bytes that are neither UTF-8 nor declared as ISO-8859-1".to_owned();
            return Err(Flaw {
                place: Place::Byte(error.valid_up_to()),
                problem: MeshProblem::Expected { what: "XML", found },
            });
        }
    };
    let closing = if appended.is_some() { "</AppendedData></VTKFile>" } else { "" };
    Ok((text + closing, appended))
}

/// Whether the XML declaration has the encoding ISO-8859-1.
fn is_latin(head: &[u8]) -> bool {
    let declaration = head.split(|&byte| byte == b'>').next().unwrap_or_default().to_ascii_lowercase();
    declaration.windows(10).any(|window| window == b"iso-8859-1")
}

/// Rejects what would cost the XML parser more than in proportion to the file: entities, which multiply; tags with many
/// attributes, each of which is compared with all others; and namespaces, which every nested element inherits.
fn bounded(head: &[u8]) -> Result<(), Flaw> {
    const LONGEST_TAG: usize = 4096;
    const MOST_NAMESPACES: usize = 16;
    let fail = |at: usize, found: &str| {
        let line = 1 + head[..at].iter().filter(|&&byte| byte == b'\n').count();
        Flaw { place: Place::Line(line), problem: MeshProblem::Variety(format!("VTK XML with {found}")) }
    };
    let (mut at, mut namespaces) = (0, 0);
    while let Some(open) = head[at..].iter().position(|&byte| byte == b'<') {
        let tag = at + open;
        let end = head[tag..].iter().position(|&byte| byte == b'>').map_or(head.len(), |end| tag + end);
        at = tag + 1;
        if head[tag..].starts_with(b"<!ENTITY") {
            return Err(fail(tag, "entities of its own"));
        }
        if !head[at..].starts_with(b"!") {
            if end - tag > LONGEST_TAG {
                return Err(fail(tag, "a tag of more than 4096 characters"));
            }
            namespaces += usize::from(head[tag..end].windows(5).any(|window| window == b"xmlns"));
            if namespaces > MOST_NAMESPACES {
                return Err(fail(tag, "more namespaces than VTK uses"));
            }
            at = end;
        }
    }
    Ok(())
}

/// Settings by which the arrays of this file are read.
struct Arrays<'a> {
    encoding: Encoding,
    /// Type of the byte counts.
    header: Number,
    compressor: Option<Compressor>,
    appended: Option<&'a [u8]>,
    is_raw: bool,
    /// Memory that reading may take, bytes.
    budget: u64,
    /// Number of bytes to which the file's arrays may still expand.
    left: Cell<u64>,
}

impl<'a> Arrays<'a> {
    fn new(file: Node, appended: Option<&'a [u8]>, budget: u64) -> Result<Self, MeshProblem> {
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
        let compressor = match file.attribute("compressor") {
            None | Some("") => None,
            Some(name) => match Compressor::named(name) {
                Some(compressor) => Some(compressor),
                None => return variety("compressor", name),
            },
        };
        // As in VTK, whatever is not raw is in base64.
        let data = file.children().find(|node| node.has_tag_name("AppendedData"));
        let is_raw = data.and_then(|node| node.attribute("encoding")) == Some("raw");
        let left = Cell::new(budget / BYTES_PER_BYTE);
        Ok(Self { encoding, header, compressor, appended, is_raw, budget, left })
    }

    /// Reads the nodes of this many cells.
    fn cell_list(&self, cells: Node, count: u64) -> Result<CellList, Flaw> {
        let ends = self.read(array_named(cells, "offsets")?, "offsets of cells", count, index)?;
        let nodes = ends.last().copied().unwrap_or(0);
        let connectivity = self.read(array_named(cells, "connectivity")?, "nodes of cells", nodes, index)?;
        Ok(CellList { connectivity, ends, types: Vec::new() })
    }

    /// Reads all numbers of an array, which are to be `count`.
    fn read<T>(
        &self,
        array: Node,
        what: &'static str,
        count: u64,
        next: impl Fn(&mut Cursor, Number, &'static str) -> Result<T, Flaw>,
    ) -> Result<Vec<T>, Flaw> {
        // An error states the line of the array's element; in text, that of the number.
        let place = line_of(array);
        let placed = |problem: MeshProblem| Flaw { place, problem };
        let variety = |value: &str| placed(MeshProblem::Variety(format!("VTK XML with an array of {value:?}")));
        if count == 0 {
            return Ok(Vec::new());
        }
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
            other => return Err(variety(other)),
        };
        let text = array.children().find(Node::is_text);
        let written = text.and_then(|node| node.text()).unwrap_or_default();
        let data = match array.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let mut cursor = Cursor::new(written.as_bytes(), Encoding::Text);
                let first = text.map_or(0, |text| array.document().text_pos_at(text.range().start).row as usize);
                let mut numbers = Vec::new();
                while !cursor.is_at_end() {
                    let value = next(&mut cursor, number, what);
                    let value =
                        value.map_err(|flaw| Flaw { place: Place::Line(first + cursor.line_number() - 1), ..flaw });
                    numbers.push(value?);
                }
                let found = numbers.len() as u64;
                let fits = if found == count {
                    Ok(numbers)
                } else {
                    Err(MeshProblem::Count { what, announced: count, found })
                };
                return fits.map_err(placed);
            }
            "binary" => self.payload(&mut Source::base64(written.as_bytes()), what, count, number.size()),
            "appended" => {
                let offset = array.attribute("offset").and_then(|offset| offset.trim().parse::<usize>().ok());
                let start = self.appended.zip(offset).and_then(|(data, offset)| data.get(offset..));
                let start = start.ok_or_else(|| placed(MeshProblem::Missing("appended data for every array")))?;
                let mut source = if self.is_raw { Source::Raw(start) } else { Source::base64(start) };
                self.payload(&mut source, what, count, number.size())
            }
            other => return Err(variety(other)),
        };
        let data = data.map_err(placed)?;
        let mut cursor = Cursor::new(&data, self.encoding);
        let mut numbers = Vec::new();
        while !cursor.is_at_end() {
            numbers.push(next(&mut cursor, number, what).map_err(|flaw| Flaw { place, ..flaw })?);
        }
        Ok(numbers)
    }

    /// Returns the data behind the header, which holds the number of bytes, or of blocks with their sizes before and
    /// after compression. They are to be `count` numbers of `size` bytes.
    fn payload(
        &self,
        source: &mut Source,
        what: &'static str,
        count: u64,
        size: usize,
    ) -> Result<Vec<u8>, MeshProblem> {
        let fits = |bytes: u64| {
            let announced = count.saturating_mul(size as u64);
            if bytes != announced {
                return Err(MeshProblem::Count { what, announced: count, found: bytes / size as u64 });
            }
            let Some(left) = self.left.get().checked_sub(bytes) else {
                let needed_mib = bytes.saturating_mul(BYTES_PER_BYTE) >> 20;
                return Err(MeshProblem::TooLarge { needed_mib, budget_mib: self.budget >> 20 });
            };
            self.left.set(left);
            Ok(())
        };
        let Some(compressor) = self.compressor else {
            let bytes = self.sizes(source, 1)?[0];
            fits(bytes)?;
            return source.take(bytes);
        };
        // Header: the number of blocks, the size of all but the last, the size of a last one that is smaller, or 0.
        let [blocks, usual, last] = self.sizes(source, 3)?[..] else { return Err(MeshProblem::Ended(HEADER)) };
        let last = if last == 0 { usual } else { last };
        fits(blocks.saturating_sub(1).saturating_mul(usual).saturating_add(last))?;
        let compressed = self.sizes(source, blocks)?;
        let mut data = Vec::new();
        for (block, bytes) in (1..).zip(compressed) {
            let size = if block == blocks { last } else { usual };
            data.extend(compressor.decompress(&source.take(bytes)?, usize::try_from(size).unwrap_or(usize::MAX))?);
        }
        Ok(data)
    }

    /// Reads sizes of a header.
    fn sizes(&self, source: &mut Source, count: u64) -> Result<Vec<u64>, MeshProblem> {
        let bytes = source.take(count.saturating_mul(self.header.size() as u64))?;
        let mut cursor = Cursor::new(&bytes, self.encoding);
        let sizes = (0..count).map(|_| cursor.index(self.header, HEADER));
        sizes.collect::<Result<_, Flaw>>().map_err(|flaw| flaw.problem)
    }
}

const HEADER: &str = "the data that the header of an array announces";

fn index(cursor: &mut Cursor, number: Number, what: &'static str) -> Result<u64, Flaw> {
    cursor.index(number, what)
}

fn real(cursor: &mut Cursor, number: Number, what: &'static str) -> Result<f64, Flaw> {
    cursor.real(number, what)
}

/// Data of an array and of what follows it.
enum Source<'a> {
    Raw(&'a [u8]),
    Base64 {
        text: &'a [u8],
        /// Bytes decoded and not yet taken: fewer than one group of characters holds.
        decoded: Vec<u8>,
    },
}

impl<'a> Source<'a> {
    fn base64(text: &'a [u8]) -> Self {
        Source::Base64 { text, decoded: Vec::new() }
    }

    /// Takes this many bytes. In base64, header and data may each have been encoded, and padded, separately.
    fn take(&mut self, count: u64) -> Result<Vec<u8>, MeshProblem> {
        const ENGINE: GeneralPurpose = GeneralPurpose::new(
            &STANDARD,
            GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
        );
        const GROUP: usize = 4;
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        match self {
            Source::Raw(bytes) => {
                let (taken, rest) = bytes.split_at_checked(count).ok_or(MeshProblem::Ended(HEADER))?;
                *bytes = rest;
                Ok(taken.to_vec())
            }
            Source::Base64 { text, decoded: rest } => {
                let mut taken = std::mem::take(rest);
                let mut group = Vec::with_capacity(GROUP);
                while taken.len() < count {
                    // Appended text ends where the element does.
                    let next = text.split_first().filter(|(byte, _)| **byte != b'<');
                    if let Some((&byte, behind)) = next {
                        *text = behind;
                        if !byte.is_ascii_whitespace() {
                            group.push(byte);
                        }
                    }
                    if group.len() == GROUP || (next.is_none() && !group.is_empty()) {
                        let decoded = ENGINE.decode(&group);
                        let not_base64 = |error: base64::DecodeError| error.to_string();
                        let decoded = decoded.map_err(not_base64);
                        taken.extend(decoded.map_err(|found| MeshProblem::Expected { what: "base64", found })?);
                        group.clear();
                    } else if next.is_none() {
                        return Err(MeshProblem::Ended(HEADER));
                    }
                }
                *rest = taken.split_off(count);
                Ok(taken)
            }
        }
    }
}
