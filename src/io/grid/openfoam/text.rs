//! Parses one file of a case: its header, and the words and lists after it.

use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, doubles};

/// The greatest depth of blocks in skipped entries.
const DEEPEST: usize = 64;

/// A file of a case.
#[derive(Debug)]
pub(super) struct CaseFile {
    /// The path that errors report.
    pub(super) path: PathBuf,
    /// Name in the case: `0.5/U`.
    pub(super) name: String,
    pub(super) bytes: Vec<u8>,
}

/// The header of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) class: String,
    is_binary: bool,
    label: Encoding,
    scalar: Encoding,
}

/// A file, and the position in it.
#[derive(Debug)]
pub(super) struct Scanner<'a> {
    file: &'a CaseFile,
    pub(super) header: Header,
    at: usize,
}

/// Type of a list's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Whole numbers.
    Labels,
    /// Values of this many components, in brackets if there are several.
    Scalars(usize),
}

impl Kind {
    fn components(self) -> usize {
        match self {
            Self::Labels => 1,
            Self::Scalars(components) => components,
        }
    }
}

impl<'a> Scanner<'a> {
    /// Starts after the header.
    ///
    /// # Errors
    /// No header, or one with an unknown form of numbers.
    pub(super) fn new(file: &'a CaseFile) -> Result<Self> {
        let encoding = |scalar| Encoding {
            scalar,
            big_endian: false,
        };
        let mut scanner = Self {
            file,
            header: Header {
                class: String::new(),
                is_binary: false,
                label: encoding(ScalarType::I32),
                scalar: encoding(ScalarType::F64),
            },
            at: 0,
        };
        if scanner.word() != b"FoamFile" || scanner.word() != b"{" {
            return Err(scanner.fault("a header `FoamFile { ... }`"));
        }
        loop {
            let key = scanner.word();
            match key {
                b"}" => return Ok(scanner),
                b"" => return Err(scanner.fault("the end of the header, `}`")),
                _ => {}
            }
            let value = scanner.word();
            let text = String::from_utf8_lossy(value).into_owned();
            match key {
                b"class" => scanner.header.class = text,
                b"format" => scanner.header.is_binary = text == "binary",
                b"arch" => scanner.set_architecture(&text)?,
                _ => {}
            }
            if value != b";" && scanner.word() != b";" {
                return Err(scanner.fault("a `;` behind each entry of the header"));
            }
        }
    }

