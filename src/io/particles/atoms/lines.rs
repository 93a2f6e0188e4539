//! Reads a file line by line.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::vtk::xml::clip;

/// Greatest length of a line in bytes, far more than any program writes.
const LONGEST: u64 = 1 << 20;

/// Bytes that are read at a time.
const BUFFER: usize = 1 << 17;

pub(super) const DAMAGED: &str = "the file is damaged or was cut off: write or copy it again";

/// A file, read line by line.
pub(super) struct Lines<'a> {
    pub(super) path: &'a Path,
    reader: BufReader<Box<dyn Read + 'a>>,
    line: Vec<u8>,
    /// Number of the current line, counted from 1.
    number: u64,
    /// True once the end of the file was reached, perhaps in the middle of the current line.
    pub(super) has_ended: bool,
}

impl<'a> Lines<'a> {
    pub(super) fn open(input: Input<'a>) -> Result<Self> {
        let (reader, len) = input.open()?;
        let reader: Box<dyn Read + 'a> = Box::new(reader.take(len));
        Ok(Self {
            path: input.path,
            reader: BufReader::with_capacity(BUFFER, reader),
            line: Vec::new(),
            number: 0,
            has_ended: false,
        })
    }

    /// Reads the next line; returns false at the end of the file.
    pub(super) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        let read = (&mut self.reader)
            .take(LONGEST)
            .read_until(b'\n', &mut self.line)
            .map_err(|e| Error::io(self.path, "reading", e, "check the disk"))?;
        if read == 0 {
            self.has_ended = true;
            return Ok(false);
        }
        self.number += 1;
        if self.line.last() != Some(&b'\n') {
            if read as u64 == LONGEST {
                return Err(self.fault(
                    &format!("a line of less than {LONGEST} bytes"),
                    "a longer one",
                ));
            }
            self.has_ended = true;
        }
        while matches!(self.line.last(), Some(b'\n' | b'\r')) {
            self.line.pop();
        }
        Ok(true)
    }

    /// Reads the next line that is not blank; returns false at the end of the file.
    pub(super) fn advance_to_text(&mut self) -> Result<bool> {
        while self.advance()? {
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Reads the next line, which must exist.
    ///
    /// - `expected`: contents of the line, for the message.
    pub(super) fn need(&mut self, expected: &str) -> Result<()> {
        match self.advance()? {
            true => Ok(()),
            false => Err(self.ends(expected)),
        }
    }

    /// Reads a line with one number.
    pub(super) fn number<T: FromStr>(&mut self, expected: &str) -> Result<T> {
        self.need(expected)?;
        let number = self.text().trim().parse();
        number.map_err(|_| self.fault(expected, &self.shown()))
    }

    /// Bytes of the current line, without its end.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.line
    }

    /// The current line, without its end.
    pub(super) fn text(&self) -> Cow<'_, str> {
        let text = String::from_utf8_lossy(&self.line);
        match (self.number, text) {
            (1, text) if text.starts_with('\u{feff}') => {
                Cow::Owned(text.trim_start_matches('\u{feff}').to_owned())
            }
            (_, text) => text,
        }
    }

    /// The current line's numbers; `None` if one of its words is not a number.
    pub(super) fn numbers(&self) -> Option<Vec<f64>> {
        let text = self.text();
        text.split_whitespace().map(|w| w.parse().ok()).collect()
    }

    /// The current line for messages.
    pub(super) fn shown(&self) -> String {
        format!("`{}`", clip(&self.text()))
    }

    /// Returns an error of the current line.
    pub(super) fn fault(&self, expected: &str, found: &str) -> Error {
        self.fault_at("", expected, found)
    }

    /// Returns an error of a place in the current line.
    ///
    /// - `place`: `", column `x`"`, or nothing.
    pub(super) fn fault_at(&self, place: &str, expected: &str, found: &str) -> Error {
        let place = format!("line {}{place}", self.number);
        let advice = match self.has_ended {
            true => DAMAGED,
            false => "correct the line",
        };
        Error::format(self.path, place, expected, found, advice)
    }

    /// Returns the error for a file that ends too early.
    pub(super) fn ends(&self, expected: &str) -> Error {
        let place = format!("line {}", self.number + 1);
        Error::format(self.path, place, expected, "the end of the file", DAMAGED)
    }
}
