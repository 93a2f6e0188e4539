//! Reads words and numbers of a geometry or a variable, from text or one of the two binary forms.
//!
//! | form | how it is known | a line | numbers |
//! |---|---|---|---|
//! | text | neither of these | a line | words |
//! | C binary | `C Binary` in the first 80 bytes | 80 bytes | of 32 bits |
//! | Fortran binary | a record of 80 bytes that says so | the same, in records | the same: each record has its length in 32 bits before and behind it |
//!
//! Only geometry files state their form; variable files have the same form. The byte order is the one in which the
//! record marks or the number of the first part are plausible.

use std::path::Path;

use crate::error::{Error, Result};
use crate::io::bytes::records::{MARK, record, word};

pub(super) const DAMAGED: &str = "the file is damaged: save it again";

/// Length in bytes of a line in binary files.
const LINE: usize = 80;

/// Greatest plausible part number; it decides the byte order.
const MOST_PARTS: u32 = 1 << 16;

/// Encoding of the files.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    Text,
    C,
    Fortran,
}

impl Form {
    /// Returns the form of a geometry file.
    pub(super) fn of(bytes: &[u8]) -> Self {
        let has = |at: usize, name: &str| {
            let start = bytes.get(at..at + name.len());
            start.is_some_and(|s| s.eq_ignore_ascii_case(name.as_bytes()))
        };
        if has(0, "C Binary") {
            Self::C
        } else if has(4, "Fortran Binary") {
            Self::Fortran
        } else {
            Self::Text
        }
    }
}

/// Unread rest of a file.
pub(super) struct Stream<'a> {
    path: &'a Path,
    form: Form,
    bytes: Vec<u8>,
    at: usize,
    big_endian: Option<bool>,
}

impl<'a> Stream<'a> {
    /// - `step`: index of the section to read, if the file has several between `BEGIN TIME STEP` and `END TIME STEP`.
    pub(super) fn new(path: &'a Path, bytes: Vec<u8>, form: Form, step: usize) -> Result<Self> {
        let (bytes, big_endian) = match form {
            Form::Fortran => {
                let (bytes, big_endian) = records(path, &bytes)?;
                (bytes, Some(big_endian))
            }
            Form::Text | Form::C => (bytes, None),
        };
        let mut stream = Self {
            path,
            form,
            bytes,
            at: 0,
            big_endian,
        };
        const BEGIN: &[u8] = b"BEGIN TIME STEP";
        let mut begins = stream
            .bytes
            .windows(BEGIN.len())
            .enumerate()
            .filter(|(_, window)| *window == BEGIN)
            .map(|(at, _)| at)
            .peekable();
        if begins.peek().is_some() {
            let at = begins.nth(step);
            stream.at = at.ok_or_else(|| {
                let expected = format!("more than {step} time steps in the file");
                Error::format(path, "BEGIN TIME STEP", expected, "fewer", DAMAGED)
            })?;
            stream.line()?;
        }
        Ok(stream)
    }

    /// Reads the next line, without its padding.
    pub(super) fn line(&mut self) -> Result<String> {
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let (line, len) = match self.form {
            Form::Text => {
                let end = rest.iter().position(|&b| b == b'\n');
                let len = end.map_or(rest.len(), |end| end + 1);
                (&rest[..len], len)
            }
            Form::C | Form::Fortran => {
                let len = LINE.min(rest.len());
                (&rest[..len], len)
            }
        };
        if len == 0 {
            return Err(self.cut_short("a line"));
        }
        let text = line.split(|b| *b == 0).next().unwrap_or(&[]);
        let text = String::from_utf8_lossy(text).trim().to_owned();
        self.at += len;
        Ok(text)
    }

    /// Returns the next line that is not empty, without consuming it; `None` at the end of the step.
    pub(super) fn peek(&mut self) -> Option<String> {
        loop {
            let at = self.at;
            let line = self.line().ok()?;
            // The index of the steps follows the last step.
            if line.starts_with("END TIME STEP") || line.starts_with("FILE_INDEX") {
                self.at = at;
                return None;
            }
            if !line.is_empty() {
                self.at = at;
                return Some(line);
            }
            if self.form != Form::Text {
                return None;
            }
        }
    }

    /// Reads the next line that is not empty, if there is one.
    pub(super) fn keyword(&mut self) -> Option<String> {
        self.peek()?;
        self.line().ok()
    }

    pub(super) fn integer(&mut self) -> Result<i32> {
        Ok(self.integers(1)?.first().copied().unwrap_or(0))
    }

