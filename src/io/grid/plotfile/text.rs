//! Parses the text of plotfiles: words, numbers and boxes `((0,0,0) (7,7,7) (0,0,0))`.

use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

pub(super) const DAMAGED: &str = "the plotfile is damaged: copy it again";

/// The cells of a box: the first and the last along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Box3 {
    pub(super) first: [i64; 3],
    pub(super) last: [i64; 3],
}

impl Box3 {
    /// Number of cells along each axis; 0 along the third axis of data of two dimensions.
    pub(super) fn cells(&self, dimensions: usize) -> [usize; 3] {
        [0, 1, 2].map(|axis| match axis < dimensions {
            true => usize::try_from(self.last[axis] - self.first[axis] + 1).unwrap_or(0),
            false => 0,
        })
    }
}

/// A text, read word by word; in boxes `(`, `)` and `,` are separators, too.
pub(super) struct Tokens<'a> {
    path: &'a Path,
    rest: &'a str,
}

impl<'a> Tokens<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self> {
        let rest = std::str::from_utf8(bytes)
            .map_err(|_| fault(path, "text", "text", "other bytes".into()))?;
        Ok(Self { path, rest })
    }

    pub(super) fn fault(&self, place: &str, expected: &str, found: String) -> Error {
        fault(self.path, place, expected, found)
    }

    /// The rest of the line.
    pub(super) fn line(&mut self) -> &'a str {
        let (line, rest) = self.rest.split_once('\n').unwrap_or((self.rest, ""));
        self.rest = rest;
        line
    }

    fn next(&mut self, between: impl Fn(char) -> bool + Copy) -> Option<&'a str> {
        let start = self.rest.trim_start_matches(between);
        let end = start.find(between).unwrap_or(start.len());
        let (word, rest) = start.split_at(end);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    pub(super) fn word(&mut self, place: &str) -> Result<&'a str> {
        let word = self.next(char::is_whitespace);
        word.ok_or_else(|| self.fault(place, "a word", "the end of the file".into()))
    }

    pub(super) fn expect(&mut self, word: &str) -> Result<()> {
        let found = self.word(word)?;
        match found == word {
            true => Ok(()),
            false => Err(self.fault(word, "this word", format!("`{}`", clip(found)))),
        }
    }

    pub(super) fn number<T: FromStr>(&mut self, place: &str) -> Result<T> {
        let word = self.word(place)?;
        word.parse()
            .map_err(|_| self.fault(place, "a number", format!("`{}`", clip(word))))
    }

    /// A whole number of a box.
    fn index(&mut self) -> Result<i64> {
        let between = |c: char| c.is_whitespace() || matches!(c, '(' | ')' | ',');
        let word = self.next(between).unwrap_or("");
        let index = word.parse().ok().filter(|n: &i64| n.abs() < 1 << 40);
        index.ok_or_else(|| {
            let expected = "whole numbers such as ((0,0,0) (7,7,7) (0,0,0))";
            self.fault("a box", expected, format!("`{}`", clip(word)))
        })
    }

    /// A box of cells, not of nodes.
    pub(super) fn box3(&mut self, dimensions: usize) -> Result<Box3> {
        let mut ends = [[0; 3]; 3];
        for end in &mut ends {
            for index in &mut end[..dimensions] {
                *index = self.index()?;
            }
        }
        self.rest = self.rest.trim_start_matches(')');
        let [first, last, kind] = ends;
        let is_sound = (0..3).all(|axis| first[axis] <= last[axis] && kind[axis] == 0);
        match is_sound {
            true => Ok(Box3 { first, last }),
            false => {
                let expected = "a box of cells";
                Err(self.fault("a box", expected, format!("{ends:?}")))
            }
        }
    }

    /// Skips the widths of ghost layers, which each box's own extent includes.
    pub(super) fn skip_ghosts(&mut self) {
        let text = self.rest.trim_start();
        let end = match text.starts_with('(') {
            true => text.find(')').map_or(text.len(), |at| at + 1),
            false => text.find(char::is_whitespace).unwrap_or(text.len()),
        };
        self.rest = &text[end..];
    }

    /// A list of boxes: `(2 0`, the boxes, `)`.
    pub(super) fn boxes(&mut self, dimensions: usize) -> Result<Vec<Box3>> {
        let count = self.index()?;
        self.index()?;
        let mut boxes = Vec::new();
        for _ in 0..count {
            boxes.push(self.box3(dimensions)?);
        }
        self.rest = self.rest.trim_start().trim_start_matches(')');
        Ok(boxes)
    }
}

/// The error for a damaged file of the plotfile.
pub(super) fn fault(path: &Path, place: &str, expected: &str, found: String) -> Error {
    Error::format(path, place, expected, found, DAMAGED)
}