    /// Parses `LSB;label=32;scalar=64`.
    fn set_architecture(&mut self, text: &str) -> Result<()> {
        for part in text.split(';').map(str::trim) {
            match part {
                "MSB" => {
                    self.header.label.big_endian = true;
                    self.header.scalar.big_endian = true;
                }
                "label=32" => self.header.label.scalar = ScalarType::I32,
                "label=64" => self.header.label.scalar = ScalarType::I64,
                "scalar=32" => self.header.scalar.scalar = ScalarType::F32,
                "scalar=64" => self.header.scalar.scalar = ScalarType::F64,
                _ if part.starts_with("label=") || part.starts_with("scalar=") => {
                    return Err(self.fault("numbers of 32 or 64 bits in `arch`"));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// An error at the current position.
    pub(super) fn fault(&self, expected: &str) -> Error {
        let rest = self.rest();
        let found: String = String::from_utf8_lossy(&rest[..rest.len().min(60)])
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .take(40)
            .collect();
        let found = match found.trim() {
            "" => "nothing".to_owned(),
            some => format!("`{some}`"),
        };
        Error::format(
            &self.file.path,
            format!("{}, byte {}", self.file.name, self.at),
            expected,
            found,
            "the case is damaged: copy it again, or write it anew (foamFormatConvert)",
        )
    }

    fn rest(&self) -> &'a [u8] {
        self.file.bytes.get(self.at..).unwrap_or_default()
    }

    /// Skips white space and comments.
    fn skip_space(&mut self) {
        loop {
            let rest = self.rest();
            let space = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
            self.at += space;
            let rest = &rest[space..];
            let length = if rest.starts_with(b"//") {
                rest.iter().position(|&b| b == b'\n')
            } else if rest.starts_with(b"/*") {
                let end = rest[2..].windows(2).position(|end| end == b"*/");
                end.map(|end| end + 4)
            } else {
                return;
            };
            self.at += length.unwrap_or(rest.len());
        }
    }

    /// The next byte that is not white space.
    pub(super) fn peek(&mut self) -> Option<u8> {
        self.skip_space();
        self.rest().first().copied()
    }

    /// A bracket or semicolon, a quoted text, or all bytes until the next of these or white space; empty at the
    /// end.
    pub(super) fn word(&mut self) -> &'a [u8] {
        self.skip_space();
        let rest = self.rest();
        let is_mark = |b: &u8| b"(){}[];".contains(b);
        let (length, word) = match rest.first() {
            None => (0, rest),
            Some(b'"') => {
                let end = rest[1..].iter().position(|&b| b == b'"');
                let end = end.unwrap_or(rest.len() - 1);
                (end + 2, &rest[1..=end])
            }
            Some(mark) if is_mark(mark) => (1, &rest[..1]),
            Some(_) => {
                let end = rest
                    .iter()
                    .position(|b| is_mark(b) || b.is_ascii_whitespace() || *b == b'"');
                let end = end.unwrap_or(rest.len());
                (end, &rest[..end])
            }
        };
        self.at = (self.at + length).min(self.file.bytes.len());
        word
    }

    /// Skips the rest of an entry: to its `;`, or to the end of its block; for a directive, to the end of the
    /// line.
    pub(super) fn skip_entry(&mut self, key: &[u8]) -> Result<()> {
        if key.starts_with(b"#") {
            let rest = self.rest();
            let line = rest.iter().position(|&b| b == b'\n');
            self.at += line.unwrap_or(rest.len());
            return Ok(());
        }
        let mut depth = 0;
        loop {
            match self.word() {
                b"" => return Err(self.fault("the end of an entry")),
                b"{" | b"(" | b"[" => depth += 1,
                b"}" if depth <= 1 => return Ok(()),
                b"}" | b")" | b"]" if depth > 0 => depth -= 1,
                b";" if depth == 0 => return Ok(()),
                _ => {}
            }
            if depth > DEEPEST {
                return Err(self.fault("blocks that end"));
            }
        }
    }

    /// Skips one required byte.
    pub(super) fn expect(&mut self, mark: u8) -> Result<()> {
        if self.peek() == Some(mark) {
            self.at += 1;
            return Ok(());
        }
        Err(self.fault(&format!("`{}`", char::from(mark))))
    }

    fn parsed<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T> {
        self.skip_space();
        let before = self.at;
        let word = std::str::from_utf8(self.word()).ok();
        word.and_then(|word| word.parse().ok()).ok_or_else(|| {
            self.at = before;
            self.fault(expected)
        })
    }

    /// One number.
    pub(super) fn number(&mut self) -> Result<f64> {
        self.parsed("a number")
    }

    /// One value in text: a number, or several in brackets.
    pub(super) fn value(&mut self, components: usize, out: &mut Vec<f64>) -> Result<()> {
        if components == 1 {
            out.push(self.number()?);
            return Ok(());
        }
        self.expect(b'(')?;
        for _ in 0..components {
            out.push(self.number()?);
        }
        self.expect(b')')
    }

    /// The length of a list, which precedes it. A list is no longer than its bytes, unless it has a single
    /// value.
    pub(super) fn count(&mut self) -> Result<usize> {
        self.parsed("the length of a list")
    }

    /// A list of numbers, value after value, each with all its components.
    ///
    /// - `count`: required number of values; without it, any number.
    ///
    /// # Errors
    /// Another count; something other than numbers; fewer than the list states.
    pub(super) fn list(&mut self, kind: Kind, count: Option<usize>) -> Result<Vec<f64>> {
        let components = kind.components();
        let stated = self.count()?;
        if let Some(count) = count
            && stated != count
        {
            return Err(self.fault(&format!("a list of {count} values, not {stated}")));
        }
        match self.peek() {
            // All values are equal.
            Some(b'{') if count.is_some() => {
                self.at += 1;
                let mut value = Vec::new();
                self.value(components, &mut value)?;
                self.expect(b'}')?;
                return Ok(value.repeat(stated));
            }
            Some(b'(') => {}
            _ if stated == 0 => return Ok(Vec::new()),
            _ => return Err(self.fault("a list in brackets")),
        }
        self.at += 1;
        if self.header.is_binary && stated > 0 {
            return self.binary(kind, stated);
        }
        let least = stated.checked_mul(2 * components);
        if least.is_none_or(|least| least > self.rest().len() + 1) {
            return Err(self.fault(&format!("{stated} values")));
        }
        let mut numbers = Vec::with_capacity(stated * components);
        for _ in 0..stated {
            self.value(components, &mut numbers)?;
        }
        self.expect(b')')?;
        Ok(numbers)
    }

    fn binary(&mut self, kind: Kind, count: usize) -> Result<Vec<f64>> {
        let encoding = match kind {
            Kind::Labels => self.header.label,
            Kind::Scalars(_) => self.header.scalar,
        };
        let size = encoding.scalar.size();
        let number_count = count.checked_mul(kind.components());
        let numbers = number_count.and_then(|count| {
            let stride = Stride {
                first: 0,
                step: size,
                count,
            };
            doubles(self.rest(), encoding, stride)
        });
        let numbers = numbers.ok_or_else(|| {
            let bits = 8 * size;
            self.fault(&format!("{count} values, in numbers of {bits} bits"))
        })?;
        self.at += numbers.len() * size;
        self.expect(b')')?;
        Ok(numbers)
    }

    /// A list of labels from -1 on, -1 as `u32::MAX`.
    ///
    /// # Errors
    /// As [`Scanner::list`], and labels beyond 32 bits.
    pub(super) fn labels(&mut self, count: Option<usize>) -> Result<Vec<u32>> {
        let numbers = self.list(Kind::Labels, count)?;
        let labels: Option<Vec<u32>> = numbers.into_iter().map(label).collect();
        labels.ok_or_else(|| self.fault("whole numbers from -1 to 4294967294 before this"))
    }
}

/// A label of a list; -1, which means none, as `u32::MAX`.
fn label(number: f64) -> Option<u32> {
    if number == -1.0 {
        return Some(u32::MAX);
    }
    let is_label = number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&number);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number in the type's range"
    )]
    is_label.then_some(number as u32)
}