    /// Reads `count` whole numbers.
    pub(super) fn integers(&mut self, count: usize) -> Result<Vec<i32>> {
        if self.form == Form::Text {
            return self.parsed(count, |word| word.parse().ok());
        }
        let bytes = self.take(count)?;
        if self.big_endian.is_none() {
            let first: [u8; 4] = bytes
                .get(..4)
                .and_then(|b| b.try_into().ok())
                .unwrap_or([0; 4]);
            self.big_endian = Some(u32::from_le_bytes(first) > MOST_PARTS);
        }
        let big_endian = self.big_endian == Some(true);
        let number = |b: &[u8]| {
            let b = [b[0], b[1], b[2], b[3]];
            if big_endian {
                i32::from_be_bytes(b)
            } else {
                i32::from_le_bytes(b)
            }
        };
        Ok(bytes.chunks_exact(4).map(number).collect())
    }

    /// Reads a number that must not be negative.
    pub(super) fn count(&mut self) -> Result<usize> {
        let number = self.integer()?;
        usize::try_from(number).map_err(|_| self.fault("a count", number.to_string()))
    }

    /// Reads `count` real numbers.
    pub(super) fn reals(&mut self, count: usize) -> Result<Vec<f32>> {
        if self.form == Form::Text {
            return self.parsed(count, real);
        }
        let bytes = self.take(count)?;
        let big_endian = self.big_endian == Some(true);
        let number = |b: &[u8]| {
            let b = [b[0], b[1], b[2], b[3]];
            if big_endian {
                f32::from_be_bytes(b)
            } else {
                f32::from_le_bytes(b)
            }
        };
        Ok(bytes.chunks_exact(4).map(number).collect())
    }

    /// Reads the bytes of `count` 32-bit numbers.
    fn take(&mut self, count: usize) -> Result<Vec<u8>> {
        let end = count
            .checked_mul(4)
            .and_then(|len| self.at.checked_add(len));
        let bytes = end.and_then(|end| self.bytes.get(self.at..end));
        match (bytes, end) {
            (Some(bytes), Some(end)) => {
                let bytes = bytes.to_vec();
                self.at = end;
                Ok(bytes)
            }
            _ => Err(self.cut_short(&format!("{count} numbers"))),
        }
    }

    fn parsed<T>(&mut self, count: usize, parse: impl Fn(&str) -> Option<T>) -> Result<Vec<T>> {
        // A number and a separator take at least two bytes.
        if count / 2 > self.bytes.len() - self.at {
            return Err(self.cut_short(&format!("{count} numbers")));
        }
        let mut numbers = Vec::new();
        while numbers.len() < count {
            let rest = &self.bytes[self.at..];
            let Some(start) = rest.iter().position(|b| !b.is_ascii_whitespace()) else {
                return Err(self.cut_short(&format!("{count} numbers")));
            };
            let word = &rest[start..];
            let end = word.iter().position(u8::is_ascii_whitespace);
            let word = &word[..end.unwrap_or(word.len())];
            let text = String::from_utf8_lossy(word);
            let Some(number) = parse(&text) else {
                let found = format!("`{}`", text.chars().take(40).collect::<String>());
                return Err(self.fault("a number", found));
            };
            let passed = start + word.len();
            numbers.push(number);
            self.at += passed;
        }
        // Skips the rest of the line if it is blank.
        let rest = &self.bytes[self.at..];
        let blank = rest
            .iter()
            .take_while(|b| matches!(b, b' ' | b'\t' | b'\r'))
            .count();
        if rest.get(blank) == Some(&b'\n') {
            self.at += blank + 1;
        }
        Ok(numbers)
    }

    pub(super) fn fault(&self, expected: impl Into<String>, found: impl Into<String>) -> Error {
        let place = format!("byte {}", self.at);
        Error::format(self.path, place, expected, found, DAMAGED)
    }

    fn cut_short(&self, expected: &str) -> Error {
        self.fault(expected, "the end of the file")
    }
}

/// Parses a number as C or Fortran writes it: `1.5`, `1.5D0`, `1.5+003`.
fn real(word: &str) -> Option<f32> {
    if let Ok(number) = word.parse() {
        return Some(number);
    }
    let word = word.replace(['d', 'D'], "e");
    if let Ok(number) = word.parse() {
        return Some(number);
    }
    let sign = word.rfind(['+', '-']).filter(|at| *at > 0)?;
    let (digits, exponent) = word.split_at(sign);
    format!("{digits}e{exponent}").parse().ok()
}

/// Returns the contents of the records, and true if their marks are big-endian.
fn records(path: &Path, bytes: &[u8]) -> Result<(Vec<u8>, bool)> {
    let big_endian = word(bytes, 0, true) == u32::try_from(LINE).ok();
    let mut held = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let record = record(bytes, at, big_endian).map_err(|_| {
            let expected = "a record with its length before and behind it";
            Error::format(path, format!("byte {at}"), expected, "none", DAMAGED)
        })?;
        at = record.end + MARK;
        held.extend_from_slice(&bytes[record]);
    }
    Ok((held, big_endian))
}
