//! Scans words, lines and blocks of numbers of a legacy VTK file.

use std::borrow::Cow;
use std::path::Path;

use glam::DVec3;

use crate::error::{Advice, Error, Result};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles, node_ids, points, values};
use crate::scene::Values;

/// The types of arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DataType {
    /// Numbers, stored in binary files in their own type.
    Number(ScalarType),
    /// VTK's ids: 32 bits in binary files.
    Id,
    /// Bits, eight to a byte in binary files, the highest first.
    Bit,
    /// Text: one percent-encoded line each, or a length and bytes.
    Text,
    /// Values of many types: a line each, in binary files too.
    Variant,
}

impl DataType {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "signed_char" | "vtktypeint8" => Self::Number(ScalarType::I8),
            "unsigned_char" | "vtktypeuint8" => Self::Number(ScalarType::U8),
            "short" | "vtktypeint16" => Self::Number(ScalarType::I16),
            "unsigned_short" | "vtktypeuint16" => Self::Number(ScalarType::U16),
            "int" | "vtktypeint32" => Self::Number(ScalarType::I32),
            "unsigned_int" | "vtktypeuint32" => Self::Number(ScalarType::U32),
            // As on every system but Windows, where they have 32 bits.
            "long" | "vtktypeint64" => Self::Number(ScalarType::I64),
            "unsigned_long" | "vtktypeuint64" => Self::Number(ScalarType::U64),
            "float" => Self::Number(ScalarType::F32),
            "double" => Self::Number(ScalarType::F64),
            "vtkidtype" => Self::Id,
            "bit" => Self::Bit,
            "string" | "utf8_string" => Self::Text,
            "variant" => Self::Variant,
            _ => return None,
        })
    }
}

/// Consecutive numbers, in the file's bytes or parsed from its text.
#[derive(Debug)]
pub(super) struct Block<'a> {
    bytes: Cow<'a, [u8]>,
    encoding: Encoding,
}

impl Block<'_> {
    fn len(&self) -> usize {
        self.bytes.len() / self.encoding.scalar.size()
    }

    /// The numbers of one of `component_count` interleaved components.
    pub(super) fn component(&self, component: usize, component_count: usize) -> Option<Values> {
        let size = self.encoding.scalar.size();
        let stride = Stride {
            first: component * size,
            step: component_count * size,
            count: self.len() / component_count,
        };
        values(&self.bytes, self.encoding, stride)
    }

    /// All numbers in double precision.
    pub(super) fn doubles(&self) -> Option<Vec<f64>> {
        let stride = Stride {
            first: 0,
            step: self.encoding.scalar.size(),
            count: self.len(),
        };
        doubles(&self.bytes, self.encoding, stride)
    }

    /// All numbers as positions.
    pub(super) fn positions(&self) -> Option<Vec<DVec3>> {
        points(&self.bytes, self.encoding, self.len() / 3)
    }
}

/// A position in a file, with the parsing state.
#[derive(Debug)]
pub(super) struct Scanner<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    /// Offset of the word read last.
    word_at: usize,
    /// Whether arrays are binary; everything else is text in binary files too.
    pub(super) is_binary: bool,
    /// The section being read, for messages.
    pub(super) section: String,
}

