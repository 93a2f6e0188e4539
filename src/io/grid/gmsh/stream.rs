//! Reads lines, words and numbers of a Gmsh file, from text or from binary numbers in either byte order.
//!
//! Names of sections, and the first lines of most, are text in both forms.

use std::path::Path;

use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;
use crate::io::vtk::xml::find;

pub(super) const DAMAGED: &str = "the file is damaged: save it again";

/// Unread rest of a file.
#[derive(Clone)]
pub(super) struct Stream<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: &'a [u8],
    pub(super) at: usize,
    /// Start of the line, the word or the number that was read last, for errors.
    last: usize,
    pub(super) is_text: bool,
    pub(super) big_endian: bool,
    /// Bytes of a count or a number of a node in binary files of version 4.
    pub(super) size_bytes: usize,
    /// Name of the section, for errors.
    pub(super) section: String,
}

impl<'a> Stream<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self {
            path,
            bytes,
            at: 0,
            last: 0,
            is_text: true,
            big_endian: false,
            size_bytes: 8,
            section: "file".to_owned(),
        }
    }

    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Returns the next line without spaces at its ends; `None` at the end of the file.
    pub(super) fn line(&mut self) -> Option<String> {
        let rest = self.rest();
        if rest.is_empty() {
            return None;
        }
        let end = rest.iter().position(|&b| b == b'\n');
        self.last = self.at;
        self.at += end.map_or(rest.len(), |end| end + 1);
        let line = &rest[..end.unwrap_or(rest.len())];
        Some(String::from_utf8_lossy(line).trim().to_owned())
    }

    /// Returns the next line that is not empty, of a section.
    pub(super) fn header(&mut self, expected: &str) -> Result<String> {
        loop {
            let line = self.line().ok_or_else(|| self.cut(expected))?;
            if !line.is_empty() {
                return Ok(line);
            }
        }
    }

    /// Returns the whole number in a line of its own.
    pub(super) fn header_count(&mut self, expected: &str) -> Result<i64> {
        let line = self.header(expected)?;
        line.parse().map_err(|_| self.fault(expected, &line))
    }

    /// Moves to the next section and returns its name without `$`.
    pub(super) fn next_section(&mut self) -> Option<String> {
        loop {
            let line = self.line()?;
            if let Some(name) = line.strip_prefix('$') {
                let name: String = name.chars().take(40).collect();
                self.section = format!("section `${name}`");
                return Some(name);
            }
        }
    }

    /// Moves behind the end of a section whose content is not read.
    pub(super) fn skip_section(&mut self, name: &str) -> Result<()> {
        let end = format!("$End{name}");
        let found = find(self.rest(), end.as_bytes());
        let found = found.ok_or_else(|| self.cut(&format!("`{end}`")))?;
        self.at += found + end.len();
        Ok(())
    }

    /// Moves behind the end of a section whose content has been read.
    pub(super) fn end_section(&mut self, name: &str) -> Result<()> {
        let line = self.header(&format!("`$End{name}`"))?;
        match line.strip_prefix("$End") == Some(name) {
            true => Ok(()),
            false => Err(self.fault(
                &format!("`$End{name}` after as many entries as it states"),
                &line,
            )),
        }
    }

    /// An integer: 32 bits in binary files.
    pub(super) fn int(&mut self, expected: &str) -> Result<i64> {
        if self.is_text {
            return self.parsed(expected);
        }
        let bytes = self.taken::<4>(expected)?;
        Ok(i64::from(match self.big_endian {
            true => i32::from_be_bytes(bytes),
            false => i32::from_le_bytes(bytes),
        }))
    }

    /// A count, or the number of a node or an element: as long as the header of version 4 says in binary files.
    pub(super) fn size(&mut self, expected: &str) -> Result<u64> {
        if self.is_text {
            return self.parsed(expected);
        }
        if self.size_bytes == 4 {
            let bytes = self.taken::<4>(expected)?;
            return Ok(u64::from(match self.big_endian {
                true => u32::from_be_bytes(bytes),
                false => u32::from_le_bytes(bytes),
            }));
        }
        let bytes = self.taken::<8>(expected)?;
        Ok(match self.big_endian {
            true => u64::from_be_bytes(bytes),
            false => u64::from_le_bytes(bytes),
        })
    }

    pub(super) fn double(&mut self, expected: &str) -> Result<f64> {
        if self.is_text {
            return self.parsed(expected);
        }
        let bytes = self.taken::<8>(expected)?;
        Ok(match self.big_endian {
            true => f64::from_be_bytes(bytes),
            false => f64::from_le_bytes(bytes),
        })
    }

    pub(super) fn point(&mut self) -> Result<glam::DVec3> {
        let mut axis = || self.double("the coordinates of a node");
        Ok(glam::DVec3::new(axis()?, axis()?, axis()?))
    }

    /// Reads over some integers.
    pub(super) fn skip_ints(&mut self, count: u64, expected: &str) -> Result<()> {
        (0..count).try_for_each(|_| self.int(expected).map(drop))
    }

    fn taken<const N: usize>(&mut self, expected: &str) -> Result<[u8; N]> {
        let bytes = self.rest().first_chunk::<N>().copied();
        let bytes = bytes.ok_or_else(|| self.cut(expected))?;
        self.last = self.at;
        self.at += N;
        Ok(bytes)
    }

    fn parsed<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T> {
        let rest = self.rest();
        let start = rest.iter().position(|b| !b.is_ascii_whitespace());
        let start = start.ok_or_else(|| self.cut(expected))?;
        let word = &rest[start..];
        let end = word.iter().position(u8::is_ascii_whitespace);
        let word = &word[..end.unwrap_or(word.len())];
        self.last = self.at + start;
        let number = std::str::from_utf8(word)
            .ok()
            .and_then(|word| word.parse().ok());
        let number = number.ok_or_else(|| self.fault(expected, &String::from_utf8_lossy(word)))?;
        self.at += start + word.len();
        Ok(number)
    }

    pub(super) fn fault(&self, expected: &str, found: &str) -> Error {
        let found = clip(found);
        let place = match self.is_text {
            true => {
                let before = &self.bytes[..self.last];
                let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
                format!("{}, line {line}", self.section)
            }
            false => format!("{}, byte {}", self.section, self.last),
        };
        Error::format(self.path, place, expected, format!("`{found}`"), DAMAGED)
    }

    fn cut(&self, expected: &str) -> Error {
        let found = "the end of the file";
        Error::format(self.path, self.section.clone(), expected, found, DAMAGED)
    }
}
