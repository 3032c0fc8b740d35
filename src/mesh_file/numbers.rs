//! A reader of a file's words and numbers in sequence. Counts in a file are never trusted: nothing is allocated for
//! data that has not been read.

use super::error::{Flaw, MeshProblem, Place};

/// Encoding of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Text: words between white space.
    Text,
    /// Binary, little-endian.
    Little,
    /// Binary, big-endian.
    Big,
}

/// Type of a binary number. In text all types are alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Number {
    /// Size, bytes.
    pub fn size(self) -> usize {
        match self {
            Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::I64 | Number::U64 | Number::F64 => 8,
        }
    }

    fn real(self, bits: u64) -> f64 {
        match self {
            Number::I8 => f64::from(bits as i8),
            Number::I16 => f64::from(bits as i16),
            Number::I32 => f64::from(bits as i32),
            Number::I64 => bits as i64 as f64,
            Number::U8 | Number::U16 | Number::U32 | Number::U64 => bits as f64,
            Number::F32 => f64::from(f32::from_bits(bits as u32)),
            Number::F64 => f64::from_bits(bits),
        }
    }

    /// Converts bits to an index; `None` for types or values that cannot be one.
    fn index(self, bits: u64) -> Option<u64> {
        match self {
            Number::I8 => u64::try_from(bits as i8).ok(),
            Number::I16 => u64::try_from(bits as i16).ok(),
            Number::I32 => u64::try_from(bits as i32).ok(),
            Number::I64 => u64::try_from(bits as i64).ok(),
            Number::U8 | Number::U16 | Number::U32 | Number::U64 => Some(bits),
            Number::F32 | Number::F64 => None,
        }
    }
}