impl<'a> Scanner<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self {
            path,
            bytes,
            at: 0,
            word_at: 0,
            is_binary: false,
            section: "header".to_owned(),
        }
    }

    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// The next word: bytes between white space, line ends included.
    pub(super) fn word(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace());
        let Some(start) = start else {
            self.at = self.bytes.len();
            self.word_at = self.at;
            return None;
        };
        let rest = &rest[start..];
        let len = rest.iter().position(u8::is_ascii_whitespace);
        let word = &rest[..len.unwrap_or(rest.len())];
        self.word_at = self.at + start;
        self.at = self.word_at + word.len();
        Some(word)
    }

    /// The next word; if there is none, an error with the expectation.
    pub(super) fn expect(&mut self, expected: &str) -> Result<&'a [u8]> {
        match self.word() {
            Some(word) => Ok(word),
            None => Err(self.cut_short(expected, "the end of the file")),
        }
    }

    /// The next word in upper case, without going past it.
    pub(super) fn peek(&mut self) -> Option<String> {
        let before = (self.at, self.word_at);
        let word = self.word().map(|w| quote(w).to_ascii_uppercase());
        (self.at, self.word_at) = before;
        word
    }

    /// The next word on this line in lower case; `None` if the line ends.
    pub(super) fn word_on_line(&mut self) -> Option<String> {
        let is_blank = |b: &u8| *b != b'\n' && b.is_ascii_whitespace();
        let next = self.bytes[self.at..].iter().find(|b| !is_blank(b));
        if next.is_none_or(|&b| b == b'\n') {
            return None;
        }
        self.word().map(|w| quote(w).to_ascii_lowercase())
    }

    /// Whether the next word is the last one of its line.
    pub(super) fn word_ends_line(&mut self) -> bool {
        let before = (self.at, self.word_at);
        let ends = self.word().is_some() && self.line().trim_ascii().is_empty();
        (self.at, self.word_at) = before;
        ends
    }

    /// The rest of this line.
    pub(super) fn line(&mut self) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|&b| b == b'\n');
        let line = &rest[..end.unwrap_or(rest.len())];
        self.word_at = self.at;
        self.at += end.map_or(rest.len(), |n| n + 1);
        line.strip_suffix(b"\r").unwrap_or(line)
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.bytes.len()
    }

    /// A count.
    pub(super) fn count(&mut self, what: &str) -> Result<usize> {
        self.parse(what)
    }

    /// A number that is text in binary files too.
    pub(super) fn parse<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.expect(what)?;
        let parsed = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        parsed.ok_or_else(|| self.fault(what, format!("`{}`", quote(word))))
    }

    /// Three such numbers.
    pub(super) fn parse3<T: std::str::FromStr>(&mut self, what: &str) -> Result<[T; 3]> {
        Ok([self.parse(what)?, self.parse(what)?, self.parse(what)?])
    }

    /// The name of an array, percent-encoded as VTK writes it.
    pub(super) fn name(&mut self) -> Result<String> {
        self.expect("a name").map(decode_percent)
    }

    /// The name of an array's type.
    pub(super) fn data_type(&mut self) -> Result<DataType> {
        let word = self.expect("a type")?;
        DataType::from_name(&quote(word).to_ascii_lowercase()).ok_or_else(|| {
            let types = "a type: bit, char, short, int, long (or unsigned_ these), float, double, \
                         vtkIdType, vtktypeint64, vtktypeuint64 or string";
            self.fault(types, format!("`{}`", quote(word)))
        })
    }

    /// The next `count` numbers.
    pub(super) fn array(&mut self, data_type: DataType, count: usize) -> Result<Block<'a>> {
        let scalar = match data_type {
            DataType::Number(scalar) => scalar,
            DataType::Id if self.is_binary => ScalarType::I32,
            DataType::Id => ScalarType::I64,
            DataType::Bit => ScalarType::U8,
            DataType::Text | DataType::Variant => {
                return Err(self.fault("numbers", "text"));
            }
        };
        let encoding = Encoding {
            scalar,
            big_endian: self.is_binary,
        };
        let bytes = match (self.is_binary, data_type) {
            (false, _) => Cow::Owned(self.text_array(scalar, count)?),
            (true, DataType::Bit) => {
                let packed = self.binary(count.div_ceil(8), 1)?;
                let bits = (0..count).map(|i| packed[i / 8] >> (7 - i % 8) & 1);
                Cow::Owned(bits.collect())
            }
            (true, _) => Cow::Borrowed(self.binary(count, scalar.size())?),
        };
        Ok(Block { bytes, encoding })
    }

    /// The next `count` numbers, for node numbers, sizes or kinds.
    pub(super) fn ids(&mut self, data_type: DataType, count: usize) -> Result<Vec<u32>> {
        const WHAT: &str = "a whole number from 0 to 4294967295";
        if self.is_binary {
            let block = self.array(data_type, count)?;
            return node_ids(&block.bytes, block.encoding).map_err(|i| {
                let size = block.encoding.scalar.size();
                let bytes = block.bytes.get(i * size..(i + 1) * size);
                let found = format!("the bytes {:02x?}", bytes.unwrap_or_default());
                self.fault(format!("{WHAT} as number {} of {count}", i + 1), found)
            });
        }
        let mut ids = Vec::new();
        self.numbers(count, WHAT, |word| {
            word.parse().map(|id| ids.push(id)).is_ok()
        })?;
        Ok(ids)
    }

    /// Skips `count` values that are not numbers.
    pub(super) fn skip_texts(&mut self, data_type: DataType, count: usize) -> Result<()> {
        if count == 0 {
            return Ok(());
        }
        self.line();
        for i in 0..count {
            let cut = |scan: &Self| {
                Err(scan.cut_short(format!("{count} texts"), format!("the end after {i}")))
            };
            if self.is_at_end() {
                return cut(self);
            }
            if !self.is_binary || data_type == DataType::Variant {
                self.line();
                continue;
            }
            // The first two bits encode the size of the length.
            let rest = &self.bytes[self.at..];
            let width = [8, 4, 2, 1][usize::from(rest[0] >> 6)];
            let length = rest.get(..width).and_then(|bytes| {
                let length = bytes.iter().fold(0, |n: u64, &b| n << 8 | u64::from(b));
                usize::try_from(length & u64::MAX >> (66 - 8 * width)).ok()
            });
            let end = length.and_then(|n| n.checked_add(width));
            match end.filter(|&end| end <= rest.len()) {
                Some(end) => self.at += end,
                None => return cut(self),
            }
        }
        Ok(())
    }

    /// Skips a `METADATA` block, which ends at an empty line, if there is one here.
    ///
    /// An array of that name has numbers after it, on its line.
    pub(super) fn skip_metadata(&mut self) -> bool {
        if self.peek().as_deref() != Some("METADATA") || !self.word_ends_line() {
            return false;
        }
        self.word();
        self.line();
        while !self.is_at_end() && !self.line().trim_ascii().is_empty() {}
        true
    }

    /// The bytes of `count` numbers, from the next line on.
    fn binary(&mut self, count: usize, size: usize) -> Result<&'a [u8]> {
        if count == 0 {
            return Ok(&[]);
        }
        self.line();
        self.word_at = self.at;
        let rest = &self.bytes[self.at..];
        let len = count.checked_mul(size).filter(|&n| n <= rest.len());
        let Some(len) = len else {
            let expected = format!("{count} numbers of {size} bytes");
            return Err(self.cut_short(expected, format!("{} bytes", rest.len())));
        };
        self.at += len;
        Ok(&rest[..len])
    }

    /// Passes the next `count` words to `take`, which returns whether they are numbers.
    fn numbers(
        &mut self,
        count: usize,
        what: &str,
        mut take: impl FnMut(&str) -> bool,
    ) -> Result<()> {
        // Each takes a separator and a digit: a count beyond that is refused at once.
        let left = self.bytes.len() - self.at;
        if count > left / 2 {
            return Err(self.cut_short(format!("{count} numbers"), format!("{left} bytes")));
        }
        for i in 0..count {
            let Some(word) = self.word() else {
                let found = format!("the end of the file after {i}");
                return Err(self.cut_short(format!("{count} numbers"), found));
            };
            if !std::str::from_utf8(word).is_ok_and(&mut take) {
                let expected = format!("{what} as number {} of {count}", i + 1);
                return Err(self.fault(expected, format!("`{}`", quote(word))));
            }
        }
        Ok(())
    }

    /// Parses numbers into little-endian bytes.
    fn text_array(&mut self, scalar: ScalarType, count: usize) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        macro_rules! take {
            ($t:ty) => {
                take!(|w: &str| w.parse::<$t>().ok())
            };
            ($parse:expr) => {
                |word| match $parse(word) {
                    Some(x) => {
                        bytes.extend(x.to_le_bytes());
                        true
                    }
                    None => false,
                }
            };
        }
        use ScalarType as S;
        match scalar {
            S::I8 => self.numbers(count, "a whole number from -128 to 127", take!(i8)),
            S::U8 => self.numbers(count, "a whole number from 0 to 255", take!(u8)),
            S::I16 => self.numbers(count, "a whole number of 16 bits", take!(i16)),
            S::U16 => self.numbers(count, "a positive number of 16 bits", take!(u16)),
            S::I32 => self.numbers(count, "a whole number of 32 bits", take!(i32)),
            S::U32 => self.numbers(count, "a positive number of 32 bits", take!(u32)),
            S::I64 => self.numbers(count, "a whole number of 64 bits", take!(i64)),
            S::U64 => self.numbers(count, "a positive number of 64 bits", take!(u64)),
            // No type of VTK's.
            S::F16 => return Err(self.fault("a type of VTK's", "half floats")),
            S::F32 => self.numbers(
                count,
                "a number",
                take!(|w: &str| w.parse::<f32>().ok().or_else(|| not_finite(w))),
            ),
            S::F64 => self.numbers(
                count,
                "a number",
                take!(|w: &str| w
                    .parse::<f64>()
                    .ok()
                    .or_else(|| not_finite(w).map(f64::from))),
            ),
        }?;
        Ok(bytes)
    }

    /// An error at the last word: `expected` was not found.
    pub(super) fn fault(&self, expected: impl Into<String>, found: impl Into<String>) -> Error {
        self.error(
            expected,
            found,
            "correct it, or write the file again (as VTK XML if you can)",
        )
    }

    /// An error at the last word: the file ends too early.
    pub(super) fn cut_short(&self, expected: impl Into<String>, found: impl Into<String>) -> Error {
        self.error(
            expected,
            found,
            "the file is cut short, or a count in it is wrong: copy or write it again",
        )
    }

    /// An error at the last word. Its place is the line; in binary files, where lines have no numbers, the
    /// byte.
    pub(super) fn error(
        &self,
        expected: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<Advice>,
    ) -> Error {
        let place = if self.is_binary {
            format!("{}, byte {}", self.section, self.word_at)
        } else {
            let before = &self.bytes[..self.word_at];
            let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
            format!("{}, line {line}", self.section)
        };
        Error::format(self.path, place, expected, found, advice)
    }
}

