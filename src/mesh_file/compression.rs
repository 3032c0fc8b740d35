//! The compressors of VTK's XML formats. The file announces the size of each block after decompression.

use super::error::MeshProblem;

/// Compressor of a file's blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compressor {
    Zlib,
    #[cfg(feature = "files")]
    Lz4,
    #[cfg(feature = "files")]
    Lzma,
}

impl Compressor {
    /// Returns the compressor that VTK calls by this name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "vtkZLibDataCompressor" => Some(Compressor::Zlib),
            #[cfg(feature = "files")]
            "vtkLZ4DataCompressor" => Some(Compressor::Lz4),
            #[cfg(feature = "files")]
            "vtkLZMADataCompressor" => Some(Compressor::Lzma),
            _ => None,
        }
    }

    /// Decompresses a block to exactly this many bytes. No more than that is allocated and, for a compressor with a largest
    /// ratio, no more than the block can expand to.
    pub fn decompress(self, block: &[u8], size: usize) -> Result<Vec<u8>, MeshProblem> {
        let (what, data) = match self {
            Compressor::Zlib => {
                let data = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(block, size);
                ("a block compressed with zlib, of the size announced", data.map_err(|error| error.to_string()))
            }
            #[cfg(feature = "files")]
            Compressor::Lz4 => ("a block compressed with lz4, of the size announced", lz4(block, size)),
            #[cfg(feature = "files")]
            Compressor::Lzma => ("a block compressed with lzma, of the size announced", lzma(block, size)),
        };
        match data {
            Ok(data) if data.len() == size => Ok(data),
            Ok(data) => Err(MeshProblem::Expected { what, found: format!("{} bytes of {size}", data.len()) }),
            Err(found) => Err(MeshProblem::Expected { what, found }),
        }
    }
}

#[cfg(feature = "files")]
fn lz4(block: &[u8], size: usize) -> Result<Vec<u8>, String> {
    // Each byte of a block adds at most 255 to a length.
    const LARGEST_RATIO: usize = 255;
    if size > block.len().saturating_mul(LARGEST_RATIO) {
        return Err(format!("{} bytes for {size}", block.len()));
    }
    let mut data = vec![0; size];
    let count = lz4_flex::block::decompress_into(block, &mut data).map_err(|error| error.to_string())?;
    data.truncate(count);
    Ok(data)
}

/// VTK writes a block as one xz stream. The crate has no limit of its own, so the sizes of the chunks are added up first.
#[cfg(feature = "files")]
fn lzma(mut block: &[u8], size: usize) -> Result<Vec<u8>, String> {
    if announced_by_xz(block) != Some(size) {
        return Err("a stream of another size".to_owned());
    }
    let mut data = Vec::new();
    lzma_rs::xz_decompress(&mut block, &mut data).map_err(|error| format!("{error:?}"))?;
    Ok(data)
}

/// Returns the size after decompression that the chunks of an xz stream of one LZMA2 block announce; `None` if the data are
/// no such stream (the .xz file format, <https://tukaani.org/xz/xz-file-format.txt>).
#[cfg(feature = "files")]
fn announced_by_xz(stream: &[u8]) -> Option<usize> {
    const STREAM_HEADER: usize = 12;
    const INDEX: u8 = 0;
    let block = stream.get(STREAM_HEADER..)?;
    let header = match *block.first()? {
        INDEX => return None,
        words => 4 * (usize::from(words) + 1),
    };
    let mut chunks = block.get(header..)?;
    let mut size = 0_usize;
    // Control bytes: 0 ends the block; 1 and 2 precede plain data; from 0x80 on they precede compressed data and hold the
    // highest bits of its size; from 0xC0 on, a byte of properties follows.
    let end = loop {
        let number = |at: usize| Some(usize::from(u16::from_be_bytes([*chunks.get(at)?, *chunks.get(at + 1)?])));
        let control = *chunks.first()?;
        let length = match control {
            0 => break &chunks[1..],
            1 | 2 => {
                size += number(1)? + 1;
                3 + number(1)? + 1
            }
            0x80.. => {
                size += (usize::from(control & 0x1f) << 16) + number(1)? + 1;
                5 + usize::from(control >= 0xc0) + number(3)? + 1
            }
            _ => return None,
        };
        chunks = chunks.get(length..)?;
    };
    // After padding and a check of four or eight bytes comes the index, which begins with a zero. Another block would begin
    // with its size instead.
    let at = stream.len() - end.len();
    let padded = at.next_multiple_of(4);
    let check = match stream.get(7)? & 0xf {
        0 => 0,
        1 => 4,
        4 => 8,
        _ => return None,
    };
    (stream.get(padded + check) == Some(&INDEX)).then_some(size)
}