/// A position in a file that advances with every read.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Start of the word, line or number that was read last: the place that an error about it states.
    last: usize,
    /// Encoding of the numbers from this position on.
    pub encoding: Encoding,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8], encoding: Encoding) -> Self {
        Self { bytes, at: 0, last: 0, encoding }
    }

    /// Returns a problem with what was read last, placed at its line in text and at its byte in binary data.
    pub fn flaw(&self, problem: MeshProblem) -> Flaw {
        let place = match self.encoding {
            Encoding::Text => Place::Line(self.line_number()),
            Encoding::Little | Encoding::Big => Place::Byte(self.last),
        };
        Flaw { place, problem }
    }

    /// Line of what was read last, counted from 1.
    pub fn line_number(&self) -> usize {
        1 + self.bytes[..self.last].iter().filter(|&&byte| byte == b'\n').count()
    }

    /// Returns the problem that the data end too early, placed at the last line with any content.
    pub fn ended(&mut self, what: &'static str) -> Flaw {
        self.last = self.at.min(self.bytes.trim_ascii_end().len());
        self.flaw(MeshProblem::Ended(what))
    }

    /// Returns the problem that something unexpected was read.
    pub fn expected(&self, what: &'static str, found: &[u8]) -> Flaw {
        const SHOWN: usize = 40;
        let found = String::from_utf8_lossy(&found[..found.len().min(SHOWN)]).into_owned();
        self.flaw(MeshProblem::Expected { what, found })
    }

    /// Number of bytes read so far.
    pub fn position(&self) -> usize {
        self.at
    }

    /// Whether nothing is left, apart from white space in text.
    pub fn is_at_end(&self) -> bool {
        let rest = &self.bytes[self.at..];
        match self.encoding {
            Encoding::Text => rest.iter().all(u8::is_ascii_whitespace),
            Encoding::Little | Encoding::Big => rest.is_empty(),
        }
    }

    /// Returns the rest of this line, without white space around it; `None` at the end of the file.
    pub fn line(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        self.last = self.at;
        let length = rest.iter().position(|&byte| byte == b'\n');
        self.at += length.map_or(rest.len(), |length| length + 1);
        Some(rest[..length.unwrap_or(rest.len())].trim_ascii())
    }

    /// Skips the rest of this line, which counts as read with what came before it.
    pub fn rest_of_line(&mut self) {
        let last = self.last;
        self.line();
        self.last = last;
    }

    /// Returns the next word of this line; `None` at its end, which counts as read too. A backslash at its end continues
    /// the line.
    pub fn word_on_line(&mut self) -> Option<&'a [u8]> {
        loop {
            let rest = &self.bytes[self.at..];
            let space =
                rest.iter().position(|byte| !byte.is_ascii_whitespace() || *byte == b'\n').unwrap_or(rest.len());
            if rest.get(space).is_none_or(|byte| *byte == b'\n') {
                self.at += space + usize::from(space < rest.len());
                return None;
            }
            match self.next_word() {
                Some(b"\\") => {
                    self.rest_of_line();
                }
                word => return word,
            }
        }
    }

    /// Returns the next line that is not blank.
    pub fn full_line(&mut self) -> Option<&'a [u8]> {
        loop {
            match self.line() {
                Some([]) => {}
                other => return other,
            }
        }
    }

    /// Returns the next word, also within binary data; `None` at the end of the file.
    pub fn next_word(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
        let word = &rest[start..];
        let word = &word[..word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len())];
        self.last = self.at + start;
        self.at = self.last + word.len();
        (!word.is_empty()).then_some(word)
    }

    /// Reads the next word as a number or a name.
    pub fn word<T: std::str::FromStr>(&mut self, what: &'static str) -> Result<T, Flaw> {
        let word = self.next_word().ok_or_else(|| self.ended(what))?;
        let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        value.ok_or_else(|| self.expected(what, word))
    }

    /// Reads this many bytes.
    pub fn take(&mut self, count: usize, what: &'static str) -> Result<&'a [u8], Flaw> {
        let Some(taken) = self.bytes[self.at..].get(..count) else {
            self.last = self.bytes.len();
            return Err(self.flaw(MeshProblem::Ended(what)));
        };
        self.last = self.at;
        self.at += count;
        Ok(taken)
    }

    /// Moves behind the next occurrence of a mark.
    pub fn skip_past(&mut self, mark: &[u8], what: &'static str) -> Result<(), Flaw> {
        let found = self.bytes[self.at..].windows(mark.len()).position(|window| window == mark);
        self.at += found.ok_or_else(|| self.flaw(MeshProblem::Ended(what)))? + mark.len();
        Ok(())
    }

    /// Moves to the beginning of the data after a keyword: binary data begin on the next line, text may begin on any.
    pub fn begin_data(&mut self) {
        if self.encoding != Encoding::Text {
            self.line();
        }
    }

    fn bits(&mut self, number: Number, what: &'static str) -> Result<u64, Flaw> {
        let taken = self.take(number.size(), what)?;
        let mut bytes = [0; 8];
        bytes[..taken.len()].copy_from_slice(taken);
        if self.encoding == Encoding::Big {
            bytes[..taken.len()].reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }

    /// Reads the next number as a coordinate.
    pub fn real(&mut self, number: Number, what: &'static str) -> Result<f64, Flaw> {
        match self.encoding {
            Encoding::Text => self.word(what),
            Encoding::Little | Encoding::Big => Ok(number.real(self.bits(number, what)?)),
        }
    }

    /// Reads the next number as a count or an index.
    pub fn index(&mut self, number: Number, what: &'static str) -> Result<u64, Flaw> {
        match self.encoding {
            Encoding::Text => self.word(what),
            Encoding::Little | Encoding::Big => {
                let bits = self.bits(number, what)?;
                number
                    .index(bits)
                    .ok_or_else(|| self.flaw(MeshProblem::Expected { what, found: number.real(bits).to_string() }))
            }
        }
    }

    /// Reads this many counts or indices.
    pub fn indices(&mut self, number: Number, count: u64, what: &'static str) -> Result<Vec<u64>, Flaw> {
        (0..count).map(|_| self.index(number, what)).collect()
    }

    /// Skips this many numbers.
    pub fn skip(&mut self, number: Number, count: u64, what: &'static str) -> Result<(), Flaw> {
        match self.encoding {
            Encoding::Text => {
                for _ in 0..count {
                    self.next_word().ok_or_else(|| self.ended(what))?;
                }
            }
            Encoding::Little | Encoding::Big => {
                let bytes = usize::try_from(count).ok().and_then(|count| count.checked_mul(number.size()));
                self.take(bytes.unwrap_or(usize::MAX), what)?;
            }
        }
        Ok(())
    }
}