/// Not-a-number and infinity as the C library of Windows prints them: `1.#INF`, `-1.#IND`, `nan(ind)`.
fn not_finite(word: &str) -> Option<f32> {
    let word = word.to_ascii_lowercase();
    let (negative, digits) = match word.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, word.as_str()),
    };
    if digits.starts_with("1.#inf") {
        Some(if negative {
            f32::NEG_INFINITY
        } else {
            f32::INFINITY
        })
    } else if digits.starts_with("1.#") || digits.starts_with("nan(") {
        Some(f32::NAN)
    } else {
        None
    }
}

/// A word for messages and comparisons: as text, clipped to more than the length of any known word.
pub(super) fn quote(word: &[u8]) -> String {
    const LONGEST: usize = 40;
    String::from_utf8_lossy(&word[..word.len().min(LONGEST)]).into_owned()
}

/// Decodes `%20` and its like.
fn decode_percent(word: &[u8]) -> String {
    let mut decoded = Vec::with_capacity(word.len());
    let mut rest = word;
    while let [first, tail @ ..] = rest {
        let digits = tail.get(..2).filter(|_| *first == b'%');
        let byte = digits
            .filter(|d| d.iter().all(u8::is_ascii_hexdigit))
            .and_then(|d| u8::from_str_radix(std::str::from_utf8(d).ok()?, 16).ok());
        decoded.push(byte.unwrap_or(*first));
        rest = &tail[if byte.is_some() { 2 } else { 0 }..];
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_decoded_and_other_percent_signs_kept() {
        for (word, name) in [
            ("a%20b", "a b"),
            ("%c3%A4", "\u{e4}"),
            ("50%", "50%"),
            ("50%+5", "50%+5"),
            ("%%41", "%A"),
            ("100%zz%2", "100%zz%2"),
        ] {
            assert_eq!(decode_percent(word.as_bytes()), name);
        }
    }

    #[test]
    fn lengths_of_texts_have_four_widths() {
        for (prefix, length) in [
            (&[0xc0 | 3][..], 3),
            (&[0x80, 70], 70),
            (&[0x81, 0x00], 256),
            (&[0x40, 0, 0x40, 0x01], 0x4001),
            (&[0, 0, 0, 0, 0, 0, 0, 5], 5),
        ] {
            let bytes = [b" \n", prefix, &vec![b'\n'; length], b"END"].concat();
            let mut scan = Scanner::new(Path::new("t"), &bytes);
            scan.is_binary = true;
            scan.skip_texts(DataType::Text, 1).unwrap();
            assert_eq!(scan.word(), Some(&b"END"[..]), "{prefix:x?}");
            let mut cut = Scanner::new(Path::new("t"), &bytes[..prefix.len() + 1 + length]);
            cut.is_binary = true;
            assert!(cut.skip_texts(DataType::Text, 1).is_err(), "{prefix:x?}");
        }
        let mut huge = Scanner::new(Path::new("t"), b"\n\x3f\xff\xff\xff\xff\xff\xff\xff");
        huge.is_binary = true;
        assert!(huge.skip_texts(DataType::Text, usize::MAX).is_err());
    }

    #[test]
    fn what_is_no_number_is_read_in_every_spelling() {
        let text = b" nan -NaN inf -Infinity 1.#QNAN -1.#IND00 1.#INF -1.#INF nan(ind) 1e60 x";
        let mut scan = Scanner::new(Path::new("t"), text);
        let block = scan
            .array(DataType::Number(ScalarType::F32), 10)
            .unwrap()
            .component(0, 1)
            .unwrap();
        let printed: Vec<String> = (0..10).map(|i| block.get(i).to_string()).collect();
        let expected = "NaN NaN inf -inf NaN NaN inf -inf NaN inf";
        assert_eq!(printed.join(" "), expected);
        assert!(scan.array(DataType::Number(ScalarType::F32), 1).is_err());
    }

    #[test]
    fn a_claim_beyond_the_bytes_is_refused() {
        for is_binary in [false, true] {
            for count in [4, usize::MAX / 8, usize::MAX] {
                let mut scan = Scanner::new(Path::new("t"), b"\n1 2 3 ");
                scan.is_binary = is_binary;
                let number = DataType::Number(ScalarType::F64);
                assert!(scan.array(number, count).is_err());
            }
        }
    }
}
